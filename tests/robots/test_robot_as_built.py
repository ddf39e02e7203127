"""Robots as built: lags, delays and couplings, which no law knows."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import commands
import mujoco
import numpy as np
import pytest
from mjcf import DELAY, LAG, ONE, SECOND, STIFF, TWO

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

IDEAL = '<motor name="drive" joint="hinge" gear="2" ctrlrange="-10 10"/>'
LIMITED = LAG.replace("ctrlrange", 'actlimited="true" actrange="{}" ctrlrange')
SERVO = (
    '<position name="drive" joint="hinge" kp="30" kv="2" timeconst="0.02" gear="2" '
    'ctrlrange="-1 1" forcerange="-4 4"/>'
)


@cache
def robot(actuator: str, joint: str = "", integrator: Any = None) -> Robot:
    return Robot.from_mjcf(ONE.format(joint, actuator), integrator=integrator)


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


def waved(model: mujoco.MjModel, size: float, steps: int) -> Array:
    """Joints and torques under a sine at the first input."""
    data, rows = mujoco.MjData(model), []
    for step in range(steps):
        data.ctrl[0] = size * math.sin(0.02 * step)
        mujoco.mj_step(model, data)
        rows.append([*data.qpos, *data.qvel, *data.qfrc_actuator])
    return np.array(rows)


PID = '<pid name="drive" joint="hinge" kp="30" ki="4" kv="2" delay="0.012" nsample="15"/>'
LAGS = "the plant has a lag of 0.02 s, which no law knows"
DELAYS = "a delay of 0.012 s, which no law"
BOTH = LAG.replace("/>", ' delay="0.012" nsample="15"/>')


@pytest.mark.parametrize(
    ("actuator", "joint", "low", "high", "words"),
    [
        (LAG, "", -40, 24, f"{LAGS}; torque control within [-40, 24]"),
        (DELAY, "", -20, 20, DELAYS),
        (BOTH, "", -40, 24, f"a lag of 0.02 s and {DELAYS}"),
        (LIMITED.format("-1 2"), "", -16, 8, LAGS),
        (SERVO, "", -8, 8, "within [-8, 8] N m instead of the position servo (kp 30, kv 2)"),
        (PID, "", -math.inf, math.inf, "position servo (kp 30"),
        (DELAY, " actuatorfrcrange='-2 3'", -2, 3, DELAYS),
    ],
)  # fmt: skip
def test_a_drive_gives_its_torque_in_its_limits_after_its_lag_or_delay(
    actuator: str, joint: str, low: float, high: float, words: str
) -> None:
    """Limits are torques whatever they were limits of; a servo loses its own loop.

    RK4 looks beyond an activation's limits within a step, and reads a delayed input there.
    """
    one, u = robot(actuator, joint, integrator="implicitfast"), 1.5
    # The nominal plant is ideal, and laws know nothing else.
    assert (one.plant.model.na, one.plant.hidden_states) == (0, ())
    names = [state.name for state in one.built.hidden_states]
    lagged = "dyntype" in actuator or "timeconst" in actuator
    assert names == (["drive lag"] if lagged else [])
    mine, ideal = (inertia(which.nominal, [0.2]) for which in (one, robot(IDEAL)))
    assert mine == ideal
    assert one.notes[0].startswith("actuator 'drive': ")
    assert words in one.notes[0]
    np.testing.assert_allclose(one.plant.input_limits.T, [[low, high]], rtol=1e-12)
    demands = ((u, u), (1e3, high), (-1e3, low)) if math.isfinite(high) else ((u, u),)
    # Neither place nor speed pulls, and a torque is not a place.
    for q, v in ((0.0, 0.0), (0.6, 3.0)):
        assert torques(one.plant, u, 1, q, v)[0] == pytest.approx(u, rel=1e-12)
        for demand, end in demands:
            assert torques(one.built, demand, 400, q, v)[-1] == pytest.approx(end, rel=1e-6)
        first, late = torques(one.built, u, 30, q, v), 12 if "delay" in actuator else 0
        assert not first[:late].any()
        if lagged:
            left = u - first[late:]
            np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-1e-3 / 0.02), rtol=1e-6)
        else:
            assert first[late:].tolist() == [first[-1]] * (30 - late)


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


def test_a_file_runs_on_the_built_plant_and_says_what_no_law_knows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format("", DELAY), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    experiment = Experiment.load(file)
    one, physics = experiment.nominal.robot, experiment.plant("physics")
    assert one is not None
    assert physics.digest == one.built.digest != one.plant.digest
    run = experiment.run("physics", "grosmc").trajectory
    same = simulate(one.built, experiment.law("physics", "grosmc"), [0.1, 0.0], duration=0.1)
    np.testing.assert_array_equal(run.state, same.state)
    assert commands.run("run", file, "--out", tmp_path, "--no-figures") == 0
    assert "which no law knows; torque control" in " ".join(capsys.readouterr().out.split())


WELD = '<weld body1="a" body2="b"/>'


def test_coupled_joints_are_the_plants_and_no_laws() -> None:
    text = TWO.format(SECOND, STIFF)
    one, free = Robot.from_mjcf(text), Robot.from_mjcf(TWO.format(SECOND, ""))
    assert (one.plant.model.neq, one.nominal.neq, one.built.model.neq) == (0, 0, 1)
    assert one.notes == (
        "the plant couples the joints 'first' and 'second' (equality), which no law knows: laws "
        "move each on its own",
        *free.notes,
    )
    q, dq = [0.2, -0.4], [1.0, 0.3]
    np.testing.assert_array_equal(inertia(one.nominal, q), inertia(free.nominal, q))
    np.testing.assert_array_equal(bias(one.nominal, q, dq), bias(free.nominal, q, dq))
    original = mujoco.MjModel.from_xml_string(text)
    theirs, built, plain = (
        waved(model, 1.0, 500) for model in (original, one.built.model, one.plant.model)
    )
    np.testing.assert_array_equal(theirs, built)
    slip, free_slip = (np.abs(run[:, 0] - 2 * run[:, 1]).max() for run in (built, plain))
    assert slip < 0.01 * free_slip


def test_couplings_that_are_off_or_of_a_locked_joint_go_and_one_joint_may_be_held() -> None:
    off = Robot.from_mjcf(TWO.format(SECOND, WELD.replace("/>", ' active="false"/>')))
    alone = Robot.from_mjcf(TWO.format("", STIFF), joints=["first"])
    assert (off.built, alone.built) == (off.plant, alone.plant)
    assert "left out: the coupling (equality) of 'first' and 'second'" in alone.notes
    held = '<joint joint1="first" polycoef="0.1 0 0 0 0" solref="-40 -2"/>'
    note = Robot.from_mjcf(TWO.format(SECOND, held)).notes[0]
    assert note.startswith("the plant holds the joint 'first' (equality), which no")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((ONE.format("", actuator), words) for actuator, words in (
            ('<general name="d" joint="hinge" dyntype="filter" dynprm="0"/>',
             "has a lag of 0 s, which nothing can simulate"),
            ('<general name="d" joint="hinge" damping="0.1"/>',
             "damping of its own, which belongs to its jo"),
            ('<dcmotor name="d" joint="hinge" motorconst="0.05" resistance="2"/>',
             r"is a DC motor: make it a motor here, and give its winding in a \[\[motor\]\] table"),
            (LAG.replace('gainprm="4"', 'gaintype="affine" gainprm="4 1 0"'),
             "gain that depends on"),
        )),
        (TWO.format(SECOND, '<connect body1="a" body2="b" anchor="0 0 0"/>'),
         r"constraints \(connect\)"),
        (TWO.format(SECOND, WELD), r"constraints \(weld\): they close loops"),
        (TWO.format("", STIFF), r"joint 'second' is coupled .* leave it out of joints"),
    ],
)  # fmt: skip
def test_drives_and_constraints_that_no_torque_stands_for_are_refused(
    text: str, words: str
) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(text)
