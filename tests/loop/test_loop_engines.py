"""A law in its loop: the same bits in both engines, alone and in a batch; without parts no loop."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from looped import seen
from shipped import find_case, of_design

from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.controllers import rate_positions
from grosmc_mj.loop.estimators import TUNED_BY
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm")
FIELDS = ("state", "command", "input", "sliding", "weighed", "physics", "status", "valid_until")
H = 1e-3


@cache
def plant_of(system: str, kind: Any) -> Plant:
    return of_design(system).plant(kind)


@cache
def law_of(system: str) -> Controller:
    return of_design(system).law("corrected", "grosmc")


def whole(plant: Plant, seed: int = 1) -> Loop:
    """A loop in which every part does something."""
    system = plant.system
    pairs = rate_positions(system)
    positions = [system.states[i].name for i in pairs.values()]
    rates = tuple(system.states[i].name for i in pairs)
    estimators = [Estimator(rates[:1], "eso", bandwidth=150.0)]
    if rates[1:]:
        estimators.append(Estimator(rates[1:], "levant", slope=40.0, settled=False))
    return Loop(
        Computing(delay=2 * H, jitter=H, missed=0.05),
        tuple(
            Sensor(name, 1e-5, noise=1e-5, bias=1e-5, drift=1e-4, delay=H) for name in positions
        ),
        tuple(estimators),
        tuple(
            Actuator(each.name, H, 1e-3, limit=60.0, rate_limit=1e4, lag=1.5e-3, order=2,
                     dead_zone=1e-3)
            for each in system.inputs
        ),
        seed=seed,
    )  # fmt: skip


def assert_equal(a: Trajectory, b: Trajectory, fields: tuple[str, ...] = FIELDS) -> None:
    for name in fields:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("stride", [1, 4])
@pytest.mark.parametrize("kind", ["corrected", "physics"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_loop_without_parts_is_no_loop(system: str, kind: str, stride: int) -> None:
    plant, law = plant_of(system, kind), law_of(system)
    looped = in_loop(law, Loop(), plant.system, control_period=stride * H, timestep=H)
    options: dict[str, Any] = {"duration": 0.2, "control_period": stride * H, "timestep": H}
    x0 = find_case(system, "nominal").x0
    without = simulate(plant, law, x0, **options)
    found = simulate(plant, looped, x0, **options)
    assert_equal(without, found)
    samples = np.arange(200) // stride * stride
    np.testing.assert_array_equal(seen(found), without.state[samples])
    assert without.seen is None


@pytest.mark.slow
@pytest.mark.parametrize("predict", [False, True])
@pytest.mark.parametrize("kind", ["corrected", "physics"])
@pytest.mark.parametrize("system", ["servo", "cart_pendulum", "two_link_arm"])
def test_both_engines_agree_in_every_bit(system: str, kind: str, predict: bool) -> None:
    plant = plant_of(system, kind)
    law = in_loop(
        law_of(system),
        whole(plant),
        plant.system,
        control_period=2 * H,
        timestep=H,
        predict=predict,
    )
    x0 = find_case(system, "nominal").x0
    options: dict[str, Any] = {"duration": 0.1, "control_period": 2 * H, "timestep": H}
    native = simulate(plant, law, x0, **options)
    python = simulate(plant, law, x0, engine="python", **options)
    assert_equal(native, python, (*FIELDS, "seen", "memory"))
    # All of it is at work: what is asked for is not what is given, nor what is seen what is.
    assert not np.array_equal(seen(native), native.state[:-1])
    assert np.abs(native.input - native.command).max() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("law", [*TUNED_BY, "difference"])
def test_both_engines_agree_on_every_estimator(law: Any) -> None:
    plant, bare = plant_of("servo", "corrected"), law_of("servo")
    angle, speed = (state.name for state in plant.system.states)
    numbers: dict[str, Any] = {TUNED_BY[law]: 30.0} if law in TUNED_BY else {}
    loop = Loop(
        Computing(delay=2 * H, missed=0.1),
        (Sensor(angle, 1e-4, noise=1e-4, delay=H),),
        (Estimator((speed,), law, **numbers),),
    )
    looped = in_loop(bare, loop, plant.system, predict=True)
    native, python = (
        simulate(plant, looped, (0.1, 0.2), duration=0.1, engine=engine)
        for engine in ("native", "python")
    )
    assert_equal(native, python, (*FIELDS, "seen", "memory"))
    assert not np.array_equal(seen(native)[:, 1], native.state[:-1, 1])


@pytest.mark.slow
def test_both_engines_agree_on_a_robot() -> None:
    bench = Experiment.load("jaco/bench")
    short = bench.varied(duration=0.15)
    for name in ("grosmc", "grosmc, predicted"):
        native = short.run("physics", name).trajectory
        python = short.with_settings(engine="python").run("physics", name).trajectory
        assert_equal(native, python, (*FIELDS, "seen"))
        assert not np.array_equal(seen(native), native.state[:-1])


def test_a_loop_adds_nothing_to_the_law_s_memory_however_long_its_delays() -> None:
    plant, law = plant_of("servo", "corrected"), law_of("servo")
    for delay in (0.0, 0.1):
        looped = in_loop(law, Loop(Computing(delay=delay)), plant.system)
        run = simulate(plant, looped, (0.1, 0.0), duration=0.01, engine="python")
        without = simulate(plant, law, (0.1, 0.0), duration=0.01, engine="python")
        assert run.memory.dtype == without.memory.dtype


def batch(runs: list[int], loop: Loop, **options: Any) -> Trajectory:
    plant = plant_of("servo", "corrected")
    periods: dict[str, Any] = {"control_period": 2 * H, "timestep": H}
    laws = [in_loop(law_of("servo"), loop, plant.system, run=run, **periods) for run in runs]
    x0 = find_case("servo", "nominal").x0
    return simulate(plant, laws, x0, duration=0.1, **periods, **options)


@pytest.mark.slow
def test_a_run_of_a_batch_is_that_run_alone() -> None:
    loop, runs = whole(plant_of("servo", "corrected")), [4, 7, 4, 2**40, 0]
    together = batch(runs, loop, threads=3)
    for i, run in enumerate(runs):
        alone = batch([run], loop)
        assert_equal(together[i], alone[0], (*FIELDS, "seen", "memory"))


@pytest.mark.slow
def test_another_run_or_seed_has_other_noise() -> None:
    """Numbers with 53 random bits are never the same twice in so few."""
    plant = plant_of("servo", "corrected")
    angle = plant.system.states[0].name
    loops = [whole(plant, seed).changed("sensor", angle, resolution=0.0) for seed in (1, 2)]
    first, other = batch([4, 7, 2**32 + 4], loops[0]), batch([4], loops[1])
    angles = [*seen(first)[..., 0], *seen(other)[..., 0]]
    for i, a in enumerate(angles):
        for b in angles[:i]:
            assert not np.any(a == b)
