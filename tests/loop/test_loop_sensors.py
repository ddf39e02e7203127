"""What sensors tell: multiples, noise, errors that grow, the past."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from looped import ANGLE, SPEED, H, played, seen

from grosmc_mj.loop import Loop, Sensor
from grosmc_mj.loop.counter import normal
from grosmc_mj.simulation.trajectory import Trajectory

EPS = np.finfo(float).eps
START = (0.4, 3.0)
EXAMPLES = settings(max_examples=25)


def watched(*sensors: Sensor, samples: int = 60, stride: int = 1, seed: int = 0) -> Trajectory:
    """The servo as it is braked, and what sensors tell of it."""
    u = np.linspace(0.0, -5.0, samples)
    return played(u, Loop(sensors=sensors, seed=seed), x0=START, stride=stride)


@EXAMPLES
@given(q=st.floats(1e-4, 1.0), noise=st.floats(0, 0.3))
def test_an_encoder_tells_multiples_and_the_nearest(q: float, noise: float) -> None:
    told = seen(watched(Sensor(ANGLE, q, noise=noise)))[:, 0]
    np.testing.assert_array_equal(told, q * np.round(told / q))
    run = watched(Sensor(ANGLE, noise=noise))
    rounding = 2 * EPS * np.abs(told)
    assert np.all(np.abs(told - seen(run)[:, 0]) <= 0.5 * q * (1 + 2 * EPS) + rounding)


def test_what_has_no_sensor_is_known_exactly() -> None:
    run = watched(Sensor(ANGLE, 0.5))
    np.testing.assert_array_equal(seen(run)[:, 1], run.state[:-1, 1])
    assert np.ptp(run.state[:, 1]) > 0


def test_bias_and_drift_add_up() -> None:
    run = watched(Sensor(SPEED, bias=0.25, drift=-8.0))
    wanted = run.state[:-1, 1] + 0.25 - 8.0 * run.time[:-1]
    np.testing.assert_allclose(seen(run)[:, 1], wanted, rtol=0, atol=8 * EPS * 4)


@EXAMPLES
@given(delay=st.integers(0, 9), period=st.integers(0, 9), stride=st.sampled_from([1, 2, 5]))
def test_a_sensor_tells_of_its_own_last_sample(delay: int, period: int, stride: int) -> None:
    """Its samples are at multiples of its period, the start stands for all before."""
    run = watched(Sensor(ANGLE, delay=delay * H, period=period * H), samples=30, stride=stride)
    i = np.arange(len(run.time) - 1) // stride * stride
    at = np.maximum(i - delay, 0)
    at -= at % period if period else 0
    np.testing.assert_array_equal(seen(run)[:, 0], run.state[at, 0])


def test_one_sample_of_a_slow_sensor_has_one_noise() -> None:
    run = watched(Sensor(ANGLE, noise=0.1, period=4 * H, delay=H), seed=3)
    at = np.maximum(np.arange(60) - 1, 0) // 4 * 4
    drawn = [run.state[k, 0] + 0.1 * normal(3.0, 0.0, 0, k) for k in at.tolist()]
    np.testing.assert_allclose(seen(run)[:, 0], drawn, rtol=0, atol=8 * EPS)


def test_two_sensors_have_noise_of_their_own_of_the_size_given() -> None:
    """The mean of N squares of normal numbers is off by sqrt(2 / N), of products by 1 / sqrt(N)."""
    N, sigmas = 3000, 5.0
    run = watched(Sensor(ANGLE, noise=0.2), Sensor(SPEED, noise=0.7), samples=N)
    e = (seen(run) - run.state[:-1]) / np.array([0.2, 0.7])
    assert np.all(np.abs(np.mean(e, axis=0)) < sigmas / math.sqrt(N))
    assert np.all(np.abs(np.mean(e**2, axis=0) - 1) < sigmas * math.sqrt(2 / N))
    assert abs(np.mean(e[:, 0] * e[:, 1])) < sigmas / math.sqrt(N)


def test_rounding_is_noise_of_a_twelfth_of_the_square() -> None:
    """Errors even over q have E e^2 = q^2/12, Var e^2 = q^4/180; they have no mean."""
    N, sigmas, q = 3000, 5.0, 1.234e-3
    run = watched(Sensor(ANGLE, q), samples=N)
    e = (seen(run) - run.state[:-1])[:, 0] / q
    assert abs(np.mean(e)) < sigmas / math.sqrt(12 * N)
    assert abs(np.mean(e**2) - 1 / 12) < sigmas / math.sqrt(180 * N)


def test_what_is_too_large_for_the_resolution_is_told_as_it_is() -> None:
    """Beyond 2^52 multiples neighbours are no longer told apart."""
    run = played(np.zeros(3), Loop(sensors=(Sensor(ANGLE, 1e-9),)), x0=(1e8 + 0.3, 0.0))
    np.testing.assert_array_equal(seen(run)[:, 0], 1e8 + 0.3)
