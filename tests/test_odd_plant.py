"""A plant without a neutral number, by plain MuJoCo: design, loop, run, audit, ladder, campaign.

Its joints lie off their bodies' origins, its gears and weights differ, one of them has a sign; the
reference moves, a load has a phase and an onset, sensor and computer are late, nothing starts at 0.
"""

from __future__ import annotations

import json
import math
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.linalg
from cases import write
from commands import run

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.studies.campaign.batch import evaluate
from grosmc_mj.studies.campaign.campaign import Campaign
from grosmc_mj.studies.ladder.ladder import ladder, run_rung
from grosmc_mj.studies.sweep.runs import MARGIN

MODEL = """
<mujoco model="odd">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="RK4"/>
  <worldbody>
    <body name="arm" pos="0.1 0.2 0.7" euler="0 0.2 0">
      <joint name="swing" pos="0.05 0 0.02" axis="0 1 0" damping="0.3" armature="0.04"/>
      <geom type="capsule" fromto="0 0.02 0 0.3 0 0.1" size="0.03" mass="1.3"/>
      <body name="wrist" pos="0.2 0 0.05">
        <joint name="turn" pos="0.01 0.02 0" axis="0.2 1 0.1" damping="0.2" armature="0.01"/>
        <geom type="box" size="0.05 0.03 0.02" pos="0.04 0 0.03" mass="0.8"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="drive" joint="swing" gear="3" ctrlrange="-6 5"/>
    <motor name="spindle" joint="turn" gear="-2" ctrlrange="-3 4"/>
  </actuator>
</mujoco>
"""
HEAVIER = 1.4
CASE: dict[str, Any] = {
    "title": "A plant without a neutral number",
    "run": {
        "start": {"swing": "0.3 rad", "turn": "-0.2 rad", "swing rate": "0.4 rad/s"},
        "duration": "0.3 s",
        "control_period": "2 ms",
        "timestep": "1 ms",
    },
    "task": {
        "reference": ["0.2 + 0.1*sin(3*t)", "0.2*cos(2*t)"],
        "Q": [90, 3, 40, 2],
        "R": [2, 0.5],
    },
    "edit": {"body": "wrist", "mass_scale": HEAVIER},
    "disturbance": {
        "body": "arm",
        "torque": ["0 N m", "0.6 N m", "0 N m"],
        "profile": "sine",
        "frequency": "3 Hz",
        "phase": "40 deg",
        "onset": "0.05 s",
        "label": "shake",
    },
    "computing": {"delay": "3 ms"},
    "sensor": {"of": "swing", "delay": "2 ms", "bias": "3 mrad"},
    "controller": [
        {"law": "lqr"},
        {"law": "grosmc", "k": 8, "epsilon": 9, "switching": "implicit"},
    ],
    "uncertain": [
        {"number": "edit.wrist.mass_scale", "values": [0.8, 1.6]},
        {"number": "computing.delay", "values": ["1 ms", "4 ms"]},
    ],
    "requirement": {"stays_within": "0.3 rad", "after": "0.1 s"},
}
N = 2
GEARS = np.array([3.0, -2.0])
LATE_SAMPLES = 2
LATE_OUTPUT = 3


class PlainModel:
    """The model in plain MuJoCo, with a wrist of so many times its mass."""

    def __init__(self, heavier: float) -> None:
        spec = mujoco.MjSpec.from_string(MODEL)
        wrist = spec.body("wrist")
        wrist.first_geom().mass *= heavier
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def put(self, t: float, x: Array, load: float) -> None:
        """Put the model into a state, with a torque [N m] about y on the arm."""
        self.data.time = t
        self.data.qpos[:] = x[:N]
        self.data.qvel[:] = x[N:]
        self.data.xfrc_applied[self.model.body("arm").id, 4] = load

    @cached_property
    def inertia(self) -> Array:
        """Inertia matrix where the model was put, (n, n) [kg m^2]."""
        mujoco.mj_forward(self.model, self.data)
        M = np.zeros((N, N))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def torque(self, acceleration: Array) -> Array:
        """Joint torques for an acceleration where the model was put, (n,) [N m]."""
        return self.inertia @ acceleration + self.data.qfrc_bias - self.data.qfrc_passive

    def acceleration(self, torque: Array) -> Array:
        """Acceleration under joint torques where the model was put, (n,) [rad/s^2]."""
        self.data.ctrl[:] = torque / GEARS
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc.copy()


def load_at(t: float) -> float:
    """Torque of the disturbance [N m]."""
    if t < 0.05:
        return 0.0
    return 0.6 * math.sin(2 * math.pi * 3 * t + math.radians(40))


def reference_at(t: float) -> tuple[Array, Array, Array]:
    """Reference with two derivatives, (n,) each."""
    y = np.array([0.2 + 0.1 * math.sin(3 * t), 0.2 * math.cos(2 * t)])
    rate = np.array([0.3 * math.cos(3 * t), -0.4 * math.sin(2 * t)])
    acceleration = np.array([-0.9 * math.sin(3 * t), -0.8 * math.cos(2 * t)])
    return y, rate, acceleration


def gain() -> Array:
    """LQR gain of both joints' errors and their rates by scipy, (n, 2 n)."""
    A = np.kron(np.eye(N), [[0.0, 1.0], [0.0, 0.0]])
    B = np.kron(np.eye(N), [[0.0], [1.0]])
    R = np.diag([2.0, 0.5])
    P = scipy.linalg.solve_continuous_are(A, B, np.diag([90.0, 3.0, 40.0, 2.0]), R)
    return np.linalg.solve(R, B.T @ P)


