"""Robots whose MJCF has lags, delays and DC motors: on the true plant, and in no law."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import Setpoint, setpoints
from grosmc_mj.errors import ModelError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.physics.edits import AddedMass
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

ONE = """<mujoco model="one"><option timestep="0.001" integrator="RK4"/>
<worldbody><body name="link"><joint name="hinge" axis="0 1 0" damping="0.1"{}/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""
IDEAL = '<motor name="drive" joint="hinge" gear="2" ctrlrange="-10 10"/>'
LAG = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gainprm="4" gear="-2" '
    'ctrlrange="-3 5"/>'
)
DELAY = '<motor name="drive" joint="hinge" gear="2" ctrlrange="-10 10" delay="0.012" nsample="15"/>'
DCMOTOR = (
    '<dcmotor name="drive" joint="hinge" motorconst="0.05" resistance="2" inductance="0.01" '
    'gear="50" ctrlrange="-24 24"/>'
)
ALL = {"lag": LAG, "delay": DELAY, "DC motor": DCMOTOR}


@cache
def robot(actuator: str, joint: str = "", integrator: Any = None) -> Robot:
    return Robot.from_mjcf(ONE.format(joint, actuator), integrator=integrator)


def law_of(made: Robot) -> Controller:
    return tracking_grosmc(
        made.task(setpoints(2), Setpoint(0.3), np.diag([100.0, 0.0]), 1.0), 10, 5
    )


def torques(plant: MujocoPlant, u: float, steps: int, q: float = 0.0, v: float = 0.0) -> Array:
    """Torque of the drive at the hinge, held at a place and speed, after each step."""
    model, rows = plant.model, []
    data = mujoco.MjData(model)
    data.ctrl[0] = u
    for _ in range(steps):
        data.qpos[0], data.qvel[0] = q, v
        mujoco.mj_step(model, data)
        rows.append(data.qfrc_actuator[0])
    return np.array(rows)


# --- what is built ---


@pytest.mark.parametrize("actuator", ALL.values(), ids=list(ALL))
@pytest.mark.parametrize("u", [0.7, -2.5])
def test_what_is_asked_for_is_in_the_end_the_torque_at_rest(actuator: str, u: float) -> None:
    made = robot(actuator)
    # A heavy link does not move in a step, so that no back-EMF is left.
    heavy = (AddedMass("link", 1e9, (0.0, 0.0, 0.5)),)
    assert torques(made.plant.edited(*heavy), u, 1)[0] == pytest.approx(u, rel=1e-12)
    found = torques(made.built.edited(*heavy), u, 400)
    assert abs(found[0]) < 0.5 * abs(u)
    assert found[-1] == pytest.approx(u, rel=1e-6)


def test_a_lag_a_delay_and_a_winding_are_those_of_the_model() -> None:
    """RK4 moves an exact lag nearly so, and asks for a delayed input within a step, too."""
    heavy = (AddedMass("link", 1e9, (0.0, 0.0, 0.5)),)
    for actuator, constant in ((LAG, 0.02), (DCMOTOR, 0.01 / 2)):
        built = robot(actuator, integrator="implicitfast").built
        left = 1 - torques(built.edited(*heavy), 1.0, 20)
        np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-1e-3 / constant), rtol=1e-6)
    delay = torques(robot(DELAY, integrator="implicitfast").built, 1.0, 20)
    assert delay.tolist() == [0.0] * 12 + [1.0] * 8


def test_the_back_emf_is_that_of_the_model() -> None:
    """Held at a speed it brakes by (gear K)^2/R."""
    made = robot(DCMOTOR)
    heavy = made.built.edited(AddedMass("link", 1e9, (0.0, 0.0, 0.5)))
    brakes = torques(heavy, 0.0, 200, v=0.4)[-1]
    assert brakes == pytest.approx(-0.4 * (50 * 0.05) ** 2 / 2, rel=1e-3)
    assert torques(made.plant, 0.0, 1, v=0.4)[0] == 0


@pytest.mark.parametrize("actuator", ALL.values(), ids=list(ALL))
def test_a_built_drive_moves_its_joint_as_the_models_own_did(actuator: str) -> None:
    """The same motion, once asked for in the model's own unit and once in N m."""
    original = mujoco.MjModel.from_xml_string(ONE.format("", actuator))
    unit = {LAG: 4 * -2, DELAY: 2, DCMOTOR: 50 * 0.05 / 2}[actuator]
    built, runs = robot(actuator).built.model, []
    for model, factor in ((original, 1 / unit), (built, 1.0)):
        data, rows = mujoco.MjData(model), []
        for step in range(500):
            data.ctrl[0] = factor * 3 * math.sin(0.02 * step)
            mujoco.mj_step(model, data)
            rows.append((data.qpos[0], data.qvel[0], data.qfrc_actuator[0]))
        runs.append(np.array(rows))
    assert np.abs(runs[0][:, 0]).max() > 0.1
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-9, atol=1e-9)


