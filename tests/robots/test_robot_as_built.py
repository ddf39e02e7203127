"""Robots as built: lags, delays and couplings, which no law knows."""

from __future__ import annotations

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
from grosmc_mj.control.design import tracking_grosmc
from grosmc_mj.control.references import Setpoint, Setpoints, setpoints
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
SERVO = (
    '<position name="drive" joint="hinge" kp="30" kv="2" timeconst="0.02" gear="2" '
    'ctrlrange="-1 1" forcerange="-4 4"/>'
)
# A servo as a general actuator, whose activation's range is one of places.
GENERAL = (
    '<general name="drive" joint="hinge" gainprm="30" biastype="affine" biasprm="0 -30 -2" '
    'gear="2" ctrlrange="-1 1" forcerange="-4 4" dyntype="filterexact" dynprm="0.02" '
    'actlimited="true" actrange="-0.1 0.1"/>'
)
ALL = {"lag": LAG, "delay": DELAY}
of_all = pytest.mark.parametrize("actuator", ALL.values(), ids=list(ALL))
# A heavy link does not move in a step.
HEAVY = AddedMass("link", 1e9, (0.0, 0.0, 0.5))


@cache
def robot(actuator: str, joint: str = "", integrator: Any = None) -> Robot:
    return Robot.from_mjcf(ONE.format(joint, actuator), integrator=integrator)


def law_of(made: Robot) -> Controller:
    task = made.task(setpoints(2), Setpoint(0.3), np.diag([100.0, 0.0]), 1.0)
    return tracking_grosmc(task, 10, 5)


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


def waved(model: mujoco.MjModel, size: float) -> Array:
    """Angle, speed and torque under a sine."""
    data, rows = mujoco.MjData(model), []
    for step in range(800):
        data.ctrl[0] = size * math.sin(0.02 * step)
        mujoco.mj_step(model, data)
        rows.append((data.qpos[0], data.qvel[0], data.qfrc_actuator[0]))
    return np.array(rows)


# --- the built plant ---


@pytest.mark.parametrize(("actuator", "unit"), [(LAG, 4 * -2), (DELAY, 2)])
def test_a_built_drive_moves_its_joint_as_the_models_own_did(actuator: str, unit: float) -> None:
    """The same motion, once with a command in the model's own unit and once in N m."""
    original = mujoco.MjModel.from_xml_string(ONE.format("", actuator))
    original.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    theirs = waved(original, 12 / unit)
    ours = waved(robot(actuator, integrator="implicitfast").built.model, 12.0)
    assert np.abs(theirs[:, 0]).max() > 0.1
    np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("u", [0.7, -2.5])
@of_all
def test_a_demand_is_in_the_end_the_torque_at_rest(actuator: str, u: float) -> None:
    made = robot(actuator)
    assert torques(made.plant.edited(HEAVY), u, 1)[0] == pytest.approx(u, rel=1e-12)
    built = torques(made.built.edited(HEAVY), u, 400)
    assert abs(built[0]) < 0.5 * abs(u)
    assert built[-1] == pytest.approx(u, rel=1e-6)


def test_lag_and_delay_are_those_of_the_model() -> None:
    """RK4 moves an exact lag nearly so, and reads a delayed input within a step, too."""
    built = robot(LAG, integrator="implicitfast").built
    left = 1 - torques(built.edited(HEAVY), 1.0, 20)
    np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-1e-3 / 0.02), rtol=1e-6)
    delay = torques(robot(DELAY, integrator="implicitfast").built, 1.0, 20)
    assert delay.tolist() == [0.0] * 12 + [1.0] * 8


LIMITED = LAG.replace("ctrlrange", 'actlimited="true" actrange="{}" ctrlrange')


@pytest.mark.parametrize(
    ("actuator", "joint", "low", "high"),
    [
        (LAG, "", -40, 24),
        (DELAY, "", -20, 20),
        (LIMITED.format("-1 2"), "", -16, 8),
        (LIMITED.format("-9 9"), "", -40, 24),
        (SERVO, "", -8, 8),
        (GENERAL, "", -8, 8),
        (DELAY, " actuatorfrcrange='-2 3'", -2, 3),
    ],
)
def test_limits_are_torques_whatever_they_were_limits_of(
    actuator: str, joint: str, low: float, high: float
) -> None:
    # RK4 looks beyond an activation's limits within a step.
    made = robot(actuator, joint, integrator="implicitfast")
    np.testing.assert_allclose(made.plant.input_limits.T, [[low, high]], rtol=1e-12)
    if actuator in ALL.values() and not joint:
        np.testing.assert_array_equal(made.built.input_limits, made.plant.input_limits)
    for u, end in ((1e3, high), (-1e3, low)):
        assert torques(made.built.edited(HEAVY), u, 600)[-1] == pytest.approx(end, rel=1e-6)


