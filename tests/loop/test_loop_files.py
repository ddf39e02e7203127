"""Loops in files: what a case file says of one, and what a file of signals keeps of its run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from looped import H

import grosmc_mj as gm
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.sweep.runs import Row, run_rows

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
law = "levant"
slope = "20 rad/s^2"
settled = false

[[actuator]]
of = "current"
delay = "0.5 ms"
resolution = "1 mA"
limit = "4 A"
rate_limit = "100 A/s"
lag = "2 ms"
order = 2
dead_zone = "5 mA"
"""


def written(folder: Path, *parts: str) -> Path:
    file = folder / "case.toml"
    file.write_text("".join((CASE, *parts)), encoding="utf-8")
    return file


def test_a_file_says_all_there_is_to_a_loop(tmp_path: Path) -> None:
    file = written(tmp_path, 'control_period = "1 ms"\ntimestep = "0.5 ms"\n', PARTS, PLAIN)
    loop = Experiment.load(file).case.loop
    assert loop is not None
    (sensor,) = loop.sensors
    assert sensor.resolution == pytest.approx(np.pi / 1800)
    assert loop.changed("sensor", "rotor angle", resolution=1.0) == Loop(
        Computing(delay=2 * H, jitter=0.5 * H, missed=0.1),
        (Sensor("rotor angle", 1.0, noise=H, bias=-H, drift=H, delay=H),),
        (Estimator(("rotor speed",), "levant", slope=20.0, settled=False),),
        (
            Actuator("current", 0.5 * H, H, limit=4.0, rate_limit=100.0, lag=2 * H, order=2,
                     dead_zone=5 * H),
        ),
        seed=7,
    )  # fmt: skip
    # Counts of an encoder are its steps in a turn.
    sensor = '[[sensor]]\nof = "rotor angle"\ncounts = 1024\n'
    loop = Experiment.load(written(tmp_path, sensor, PLAIN)).case.loop
    assert loop is not None
    assert loop.sensors == (Sensor("rotor angle", resolution=2 * np.pi / 1024),)


MISTAKES = [
    ('[[sensor]]\nof = "rotor angle"\ncounts = 10\nresolution = "1 deg"\n',
     "sensor 1: counts and resolution are the same number"),
    ('[[sensor]]\nof = "rotor speed"\ncounts = 10\n', "counts: rotor speed is no angle"),
    (f"{PLAIN}predict = true\n", "controller lqr: predict: there is no loop that it could know"),
    ('[[actuator]]\nof = "current"\nrate_limit = "1 A"\n', "actuator 1: rate_limit: .*A/s"),
    # All at once.
    ('[computing]\nmissed = 1\n[[actuator]]\nof = "current"\nlimit = "0 A"\norder = 1\n'
     '[[sensor]]\nof = "rotor angle"\nnoise = "1 s"\n',
     "(?s)missed = 1.*sensor 1: noise.*limit = 0"),
    ('[computing]\ndelay = "1.5 ms"\n[[sensor]]\nof = "rotor angle"\nperiod = "0.3 ms"\n',
     "(?s)delay = 0.0015 s.*period = 0.0003 s"),
]  # fmt: skip


@pytest.mark.parametrize(("parts", "words"), MISTAKES)
def test_mistakes_are_told_with_the_file(parts: str, words: str, tmp_path: Path) -> None:
    file = written(tmp_path, parts, "" if PLAIN in parts else PLAIN)
    with pytest.raises(ArgumentError, match=words) as refused:
        Experiment.load(file)
    assert str(refused.value).startswith(str(file))


@pytest.mark.slow
def test_measurements_and_commands_are_kept_in_files(tmp_path: Path) -> None:
    run = Experiment.load("servo/bench").varied(duration=0.05).run("physics", "implicit, predicted")
    found = gm.load_trajectory(run.save(tmp_path / "run.parquet"))
    pairs: Any = (
        (found.seen, run.trajectory.seen, found.state[:-1]),
        (found.command, run.trajectory.command, found.input),
    )
    for kept, own, true in pairs:
        np.testing.assert_array_equal(kept, own)
        assert not np.array_equal(kept, true)
    schema = run.trajectory.to_arrow().schema
    assert schema.field("rotor angle seen").metadata[b"unit"] == b"rad"
    assert not [name for name in schema.names if "loop" in name]


NOISY = """
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
PREDICTING = '[[controller]]\nlaw = "lqr"\npredict = true\n'


def test_the_run_of_a_file_has_the_noise_of_that_run_of_a_batch(tmp_path: Path) -> None:
    looped = Experiment.load(written(tmp_path, NOISY, PLAIN))
    without_run = Experiment.load(written(tmp_path, NOISY.replace("run = 3", ""), PLAIN))
    batch = run_rows(without_run, [Row("lqr", number=number) for number in range(4)])
    alone = run_rows(looped, [Row("lqr")])
    state = looped.run("physics", "lqr").trajectory.state[-1]
    assert np.array_equal(alone["last"][0], batch["last"][3])
    assert np.array_equal(state, batch["last"][3])
    assert len(np.unique(batch["last"], axis=0)) == 4


def delays_of(file: Path) -> tuple[float, float]:
    """True delay of the computer, and the dead time that LQR knows, in timesteps."""
    law = Experiment.load(file).law("physics", "lqr")
    assert law.loop is not None
    (computer,) = law.loop.start.computer
    return computer["delay"], computer["dead"]


def test_a_predicting_law_knows_the_loop_that_the_file_names(tmp_path: Path) -> None:
    known = '[known_loop]\ncomputing = { delay = "3 ms" }\n'
    # The true loop delays by the computer and the actuator, the known one by its computer alone.
    assert delays_of(written(tmp_path, NOISY, PREDICTING)) == (1, 2)
    assert delays_of(written(tmp_path, NOISY, known, PREDICTING)) == (1, 3)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ((NOISY.replace("run = 3", "run = -1"), PLAIN), "computing: run = -1 must be"),
        (
            (NOISY, '[known_loop]\ncomputing = { delay = "3 ms" }\n', PLAIN),
            "known_loop: no controller has predict = true, so none knows its loop",
        ),
        (
            (NOISY, '[known_loop]\nsensor = [{ of = "rotor angel" }]\n', PREDICTING),
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
