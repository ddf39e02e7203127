"""A law in its loop: the same bits in both engines, alone and in a batch; noise of its own."""

from __future__ import annotations

import itertools
import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from looped import ANGLE, SPEED, H, played, scripted, seen, servo
from shipped import find_case, of_design

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.controllers import rate_positions
from grosmc_mj.loop.estimators import TUNED_BY
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

FIELDS = ("state", "command", "input", "sliding", "weighed", "physics", "status", "valid_until")
LOOPED = (*FIELDS, "seen", "memory")
NOISE = {ANGLE: 0.2, SPEED: 0.7}


@cache
def plant_of(system: str, kind: Any) -> Plant:
    return of_design(system).plant(kind)


@cache
def law_of(system: str) -> Controller:
    return of_design(system).law("corrected", "grosmc")


def full(plant: Plant, seed: int = 1) -> Loop:
    """A loop in which every part does something."""
    states, pairs = plant.system.states, rate_positions(plant.system)
    rates = tuple(states[i].name for i in pairs)
    estimators = [Estimator(rates[:1], "eso", bandwidth=150.0)]
    if rates[1:]:
        estimators.append(Estimator(rates[1:], "levant", slope=40.0, settled=False))
    sensor: dict[str, float] = {"noise": 1e-5, "bias": 1e-5, "drift": 1e-4, "delay": H}
    actuator: dict[str, Any] = {"limit": 60.0, "rate_limit": 1e4, "lag": 1.5e-3, "order": 2}
    return Loop(
        Computing(delay=2 * H, jitter=H, missed=0.05),
        tuple(Sensor(states[i].name, 1e-5, **sensor) for i in pairs.values()),
        tuple(estimators),
        tuple(Actuator(u.name, H, 1e-3, dead_zone=1e-3, **actuator) for u in plant.system.inputs),
        seed=seed,
    )


def assert_equal(a: Trajectory, b: Trajectory, fields: tuple[str, ...] = LOOPED) -> None:
    for name in fields:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize(
    ("system", "kind"), [("servo", "corrected"), ("arm", "physics"), ("two_link_arm", "physics")]
)
def test_a_loop_without_parts_is_no_loop(system: str, kind: str, stride: int) -> None:
    plant, law, x0 = plant_of(system, kind), law_of(system), find_case(system, "nominal").x0
    periods: dict[str, Any] = {"control_period": stride * H, "timestep": H}
    looped = in_loop(law, Loop(), plant.system, **periods)
    without = simulate(plant, law, x0, duration=0.2, **periods)
    run = simulate(plant, looped, x0, duration=0.2, **periods)
    assert_equal(without, run, FIELDS)
    samples = np.arange(200) // stride * stride
    np.testing.assert_array_equal(seen(run), without.state[samples])
    assert without.seen is None


@pytest.mark.slow
@pytest.mark.parametrize("predict", [False, True])
@pytest.mark.parametrize("kind", ["corrected", "physics"])
@pytest.mark.parametrize("system", ["servo", "two_link_arm"])
def test_both_engines_agree_in_every_bit(system: str, kind: str, predict: bool) -> None:
    plant, x0 = plant_of(system, kind), find_case(system, "nominal").x0
    periods: dict[str, Any] = {"control_period": 2 * H, "timestep": H}
    law = in_loop(law_of(system), full(plant), plant.system, predict=predict, **periods)
    native, python = (
        simulate(plant, law, x0, duration=0.1, engine=engine, **periods)
        for engine in ("native", "python")
    )
    assert_equal(native, python)
    # All of it is at work: the input is not the command, nor is the state seen the true one.
    assert not np.array_equal(seen(native), native.state[:-1])
    assert np.abs(native.input - native.command).max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("law", [*TUNED_BY, "difference"])