@pytest.mark.parametrize(
    ("actuator", "u"),
    [
        (SERVO, 5.0),
        (GENERAL, 7.0),
        (SERVO.replace('timeconst="0.02"', 'delay="0.01" nsample="12"'), 0.7),
        ('<intvelocity name="drive" joint="hinge" kp="30" actrange="-1 1"/>', 3.0),
        ('<pid name="drive" joint="hinge" kp="30" ki="4" kv="2" delay="0.01" nsample="12"/>', 3.0),
    ],
)
def test_a_servo_loses_its_own_loop_and_keeps_its_lag(actuator: str, u: float) -> None:
    """Neither place nor speed pulls, and a torque is not a place."""
    made = robot(actuator, integrator="implicitfast")
    assert "position servo (kp 30" in made.notes[0]
    for q, v in ((0.0, 0.0), (0.6, 3.0)):
        assert torques(made.plant, u, 1, q, v)[-1] == pytest.approx(u, rel=1e-12)
        built = torques(made.built, u, 600, q, v)
        assert built[-1] == pytest.approx(u, rel=1e-9)
        if made.built.model.na:
            left = u - built[:20]
            np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-1e-3 / 0.02), rtol=1e-9)


# --- what laws know ---


@of_all
def test_the_nominal_plant_is_ideal_and_laws_know_nothing_else(actuator: str) -> None:
    made, ideal, x = robot(actuator), robot(IDEAL), np.array([0.2, -0.4])
    assert ideal.built is ideal.plant
    model, inputs = made.plant.model, []
    assert (model.na, model.actuator_dyntype[0], model.actuator_gear[0, 0]) == (0, 0, 1)
    assert made.plant.hidden_states == ()
    names = {LAG: ["drive lag"], DELAY: []}[actuator]
    assert [state.name for state in made.built.hidden_states] == names
    for one in (made, ideal):
        law = law_of(one)
        memory, _kept = law.begin()
        terms = inertia(one.nominal, x[:1]), bias(one.nominal, x[:1], x[1:])
        inputs.append((*terms, law.input_at(0.0, x, memory)))
    assert inputs[0] == inputs[1]


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        (LAG, "the plant has a lag of 0.02 s, which no law knows; torque control within [-40, 24]"),
        (DELAY, "the plant has a delay of 0.012 s, which no law knows"),
        (LAG.replace("/>", ' delay="0.01" nsample="12"/>'), "a lag of 0.02 s and a delay of 0.01"),
        (SERVO, "within [-8, 8] N m instead of the position servo (kp 30, kv 2)"),
    ],
)
def test_notes_say_what_the_plant_has(actuator: str, words: str) -> None:
    note = robot(actuator).notes[0]
    assert note.startswith("actuator 'drive': ")
    assert words in note


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        (
            '<general name="d" joint="hinge" dyntype="filter" dynprm="0"/>',
            "has a lag of 0 s, which nothing can simulate",
        ),
        (
            '<general name="d" joint="hinge" damping="0.1"/>',
            "damping of its own, which belongs to its jo",
        ),
        (
            '<dcmotor name="d" joint="hinge" motorconst="0.05" resistance="2"/>',
            r"is a DC motor: make it a motor here, and give its winding in a \[\[motor\]\] table",
        ),
        (LAG.replace('gainprm="4"', 'gaintype="affine" gainprm="4 1 0"'), "gain that depends on"),
    ],
)
def test_an_actuator_that_torque_cannot_stand_for_is_refused(actuator: str, words: str) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        robot(actuator)
    assert "\n" not in str(refused.value)


# --- runs ---


@of_all
def test_both_engines_and_a_batch_run_the_built_plant_alike(actuator: str) -> None:
    """What a delay remembers of one simulation is nothing to the next one."""
    made = robot(actuator)
    law, starts = law_of(made), np.array([[0.1, 0.0], [-0.5, 1.0], [0.1, 0.0]])
    options: dict[str, Any] = {"duration": 0.2, "control_period": 2e-3}
    batch = simulate(made.built, law, starts, threads=1, **options)
    for engine in ("native", "python"):
        run = simulate(made.built, law, starts[0], engine=engine, **options)
        for name in ("state", "input", "command", "physics"):
            for i in (0, 2):
                np.testing.assert_array_equal(getattr(run, name), getattr(batch[i], name))
    ideal = simulate(made.plant, law, starts[0], **options)
    assert not np.array_equal(ideal.state, batch.state[0])


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


