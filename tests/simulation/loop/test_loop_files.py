"""Loops in case files, and their runs in files of signals."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from looped import H

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.studies.sweep.runs import Row, run_rows

CASE = """
title = "a loop"
plant.system = "servo"
task = { reference = ["1"], sign = -1, Q = [1, 1], R = 1 }

[run]
duration = "0.1 s"
"""
PLAIN = """
[[controller]]
law = "lqr"
"""
PARTS = """
[computing]
delay = "2 ms"
jitter = "0.5 ms"
missed = 0.1
seed = 7

[[sensor]]
of = "rotor angle"
resolution = "0.1 deg"
noise = "1 mrad"
bias = "-1 mrad"
drift = "1 mrad/s"
delay = "1 ms"

[[estimator]]
of = "rotor speed"
law = "eso"
bandwidth = "20 rad/s"
settled = false

[[actuator]]
of = "current"
delay = "0.5 ms"
gain = 1.2
resolution = "1 mA"
limit = "4 A"
rate_limit = "100 A/s"
lag = "2 ms"
order = 2
dead_zone = "5 mA"
"""


def written(folder: Path, *parts: str) -> Path:
    """A case file of these parts."""
    file = folder / "case.toml"
    file.write_text("".join((CASE, *parts)), encoding="utf-8")
    return file


def loop_of(file: Path) -> Loop:
    loop = Experiment.load(file).loop
    assert loop is not None
    return loop


PERIODS = """control_period = "1 ms"
timestep = "0.5 ms"
"""


def test_a_file_says_all_there_is_to_a_loop(tmp_path: Path) -> None:
    loop = loop_of(written(tmp_path, PERIODS, PARTS, PLAIN))
    (sensor,) = loop.sensors
    assert sensor.resolution == pytest.approx(np.pi / 1800)

    sensor = Sensor("rotor angle", 1.0, noise=H, bias=-H, drift=H, delay=H)
    estimator = Estimator(("rotor speed",), "eso", bandwidth=20.0, settled=False)
    actuator = Actuator(
        "current",
        delay=0.5 * H,
        gain=1.2,
        resolution=H,
        limit=4.0,
        rate_limit=100.0,
        lag=2 * H,
        order=2,
        dead_zone=5 * H,
    )
    expected = Loop(
        Computing(delay=2 * H, jitter=0.5 * H, missed=0.1),
        (sensor,),
        (estimator,),
        (actuator,),
        seed=7,
    )
    assert loop.changed("sensor", "rotor angle", resolution=1.0) == expected


ENCODER = """
[[sensor]]
of = "rotor angle"
counts = 1024
"""


def test_counts_of_an_encoder_are_its_steps_in_a_turn(tmp_path: Path) -> None:
    loop = loop_of(written(tmp_path, ENCODER, PLAIN))
    assert loop.sensors == (Sensor("rotor angle", resolution=2 * np.pi / 1024),)


COUNTS_AND_RESOLUTION = """
[[sensor]]
of = "rotor angle"
counts = 10
resolution = "1 deg"
"""
COUNTS_OF_A_SPEED = """
[[sensor]]
of = "rotor speed"
counts = 10
"""
RATE_IN_AMPERE = """
[[actuator]]
of = "current"
rate_limit = "1 A"
"""
THREE_MISTAKES = """
[computing]
missed = 1
[[actuator]]
of = "current"
limit = "0 A"
order = 1
[[sensor]]
of = "rotor angle"
noise = "1 s"
"""
TWO_WRONG_TIMES = """
[computing]
delay = "1.5 ms"
[[sensor]]
of = "rotor angle"
period = "0.3 ms"
"""
PREDICTING = """
[[controller]]
law = "lqr"
predict = true
"""


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        (
            (COUNTS_AND_RESOLUTION, PLAIN),
            "sensor 1: counts and resolution are the same number",
        ),
        ((COUNTS_OF_A_SPEED, PLAIN), "counts: rotor speed is no angle"),
        ((PREDICTING,), "controller lqr: predict: there is no loop that it could know"),
        ((RATE_IN_AMPERE, PLAIN), "actuator 1: rate_limit: .*A/s"),
        # All at once.
        ((THREE_MISTAKES, PLAIN), "(?s)missed = 1.*sensor 1: noise.*limit = 0"),
        ((TWO_WRONG_TIMES, PLAIN), "(?s)delay = 0.0015 s.*period = 0.0003 s"),
    ],
)
def test_mistakes_are_told_with_the_file(
    parts: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    file = written(tmp_path, *parts)
    with pytest.raises(ArgumentError, match=words) as refused:
        Experiment.load(file)
    assert str(refused.value).startswith(str(file))


@cache
def short_bench_run() -> RunResult:
    experiment = Experiment.load("servo/bench").changed(duration=0.05)
    return experiment.run("physics", "implicit, predicted")


@pytest.mark.slow
def test_measurements_are_kept_in_files(tmp_path: Path) -> None:
    loaded = gm.load_trajectory(short_bench_run().save(tmp_path / "run.parquet"))
    np.testing.assert_array_equal(loaded.seen, short_bench_run().trajectory.seen)
    assert loaded.seen is not None
    assert not np.array_equal(loaded.seen, loaded.state[:-1])


@pytest.mark.slow
def test_commands_are_kept_in_files(tmp_path: Path) -> None:
    loaded = gm.load_trajectory(short_bench_run().save(tmp_path / "run.parquet"))
    np.testing.assert_array_equal(loaded.command, short_bench_run().trajectory.command)
    assert not np.array_equal(loaded.command, loaded.input)


@pytest.mark.slow
def test_a_column_of_measurements_says_its_unit() -> None:
    schema = short_bench_run().trajectory.to_arrow().schema
    assert schema.field("rotor angle seen").metadata[b"unit"] == b"rad"
    assert not [name for name in schema.names if "loop" in name]


NOISY = """
[computing]
delay = "1 ms"
seed = 7
[[sensor]]
of = "rotor angle"
noise = "1 mrad"
[[actuator]]
of = "current"
delay = "1 ms"
"""
NOISY_RUN_3 = """
[computing]
delay = "1 ms"
seed = 7
run = 3
[[sensor]]
of = "rotor angle"
noise = "1 mrad"
[[actuator]]
of = "current"
delay = "1 ms"
"""


def test_the_run_of_a_file_has_the_noise_of_that_run_of_a_batch(tmp_path: Path) -> None:
    without_run = Experiment.load(written(tmp_path, NOISY, PLAIN))
    rows = [Row("lqr", number=number) for number in range(4)]
    ends = run_rows(without_run, rows)["last"]
    assert len(np.unique(ends, axis=0)) == 4

    third = Experiment.load(written(tmp_path, NOISY_RUN_3, PLAIN))
    np.testing.assert_array_equal(run_rows(third, [Row("lqr")])["last"][0], ends[3])
    run = third.run("physics", "lqr").trajectory
    np.testing.assert_array_equal(run.state[-1], ends[3])


def delays_of(file: Path) -> tuple[float, float]:
    """True delay of the computer, and the dead time that LQR knows, in timesteps."""
    loop = Experiment.load(file).applied_loop("physics", "lqr")
    assert loop is not None
    (computer,) = loop.start.world.computer
    (setup,) = loop.start.software.setup
    return computer["delay"], setup["dead"]


KNOWN_LOOP = """
[known_loop]
computing = { delay = "3 ms" }
"""


def test_a_predicting_law_knows_the_true_loop(tmp_path: Path) -> None:
    """It delays by the computer and the actuator."""
    assert delays_of(written(tmp_path, NOISY, PREDICTING)) == (1, 2)


def test_a_predicting_law_knows_the_loop_that_the_file_names(tmp_path: Path) -> None:
    """It delays by its computer alone."""
    assert delays_of(written(tmp_path, NOISY, KNOWN_LOOP, PREDICTING)) == (1, 3)


NEGATIVE_RUN = """
[computing]
run = -1
"""
UNKNOWN_STATE = """
[known_loop]
sensor = [{ of = "rotor angel" }]
"""


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((NEGATIVE_RUN, PLAIN), "computing: run = -1 must be"),
        (
            (NOISY, KNOWN_LOOP, PLAIN),
            "known_loop: no controller has predict = true, so none knows its loop",
        ),
        (
            (NOISY, UNKNOWN_STATE, PREDICTING),
            "sensor: unknown state 'rotor angel': did you mean 'rotor angle'?",
        ),
    ],
)
def test_a_wrong_run_or_known_loop_is_refused(
    parts: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError) as refused:
        Experiment.load(written(tmp_path, *parts))
    assert words in str(refused.value)
