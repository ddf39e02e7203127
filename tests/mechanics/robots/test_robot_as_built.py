"""Robots as built: lags, delays and couplings, which no law knows."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import commands
import mujoco
import numpy as np
import pytest
from mjcf import DELAY, LAG, ONE, SECOND, STIFF, TWO

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.nominal import bias, inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

# Drives with lags and delays

IDEAL = '<motor name="drive" joint="hinge" gear="2" ctrlrange="-10 10"/>'
LIMITED_LAG = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gainprm="4" gear="-2" '
    'actlimited="true" actrange="-1 2" ctrlrange="-3 5"/>'
)
LAG_AND_DELAY = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gainprm="4" gear="-2" '
    'ctrlrange="-3 5" delay="0.012" nsample="15"/>'
)
SERVO = (
    '<position name="drive" joint="hinge" kp="30" kv="2" timeconst="0.02" gear="2" '
    'ctrlrange="-1 1" forcerange="-4 4"/>'
)
PID = '<pid name="drive" joint="hinge" kp="30" ki="4" kv="2" delay="0.012" nsample="15"/>'
FORCE_RANGE = " actuatorfrcrange='-2 3'"


@cache
def robot(actuator: str, joint: str = "") -> Robot:
    """A link with a drive.

    RK4 looks beyond an activation's limits within a step, and reads a delayed input there.
    """
    return Robot.from_mjcf(ONE.format(joint, actuator), integrator="implicitfast")


def torques(plant: MujocoPlant, u: float, steps: int, q: float = 0.0, v: float = 0.0) -> Array:
    """Torque of the drive at the hinge, held at a place and speed, after each step."""
    model = plant.model
    data = mujoco.MjData(model)
    data.ctrl[0] = u
    rows: list[float] = []
    for _ in range(steps):
        data.qpos[0] = q
        data.qvel[0] = v
        mujoco.mj_step(model, data)
        rows.append(data.qfrc_actuator[0])
    return np.array(rows)


LAG_NOTE = "the plant has a lag of 0.02 s, which no law knows"
DELAY_NOTE = "a delay of 0.012 s, which no law"
SERVO_NOTE = "within [-8, 8] N m instead of the position servo (kp 30, kv 2)"
each_drive = pytest.mark.parametrize(
    ("actuator", "joint"),
    [
        (LAG, ""),
        (DELAY, ""),
        (LAG_AND_DELAY, ""),
        (LIMITED_LAG, ""),
        (SERVO, ""),
        (PID, ""),
        (DELAY, FORCE_RANGE),
    ],
)
# Positions and speeds, neither of which pulls: a torque is no position.
each_position = pytest.mark.parametrize(("q", "v"), [(0.0, 0.0), (0.6, 3.0)])


@each_drive
def test_the_nominal_plant_is_ideal(actuator: str, joint: str) -> None:
    plant = robot(actuator, joint).plant
    assert plant.model.na == 0
    assert plant.hidden_states == ()


@each_drive
def test_a_drive_leaves_the_nominal_dynamics(actuator: str, joint: str) -> None:
    assert inertia(robot(actuator, joint).nominal, [0.2]) == inertia(robot(IDEAL).nominal, [0.2])


@pytest.mark.parametrize(
    ("actuator", "names"),
    [
        (LAG, ["drive lag"]),
        (DELAY, []),
        (LAG_AND_DELAY, ["drive lag"]),
        (LIMITED_LAG, ["drive lag"]),
        (SERVO, ["drive lag"]),
        (PID, []),
    ],
)
def test_a_lag_is_a_hidden_state(actuator: str, names: list[str]) -> None:
    assert [state.name for state in robot(actuator).built.hidden_states] == names


@pytest.mark.parametrize(
    ("actuator", "joint", "words"),
    [
        (LAG, "", f"{LAG_NOTE}; torque control within [-40, 24]"),
        (DELAY, "", DELAY_NOTE),
        (LAG_AND_DELAY, "", f"a lag of 0.02 s and {DELAY_NOTE}"),
        (LIMITED_LAG, "", LAG_NOTE),
        (SERVO, "", SERVO_NOTE),
        (PID, "", "position servo (kp 30"),
        (DELAY, FORCE_RANGE, DELAY_NOTE),
    ],
)
def test_a_note_says_what_no_law_knows(actuator: str, joint: str, words: str) -> None:
    note = robot(actuator, joint).notes[0]
    assert note.startswith("actuator 'drive': ")
    assert words in note


LIMITS = [
    (LAG, "", -40, 24),
    (DELAY, "", -20, 20),
    (LAG_AND_DELAY, "", -40, 24),
    (LIMITED_LAG, "", -16, 8),
    (SERVO, "", -8, 8),
    (DELAY, FORCE_RANGE, -2, 3),
]


@pytest.mark.parametrize(
    ("actuator", "joint", "low", "high"), [*LIMITS, (PID, "", -math.inf, math.inf)]
)
def test_limits_are_torques_whatever_they_were_limits_of(
    actuator: str, joint: str, low: float, high: float
) -> None:
    """A servo loses its own loop."""
    limits = robot(actuator, joint).plant.input_limits
    np.testing.assert_allclose(limits.T, [[low, high]], rtol=1e-12)


@each_position
@each_drive
def test_a_drive_gives_its_torque(actuator: str, joint: str, q: float, v: float) -> None:
    plants = robot(actuator, joint)
    assert torques(plants.plant, 1.5, 1, q, v)[0] == pytest.approx(1.5, rel=1e-12)
    assert torques(plants.built, 1.5, 400, q, v)[-1] == pytest.approx(1.5, rel=1e-6)


@each_position
@pytest.mark.parametrize(("actuator", "joint", "low", "high"), LIMITS)
def test_a_drive_gives_no_more_than_its_limits(
    actuator: str, joint: str, low: float, high: float, q: float, v: float
) -> None:
    built = robot(actuator, joint).built
    assert torques(built, 1e3, 400, q, v)[-1] == pytest.approx(high, rel=1e-6)
    assert torques(built, -1e3, 400, q, v)[-1] == pytest.approx(low, rel=1e-6)


@each_position
@pytest.mark.parametrize(
    ("actuator", "delay"), [(LAG, 0), (LAG_AND_DELAY, 12), (LIMITED_LAG, 0), (SERVO, 0)]
)
def test_a_torque_follows_by_its_lag_after_its_delay(
    actuator: str, delay: int, q: float, v: float
) -> None:
    rising = torques(robot(actuator).built, 1.5, 30, q, v)
    missing = 1.5 - rising[delay:]
    assert not rising[:delay].any()
    np.testing.assert_allclose(missing[1:] / missing[:-1], math.exp(-1e-3 / 0.02), rtol=1e-6)


@each_position
@pytest.mark.parametrize(("actuator", "joint"), [(DELAY, ""), (PID, ""), (DELAY, FORCE_RANGE)])
def test_a_torque_without_a_lag_steps_after_its_delay(
    actuator: str, joint: str, q: float, v: float
) -> None:
    rising = torques(robot(actuator, joint).built, 1.5, 30, q, v)
    assert not rising[:12].any()
    assert rising[12:].tolist() == [rising[-1]] * 18


# A case of a robot as built

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


@pytest.fixture
def case_file(tmp_path: Path) -> Path:
    (tmp_path / "arm.xml").write_text(ONE.format("", DELAY), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    return file


def test_a_case_runs_on_the_built_plant(case_file: Path) -> None:
    experiment = Experiment.load(case_file)
    read = experiment.nominal.robot
    assert read is not None
    assert experiment.plant("physics").digest == read.built.digest != read.plant.digest

    run = experiment.run("physics", "grosmc").trajectory
    law = experiment.law("physics", "grosmc")
    expected = simulate(read.built, law, [0.1, 0.0], duration=0.1)
    np.testing.assert_array_equal(run.state, expected.state)


def test_the_command_says_what_no_law_knows(
    case_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert commands.run("run", case_file, "--out", tmp_path, "--no-figures") == 0
    assert "which no law knows; torque control" in " ".join(capsys.readouterr().out.split())


# Couplings of joints

WELD = '<weld body1="a" body2="b"/>'
WELD_THAT_IS_OFF = '<weld body1="a" body2="b" active="false"/>'
CONNECT = '<connect body1="a" body2="b" anchor="0 0 0"/>'
HELD = '<joint joint1="first" polycoef="0.1 0 0 0 0" solref="-40 -2"/>'
COUPLED = TWO.format(SECOND, STIFF)


def waved(model: mujoco.MjModel, size: float, steps: int) -> Array:
    """Joints and torques under a sine at the first input."""
    data = mujoco.MjData(model)
    rows: list[list[float]] = []
    for step in range(steps):
        data.ctrl[0] = size * math.sin(0.02 * step)
        mujoco.mj_step(model, data)
        rows.append([*data.qpos, *data.qvel, *data.qfrc_actuator])
    return np.array(rows)


@pytest.fixture(scope="module")
def coupled() -> Robot:
    return Robot.from_mjcf(COUPLED)


@pytest.fixture(scope="module")
def free() -> Robot:
    return Robot.from_mjcf(TWO.format(SECOND, ""))


def test_the_built_plant_alone_has_a_coupling(coupled: Robot) -> None:
    assert coupled.plant.model.neq == 0
    assert coupled.nominal.neq == 0
    assert coupled.built.model.neq == 1


def test_a_note_says_that_no_law_knows_a_coupling(coupled: Robot, free: Robot) -> None:
    assert coupled.notes == (
        "the plant couples the joints 'first' and 'second' (equality), which no law knows: laws "
        "move each on its own",
        *free.notes,
    )


def test_a_coupling_leaves_the_nominal_dynamics(coupled: Robot, free: Robot) -> None:
    q = [0.2, -0.4]
    dq = [1.0, 0.3]
    np.testing.assert_array_equal(inertia(coupled.nominal, q), inertia(free.nominal, q))
    np.testing.assert_array_equal(bias(coupled.nominal, q, dq), bias(free.nominal, q, dq))


def test_the_built_plant_moves_as_the_model_that_was_read(coupled: Robot) -> None:
    original = mujoco.MjModel.from_xml_string(COUPLED)
    expected = waved(original, 1.0, 500)
    np.testing.assert_array_equal(waved(coupled.built.model, 1.0, 500), expected)


def test_a_coupling_keeps_its_joints_together(coupled: Robot) -> None:
    built = waved(coupled.built.model, 1.0, 500)
    plain = waved(coupled.plant.model, 1.0, 500)
    slip = np.abs(built[:, 0] - 2 * built[:, 1]).max()
    free_slip = np.abs(plain[:, 0] - 2 * plain[:, 1]).max()
    assert slip < 0.01 * free_slip


def test_a_coupling_that_is_off_goes() -> None:
    off = Robot.from_mjcf(TWO.format(SECOND, WELD_THAT_IS_OFF))
    assert off.built == off.plant


def test_a_coupling_of_a_locked_joint_goes() -> None:
    alone = Robot.from_mjcf(TWO.format("", STIFF), joints=["first"])
    assert alone.built == alone.plant
    assert "left out: the coupling (equality) of 'first' and 'second'" in alone.notes


def test_one_joint_may_be_held() -> None:
    note = Robot.from_mjcf(TWO.format(SECOND, HELD)).notes[0]
    assert note.startswith("the plant holds the joint 'first' (equality), which no")


# Refusals

LAG_OF_ZERO = '<general name="d" joint="hinge" dyntype="filter" dynprm="0"/>'
DAMPED = '<general name="d" joint="hinge" damping="0.1"/>'
DC_MOTOR = '<dcmotor name="d" joint="hinge" motorconst="0.05" resistance="2"/>'
DC_MOTOR_WORDS = (
    r"is a DC motor: make it a motor here, and give its winding in a \[\[motor\]\] table"
)
AFFINE_GAIN = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gaintype="affine" '
    'gainprm="4 1 0" gear="-2" ctrlrange="-3 5"/>'
)


@pytest.mark.parametrize(
    ("actuator", "words"),
    [
        (LAG_OF_ZERO, "has a lag of 0 s, which nothing can simulate"),
        (DAMPED, "damping of its own, which belongs to its jo"),
        (DC_MOTOR, DC_MOTOR_WORDS),
        (AFFINE_GAIN, "gain that depends on"),
    ],
)
def test_a_drive_that_no_torque_stands_for_is_refused(actuator: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(ONE.format("", actuator))


@pytest.mark.parametrize(
    ("second", "coupling", "words"),
    [
        (SECOND, CONNECT, r"constraints \(connect\)"),
        (SECOND, WELD, r"constraints \(weld\): they close loops"),
        ("", STIFF, r"joint 'second' is coupled .* leave it out of joints"),
    ],
)
def test_a_constraint_that_closes_a_loop_is_refused(second: str, coupling: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(TWO.format(second, coupling))
