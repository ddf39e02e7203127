"""What is drawn at random in a loop: for each run and each part of the loop its own."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from looped import ANGLE, SPEED, H, played, scripted, seen, servo

from grosmc_mj.arrays import Array
from grosmc_mj.loop import Computing, Loop, Sensor, in_loop
from grosmc_mj.simulation.simulate import simulate

# Independent series of N numbers have a correlation of 1/sqrt(N); one in 10^6 is beyond this.
SIGMAS = 5.0
NOISE = {ANGLE: 0.2, SPEED: 0.7}


def assert_independent(series: dict[Any, Array]) -> None:
    for (a, x), (b, y) in itertools.combinations(series.items(), 2):
        correlation = np.corrcoef(x, y)[0, 1]
        assert abs(correlation) < SIGMAS / math.sqrt(len(x)), (a, b)


@pytest.mark.parametrize("engine", ["python", pytest.param("native", marks=pytest.mark.slow)])
def test_each_run_of_a_batch_has_its_own_sensor_noise(engine: Any) -> None:
    samples, runs = 500, (0, 1, 2, 2**40)
    loop = Loop(sensors=tuple(Sensor(of, noise=size) for of, size in NOISE.items()))
    bare = scripted(np.zeros(samples))
    laws = [in_loop(bare, loop, servo().system, run=run) for run in runs]
    start = np.zeros((len(runs), 2))
    batch = simulate(servo(), laws, start, duration=samples * H, timestep=H, engine=engine)
    noise = seen(batch) - batch.state[:, :-1]
    assert_independent({(run, j): noise[i, :, j] for i, run in enumerate(runs) for j in range(2)})


def test_noise_lateness_and_missed_samples_are_drawn_independently() -> None:
    """Sample k asks for k + 1: commands tell when it was taken, inputs whether it was missed."""
    samples, stride = 2000, 3
    loop = Loop(
        Computing(jitter=H, missed=0.5),
        tuple(Sensor(of, noise=size) for of, size in NOISE.items()),
    )
    run = played(np.arange(1.0, samples + 1), loop, stride=stride)
    at = np.flatnonzero(np.diff(run.command, prepend=0.0))
    late = at - stride * np.arange(samples)
    missed = run.input[at] != run.command[at]
    assert set(late) == {0, 1}
    noise = seen(run)[at] - run.state[at]
    assert_independent(
        {"late": late * 1.0, "missed": missed * 1.0, ANGLE: noise[:, 0], SPEED: noise[:, 1]}
    )
