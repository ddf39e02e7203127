"""Robots as built: lags, delays and couplings, which no law knows."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cases
import commands
import mujoco
import numpy as np
import pytest
from mjcf import DELAY, LAG, ONE, SECOND, STIFF, TWO

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.nominal import inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

# Drives with lags and delays.

LIMITED_LAG = (
    '<general name="drive" joint="hinge" dyntype="filterexact" dynprm="0.02" gainprm="4" gear="-2" '
    'actlimited="true" actrange="-1 2" ctrlrange="-3 5"/>'
)
LAG_AND_DELAY = LAG.replace("/>", ' delay="0.012" nsample="15"/>')
SERVO = (
    '<position name="drive" joint="hinge" kp="30" kv="2" timeconst="0.02" gear="2" '
    'ctrlrange="-1 1" forcerange="-4 4"/>'
)
PID = '<pid name="drive" joint="hinge" kp="30" ki="4" kv="2" delay="0.012" nsample="15"/>'


class Drive(NamedTuple):
    """A drive of a link, whose lag is 20 ms if it has one.

    Attributes:
        actuator: Its element.
        note: Words on it.
        low: Least torque [N m].
        high: Largest torque [N m].
        delay: Delay of its torque [ms].
        lags: Whether it has a lag.
        joint: Further attributes of the joint.
    """

    actuator: str
    note: str
    low: float
    high: float
    delay: int = 0
    lags: bool = False
    joint: str = ""


LAG_NOTE = "the plant has a lag of 0.02 s, which no law knows"
DELAY_NOTE = "a delay of 0.012 s, which no law"
SERVO_NOTE = "within [-8, 8] N m instead of the position servo (kp 30, kv 2)"
LAG_IN_LIMITS = f"{LAG_NOTE}; torque control within [-40, 24]"
FORCE_RANGE = " actuatorfrcrange='-2 3'"
DRIVES = {
    "lag": Drive(LAG, LAG_IN_LIMITS, -40, 24, lags=True),
    "delay": Drive(DELAY, DELAY_NOTE, -20, 20, delay=12),
    "both": Drive(LAG_AND_DELAY, f"a lag of 0.02 s and {DELAY_NOTE}", -40, 24, 12, lags=True),
    "limited lag": Drive(LIMITED_LAG, LAG_NOTE, -16, 8, lags=True),
    "servo": Drive(SERVO, SERVO_NOTE, -8, 8, lags=True),
    "pid": Drive(PID, "position servo (kp 30", -math.inf, math.inf, delay=12),
    "range of the joint": Drive(DELAY, DELAY_NOTE, -2, 3, delay=12, joint=FORCE_RANGE),
}
each_drive = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
# Positions and speeds, neither of which pulls: a torque is no position.
each_position = pytest.mark.parametrize(("q", "v"), [(0.0, 0.0), (0.6, 3.0)])


@cache
def robot(drive: Drive) -> Robot:
    """A link with a drive.

    RK4 looks beyond an activation's limits within a step, and reads a delayed input there.
    """
    return Robot.from_mjcf(ONE.format(drive.joint, drive.actuator), integrator="implicitfast")


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


@each_drive
def test_the_nominal_plant_has_an_ideal_torque_within_the_drive_s_limits(drive: Drive) -> None:
    """Whatever they were limits of; a servo loses its own loop."""
    plant = robot(drive).plant
    assert plant.hidden_states == ()
    np.testing.assert_allclose(plant.input_limits.T, [[drive.low, drive.high]], rtol=1e-12)
    assert torques(plant, 1.5, 1, q=0.6, v=3.0)[0] == pytest.approx(1.5, rel=1e-12)
    ideal = Robot.from_mjcf(ONE.format("", '<motor name="drive" joint="hinge"/>'))
    assert inertia(robot(drive).nominal, [0.2]) == inertia(ideal.nominal, [0.2])


@each_drive
def test_a_note_says_what_no_law_knows_and_a_lag_is_a_hidden_state(drive: Drive) -> None:
    note = robot(drive).notes[0]
    assert note.startswith("actuator 'drive': ")
    assert drive.note in note
    names = [state.name for state in robot(drive).built.hidden_states]
    assert names == ["drive lag"] * drive.lags


@each_position
@each_drive
def test_a_drive_gives_its_torque_within_its_limits(drive: Drive, q: float, v: float) -> None:
    built = robot(drive).built
    assert torques(built, 1.5, 400, q, v)[-1] == pytest.approx(1.5, rel=1e-6)
    if math.isfinite(drive.high):
        assert torques(built, 1e3, 400, q, v)[-1] == pytest.approx(drive.high, rel=1e-6)
        assert torques(built, -1e3, 400, q, v)[-1] == pytest.approx(drive.low, rel=1e-6)


@each_position
@each_drive
def test_a_torque_follows_after_its_delay_by_its_lag(drive: Drive, q: float, v: float) -> None:
    rising = torques(robot(drive).built, 1.5, 30, q, v)
    assert not rising[: drive.delay].any()
    if not drive.lags:
        assert rising[drive.delay :].tolist() == [rising[-1]] * (30 - drive.delay)
        return
    missing = 1.5 - rising[drive.delay :]
    np.testing.assert_allclose(missing[1:] / missing[:-1], math.exp(-1e-3 / 0.02), rtol=1e-6)


def test_a_case_runs_on_the_built_plant_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format("", DELAY), encoding="utf-8")
    file = cases.write(
        tmp_path,
        "arm.xml",
        run={"start": {"hinge": "0.1 rad"}, "engine": "python"},
        task={"reference": ["0.3"], "Q": [100, 0], "R": 1},
        controller=[{"law": "grosmc", "k": 10, "epsilon": 5}],
    )
    experiment = Experiment.load(file)
    read = experiment.nominal.robot
    assert read is not None
    assert experiment.plant("physics").digest == read.built.digest != read.plant.digest

    run = experiment.run("physics", "grosmc").trajectory
    law = experiment.law("physics", "grosmc")
    expected = simulate(read.built, law, [0.1, 0.0], duration=0.02, engine="python")
    np.testing.assert_array_equal(run.state, expected.state)
    commands.run("run", file, "--out", tmp_path, "--no-figures")
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


def test_the_built_plant_alone_has_a_coupling(coupled: Robot, free: Robot) -> None:
    assert coupled.built.model.neq == 1
    assert coupled.plant.model.neq == 0
    assert coupled.nominal.neq == 0
    q = [0.2, -0.4]
    np.testing.assert_array_equal(inertia(coupled.nominal, q), inertia(free.nominal, q))
    assert coupled.notes == (
        "the plant couples the joints 'first' and 'second' (equality), which no law knows: laws "
        "move each on its own",
        *free.notes,
    )


def test_the_built_plant_moves_as_the_model_that_was_read(coupled: Robot) -> None:
    original = mujoco.MjModel.from_xml_string(COUPLED)
    built = waved(coupled.built.model, 1.0, 500)
    np.testing.assert_array_equal(built, waved(original, 1.0, 500))
    # Its joints keep together.
    free_slip = np.ptp(waved(coupled.plant.model, 1.0, 500)[:, :2] @ [1, -2])
    assert np.ptp(built[:, :2] @ [1, -2]) < 0.01 * free_slip


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