def test_limits_are_torques_whatever_they_were_limits_of() -> None:
    np.testing.assert_array_equal(robot(LAG).plant.input_limits.T, [[-40, 24]])
    np.testing.assert_array_equal(robot(DELAY).plant.input_limits.T, [[-20, 20]])
    np.testing.assert_allclose(robot(DCMOTOR).plant.input_limits.T, [[-30, 30]])
    for actuator in ALL.values():
        made = robot(actuator)
        np.testing.assert_array_equal(made.built.input_limits, made.plant.input_limits)
        low, high = made.plant.input_limits.T[0]
        heavy = made.built.edited(AddedMass("link", 1e9, (0.0, 0.0, 0.5)))
        for u, end in ((1e3, high), (-1e3, low)):
            assert torques(heavy, u, 400)[-1] == pytest.approx(end, rel=1e-6)


def test_an_activations_limits_are_torques_too() -> None:
    limited = LAG.replace("ctrlrange", 'actlimited="true" actrange="-1 2" ctrlrange')
    # RK4 looks beyond them within a step.
    made = robot(limited, integrator="implicitfast")
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-16, 8]])
    ends = [torques(made.built, u, 400)[-1] for u in (-1e3, 1e3)]
    assert ends == pytest.approx([-16, 8], rel=1e-6)
    beyond = robot(LAG.replace("ctrlrange", 'actlimited="true" actrange="-9 9" ctrlrange'))
    np.testing.assert_array_equal(beyond.plant.input_limits.T, [[-40, 24]])


def test_a_motor_within_a_current_may_be_asked_for_what_its_speed_takes() -> None:
    """At 8 rad/s 24 V give the 4 N m that its current allows, and 8 V are what it brakes with."""
    limited = DCMOTOR.replace(' inductance="0.01"', "").replace(
        'gear="50"', 'gear="50" saturation="0.08 0 0"'
    )
    made = robot(limited)
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-4, 4]])
    heavy = made.built.edited(AddedMass("link", 1e9, (0.0, 0.0, 0.5)))
    for volts, torque in ((24, 4.0), (22, 2.5), (20, 0.0), (0, -4.0)):
        found = torques(heavy, volts * 50 * 0.05 / 2, 2, v=8.0)[-1]
        assert found == pytest.approx(torque, abs=1e-3)


def test_a_joints_own_force_range_holds_on_the_built_plant() -> None:
    made = robot(DELAY, " actuatorfrcrange='-2 3'")
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-2, 3]])
    assert torques(made.built, 1e3, 20)[-1] == 3


def test_a_delayed_servo_loses_its_own_loop() -> None:
    """On the built plant as on the nominal one: what it was asked for is torque."""
    servo = '<position name="drive" joint="hinge" kp="30" kv="2" delay="0.01" nsample="12"/>'
    made = robot(servo)
    for plant in (made.plant, made.built):
        assert torques(plant, 0.7, 30, q=0.5, v=1.0)[-1] == pytest.approx(0.7, rel=1e-12)
    assert "instead of the position servo (kp 30, kv 2)" in made.notes[0]


def test_the_nominal_plant_is_ideal_and_laws_know_nothing_else() -> None:
    ideal = robot(IDEAL)
    for actuator in ALL.values():
        made = robot(actuator)
        model = made.plant.model
        assert model.na == 0
        assert model.actuator_dyntype[0] == mujoco.mjtDyn.mjDYN_NONE
        assert model.actuator_gear[0, 0] == 1
        x = np.array([0.2, -0.4])
        assert inertia(made.nominal, x[:1]) == inertia(ideal.nominal, x[:1])
        assert bias(made.nominal, x[:1], x[1:]) == bias(ideal.nominal, x[:1], x[1:])
        first, second = law_of(made), law_of(ideal)
        asked = []
        for law in (first, second):
            memory, _kept = law.begin()
            asked.append(law.input_at(0.0, x, memory))
        assert asked[0] == asked[1]
    assert ideal.built is ideal.plant


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        (LAG, "the plant has a lag of 0.02 s, which no law knows; torque control within [-40, 24]"),
        (DELAY, "the plant has a delay of 0.012 s, which no law knows"),
        (DCMOTOR, "the plant has a DC motor with its back-EMF, which no law knows"),
        (
            LAG.replace("/>", ' delay="0.01" nsample="12"/>'),
            "the plant has a lag of 0.02 s and a delay of 0.01 s, which no law knows",
        ),
    ],
)
def test_converted_says_what_the_plant_has(actuator: str, said: str) -> None:
    first = robot(actuator).notes[0]
    assert first.startswith("actuator 'drive': ")
    assert said in first


# --- what is refused ---


