"""Sensors, computer and actuators: against their description and SciPy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st
from looped import ANGLE, CURRENT, SPEED, H, played, seen

from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop import Actuator, Computing, Estimator, Loop, Sensor
from grosmc_mj.simulation.loop.counter import normal, uniform
from grosmc_mj.simulation.loop.timing import time_as_run
from grosmc_mj.theory.plants import SERVO

EPS = np.finfo(float).eps
SPEED_NOISE = 0.7
late = st.integers(0, 9).map(lambda steps: steps * H)
size = st.floats(1e-4, 6)


def rounded(value: float, q: float) -> float:
    if q == 0.0:
        return value
    return q * math.floor(value / q + 0.5)


def sampled_instants(count: int, stride: int, jitter: int, seed: int, run: int) -> list[int]:
    """Timesteps at which samples are taken, each late by its random number; the first is not."""
    instants = [0]
    for k in range(1, count):
        share = uniform(seed, run, len(SERVO.states), k)
        instants.append(k * stride + math.floor(share * (jitter + 1)))
    return instants


def measured_angle(sensor: Any, angles: Array, instant: int, seed: int, run: int) -> float:
    """Reading of a sensor by its description.

    The sensor's own samples are at multiples of its period; before them is the start.
    """
    at = max(instant - round(sensor["delay"] / H), 0)
    period = round(sensor["period"] / H)
    if period:
        at -= at % period

    noise = 0.0
    if sensor["noise"]:
        noise = sensor["noise"] * normal(seed, run, 0, at)
    offset = sensor["bias"] + sensor["drift"] * (at * H)
    return rounded(sensor["scale"] * angles[at] + offset + noise, sensor["resolution"])


def computed_outputs(u: list[float], missed: float, seed: int, run: int) -> list[float]:
    """Outputs of the computer: a missed sample leaves the last one."""
    outputs = []
    output = 0.0
    for k, demand in enumerate(u):
        if uniform(seed, run, len(SERVO.states) + 1, k) >= missed:
            output = demand
        outputs.append(output)
    return outputs


def actuated(actuator: Any, demands: list[float]) -> list[float]:
    """Inputs of the plant by the description of an actuator without lag."""
    limit = actuator["limit"]
    largest_change = actuator["rate_limit"] * H
    inputs = []
    rated = 0.0
    for demand in demands:
        commanded = actuator["gain"] * demand
        limited = np.clip(rounded(commanded, actuator["resolution"]), -limit, limit)
        rated += np.clip(limited - rated, -largest_change, largest_change)
        beyond = max(abs(rated) - actuator["dead_zone"], 0.0)
        inputs.append(math.copysign(beyond, rated))
    return inputs


@settings(max_examples=60)
@given(
    sensor=st.fixed_dictionaries(
        {
            "resolution": st.just(0.0) | size,
            "scale": size,
            "noise": st.floats(0, 0.3),
            "bias": st.floats(-1, 1),
            "drift": st.floats(-9, 9),
            "delay": late,
            "period": late,
        }
    ),
    computing=st.fixed_dictionaries({"delay": late, "missed": st.floats(0, 0.95)}),
    jitter=st.integers(0, 6),
    actuator=st.fixed_dictionaries(
        {
            "delay": late,
            "gain": st.floats(-2, 2),
            "resolution": st.just(0.0) | size,
            "limit": size,
            "rate_limit": st.floats(1, 1e4),
            "dead_zone": st.just(0.0) | st.floats(0.01, 1),
        }
    ),
    u=st.lists(st.floats(-5, 5), min_size=1, max_size=20),
    stride=st.sampled_from([1, 3, 7]),
    seed=st.integers(0, 2**53 - 1),
    number=st.sampled_from([0, 1, 2**40]),
)
def test_a_loop_is_its_description_sample_by_sample(
    sensor: Any,
    computing: Any,
    jitter: int,
    actuator: Any,
    u: Any,
    stride: int,
    seed: int,
    number: int,
) -> None:
    """Exactly, from the true states and the script: each random number is that of its sample."""
    jitter = min(jitter, stride - 1)
    loop = Loop(
        Computing(jitter=jitter * H, **computing),
        (Sensor(ANGLE, **sensor), Sensor(SPEED, noise=SPEED_NOISE)),
        actuators=(Actuator(CURRENT, **actuator),),
        seed=seed,
    )
    run = played(u, loop, x0=(0.4, 3.0), stride=stride, run=number)
    timesteps = np.arange(len(run.command))
    instants = sampled_instants(len(u), stride, jitter, seed, number)
    samples = np.searchsorted(instants, timesteps, side="right") - 1
    np.testing.assert_array_equal(run.command, np.array(u)[samples])

    for i, k in enumerate(samples.tolist()):
        instant = instants[k]
        angle = measured_angle(sensor, run.state[:, 0], instant, seed, number)
        speed = run.state[instant, 1] + SPEED_NOISE * normal(seed, number, 1, instant)
        assert seen(run)[i].tolist() == [angle, speed]

    outputs = computed_outputs(u, computing["missed"], seed, number)
    behind = round(computing["delay"] / H) + round(actuator["delay"] / H)
    arrived = [outputs[samples[i - behind]] if i >= behind else 0.0 for i in timesteps]
    # A sum of two numbers is rounded once in the rate limit.
    rounding = 100 * EPS * 6
    expected = actuated(actuator, arrived)
    np.testing.assert_allclose(run.input, expected, rtol=0, atol=rounding)


def test_a_time_whose_quotient_lies_just_below_a_whole_number_is_that_number() -> None:
    """0.043 s over 0.001 s is 42.99999999999999 in binary."""
    run = played(np.ones(45), Loop(Computing(delay=0.043)))
    assert run.input.tolist() == [0.0] * 43 + [1.0] * 2


@pytest.mark.parametrize(("name", "expected"), [("delay", 9e-3), ("jitter", 3e-3)])
def test_a_varied_time_is_a_multiple_of_the_timestep(name: str, expected: float) -> None:
    """Jitter stays shorter than the control period."""
    assert time_as_run(name, 9.4e-3, H, 4e-3) == pytest.approx(expected)


def test_a_reading_beyond_2_to_52_steps_is_not_rounded() -> None:
    run = played(np.zeros(3), Loop(sensors=(Sensor(ANGLE, 1e-9),)), x0=(1e8 + 0.3, 0.0))
    np.testing.assert_array_equal(seen(run)[:, 0], 1e8 + 0.3)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("lag", [2e-4, 2.3e-3, 2e-2])
def test_the_output_of_lags_is_the_mean_of_their_exact_discretization(
    lag: float, order: int
) -> None:
    """The integral of the output is one more state, whose rate is the output."""
    inputs = np.random.default_rng(2).uniform(-3, 3, 200)
    rates = np.zeros((order + 2, order + 2))
    rates[:order, :order] = (np.eye(order, k=-1) - np.eye(order)) / lag
    rates[0, -1] = 1 / lag
    rates[order, order - 1] = 1.0
    transition = scipy.linalg.expm(rates * H)

    x = np.zeros(order + 2)
    means = []
    for u in inputs:
        x[order:] = 0.0, u
        x = transition @ x
        means.append(x[order] / H)

    actuator = Actuator(CURRENT, lag=lag, order=order)
    run = played(inputs, Loop(actuators=(actuator,)))
    # Two ways to compute it differ by some roundings a timestep, which fade away; the mean is u
    # less lag / H times the gain of the output.
    bound = 16 * EPS * 3 * (1 / -math.expm1(-H / lag)) ** order * (1 + 2 * lag / H)
    np.testing.assert_allclose(run.input, means, rtol=0, atol=bound)


def test_the_words_of_a_loop_have_its_numbers_in_their_units() -> None:
    begun = Estimator((SPEED,), law="eso", bandwidth=40.0, settled=False)
    lines = Loop(computing=Computing(missed=0.05), estimators=(begun,)).words(SERVO)
    assert "computer: 5 % of the outputs missed" in lines
    assert any("estimated by eso with bandwidth 40 rad/s, from rest" in line for line in lines)
