"""The premises of a robot's run: against the symbolic two-link arm, a payload and cut torques."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from shipped import TWO_LINK_G, TWO_LINK_TARGET, TWO_LINK_WEIGHTS, run_on

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import Audit, Premise, Reading
from grosmc_mj.assumptions.balance import balance
from grosmc_mj.assumptions.robot import robot_audit
from grosmc_mj.chapter.premises import audit_document, audit_table
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import FourierSeries, fourier_series, setpoints
from grosmc_mj.control.task import AS_PRINTED
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.machine import Stop, Transmission
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit
from grosmc_mj.physics.files import load_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.document import json_text
from grosmc_mj.robots.dynamics import inertia
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance

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
KEPT = ("epsilon", "input gain", "s(0) = 0", "torque limits", "torque headroom", "joint limits")
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
    return linearized_lqr(task, "lqr") if name == "lqr" else tracking_grosmc(task, 5.0, epsilon)


@cache
def run(controller: Controller, *edits: Edit, q0: tuple[float, float] = (0.35, -0.35)) -> RunResult:
    case = Case("arm", "sines", "sines", "this test", (*q0, 0.0, 0.0), 0.1, edits)
    plant = arm().plant.edited(*edits)
    return run_on(case, "physics", controller, plant, PYTHON)


@cache
def audited(result: RunResult) -> Audit:
    return robot_audit(result)


def premise(result: RunResult, name: str) -> Premise:
    return next(each for each in audited(result).premises if each.name == name)


def along(result: RunResult, name: str) -> Reading:
    found = premise(result, name).along
    assert found is not None
    return found


def required(result: RunResult) -> Array:
    return audited(result).signals["required"]


# --- the switching rate ---


@pytest.mark.slow
def test_a_robot_from_mjcf_needs_what_the_symbolic_two_link_arm_needs() -> None:
    """The same law by MuJoCo's dynamics and by the equations, on the same edited plants."""
    robot, shipped = Robot.from_mjcf(load_spec("two_link_arm")), MujocoPlant.load("two_link_arm")
    theirs = chapter_controller("grosmc", shipped.analytic(), AS_PRINTED, "regulation")
    task = robot.task(setpoints(2, 2), TWO_LINK_TARGET, *TWO_LINK_WEIGHTS)
    ours = tracking_grosmc(task, 5.0, 30.0, TWO_LINK_G)
    heavier = BodyEdit("payload", mass_scale=3.0)
    push = Disturbance("payload", (5.0, 0.0, -3.0, 0.0, 0.2, 0.0))
    case = Case(
        "two_link_arm", "x", "x", "this test", (0.9, -1.4, 0.3, 0.0), 0.3, (heavier,), (push,)
    )
    result = run_on(case, "physics", ours, robot.plant.edited(heavier), PYTHON)
    twin, run = shipped.edited(heavier).analytic(), result.trajectory
    signals = robot_audit(result).signals
    assert run.wrench is not None
    for t, rate in zip(signals["time"], signals["required"], strict=True):
        row = int(np.searchsorted(run.time, t))
        wanted = balance(theirs, twin, t, run.state[row], run.wrench[row])
        assert wanted.required > 1
        assert rate == pytest.approx(wanted.required, rel=1e-9)


def test_the_true_plant_that_is_the_nominal_one_asks_for_nothing() -> None:
    """Nor do gears whose inertia was the joints' own; of a machine its rigid plant is looked at."""
    gears = [
        Transmission(joint, 0.15, stiffness=5e3, added=False) for joint in ("shoulder", "elbow")
    ]
    plain, geared = run(law()), run(law(), *gears, Stop("elbow", -1.0, 0.0))
    for result in (plain, geared):
        # Torques of 10 N m over inertias of 0.2 kg m², in double precision.
        assert required(result).max() < 1e-10
        assert along(result, "input gain").margin == pytest.approx(1.0)
    assert [own.name for own in audited(plain).premises] == list(KEPT)
    assert all(own.holds for own in audited(plain).premises)
    # Of a law that does not switch those of torques and joints alone.
    assert [own.name for own in robot_audit(run(law("lqr"))).premises] == list(KEPT[3:])
    assert along(geared, "joint limits").margin > 0.3
    note = "not in it: that the law is sampled, the parts of its machine, and"
    assert note in premise(geared, "epsilon").note
    assert "machine" not in premise(plain, "epsilon").note


