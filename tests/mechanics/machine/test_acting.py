"""Inputs as they act: torques of motors, recorded beside what the law asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from open_loop import held

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.requirements.judging import judge_run, unfailing
from grosmc_mj.mechanics.machine import Motor
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.acting import with_acting
from grosmc_mj.simulation.disturbances import InputDisturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory, load_trajectory
from grosmc_mj.studies.sweep.runs import Row, run_rows

MODEL = """
<mujoco model="hinge">
  <option timestep="0.001" gravity="0 0 0"/>
  <worldbody>
    <body name="disk">
      <joint name="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
    </body>
  </worldbody>
  <actuator><motor name="voltage" joint="hinge" ctrllimited="true" ctrlrange="-40 40"/></actuator>
</mujoco>
"""
LAW = "def full(t, x, memory, p):\n    return 40.0\n"
CONSTANT = 0.1
RESISTANCE = 2.0
WARM = {"thermal_resistance": "2 K/W", "heat_capacity": "0.3 J/K"}


def disk(
    folder: Path,
    damping: float = 1.0,
    duration: str = "1 s",
    requirements: Any = (),
    **motor: Any,
) -> Experiment:
    """A disk on a motor, with all that its voltage gives."""
    (folder / "hinge.xml").write_text(MODEL)
    (folder / "laws.py").write_text(LAW)
    common = {"input": "voltage", "constant": "0.1 N m/A", "resistance": "2 ohm", "voltage": "24 V"}
    return cases.case(
        "hinge.xml",
        folder=folder,
        law="laws:full",
        run={"duration": duration, "control_period": "10 ms", "engine": "python"},
        task={"reference": ["0"], "Q": [1, 1], "R": 1},
        edit={"joint": "hinge", "damping": damping},
        motor={**common, **motor},
        requirement=list(requirements),
    )


def trajectory_of(experiment: Experiment) -> tuple[Trajectory, Any]:
    """The run, and the torque that acted."""
    trajectory = experiment.run("physics", "full").trajectory
    assert trajectory.acting is not None
    return trajectory, trajectory.acting


@pytest.mark.parametrize("motor", [WARM, {**WARM, "ratio": 3}, {"ratio": -3}])
def test_at_a_constant_speed_the_torque_is_that_of_the_damping(
    tmp_path: Path, motor: dict[str, Any]
) -> None:
    """A winding of a time constant of 0.6 s has warmed up by then; what is asked for stays."""
    trajectory, acting = trajectory_of(disk(tmp_path, duration="5 s", **motor))
    assert acting[-1] == pytest.approx(1.0 * trajectory.state[-2, 1], rel=2e-3)
    assert acting[-1] < 0.96 * trajectory.input[-1]
    assert trajectory.input[0] == trajectory.input[-1]
    assert np.all(trajectory.command == 40.0)


@pytest.mark.parametrize("ratio", [1.0, -5.0])
def test_a_voltage_gives_its_torque_less_the_back_emf(tmp_path: Path, ratio: float) -> None:
    """torque = n K (V - n K w) / R, with n K V / R = the demanded torque."""
    trajectory, acting = trajectory_of(disk(tmp_path, damping=0.05, ratio=ratio))
    speed = trajectory.state[:-1, 1]
    expected = trajectory.input - (ratio * CONSTANT) ** 2 / RESISTANCE * speed
    np.testing.assert_allclose(acting, expected, rtol=1e-9, atol=1e-12)
    assert acting[0] == pytest.approx(trajectory.input[0], rel=1e-12)


def test_a_disturbance_of_an_input_is_a_part_of_what_acts(tmp_path: Path) -> None:
    push = InputDisturbance("voltage", -0.3)
    experiment = disk(tmp_path, duration="50 ms").changed(disturbances=(push,))
    trajectory, acting = trajectory_of(experiment)
    emf = CONSTANT**2 / RESISTANCE * trajectory.state[:-1, 1]
    np.testing.assert_allclose(acting, trajectory.input - 0.3 - emf, rtol=1e-9, atol=1e-12)


def test_an_input_without_a_motor_acts_as_it_is() -> None:
    motor = Motor("elbow_torque", CONSTANT, RESISTANCE)
    plant = MujocoPlant.load("two_link_arm", edits=(motor,))
    run = simulate(plant, held((1.0, -0.5)), [0.0] * 4, duration=0.05)
    acting: Any = with_acting(run, plant).acting
    np.testing.assert_array_equal(acting[:, 0], 1.0)
    emf = CONSTANT**2 / RESISTANCE * run.state[:-1, 3]
    np.testing.assert_allclose(acting[:, 1], -0.5 - emf, rtol=1e-9)


def test_a_winding_gives_its_current_times_the_constant(tmp_path: Path) -> None:
    numbers = {"inductance": "20 mH", "ratio": 2, "efficiency": 0.8}
    trajectory, acting = trajectory_of(disk(tmp_path, **numbers))
    (winding,) = [state for state in trajectory.unseen if state.kind == "winding"]
    assert trajectory.physics is not None
    # MuJoCo's force in a timestep is that of the current at its end.
    current = winding.of(trajectory.physics)[1:]
    np.testing.assert_allclose(acting, 0.8 * CONSTANT * 2 * current, rtol=1e-9, atol=1e-12)


def test_limits_are_judged_on_what_acts(tmp_path: Path) -> None:
    """A disk that is turned fast is braked with more than the torque at rest."""
    limits = [{"input_below": "0.5 N m"}, {"always": "abs(voltage) < 0.5 N m"}]
    experiment = disk(tmp_path, requirements=limits).changed(x0=(0.0, -500.0))
    result = experiment.run("physics", "full")
    assert result.trajectory.acting is not None
    largest = np.abs(result.trajectory.acting).max()
    assert largest > 2 * np.abs(result.trajectory.input).max()
    assert [judge_run(limit, result).measured for limit in experiment.limits] == [largest] * 2
    assert unfailing(experiment.limits, [result]) == []

    outcomes = run_rows(experiment, [Row("full", case=experiment)], plant="physics")
    margins = [outcomes[f"margin {limit.name}"][0] for limit in outcomes.limits]
    assert margins == [0.5 - largest] * 2


@pytest.mark.parametrize(
    ("motor", "can_fail"),
    [
        ({}, True),
        ({"current": "12 A"}, False),
        ({"bandwidth": "500 rad/s"}, False),
        ({"current": "12 A", "cogging": "1 mN m"}, True),
    ],
)
def test_a_limit_that_no_motor_exceeds_cannot_fail(
    tmp_path: Path, motor: dict[str, Any], can_fail: bool
) -> None:
    limits = [{"input_below": "40 N m"}]
    experiment = disk(tmp_path, duration="0.02 s", requirements=limits, **motor)
    result = experiment.run("physics", "full")
    assert (unfailing(experiment.limits, [result]) == []) is can_fail


def test_a_current_that_lags_gives_no_more_than_is_asked_of_it() -> None:
    """RK4 exceeds the actuator's 3.3 N m by rounding, 1e-8 N m, which is no failure of a law."""
    quick = {"laws.lqr.Q[1]": 1e6, "laws.lqr.Q[2]": 1.5e4}
    experiment = Experiment.load("arm/machine").changed(quick, laws=["lqr"], duration=0.1)
    result = experiment.run("physics", "lqr")
    acting = result.trajectory.acting
    assert acting is not None
    assert 3.3 < np.abs(acting).max() < 3.3 + 1e-7
    (limit,) = [limit for limit in experiment.limits if limit.key == "input_below"]
    assert judge_run(limit, result).measured == 3.3


def test_a_table_has_names_of_what_acts_and_what_is_asked_for(tmp_path: Path) -> None:
    result = disk(tmp_path, duration="20 ms").run("physics", "full")
    header = result.save(tmp_path / "run.csv").read_text().splitlines()[0]
    for name in ("voltage [N m]", "voltage given [N m]", "voltage asked [N m]"):
        assert f'"{name}"' in header
    restored = load_trajectory(result.save(tmp_path / "run.parquet"))
    assert restored.acting is not None
    assert result.trajectory.acting is not None
    np.testing.assert_array_equal(restored.acting, result.trajectory.acting)
    np.testing.assert_array_equal(restored.input, result.trajectory.input)


def test_without_a_motor_the_input_is_what_acts() -> None:
    experiment = Experiment.load("servo/nominal").changed(duration=0.01)
    trajectory = experiment.run("physics", "lqr").trajectory
    assert trajectory.acting is None
    assert trajectory.applied is trajectory.input
