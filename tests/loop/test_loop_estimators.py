"""Estimators of a rate: what they are exact for, and what noise costs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from looped import ANGLE, CURRENT, SPEED, H, played, scripted, seen, servo

from grosmc_mj.arrays import Array
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.estimators import levant
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop

EPS = np.finfo(float).eps
L = 10.0
RATE = 2.0


def differentiated(y: Array, T: float, rate: float = 0.0, slope: float = L) -> Array:
    """The rates that Levant's differentiator gives."""
    position, found = float(y[0]), []
    for each in y.tolist():
        position, rate = levant(position, rate, each, slope, T)
        found.append(rate)
    return np.array(found)


@pytest.mark.parametrize("scale", [2.0, 4.0, 0.25])
def test_levant_s_error_grows_with_the_root_of_the_noise(scale: float) -> None:
    """Time and rates by c, noise by c^2: the same numbers, to the bit where c is a power of 2.

    A rate's error is thus a function of L T^2 / noise times the root of L noise.
    """
    noise, T = np.random.default_rng(3).uniform(-1e-3, 1e-3, 2000), 1e-3
    found = differentiated(noise * scale**2, T * scale)
    np.testing.assert_array_equal(found, scale * differentiated(noise, T))
    assert np.abs(found).max() > 0


@pytest.mark.parametrize("T", [1e-3, 1e-4])
def test_the_worst_noise_costs_the_root_of_itself(T: float) -> None:
    """e sin(sqrt(L / e) t) might be the signal itself: it must be followed, to a rate sqrt(L e).

    What is left is the secant instead of the slope, less (w T)^2 / 24, and that samples miss the
    crest, less (w T)^2 / 8. On a log-log plot the line has the slope 1/2.
    """
    noises, largest = 10.0 ** np.arange(-4, 0), []
    for e in noises.tolist():
        w = math.sqrt(L / e)
        t = np.arange(round(20 * 2 * math.pi / (w * T))) * T
        largest.append(np.abs(differentiated(e * np.sin(w * t), T)[len(t) // 2 :]).max())
        assert 1 - (w * T) ** 2 / 6 <= largest[-1] / math.sqrt(L * e) <= 1 + 1e-9
    slope = np.polyfit(np.log(noises), np.log(largest), 1)[0]
    worst = L / noises[0] * T**2 / 6
    assert abs(slope - 0.5) <= worst / math.log(noises[-1] / noises[0])


@pytest.mark.parametrize("acceleration", [-9.0, 0.0, 9.0])
def test_levant_is_exact_for_a_constant_acceleration_below_its_bound(acceleration: float) -> None:
    """Without chatter: once there it is the slope of the secant, sample by sample."""
    T = 1e-3
    t = np.arange(2000) * T
    y = 0.5 * acceleration * t**2
    rate = differentiated(y, T, rate=-1.0)[-1000:]
    # A difference of two readings over T, each of them rounded.
    rounding = 4 * EPS * (np.abs(y).max() + 1.0) / T
    np.testing.assert_allclose(rate, acceleration * (t[-1000:] - T / 2), rtol=0, atol=rounding)
    assert np.abs(np.diff(rate, 2)).max() <= 4 * rounding


def test_levant_is_left_behind_by_more_than_its_bound() -> None:
    """It turns its rate by 1.1 L at most, and never more."""
    t = np.arange(1000) * H
    rate = differentiated(L * t**2, H)
    assert np.abs(np.diff(rate)).max() <= 1.1 * L * H * (1 + 1e-9)
    assert 2 * L * t[-1] - rate[-1] >= 0.9 * L * t[-1] * (1 - 1e-2)


def coasting(estimator: Estimator, samples: int = 1500, **options: Any) -> Array:
    """Error of an estimate while the rotor turns at a constant rate, held by its input."""
    p = servo().parameters
    u = np.full(samples, p.B * RATE / p.Kt)
    run = played(u, Loop(estimators=(estimator,)), x0=(0.0, RATE), **options)
    np.testing.assert_allclose(run.state[:, 1], RATE, rtol=1e-12)
    return seen(run)[:, 1] - run.state[:-1, 1]


# Readings of up to 3 rad, rounded, over a period: a factor for what adds up on the way.
ROUNDING = 16 * EPS * 3 / H


@pytest.mark.parametrize(
    "estimator",
    [
        Estimator((SPEED,), "difference", settled=False),
        Estimator((SPEED,), "filtered", time_constant=5e-3, settled=False),
        Estimator((SPEED,), "levant", slope=20.0, settled=False),
        Estimator((SPEED,), "high-gain", bandwidth=50.0, settled=False),
    ],
    ids=lambda each: each.law,
)
def test_a_constant_rate_is_found_exactly(estimator: Estimator) -> None:
    error = coasting(estimator)
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING


@pytest.mark.parametrize("law", ["difference", "filtered", "levant", "high-gain"])
def test_what_begins_settled_has_nothing_to_find(law: Any) -> None:
    number = {"filtered": "time_constant", "levant": "slope", "high-gain": "bandwidth"}.get(law)
    numbers: dict[str, Any] = {number: 50.0} if number else {}
    error = coasting(Estimator((SPEED,), law, **numbers), 200)
    assert np.abs(error).max() < ROUNDING


def test_the_high_gain_observer_has_the_double_pole_of_its_bandwidth() -> None:
    error = coasting(Estimator((SPEED,), "high-gain", bandwidth=50.0, settled=False), 200)
    pole = math.exp(-50.0 * H)
    rest = error[2:] - 2 * pole * error[1:-1] + pole**2 * error[:-2]
    assert np.abs(rest).max() < 4 * ROUNDING
    assert error[20] < -0.5


def test_the_filtered_difference_fades_with_its_time_constant() -> None:
    error = coasting(Estimator((SPEED,), "filtered", time_constant=5e-3, settled=False), 50)
    np.testing.assert_allclose(error, -RATE * np.exp(-np.arange(50) / 5), rtol=0, atol=ROUNDING)


def test_the_extended_observer_is_exact_under_a_constant_load() -> None:
    """Its load is what the rate misses in a period, less than h times the load by B h / 2 J."""
    p, u, w = servo().parameters, 0.3, 50.0
    load = p.Kt * u - p.B * RATE  # N m that keep the rate as it is
    push = Disturbance("rotor", (0, 0, 0, 0, load, 0))
    loop = Loop(estimators=(Estimator((SPEED,), "eso", bandwidth=w, settled=False),))
    run = played(np.full(1500, u), loop, x0=(0.0, RATE), modelled=True, disturbances=[push])
    error = seen(run)[:, 1] - run.state[:-1, 1]
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING
    law = in_loop(scripted(np.full(1500, u), modelled=True), loop, SERVO)
    options: dict[str, Any] = {"duration": 1.5, "timestep": H, "disturbances": [push]}
    closed = ClosedLoop(prepare(servo(), law, (0.0, RATE), **options)[0])
    closed.advance(1500)
    assert closed.run.loop.estimators[0].load == pytest.approx(-load / p.J, rel=p.B * H / p.J)


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize("law", ["eso", "kalman"])
def test_observers_know_when_an_input_arrives(law: Any, stride: int) -> None:
    """With the loop known they are right while the input jumps; without they are far off.

    A rate gains Kt/J u h in a timestep; the observer's position, which takes the acceleration as
    constant, is off by B h/J of that a sample. |u| is below 4. The noise is 2e-9 in the rate.
    """
    u = np.random.default_rng(0).normal(size=200)
    number: dict[str, Any] = {"bandwidth": 50.0} if law == "eso" else {"load": 1e-6}
    loop = Loop(
        Computing(delay=4 * H),
        (Sensor(ANGLE, noise=1e-12, delay=2 * H),),
        (Estimator((SPEED,), law, **number),),
        (Actuator(CURRENT, delay=2 * H),),
    )
    errors = []
    for predict in (True, False):
        run = played(u, loop, stride=stride, modelled=True, predict=predict)
        # What is told is 2 timesteps old; between samples it grows older.
        errors.append(np.abs((seen(run)[2:, 1] - run.state[:-3, 1])[::stride]).max())
    p = servo().parameters
    bound = 4 * p.Kt / p.J * H * p.B * H / p.J * stride**2
    assert errors[0] < bound < 0.1 * errors[1]