def test_the_least_that_is_left_of_rho_is_that_of_the_inertias() -> None:
    """R = (G E*)(G E)^-1 = M*^-1 M, by MuJoCo's mj_fullM of the edited model."""
    weak, enough = run(law(epsilon=0.5), LOAD), run(law(epsilon=12.0), LOAD)
    plant, gain = weak.true, along(weak, "input gain")
    assert isinstance(plant, MujocoPlant)
    data, M = mujoco.MjData(plant.model), np.zeros((N, N))
    data.qpos[:] = gain.worst.x[:N]
    mujoco.mj_forward(plant.model, data)
    mujoco.mj_fullM(plant.model, data, M)
    R = np.linalg.solve(M, inertia(arm().nominal, data.qpos))
    left = (2 * np.diag(R) - np.abs(R).sum(axis=1)).min()
    assert gain.margin == pytest.approx(left, rel=1e-9, abs=1e-9)
    # A law with less than it needs fails, with the rate that restores it.
    failed, rate = premise(weak, "epsilon"), along(weak, "epsilon")
    assert not failed.holds
    assert rate.margin == pytest.approx(0.5 - required(weak).max(), rel=1e-12)
    assert f"{required(weak).max():.3g}" in failed.restores
    assert rate.worst.t in audited(weak).signals["time"]
    assert (premise(enough, "epsilon").holds, premise(enough, "epsilon").restores) == (True, "")


# --- what takes the dominance of the input gain away ---

THREE_LINKS = """
<mujoco model="three"><option timestep="0.001" integrator="RK4"/><compiler angle="radian"/>
<default><geom type="capsule" contype="0" conaffinity="0"/><joint axis="0 1 0"/></default>
<worldbody><body name="a"><joint name="j1"/><geom fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
<body name="b" pos="0.4 0 0"><joint name="j2"/><geom fromto="0 0 0 0.3 0 0" size="0.03" mass="0.7"/>
<body name="c" pos="0.3 0 0"><joint name="j3"/><geom fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/>
</body></body></body></worldbody>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="m3" joint="j3"/>
</actuator></mujoco>
"""
THREE_LINKS_CASE = """
[plant]
model = "three.xml"
[run]
duration = "0.05 s"
[task]
reference = ["0.5", "-0.5", "0.3"]
Q = [100, 20, 100, 20, 100, 20]
R = 1
[[edit]]
body = "c"
mass_scale = {scale}
[[controller]]
law = "grosmc"
k = 5
epsilon = 60
switching = "implicit"
"""


def three_links(folder: Path, scale: float) -> Path:
    (folder / "three.xml").write_text(THREE_LINKS)
    (folder / "three.toml").write_text(THREE_LINKS_CASE.format(scale=scale))
    return folder / "three.toml"


def test_the_row_is_named_and_a_smaller_payload_restores_it(tmp_path: Path) -> None:
    heavy, light = (Experiment.load(three_links(tmp_path, scale)).run() for scale in (4.0, 1.01))
    failed = {each.name: each for each in robot_audit(heavy).failed()}
    gain, rate = failed["input gain"], failed["epsilon"]
    assert "in the row of j3 0.25 is its own" in gain.note
    assert "most of it j1's" in gain.note
    assert rate.restores == "no ρ, while r is not positive: see the input gain"
    assert gain.restores.startswith(("a unit-vector switching law", "another G, smaller edits"))
    assert "input gain" not in [premise.name for premise in robot_audit(light).failed()]


