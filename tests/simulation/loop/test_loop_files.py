"""Loops in case files, and their runs in files of signals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cases import case, write
from looped import ANGLE, CURRENT, SPEED, H, played

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.studies.sweep.runs import Row, run_rows


def loop_of(**tables: Any) -> Loop:
    loop = case("servo", **tables).loop
    assert loop is not None
    return loop


def test_a_file_says_all_there_is_to_a_loop() -> None:
    sensor = {
        "of": ANGLE,
        "resolution": "0.1 deg",
        "noise": "1 mrad",
        "bias": "-1 mrad",
        "drift": "1 mrad/s",
        "delay": "1 ms",
    }
    actuator = {
        "of": CURRENT,
        "delay": "0.5 ms",
        "gain": 1.2,
        "resolution": "1 mA",
        "limit": "4 A",
        "rate_limit": "100 A/s",
        "lag": "2 ms",
        "order": 2,
        "dead_zone": "5 mA",
    }
    loop = loop_of(
        run={"control_period": "1 ms", "timestep": "0.5 ms"},
        computing={"delay": "2 ms", "jitter": "0.5 ms", "missed": 0.1, "seed": 7},
        sensor=sensor,
        estimator={"of": SPEED, "law": "eso", "bandwidth": "20 rad/s", "settled": False},
        actuator=actuator,
    )
    assert loop.sensors[0].resolution == pytest.approx(np.pi / 1800)
    assert loop.changed("sensor", ANGLE, resolution=1.0) == Loop(
        Computing(delay=2 * H, jitter=0.5 * H, missed=0.1),
        (Sensor(ANGLE, 1.0, noise=H, bias=-H, drift=H, delay=H),),
        (Estimator((SPEED,), "eso", bandwidth=20.0, settled=False),),
        (
            Actuator(
                CURRENT,
                delay=0.5 * H,
                gain=1.2,
                resolution=H,
                limit=4.0,
                rate_limit=100.0,
                lag=2 * H,
                order=2,
                dead_zone=5 * H,
            ),
        ),
        seed=7,
    )


def test_counts_of_an_encoder_are_its_steps_in_a_turn() -> None:
    loop = loop_of(sensor={"of": ANGLE, "counts": 1024})
    assert loop.sensors == (Sensor(ANGLE, resolution=2 * np.pi / 1024),)


NOISY: dict[str, Any] = {
    "computing": {"delay": "1 ms", "seed": 7},
    "sensor": {"of": ANGLE, "noise": "1 mrad"},
    "actuator": {"of": CURRENT, "delay": "1 ms"},
}
PREDICTING = {"law": "lqr", "predict": True}
KNOWN = {"computing": {"delay": "3 ms"}}


def test_the_run_of_a_file_has_the_noise_of_that_run_of_a_batch() -> None:
    rows = [Row("lqr", number=number) for number in range(4)]
    ends = run_rows(case("servo", **NOISY), rows)["last"]
    assert len(np.unique(ends, axis=0)) == 4

    numbered: Any = NOISY | {"computing": {"delay": "1 ms", "seed": 7, "run": 3}}
    third = case("servo", **numbered)
    np.testing.assert_array_equal(run_rows(third, [Row("lqr")])["last"][0], ends[3])
    np.testing.assert_array_equal(third.run("physics", "lqr").trajectory.state[-1], ends[3])


def delays_of(experiment: Experiment) -> tuple[float, float]:
    """True delay of the computer, and the dead time that LQR knows, in timesteps."""
    loop = experiment.applied_loop("physics", "lqr")
    assert loop is not None
    (computer,) = loop.start.world.computer
    (setup,) = loop.start.software.setup
    return computer["delay"], setup["dead"]


@pytest.mark.parametrize(("known", "delays"), [({}, (1, 2)), ({"known_loop": KNOWN}, (1, 3))])
def test_a_predicting_law_knows_the_true_loop_or_the_one_that_its_file_names(
    known: Any, delays: Any
) -> None:
    """The true one delays by the computer and the actuator, the named one by its computer alone."""
    assert delays_of(case("servo", controller=PREDICTING, **NOISY, **known)) == delays


def test_measurements_and_commands_are_kept_in_files(tmp_path: Path) -> None:
    loop = Loop(sensors=(Sensor(ANGLE, noise=H),), actuators=(Actuator(CURRENT, limit=0.5),))
    run: Any = played(np.linspace(-1, 1, 20), loop, x0=(0.4, 3.0))
    loaded = gm.load_trajectory(run.save(tmp_path / "run.parquet"))
    for kept in ("seen", "command", "input"):
        np.testing.assert_array_equal(getattr(loaded, kept), getattr(run, kept))
    assert not np.array_equal(run.seen, run.state[:-1])
    assert not np.array_equal(run.command, run.input)

    schema = run.to_arrow().schema
    assert schema.field("rotor angle seen").metadata[b"unit"] == b"rad"
    assert not [name for name in schema.names if "loop" in name]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        (
            {"sensor": {"of": ANGLE, "counts": 10, "resolution": "1 deg"}},
            "sensor 1: counts and resolution are the same number",
        ),
        ({"sensor": {"of": SPEED, "counts": 10}}, "counts: rotor speed is no angle"),
        ({"controller": PREDICTING}, "lqr: predict: there is no loop that it could know"),
        ({"actuator": {"of": CURRENT, "rate_limit": "1 A"}}, "actuator 1: rate_limit: .*A/s"),
        ({"computing": {"run": -1}}, "computing: run = -1 must be"),
        (
            NOISY | {"known_loop": KNOWN},
            "known_loop: no controller has predict = true, so none knows its loop",
        ),
        (
            NOISY | {"known_loop": {"sensor": [{"of": "angle"}]}, "controller": PREDICTING},
            "sensor: unknown state 'angle'",
        ),
        # All at once.
        (
            {
                "computing": {"missed": 1},
                "actuator": {"of": CURRENT, "limit": "0 A"},
                "sensor": {"of": ANGLE, "noise": "1 s"},
            },
            "(?s)missed = 1.*sensor 1: noise.*limit = 0",
        ),
        (
            {"computing": {"delay": "1.5 ms"}, "sensor": {"of": ANGLE, "period": "0.3 ms"}},
            "(?s)delay = 0.0015 s.*period = 0.0003 s",
        ),
    ],
)
def test_mistakes_of_a_loop_are_told_with_the_file(tables: Any, words: str, tmp_path: Path) -> None:
    file = write(tmp_path, "servo", **tables)
    with pytest.raises(ArgumentError, match=words) as refused:
        Experiment.load(file)
    assert str(refused.value).startswith(str(file))
