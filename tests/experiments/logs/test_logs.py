"""Cleaning of logs: what is used, turns of angles, late columns, commands of actuators."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from grosmc_mj.experiments.logs.log import Log
from grosmc_mj.experiments.logs.read import read_log
from grosmc_mj.experiments.logs.table import LogTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.theory.plants import find_system

SERVO = find_system("servo")
SAMPLING = 0.01
TIME = np.arange(400) * SAMPLING
CURRENT = np.sign(np.sin(7 * TIME + 0.1))
# More than two turns.
ANGLE = 4 * TIME + np.sin(3 * TIME)


def read(
    folder: Path,
    table: Mapping[str, Any],
    angle: Array = ANGLE,
    current: Array = CURRENT,
    gears: Mapping[str, float] | None = None,
) -> Log:
    """The log of these columns, read by a table of a case."""
    path = folder / "log.csv"
    rows = np.column_stack([TIME, current, angle])
    np.savetxt(path, rows, delimiter=",", header="time,current,rotor angle", comments="")
    return read_log(path, SERVO, LogTable.model_validate(table), gears)


def of_column(signal: str, **numbers: Any) -> dict[str, Any]:
    """A table that says how a column is read."""
    return {"columns": {signal: {"column": signal, **numbers}}}


WRAPPED = (ANGLE + np.pi) % (2 * np.pi) - np.pi


@pytest.mark.parametrize(("unit", "angle"), [("rad", WRAPPED), ("deg", np.degrees(WRAPPED))])
def test_a_periodic_angle_has_no_jumps(tmp_path: Path, unit: str, angle: Array) -> None:
    log = read(tmp_path, of_column("rotor angle", periodic=True, unit=unit), angle)
    assert log.states["rotor angle"] == pytest.approx(ANGLE)
    assert log.notes == []


def test_jumps_of_a_turn_are_noted_with_their_cure(tmp_path: Path) -> None:
    (note,) = read(tmp_path, {}, WRAPPED).notes
    assert re.fullmatch(
        r"rotor angle jumps by a turn, 2 times, first at 0\.\d+ s: write periodic = true into "
        r'\[log\.columns\."rotor angle"\]',
        note,
    )


def test_a_shaft_that_makes_a_turn_in_each_sample_does_not_jump(tmp_path: Path) -> None:
    assert read(tmp_path, {}, 2 * np.pi * np.arange(400)).notes == []


def test_a_window_is_used_and_others_are_masked(tmp_path: Path) -> None:
    table = {"use": ["1 s", "3 s"], "mask": [["1500 ms", "1.6 s"]]}
    log = read(tmp_path, table)
    assert log.pieces == [slice(100, 150), slice(161, 301)]


def test_shares_of_a_log_are_of_what_is_used(tmp_path: Path) -> None:
    log = read(tmp_path, {"use": ["1 s", "3 s"]})
    assert log.between(0.5, 1).pieces == [slice(201, 301)]


@pytest.mark.parametrize("delay", ["20 ms", "-20 ms"])
def test_a_late_column_shows_its_signal_at_its_time(tmp_path: Path, delay: str) -> None:
    late = 2 if delay == "20 ms" else -2
    shifted = np.roll(CURRENT, late)
    log = read(tmp_path, of_column("current", delay=delay), current=shifted)
    (piece,) = log.pieces
    assert log.inputs[piece, 0].tolist() == CURRENT[piece].tolist()
    assert piece.stop - piece.start == len(TIME) - 2


def test_a_late_state_is_read_between_its_samples(tmp_path: Path) -> None:
    ramp = 3 * (TIME - 0.004)
    log = read(tmp_path, of_column("rotor angle", delay="4 ms"), ramp)
    (piece,) = log.pieces
    assert log.states["rotor angle"][piece] == pytest.approx(3 * TIME[piece])


def test_commands_of_an_actuator_are_times_its_gear(tmp_path: Path) -> None:
    table = of_column("current", unit="control")
    log = read(tmp_path, table, gears={"current": 6.21})
    assert log.inputs[:, 0] == pytest.approx(6.21 * CURRENT)


PENDULUM = """
<mujoco>
  <worldbody>
    <body>
      <joint name="pivot" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.5" size="0.01" mass="1"/>
    </body>
  </worldbody>
  <actuator><general name="drive" joint="pivot" gear="5" gainprm="0.3"/></actuator>