# --- torques and joints ---


def test_a_cut_torque_is_noticed_by_joint_and_by_how_often() -> None:
    strong = run(law(epsilon=40.0))
    reading, trajectory = along(strong, "torque limits"), strong.trajectory
    cut = trajectory.command != trajectory.input
    assert cut.any()
    assert not premise(strong, "torque limits").holds
    assert reading.violated == cut.any(axis=1).mean()
    largest = np.abs(trajectory.command / [25.0, 9.0]).max(axis=0)
    assert reading.margin == pytest.approx(1 - largest.max(), rel=1e-12)
    for joint, share in zip(("shoulder", "elbow"), largest, strict=True):
        assert f"{joint} {100 * share:.0f} %" in premise(strong, "torque limits").note
    assert premise(run(law("lqr")), "torque limits").holds


def test_inverse_dynamics_and_switching_leave_headroom_of_the_limits() -> None:
    controller = law(epsilon=2.0)
    headroom = along(run(controller), "torque headroom")
    t = headroom.worst.t
    y = np.reshape(controller.coordinates.reference(t, controller.parameters.reference), (N, 3))
    data = mujoco.MjData(arm().plant.model)
    data.qpos[:], data.qvel[:], data.qacc[:] = y.T
    mujoco.mj_inverse(arm().plant.model, data)
    switching = 2.0 * np.abs(inertia(arm().nominal, y[:, 0])).sum(axis=1)
    left = (1 - (np.abs(data.qfrc_inverse) + switching) / [25.0, 9.0]).min()
    assert headroom.margin == pytest.approx(left, rel=1e-9)
    # Without switching there is more of it.
    assert along(run(law("lqr")), "torque headroom").margin > headroom.margin + 0.05


def test_a_touched_joint_limit_is_noticed() -> None:
    result = run(law("lqr"), q0=(2.05, -0.35))
    touched, largest = premise(result, "joint limits"), result.trajectory.state[:, 0].max()
    assert not touched.holds
    assert along(result, "joint limits").margin == pytest.approx((2 - largest) / 4)
    assert "shoulder" in touched.note
    assert premise(run(law("lqr")), "joint limits").holds
    # A robot without limits keeps them.
    robot = Robot.from_mjcf(re.sub(r'(ctrl)?(limited|range)="[^"]*"', "", ARM))
    task = robot.task(setpoints(2, 2), TWO_LINK_TARGET, *TWO_LINK_WEIGHTS)
    case = Case("arm", "x", "x", "this test", (0.9, -1.4, 0.0, 0.0), 0.05)
    result = run_on(case, "physics", linearized_lqr(task, "lqr"), robot.plant, PYTHON)
    assert all(own.holds for own in audited(result).premises)
    assert premise(result, "joint limits").note == "no joint has a limit"


# --- which runs have premises, and as a table and as values ---


@pytest.mark.slow
def test_run_prints_and_writes_the_premises_of_the_law_that_switches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = three_links(tmp_path, 4.0)
    file.write_text(file.read_text() + '[[controller]]\nlaw = "lqr"\n')
    found = robot_audit(Experiment.load(file).run(law="grosmc"))
    assert len(audit_table(found).rows) == len(found.premises)
    with pytest.raises(SystemExit) as stop:
        cli.main(("run", str(file), "--verbose", "--out", str(tmp_path)))
    assert stop.value.code == cli.DONE
    said = capsys.readouterr().out
    assert said.count("torque headroom") == 1
    assert "epsilon: worst in the run at t =" in said
    (document,) = json.loads((tmp_path / "three.json").read_text(encoding="utf-8"))["premises"]
    assert document == json.loads(json_text(audit_document(found)))
    assert document["controller"] == "grosmc"
    written = {each["name"]: each["holds"] for each in document["premises"]}
    assert written == {each.name: each.holds for each in found.premises}
    assert not written["epsilon"]
