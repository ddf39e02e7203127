"""Loops in files: what a case file says of one, and what a file of signals keeps of its run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from looped import H, seen

import grosmc_mj as gm
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.document import experiment_document
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor

CASE = """
title = "a loop"

[plant]
system = "servo"

[task]
reference = ["1"]
sign = -1
Q = [1, 1]
R = 1

[run]
duration = "0.1 s"
"""
PREDICTED = """
[[controller]]
law = "lqr"
predict = true
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


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ((PREDICTED,), "controller lqr: predict: there is no loop that it could know"),
        (('[computing]\ndelay = "2 mm"\n', PLAIN), "computing: delay: .*mm"),
        (('[[sensor]]\nof = "rotor angle"\nnoise = "1 A"\n', PLAIN), "sensor 1: noise: .*A"),
        (
            ('[[actuator]]\nof = "current"\nrate_limit = "1 A"\n', PLAIN),
            "actuator 1: rate_limit: .*A/s",
        ),
        (
            ('[[sensor]]\nof = "rotor angel"\nnoise = "1 mrad"\n', PLAIN),
            "sensor 1: unknown state 'rotor angel': did you mean 'rotor angle'",
        ),
        (('[computing]\ndelay = "1.5 ms"\n', PLAIN), "computing: delay = 0.0015 s is no multiple"),
        (('[computing]\ndely = "1 ms"\n', PLAIN), "dely.*did you mean.*delay"),
        (("[computing]\nseed = 1.0\n", PLAIN), r"computing: seed = 1\.0 must be a whole number"),
        (('[computing]\nseed = "1"\n', PLAIN), "computing: seed = '1' must be a whole number"),
        (
            ('[[actuator]]\nof = "current"\norder = true\n', PLAIN),
            "actuator 1: order = True must be a whole number",
        ),
        (('[[estimator]]\nof = "rotor speed"\nlaw = "eso"\n', PLAIN), "eso needs bandwidth"),
        (
            ('[[estimator]]\nof = "rotor angle"\n', PLAIN),
            "controller lqr: estimator: difference gives a rate",
        ),
    ],
)
def test_a_mistake_is_one_line_with_the_file(
    parts: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    file = written(tmp_path, *parts)
    with pytest.raises(ArgumentError, match=said) as told:
        Experiment.load(file)
    assert str(told.value).startswith(str(file))
    assert "\n" not in str(told.value)


def test_two_mistakes_are_told_at_once(tmp_path: Path) -> None:
    """A number of a part that cannot be and one of another; what does not fit the plant too."""
    wrong = (
        '[computing]\nmissed = 1\n[[actuator]]\nof = "current"\nlimit = "0 A"\norder = 1\n'
        '[[sensor]]\nof = "rotor angle"\nnoise = "1 s"\n'
    )
    with pytest.raises(ArgumentError) as told:
        Experiment.load(written(tmp_path, wrong, PLAIN))
    for said in ("missed = 1", "limit = 0", "sensor 1: noise"):
        assert said in str(told.value)
    misfit = '[computing]\ndelay = "1.5 ms"\n[[sensor]]\nof = "rotor angle"\nperiod = "0.3 ms"\n'
    with pytest.raises(ArgumentError) as told:
        Experiment.load(written(tmp_path, misfit, PLAIN))
    for said in ("delay = 0.0015 s", "period = 0.0003 s"):
        assert said in str(told.value)


@pytest.mark.parametrize(("parts", "seed"), [((PARTS, PLAIN), 7), ((PLAIN,), None)])
def test_the_document_of_runs_has_the_seed_of_the_loop(
    parts: tuple[str, ...], seed: int | None, tmp_path: Path
) -> None:
    made = Experiment.load(written(tmp_path, 'timestep = "0.5 ms"\n', *parts))
    assert experiment_document(made, [], [], complete=True)["seed"] == seed


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".parquet", ".npz"])
def test_what_a_law_saw_is_kept_in_files(ending: str, tmp_path: Path) -> None:
    run = Experiment.load("servo/bench").varied(duration=0.05).run("physics", "implicit, predicted")
    found = gm.load_trajectory(run.save(tmp_path / f"run{ending}"))
    np.testing.assert_array_equal(seen(found), seen(run.trajectory))
    assert not np.array_equal(seen(found), found.state[:-1])
    np.testing.assert_array_equal(found.command, run.trajectory.command)
    assert not np.array_equal(found.command, found.input)
    columns = run.trajectory.to_arrow().schema
    assert columns.field("rotor angle seen").metadata[b"unit"] == b"rad"
    # What a loop computes in is no signal.
    assert not [name for name in columns.names if "loop" in name]


def test_a_run_without_a_loop_has_nothing_seen(tmp_path: Path) -> None:
    run = Experiment.load("servo/nominal").varied(duration=0.05).run("physics", "lqr")
    assert run.trajectory.seen is None
    assert gm.load_trajectory(run.save(tmp_path / "run.npz")).seen is None


@pytest.mark.slow
def test_a_batch_keeps_what_each_law_saw() -> None:
    bench = Experiment.load("servo/bench")
    law, plant = bench.law("physics", "implicit"), bench.plant("physics")
    runs = gm.simulate(
        plant, law, [[0.0, 0.0], [0.5, 1.0]], duration=0.05, control_period=H, timestep=H / 2
    )
    assert seen(runs).shape == (2, 100, 2)
    np.testing.assert_array_equal(seen(runs[1]), seen(runs)[1])