</mujoco>
"""


def test_a_robot_has_the_torque_of_a_command() -> None:
    """Gear times gain."""
    assert dict(Robot.from_mjcf(PENDULUM).gears) == pytest.approx({"drive": 1.5})


REFUSED = [
    ({"use": ["3 s", "1 s"]}, "3 to 1 s must end after it begins"),
    ({"use": ["1 s", "2 rad"]}, '"2 rad" cannot be converted to s'),
    ({"use": [1, 2]}, '1 has no unit: write "1 s"'),
    ({"use": "1 s"}, "'1 s' must be two times"),
    ({"mask": [["1 s", "1 s"]]}, "1 to 1 s must end after it begins"),
    (
        {"mask": [["9 s", "10 s"]]},
        "[log] mask: 9 to 10 s holds no sample",
    ),
    ({"mask": [["0 s", "9 s"]]}, "leave no 3 samples in a row"),
    (of_column("rotor angle", delay="9 s"), "delays of [log], leave no 3 samples in a row"),
    ({"loss": "hubr"}, "'squares' or 'huber'"),
    (of_column("current", delay=0.01), '0.01 has no unit: write "0.01 s"'),
    (of_column("current", periodic=True), "current: periodic is for angles, not for A"),
    (of_column("current", periodic="yes"), "valid boolean"),
    (of_column("current", unit="control"), "current has no gear, which the unit 'control' is for"),
]


@pytest.mark.parametrize(("table", "words"), REFUSED)
def test_a_wrong_key_of_a_log_is_refused(tmp_path: Path, table: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=re.escape(words)):
        read(tmp_path, table)


# MATLAB files

SIGNALS = {"current": CURRENT, "rotor_angle": ANGLE}
MATLAB: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "vectors": ({"t": TIME, **SIGNALS}, {}),
    "columns": ({"t": TIME[:, None], **SIGNALS}, {}),
    "structure": ({"log": {"time": TIME, **SIGNALS}}, {}),
    "other lengths beside": ({"t": TIME, **SIGNALS, "gains": [1.0, 2.0], "name": "bench"}, {}),
    "matrix": (
        {"out": {"time": TIME, "values": np.column_stack([CURRENT, ANGLE])}},
        {
            "columns": {
                "current": {"column": "out.values(1)"},
                "rotor angle": {"column": "out.values(2)"},
            }
        },
    ),
}


@pytest.mark.usefixtures("reader_in_this_process")
@pytest.mark.parametrize(("content", "table"), MATLAB.values(), ids=MATLAB)
def test_a_matlab_file_is_read(
    tmp_path: Path, content: dict[str, Any], table: dict[str, Any]
) -> None:
    path = tmp_path / "log.mat"
    savemat(path, content)
    log = read_log(path, SERVO, LogTable.model_validate(table))
    assert log.time == pytest.approx(TIME)
    assert log.inputs[:, 0].tolist() == CURRENT.tolist()
    assert log.states["rotor angle"].tolist() == ANGLE.tolist()


@pytest.mark.usefixtures("reader_in_this_process")
def test_columns_of_other_lengths_than_the_time_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    savemat(path, {"t": TIME, "current": CURRENT[:-1], "rotor_angle": ANGLE})
    with pytest.raises(ArgumentError, match="current has 399 values, and the time 400"):
        read_log(path, SERVO, None)


@pytest.mark.usefixtures("reader_in_this_process")
@pytest.mark.parametrize("content", [b"", b"MATLAB 5.0", b"\0" * 200])
def test_a_damaged_matlab_file_is_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "log.mat"
    path.write_bytes(content)
    with pytest.raises(ArgumentError, match=r"log\.mat: it (cannot be read|has 0 rows)"):
        read_log(path, SERVO, None)


# Sensors


def measured(values: Array) -> Log:
    """A log of an angle with these values."""
    time = np.arange(len(values)) * SAMPLING
    return Log("log", time, 0 * time[:, None], {"angle": values}, [slice(0, len(values))])


def test_the_noise_of_a_moving_state_is_its_deviation_about_the_motion() -> None:
    """A parabola has no third differences; those of white noise have 20 times its variance."""
    t = np.linspace(0, 3, 20_000)
    noise = 0.03 * np.random.default_rng(1).standard_normal(len(t))
    log = measured(5 - 2 * t + 0.7 * t**2 + noise)
    assert log.noise("angle") == pytest.approx(0.03, rel=0.02)
    assert log.resolution("angle") == 0.0
    assert log.deviation("angle") == log.noise("angle")


def test_an_encoder_has_its_step_and_at_least_the_deviation_of_rounding() -> None:
    """On a slow way it repeats its values, and third differences show less than q/sqrt(12)."""
    log = measured(0.04 * np.round(np.linspace(0, 3, 20_000) ** 2))
    assert log.resolution("angle") == pytest.approx(0.04)
    assert log.noise("angle") < 0.04 / np.sqrt(12)
    assert log.deviation("angle") == pytest.approx(0.04 / np.sqrt(12))


def test_an_encoder_on_a_long_way_has_the_common_step_of_its_values() -> None:
    """It moves by up to 6 steps a sample, and nearly no value is there twice."""
    values = 0.02 * np.round(0.008 * np.arange(400) ** 2)
    log = measured(values)
    assert len(np.unique(values)) > 340
    assert log.resolution("angle") == pytest.approx(0.02)