@pytest.mark.parametrize("actuator", [DELAY, SERVO])
def test_a_file_runs_on_the_built_plant_and_says_what_no_law_knows(
    actuator: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format("", actuator), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    experiment = Experiment.load(file)
    made, physics = experiment.nominal.robot, experiment.plant("physics")
    assert made is not None
    assert physics.digest == made.built.digest != made.plant.digest
    run = experiment.run("physics", "grosmc").trajectory
    same = simulate(made.built, experiment.law("physics", "grosmc"), [0.1, 0.0], duration=0.1)
    np.testing.assert_array_equal(run.state, same.state)
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(file), "--out", str(tmp_path)])
    assert stop.value.code == 0
    assert "which no law knows; torque control" in " ".join(capsys.readouterr().out.split())


# --- coupled joints ---

TWO = """<mujoco model="two"><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="a"><joint name="first" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.5" mass="1"/></body>
<body name="b" pos="0 1 0"><joint name="second" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.3" mass="2"/></body></worldbody>
<actuator><motor name="one" joint="first"/>{}</actuator><equality>{}</equality></mujoco>"""
SECOND = '<motor name="two" joint="second"/>'
COUPLED = '<joint joint1="first" joint2="second" polycoef="0 2 0 0 0" {}/>'
KINDS = {"stiff": COUPLED.format(""), "compliant": COUPLED.format('solref="-40 -2"')}
WELD = '<weld body1="a" body2="b"/>'


@pytest.mark.parametrize("coupled", KINDS.values(), ids=list(KINDS))
def test_coupled_joints_are_the_plants_and_no_laws(coupled: str) -> None:
    text = TWO.format(SECOND, coupled)
    made, free = Robot.from_mjcf(text), Robot.from_mjcf(TWO.format(SECOND, ""))
    assert (made.plant.model.neq, made.nominal.neq, made.built.model.neq) == (0, 0, 1)
    assert made.notes == (
        "the plant couples the joints 'first' and 'second' (equality), which no law knows: laws "
        "move each on its own",
        *free.notes,
    )
    q, dq = [0.2, -0.4], [1.0, 0.3]
    np.testing.assert_array_equal(inertia(made.nominal, q), inertia(free.nominal, q))
    np.testing.assert_array_equal(bias(made.nominal, q, dq), bias(free.nominal, q, dq))
    original, runs = mujoco.MjModel.from_xml_string(text), []
    for model in (original, made.built.model, made.plant.model):
        data, rows = mujoco.MjData(model), []
        for step in range(500):
            data.ctrl[:] = math.sin(0.01 * step), 0.0
            mujoco.mj_step(model, data)
            rows.append(data.qpos.copy())
        runs.append(np.array(rows))
    np.testing.assert_array_equal(runs[0], runs[1])
    slip, free_slip = (np.abs(run[:, 0] - 2 * run[:, 1]).max() for run in runs[1:])
    assert slip < (0.01 if coupled == KINDS["stiff"] else 0.5) * free_slip


def test_a_law_holds_a_coupled_plant_where_that_agrees_in_both_engines() -> None:
    made = Robot.from_mjcf(TWO.format(SECOND, KINDS["compliant"]))
    weights = np.diag([100.0, 0.0, 100.0, 0.0])
    law = tracking_grosmc(made.task(setpoints(2, 2), Setpoints(0.4, 0.2), weights, 1.0), 10, 5)
    options: dict[str, Any] = {"control_period": 2e-3}
    runs = [
        simulate(made.built, law, np.zeros(4), duration=0.2, engine=engine, **options)
        for engine in ("native", "python")
    ]
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    end = simulate(made.built, law, np.zeros(4), duration=4.0, **options).state[-1]
    np.testing.assert_allclose(end[:2], [0.4, 0.2], atol=0.02)


@pytest.mark.parametrize(
    ("second", "constraint", "words"),
    [
        (SECOND, '<connect body1="a" body2="b" anchor="0 0 0"/>', r"constraints \(connect\)"),
        (SECOND, WELD, r"constraints \(weld\): they close loops"),
        ("", KINDS["stiff"], r"joint 'second' is coupled .* leave it out of joints"),
    ],
)
def test_a_constraint_that_no_torque_tells_of_is_refused(
    second: str, constraint: str, words: str
) -> None:
    with pytest.raises(ModelError, match=words) as refused:
        Robot.from_mjcf(TWO.format(second, constraint))
    assert "\n" not in str(refused.value)


def test_couplings_that_are_off_or_of_a_locked_joint_go_and_one_joint_may_be_held() -> None:
    off = Robot.from_mjcf(TWO.format(SECOND, WELD.replace("/>", ' active="false"/>')))
    assert off.built is off.plant
    alone = Robot.from_mjcf(TWO.format("", KINDS["stiff"]), joints=["first"])
    assert alone.built is alone.plant
    assert "left out: the coupling (equality) of 'first' and 'second'" in alone.notes
    held = '<joint joint1="first" polycoef="0.1 0 0 0 0" solref="-40 -2"/>'
    made = Robot.from_mjcf(TWO.format(SECOND, held))
    assert made.notes[0].startswith("the plant holds the joint 'first' (equality), which no")
