"""The premises of a robot's run: against the symbolic two-link arm, a payload and cut torques."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from shipped import REGULATION, TWO_LINK_TARGET, run_on, surface_of, weights_of

from grosmc_mj.experiments.assumptions.audit import Audit, Premise, Reading
from grosmc_mj.experiments.assumptions.balance import Loads, balance
from grosmc_mj.experiments.assumptions.robot import robot_audit
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.run_cache import trial
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.machine import Stop, Transmission
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.nominal import inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.theory.control.references import FourierSeries, fourier_series, setpoints
from grosmc_mj.theory.control.task import AS_PRINTED

PYTHON = Settings(engine="python")
# Two links in the vertical plane, with limits of torques and of one joint.
ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.001"/>
  <worldbody>
    <body>
      <joint name="shoulder" axis="0 1 0" armature="0.3" limited="true" range="-2 2"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.02" mass="1.5"/>
      <body name="forearm" pos="0.4 0 0">
        <joint name="elbow" axis="0 1 0" armature="0.2"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="m1" joint="shoulder" ctrllimited="true" ctrlrange="-25 25"/>
    <motor name="m2" joint="elbow" ctrllimited="true" ctrlrange="-9 9"/>
  </actuator>
</mujoco>
"""
N = 2
KEPT = ("epsilon", "input gain", "s(0) = 0", "input limits", "input headroom", "joint limits")
LOAD = AddedMass("forearm", 0.4, (0.3, 0.0, 0.0))


@cache
def arm() -> Robot:
    return Robot.from_mjcf(ARM)


@cache
def law(name: str = "grosmc", epsilon: float = 2.0, amplitude: float = 0.2) -> Controller:
    sine = amplitude * np.ones((N, 1))
    series = FourierSeries(2.0, np.array([0.3, -0.4]), np.zeros((N, 1)), sine)
    Q = np.kron(np.eye(N), np.diag([100.0, 0.0]))
    task = arm().task(fourier_series(N, 1), series, Q, np.eye(N))
    if name == "lqr":
        return linearized_lqr(task, "lqr")
    return tracking_grosmc(task, 5.0, epsilon)


@cache
def run(controller: Controller, *edits: Edit, q0: tuple[float, float] = (0.35, -0.35)) -> RunResult:
    case = trial("arm", "sines", (*q0, 0.0, 0.0), 0.1, edits)
    plant = arm().plant.changed(*edits)
    return run_on(case, "physics", controller, plant, PYTHON)


@cache
def audited(result: RunResult) -> Audit:
    return robot_audit(result)


def names(result: RunResult) -> list[str]:
    return [premise.name for premise in audited(result).premises]


def premise(result: RunResult, name: str) -> Premise:
    return next(premise for premise in audited(result).premises if premise.name == name)


def along(result: RunResult, name: str) -> Reading:
    reading = premise(result, name).along
    assert reading is not None
    return reading


def required(result: RunResult) -> Array:
    return audited(result).signals["required"]


@pytest.mark.slow
def test_a_robot_from_mjcf_needs_what_the_symbolic_two_link_arm_needs() -> None:
    """The same law by MuJoCo's dynamics and by the equations, on the same edited plants."""
    robot = Robot.from_mjcf(load_spec("two_link_arm"))
    task = robot.task(setpoints(2, 2), TWO_LINK_TARGET, *weights_of(REGULATION))
    law_of_robot = tracking_grosmc(task, 5.0, 30.0, surface_of(REGULATION))
    heavier = BodyEdit("payload", mass_scale=3.0)
    push = Disturbance("payload", (5.0, 0.0, -3.0, 0.0, 0.2, 0.0))
    start = (0.9, -1.4, 0.3, 0.0)
    case = trial("two_link_arm", "x", start, 0.3, (heavier,), (push,))
    result = run_on(case, "physics", law_of_robot, robot.plant.changed(heavier), PYTHON)

    shipped = MujocoPlant.load("two_link_arm")
    true = shipped.changed(heavier).analytic()
    symbolic_law = chapter_controller("grosmc", shipped.analytic(), AS_PRINTED, "regulation")
    trajectory = result.trajectory
    assert trajectory.wrench is not None
    signals = robot_audit(result).signals
    for t, rate in zip(signals["time"], signals["required"], strict=True):
        row = int(np.searchsorted(trajectory.time, t))
        w = trajectory.wrench[row]
        expected = balance(
            symbolic_law, true, t, trajectory.state[row], Loads.of_wrench(w, true.system)
        )
        assert expected.required > 1
        assert rate == pytest.approx(expected.required, rel=1e-9)


def geared() -> RunResult:
    """A run on a machine whose gears have the inertia that the joints had."""
    shoulder = Transmission("shoulder", 0.15, stiffness=5e3, added=False)
    elbow = Transmission("elbow", 0.15, stiffness=5e3, added=False)
    return run(law(), shoulder, elbow, Stop("elbow", -1.0, 0.0))


@pytest.mark.parametrize("machine", [False, True])
def test_the_true_plant_that_is_the_nominal_one_asks_for_nothing(machine: bool) -> None:
    """Of a machine its rigid plant is looked at."""
    result = geared() if machine else run(law())
    # Torques of 10 N m over inertias of 0.2 kg m², in double precision.
    assert required(result).max() < 1e-10
    assert along(result, "input gain").margin == pytest.approx(1.0)


@pytest.mark.parametrize(("name", "premises"), [("grosmc", KEPT), ("lqr", KEPT[3:])])
def test_every_premise_holds_on_the_nominal_robot(name: str, premises: tuple[str, ...]) -> None:
    """A law that does not switch has those of limits alone."""
    result = run(law(name))
    assert names(result) == list(premises)
    assert audited(result).failed() == []