def wanted_acceleration(t: float, x: Array) -> Array:
    """Acceleration that the optimum asks for, (n,)."""
    y, rate, acceleration = reference_at(t)
    error = np.stack([x[:N] - y, x[N:] - rate], axis=1).ravel()
    return acceleration - gain() @ error


def write_odd(folder: Path, **tables: Any) -> Path:
    """Write the case, with tables in place of its own."""
    (folder / "odd.xml").write_text(MODEL)
    return write(folder, "odd.xml", name="odd", **(CASE | tables))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_odd(tmp_path_factory.mktemp("odd"))


@pytest.fixture(scope="module")
def experiment(file: Path) -> Experiment:
    return Experiment.load(file)


@pytest.fixture(scope="module")
def trajectory(experiment: Experiment) -> Trajectory:
    """The run of the LQR."""
    return experiment.run(law="lqr").trajectory


def test_the_gain_minimizes_the_cost_with_its_own_weight_of_each_input(
    experiment: Experiment,
) -> None:
    K = experiment.law("physics", "lqr").designed.lqr.K
    np.testing.assert_allclose(K, gain(), rtol=1e-9, atol=1e-12)


def test_the_sensor_shows_its_joint_late_and_biased(trajectory: Trajectory) -> None:
    assert trajectory.seen is not None
    samples = np.arange(2, 300, 2)
    swing = trajectory.state[samples - LATE_SAMPLES, 0]
    np.testing.assert_allclose(trajectory.seen[samples, 0], swing + 3e-3, rtol=0, atol=1e-12)


def test_the_law_computes_its_torque_by_the_nominal_dynamics(trajectory: Trajectory) -> None:
    assert trajectory.seen is not None
    for sample in range(0, 300, 50):
        t = float(trajectory.time[sample])
        x = trajectory.seen[sample]
        nominal = PlainModel(1.0)
        nominal.put(t, x, load=0.0)
        expected = nominal.torque(wanted_acceleration(t, x))
        np.testing.assert_allclose(trajectory.command[sample], expected, rtol=1e-9)


def test_the_plant_moves_as_its_edited_model_under_load_and_late_torque(
    trajectory: Trajectory,
) -> None:
    plain = PlainModel(HEAVIER)
    plain.put(0.0, trajectory.state[0], load=0.0)
    for step in range(300):
        command = np.zeros(N)
        if step >= LATE_OUTPUT:
            # The output of the sample that was taken last, 3 ms ago.
            sample = (step - LATE_OUTPUT) // 2 * 2
            command = trajectory.command[sample]
        plain.data.ctrl[:] = command / GEARS
        plain.data.xfrc_applied[plain.model.body("arm").id, 4] = load_at(step * 1e-3)
        mujoco.mj_step(plain.model, plain.data)
        moved = np.concatenate([plain.data.qpos, plain.data.qvel])
        np.testing.assert_allclose(trajectory.state[step + 1], moved, rtol=1e-9, atol=1e-9)


def test_the_required_switching_rate_is_the_load_over_what_the_inertias_leave(
    file: Path, tmp_path: Path
) -> None:
    """At the audit's worst instant: |q'' - v| under the continuous torque, over dominance."""
    run("claims", "premises", file, "--out", tmp_path)
    (document,) = json.loads(next(tmp_path.glob("premises_odd_*.json")).read_text())["premises"]
    premises = {premise["name"]: premise["along_run"] for premise in document["premises"]}
    worst = premises["epsilon"]["worst"]
    t = worst["t"]
    x = np.array(worst["x"])

    nominal = PlainModel(1.0)
    nominal.put(t, x, load=0.0)
    true = PlainModel(HEAVIER)
    true.put(t, x, load=load_at(t))
    v = wanted_acceleration(t, x)
    push = np.abs(true.acceleration(nominal.torque(v)) - v).max()
    ratio = np.linalg.solve(true.inertia, nominal.inertia)
    left = (2 * np.diag(ratio) - np.abs(ratio).sum(axis=1)).min()
    assert premises["epsilon"]["margin"] == pytest.approx(9 - push / left, rel=1e-6)


def test_the_highest_rung_of_a_ladder_is_the_run_of_the_case(
    file: Path, experiment: Experiment
) -> None:
    studied = ladder(str(file), ["lqr"])
    law = studied.laws[0]
    row = run_rung(studied, law, studied.climbing[-1], studied.conditions[0], together=True)
    (judgement,) = experiment.run(law="lqr").requirements
    assert row.share == pytest.approx((judgement.measured or 0.0) / 0.3)


def test_a_plant_of_a_campaign_is_the_case_with_its_numbers(file: Path, tmp_path: Path) -> None:
    """A mass scale of 1.1 and a delay of 2 ms in place of what the case has."""
    campaign = Campaign.load(str(file), runs=1)
    outcome = evaluate(campaign, "lqr", np.array([[1.1, 2e-3]]))
    (limit,) = outcome.limits

    edit = {"body": "wrist", "mass_scale": 1.1}
    drawn = write_odd(tmp_path, edit=edit, computing={"delay": "2 ms"})
    (judgement,) = Experiment.load(drawn).run(law="lqr").requirements
    assert outcome[MARGIN + limit.name][0] == pytest.approx(judgement.margin, rel=1e-12)