def test_both_engines_agree_on_every_estimator(law: Any) -> None:
    plant = plant_of("servo", "corrected")
    numbers: dict[str, Any] = {TUNED_BY[law]: 30.0} if law in TUNED_BY else {}
    loop = Loop(
        Computing(delay=2 * H, missed=0.1),
        (Sensor(ANGLE, 1e-4, noise=1e-4, delay=H),),
        (Estimator((SPEED,), law, **numbers),),
    )
    looped = in_loop(law_of("servo"), loop, plant.system, predict=True)
    native, python = (
        simulate(plant, looped, (0.1, 0.2), duration=0.1, engine=engine)
        for engine in ("native", "python")
    )
    assert_equal(native, python)
    assert not np.array_equal(seen(native)[:, 1], native.state[:-1, 1])


@pytest.mark.slow
def test_both_engines_agree_on_a_robot() -> None:
    short = Experiment.load("jaco/bench").varied(duration=0.15)
    native, python = (
        short.with_settings(engine=engine).run("physics", "grosmc, predicted").trajectory
        for engine in ("native", "python")
    )
    assert_equal(native, python, (*FIELDS, "seen"))
    assert not np.array_equal(seen(native), native.state[:-1])


def batch(runs: list[int], loop: Loop, **options: Any) -> Trajectory:
    plant = plant_of("servo", "corrected")
    periods: dict[str, Any] = {"control_period": 2 * H, "timestep": H}
    laws = [in_loop(law_of("servo"), loop, plant.system, run=run, **periods) for run in runs]
    x0 = find_case("servo", "nominal").x0
    return simulate(plant, laws, x0, duration=0.1, **periods, **options)


@pytest.mark.slow
def test_a_run_of_a_batch_is_that_run_alone_and_has_its_own_noise() -> None:
    """Numbers with 53 random bits are never the same twice in so few."""
    plant, runs = plant_of("servo", "corrected"), [4, 7, 4, 2**40, 0]
    loops = [full(plant, seed).changed("sensor", ANGLE, resolution=0.0) for seed in (1, 2)]
    together = batch(runs, loops[0], threads=3)
    for i, run in enumerate(runs):
        assert_equal(together[i], batch([run], loops[0])[0])
    angles = [*seen(together)[[0, 1, 3, 4], :, 0], seen(batch([4], loops[1]))[0, :, 0]]
    for a, b in itertools.combinations(angles, 2):
        assert not np.any(a == b)


# --- independence ---


def assert_independent(series: dict[Any, Array]) -> None:
    """Series of N numbers have a correlation of 1/sqrt(N); one in 10^6 is beyond five of it."""
    for (a, x), (b, y) in itertools.combinations(series.items(), 2):
        correlation = np.corrcoef(x, y)[0, 1]
        assert abs(correlation) < 5.0 / math.sqrt(len(x)), (a, b)


def test_each_run_of_a_batch_has_its_own_sensor_noise() -> None:
    samples, runs = 500, (0, 1, 2**40)
    loop = Loop(sensors=tuple(Sensor(of, noise=size) for of, size in NOISE.items()))
    laws = [in_loop(scripted(np.zeros(samples)), loop, servo().system, run=run) for run in runs]
    start = np.zeros((len(runs), 2))
    runs_of = simulate(servo(), laws, start, duration=samples * H, timestep=H, engine="python")
    noise = seen(runs_of) - runs_of.state[:, :-1]
    assert_independent({(run, j): noise[i, :, j] for i, run in enumerate(runs) for j in range(2)})


def test_noise_lateness_and_missed_samples_are_drawn_independently() -> None:
    """Sample k demands k + 1: commands tell when it was taken, inputs whether it was missed."""
    samples, stride = 2000, 3
    sensors = tuple(Sensor(of, noise=size) for of, size in NOISE.items())
    demand = np.arange(1.0, samples + 1)
    run = played(demand, Loop(Computing(jitter=H, missed=0.5), sensors), stride=stride)
    at = np.flatnonzero(np.diff(run.command, prepend=0.0))
    late, missed = at - stride * np.arange(samples), run.input[at] != run.command[at]
    noise = (seen(run)[at] - run.state[at]).T
    assert set(late) == {0, 1}
    assert_independent(dict(enumerate([late * 1.0, missed * 1.0, *noise])))