def test_parts_of_a_machine_are_not_in_the_push() -> None:
    note = "not in it: that the law is sampled, the parts of its machine, and"
    assert note in premise(geared(), "epsilon").note
    assert "machine" not in premise(run(law()), "epsilon").note
    assert along(geared(), "joint limits").margin > 0.3


def test_the_least_that_is_left_of_rho_is_that_of_the_inertias() -> None:
    """R = (G E*)(G E)^-1 = M*^-1 M, by MuJoCo's mj_fullM of the edited model."""
    result = run(law(epsilon=0.5), LOAD)
    plant = result.true
    gain = along(result, "input gain")
    assert isinstance(plant, MujocoPlant)
    data = mujoco.MjData(plant.model)
    data.qpos[:] = gain.x[:N]
    mujoco.mj_forward(plant.model, data)
    M = np.zeros((N, N))
    mujoco.mj_fullM(plant.model, data, M)
    R = np.linalg.solve(M, inertia(arm().nominal, data.qpos))
    dominance = (2 * np.diag(R) - np.abs(R).sum(axis=1)).min()
    assert gain.margin == pytest.approx(dominance, rel=1e-9, abs=1e-9)
    assert premise(result, "input gain").holds


def test_a_law_with_less_than_it_needs_fails_with_the_rate_that_restores_it() -> None:
    weak = run(law(epsilon=0.5), LOAD)
    failed = premise(weak, "epsilon")
    rate = along(weak, "epsilon")
    assert not failed.holds
    assert rate.margin == pytest.approx(0.5 - required(weak).max(), rel=1e-12)
    assert f"{required(weak).max():.3g}" in failed.restores
    assert rate.t in audited(weak).signals["time"]


def test_a_law_with_more_than_it_needs_holds() -> None:
    rate = premise(run(law(epsilon=12.0), LOAD), "epsilon")
    assert rate.holds
    assert rate.restores == ""


def test_a_payload_that_takes_the_dominance_away_is_named_by_its_row() -> None:
    heavy = run(law(), replace(LOAD, mass=30.0))
    gain = premise(heavy, "input gain")
    assert not gain.holds
    assert "in the row of elbow 0.568 is its own and 0.573 the others', most of it" in gain.note
    assert gain.restores.startswith("another G, smaller edits")
    no_rate = "no ρ, while r is not positive: see the input gain"
    assert premise(heavy, "epsilon").restores == no_rate


def test_cut_torques_fail_the_premise_of_their_limits() -> None:
    """By the largest share of a limit, for the share of samples that are cut, of each joint."""
    result = run(law(epsilon=40.0))
    trajectory = result.trajectory
    limits = premise(result, "input limits")
    shares = np.abs(trajectory.command / [25.0, 9.0]).max(axis=0)
    cut = (trajectory.command != trajectory.input).any(axis=1)
    assert not limits.holds
    reading = along(result, "input limits")
    assert reading.violated == cut.mean() > 0
    assert reading.margin == pytest.approx(1 - shares.max(), rel=1e-12)
    assert f"shoulder {100 * shares[0]:.0f} %" in limits.note
    assert f"elbow {100 * shares[1]:.0f} %" in limits.note


def test_a_torque_within_its_limits_is_not_cut() -> None:
    assert premise(run(law("lqr")), "input limits").holds


def test_headroom_is_what_the_torques_along_the_reference_leave_of_the_limits() -> None:
    """The torques are those of inverse dynamics, plus the largest ones of switching."""
    controller = law(epsilon=2.0)
    headroom = along(run(controller), "input headroom")
    reference = controller.coordinates.reference
    y = np.reshape(reference(headroom.t, controller.parameters.reference), (N, 3))
    data = mujoco.MjData(arm().plant.model)
    data.qpos[:] = y[:, 0]
    data.qvel[:] = y[:, 1]
    data.qacc[:] = y[:, 2]
    mujoco.mj_inverse(arm().plant.model, data)
    switching = 2.0 * np.abs(inertia(arm().nominal, y[:, 0])).sum(axis=1)
    shares = (np.abs(data.qfrc_inverse) + switching) / [25.0, 9.0]
    assert headroom.margin == pytest.approx((1 - shares).min(), rel=1e-9)


def test_there_is_more_headroom_without_switching() -> None:
    switching = along(run(law(epsilon=2.0)), "input headroom").margin
    assert along(run(law("lqr")), "input headroom").margin > switching + 0.05


def test_a_touched_joint_limit_is_noticed() -> None:
    result = run(law("lqr"), q0=(2.05, -0.35))
    touched = premise(result, "joint limits")
    largest = result.trajectory.state[:, 0].max()
    assert not touched.holds
    assert along(result, "joint limits").margin == pytest.approx((2 - largest) / 4)
    assert "shoulder" in touched.note


def test_a_robot_without_limits_keeps_them() -> None:
    robot = Robot.from_mjcf(re.sub(r'(ctrl)?(limited|range)="[^"]*"', "", ARM))
    task = robot.task(setpoints(2, 2), TWO_LINK_TARGET, *weights_of(REGULATION))
    case = trial("arm", "x", (0.9, -1.4, 0.0, 0.0), 0.05)
    result = run_on(case, "physics", linearized_lqr(task, "lqr"), robot.plant, PYTHON)
    assert audited(result).failed() == []
    assert premise(result, "joint limits").note == "no joint has a limit"