@pytest.mark.parametrize(
    ("actuator", "said"),
    [
        (
            '<general name="d" joint="hinge" dyntype="integrator" actrange="-1 1"/>',
            r"has activation dynamics \(integrator\)",
        ),
        (
            '<general name="d" joint="hinge" dyntype="filter" dynprm="0"/>',
            "has a lag of 0 s, which nothing can simulate",
        ),
        (DCMOTOR.replace("/>", ' damping="0.1"/>'), "damping of its own, which belongs to its jo"),
        (DCMOTOR.replace("/>", ' input="none"/>'), "is a DC motor without an input"),
        ('<muscle name="d" joint="hinge" lengthrange="0 1"/>', "is a muscle, which pulls by its"),
        (DELAY.replace('joint="hinge"', 'site="s"'), "acts on a site"),
        (LAG.replace('gainprm="4"', 'gaintype="affine" gainprm="4 1 0"'), "gain that depends on"),
    ],
)
def test_what_torque_cannot_stand_for_is_still_refused(actuator: str, said: str) -> None:
    xml = ONE.format("", actuator).replace("</body>", '<site name="s"/></body>')
    with pytest.raises(ModelError, match=said) as told:
        Robot.from_mjcf(xml)
    assert "\n" not in str(told.value)


# --- runs ---


@pytest.mark.parametrize("actuator", ALL.values(), ids=list(ALL))
def test_both_engines_run_the_built_plant_alike(actuator: str) -> None:
    made = robot(actuator)
    law = law_of(made)
    runs = [
        simulate(made.built, law, [0.1, 0.0], duration=0.2, control_period=2e-3, engine=engine)
        for engine in ("native", "python")
    ]
    for name in ("state", "input", "command", "physics"):
        np.testing.assert_array_equal(getattr(runs[0], name), getattr(runs[1], name))
    ideal = simulate(made.plant, law, [0.1, 0.0], duration=0.2, control_period=2e-3)
    assert not np.array_equal(ideal.state, runs[0].state)


def test_a_batch_with_delays_is_its_single_runs() -> None:
    """What a delay remembers of one simulation is nothing to the next one."""
    made = robot(DELAY)
    law, starts = law_of(made), np.array([[0.1, 0.0], [-0.5, 1.0], [0.3, 0.3], [0.1, 0.0]])
    batch = simulate(made.built, law, starts, duration=0.1, threads=1)
    for x0, state in zip(starts, batch.state, strict=True):
        alone = simulate(made.built, law, x0, duration=0.1)
        np.testing.assert_array_equal(alone.state, state)
    np.testing.assert_array_equal(batch.state[0], batch.state[3])


def test_a_delay_of_the_model_is_one_of_twelve_samples() -> None:
    """The plant with its delay moves as the ideal one, twelve steps later."""
    made = robot(DELAY, integrator="Euler")
    task = made.task(setpoints(2), Setpoint(0.3), np.diag([100.0, 0.0]), 1.0)
    run = simulate(made.built, linearized_lqr(task), [0.1, 0.0], duration=0.05)
    asked = run.command[:, 0] if run.command.ndim > 1 else run.command
    model, data = made.plant.model, mujoco.MjData(made.plant.model)
    data.qpos[0] = 0.1
    for step, row in enumerate(run.state[1:]):
        data.ctrl[0] = asked[step - 12] if step >= 12 else 0.0
        mujoco.mj_step(model, data)
        assert data.qpos[0] == pytest.approx(row[0], rel=1e-9)


def test_what_is_unseen_of_a_built_plant_is_named() -> None:
    for actuator, names in ((LAG, ["drive lag"]), (DELAY, []), (DCMOTOR, ["drive current"])):
        assert [each.name for each in robot(actuator).built.hidden_states] == names
        assert robot(actuator).plant.hidden_states == ()


# --- in case files ---

CASE = """
[plant]
model = "arm.xml"

[run]
start = { hinge = "0.1 rad" }
duration = "0.1 s"

[task]
reference = ["0.3"]
Q = [100, 0]
R = 1

[[controller]]
law = "grosmc"
k = 10
epsilon = 5
"""


@pytest.mark.parametrize("actuator", ALL.values(), ids=list(ALL))
def test_experiments_run_on_the_built_plant(actuator: str, tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format("", actuator), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    experiment = Experiment.load(file)
    physics: Any = experiment.plant("physics")
    made = experiment.nominal.robot
    assert made is not None
    assert physics.digest == made.built.digest != made.plant.digest
    run = experiment.run("physics", "grosmc").trajectory
    law = experiment.law("physics", "grosmc")
    same = simulate(made.built, law, [0.1, 0.0], duration=0.1)
    np.testing.assert_array_equal(run.state, same.state)


def test_the_command_line_says_what_no_law_knows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format("", DELAY), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(file), "--out", str(tmp_path)])
    assert stop.value.code == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the plant has a delay of 0.012 s, which no law knows" in said
    json.loads((tmp_path / "case.json").read_text(encoding="utf-8"))
