"""Estimators of a rate and the Kalman filter: exactness, noise, gain and covariance."""

from __future__ import annotations

import math
from typing import Any

import control
import numba
import numpy as np
import pytest
import scipy.linalg
from looped import ANGLE, CURRENT, SPEED, H, applied, closed, nominal, played, scripted, seen, servo

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GainError
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.counter import normal
from grosmc_mj.loop.estimators import levant
from grosmc_mj.loop.kalman import kalman_gain
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop

EPS = np.finfo(float).eps
L, RATE = 10.0, 2.0
# Readings of up to 3 rad, rounded, over a period: a factor for what adds up on the way.
ROUNDING = 16 * EPS * 3 / H


def differentiated(y: Array, T: float, rate: float = 0.0) -> Array:
    """The rates that Levant's differentiator gives."""
    position, rates = float(y[0]), []
    for reading in y.tolist():
        position, rate = levant(position, rate, reading, L, T)
        rates.append(rate)
    return np.array(rates)


@pytest.mark.parametrize("T", [1e-3, 1e-4])
def test_the_worst_noise_costs_the_root_of_itself(T: float) -> None:
    """e sin(sqrt(L / e) t) might be the signal itself: it must be followed, to a rate sqrt(L e).

    Left out are the secant instead of the slope, less (w T)^2 / 24, and that samples miss the
    crest, less (w T)^2 / 8.
    """
    for e in (1e-4, 1e-2):
        w = math.sqrt(L / e)
        t = np.arange(round(20 * 2 * math.pi / (w * T))) * T
        largest = np.abs(differentiated(e * np.sin(w * t), T)[len(t) // 2 :]).max()
        assert 1 - (w * T) ** 2 / 6 <= largest / math.sqrt(L * e) <= 1 + 1e-9


@pytest.mark.parametrize("acceleration", [-9.0, 9.0])
def test_levant_is_exact_for_a_constant_acceleration_below_its_bound(acceleration: float) -> None:
    """Without chatter: once there it is the slope of the secant, sample by sample."""
    t = np.arange(2000) * H
    y = 0.5 * acceleration * t**2
    rate = differentiated(y, H, rate=-1.0)[-1000:]
    # A difference of two readings over T, each of them rounded.
    rounding = 4 * EPS * (np.abs(y).max() + 1.0) / H
    np.testing.assert_allclose(rate, acceleration * (t[-1000:] - H / 2), rtol=0, atol=rounding)
    # Beyond its bound it turns its rate by 1.1 L at most, and is left behind.
    late = differentiated(L * t**2, H)
    assert np.abs(np.diff(late)).max() == pytest.approx(1.1 * L * H, rel=1e-9)
    assert 2 * L * t[-1] - late[-1] >= 0.9 * L * t[-1] * (1 - 1e-2)


def coasting(law: Any, samples: int = 1500, *, settled: bool = False, **number: float) -> Array:
    """Error of an estimate while the rotor turns at a constant rate, held by its input."""
    p, estimator = servo().parameters, Estimator((SPEED,), law, settled=settled, **number)
    u = np.full(samples, p.B * RATE / p.Kt)
    run = played(u, Loop(estimators=(estimator,)), x0=(0.0, RATE))
    np.testing.assert_allclose(run.state[:, 1], RATE, rtol=1e-12)
    return seen(run)[:, 1] - run.state[:-1, 1]


@pytest.mark.parametrize(
    ("law", "number"),
    [
        ("difference", {}),
        ("filtered", {"time_constant": 5e-3}),
        ("levant", {"slope": 20.0}),
        ("high-gain", {"bandwidth": 50.0}),
    ],
)
def test_a_constant_rate_is_estimated_exactly(law: str, number: dict[str, Any]) -> None:
    error = coasting(law, **number)
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING
    assert np.abs(coasting(law, 200, settled=True, **number)).max() < ROUNDING


def test_transients_have_the_poles_that_they_are_tuned_for() -> None:
    error = coasting("high-gain", 200, bandwidth=50.0)
    pole = math.exp(-50.0 * H)
    rest = error[2:] - 2 * pole * error[1:-1] + pole**2 * error[:-2]
    assert np.abs(rest).max() < 4 * ROUNDING
    assert error[20] < -0.5
    error = coasting("filtered", 50, time_constant=5e-3)
    np.testing.assert_allclose(error, -RATE * np.exp(-np.arange(50) / 5), rtol=0, atol=ROUNDING)


def test_the_extended_observer_is_exact_under_a_constant_load() -> None:
    """Its load is what the rate misses in a period, less than h times the load by B h / 2 J."""
    p, u, w = servo().parameters, 0.3, 50.0
    load = p.Kt * u - p.B * RATE  # N m that keep the rate as it is
    push = Disturbance("rotor", (0, 0, 0, 0, load, 0))
    loop = Loop(estimators=(Estimator((SPEED,), "eso", bandwidth=w, settled=False),))
    law = in_loop(scripted(np.full(1500, u), modelled=True), loop, SERVO)
    options: dict[str, Any] = {"duration": 1.5, "timestep": H, "disturbances": [push]}
    closed_loop = ClosedLoop(prepare(servo(), law, (0.0, RATE), **options)[0])
    closed_loop.advance(1500)
    estimator = closed_loop.run.loop.estimators[0]
    assert estimator.load == pytest.approx(-load / p.J, rel=p.B * H / p.J)
    run = played(np.full(1500, u), loop, x0=(0.0, RATE), modelled=True, disturbances=[push])
    error = seen(run)[:, 1] - run.state[:-1, 1]
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING


@pytest.mark.parametrize("stride", [1, 2])
@pytest.mark.parametrize(("law", "number"), [("eso", "bandwidth"), ("kalman", "load")])
def test_observers_know_when_an_input_arrives(law: Any, number: str, stride: int) -> None:
    """With the loop known they are right while the input jumps; without they are far off.

    A rate gains Kt/J u h in a timestep; the observer's position, which takes the acceleration as
    constant, is off by B h/J of that a sample. |u| is below 4. The noise is 2e-9 in the rate.
    """
    u = np.random.default_rng(0).normal(size=200)
    numbers: dict[str, Any] = {number: {"bandwidth": 50.0, "load": 1e-6}[number]}
    loop = Loop(
        Computing(delay=4 * H),
        (Sensor(ANGLE, noise=1e-12, delay=2 * H),),
        (Estimator((SPEED,), law, **numbers),),
        (Actuator(CURRENT, delay=2 * H),),
    )
    errors = []
    for predict in (True, False):
        run = played(u, loop, stride=stride, modelled=True, predict=predict)
        # A measurement is 2 timesteps old; between samples it grows older.
        errors.append(np.abs((seen(run)[2:, 1] - run.state[:-3, 1])[::stride]).max())
    p = servo().parameters
    bound = 4 * p.Kt / p.J * H * p.B * H / p.J * stride**2
    assert errors[0] < bound < 0.1 * errors[1]


# --- the Kalman filter ---

C = np.array([[1.0, 0.0]])
# As much load in a sample as noise, so that the filter forgets at once.
NOISE, LOAD = 1e-5, 1.0
WITHIN, SIGMAS = 0.02, 4.0


def held_servo() -> tuple[Array, Array]:
    p = servo().parameters
    rates = np.array([[0.0, 1.0, 0.0], [0.0, -p.B / p.J, p.Kt / p.J], [0.0, 0.0, 0.0]])
    transition = scipy.linalg.expm(rates * H)
    return transition[:2, :2], transition[:2, 2:]


def filtered(
    noise: float = NOISE, load: float = LOAD, of: str = ANGLE, resolution: float = 0.0
) -> Loop:
    return Loop(
        sensors=(Sensor(of, resolution, noise=noise),),
        estimators=(Estimator((ANGLE, SPEED), "kalman", load=load),),
    )


def gain_of(loop: Loop) -> Array:
    return applied(in_loop(scripted([0.0], modelled=True), loop, SERVO)).start.gain


@pytest.mark.parametrize(("noise", "load"), [(1e-3, 1e-2), (1e-3, 1.0), (1e-7, 1.0)])
def test_the_gain_is_python_control_s(noise: float, load: float) -> None:
    """Theirs is of the predicted state, A times ours; two solvers of one Riccati equation."""
    A, B = held_servo()
    gain = kalman_gain(A, B, [0], np.array([noise**2]), load)
    theirs, _covariance, _poles = control.dlqe(A, B, C, [[load**2]], [[noise**2]])
    np.testing.assert_allclose(A @ gain, theirs, rtol=1e-6)
    # Differences over 1e-6 of a linear model are off by rounding: 1e-16 / 1e-6, over h.
    ours = gain_of(filtered(noise, load))
    np.testing.assert_allclose(ours, np.hstack([gain, np.zeros((2, 1))]), rtol=1e-6)
    # A resolution counts as noise of a twelfth of its square.
    rounded = gain_of(filtered(0.0, load, resolution=noise * 12**0.5))
    np.testing.assert_allclose(ours, rounded, rtol=1e-9)


@numba.njit
def drawn(count: int) -> Array:
    numbers = np.empty(count)
    for i in range(count):
        numbers[i] = normal(11, 0, 200, i)
    return numbers


@pytest.mark.slow
def test_estimates_have_the_covariance_that_the_filter_believes_in() -> None:
    """Under LQR at its target, with a load torque that is held for a sample, as it believes.

    The variance of N squares is 2/N times the sum of the squared correlations.
    """
    A, B = held_servo()
    gain = kalman_gain(A, B, [0], np.array([NOISE**2]), LOAD)
    P = np.asarray(control.dlqe(A, B, C, [[LOAD**2]], [[NOISE**2]])[1])
    covariance = (np.eye(2) - gain @ C) @ P
    N, skipped = 110_000, 100
    kept, lagged, total = (np.eye(2) - gain @ C) @ A, covariance, -1.0 * np.ones(2)
    for _ in range(1000):
        total += 2 * (np.diag(lagged) / np.diag(covariance)) ** 2
        lagged = kept @ lagged
    assert 2 * (SIGMAS / WITHIN) ** 2 * total.max() < N - skipped
    w = drawn(N) * LOAD * servo().parameters.Kt
    push = Disturbance("rotor", (0, 0, 0, 0, 1, 0), lambda t: w[round(t / H)])
    law = nominal().law("corrected", "lqr")
    run = closed(law, filtered(), (1.0, 0.0), N * H, disturbances=[push])
    error = (seen(run) - run.state[:-1])[skipped:]
    measured = error.T @ error / len(error)
    np.testing.assert_allclose(np.diag(measured), np.diag(covariance), rtol=WITHIN)
    # The covariance's own spread is at most that of the variances, of their geometric mean.
    scale = np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert abs(measured[0, 1] - covariance[0, 1]) < WITHIN * scale


@pytest.mark.parametrize(("settled", "start"), [(False, 0.0), (True, 2.0)])
def test_a_filter_begins_at_the_true_state_or_at_zero(settled: bool, start: float) -> None:
    estimator = Estimator((SPEED,), "kalman", load=LOAD, settled=settled)
    loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE),), estimators=(estimator,))
    run = played([0.0] * 3, loop, x0=(0.0, 2.0), modelled=True)
    gain = kalman_gain(*held_servo(), [0], np.array([NOISE**2]), LOAD)
    # A first reading of pure noise, within five of its deviations.
    assert abs(seen(run)[0, 1] - start) < 5 * gain[1, 0] * NOISE
    # A state that the filter does not give stays as it was measured.
    assert seen(run)[0, 0] != 0.0


def test_a_filter_waits_until_its_oldest_measurement_is_of_another_instant_than_the_start() -> None:
    """Until then it keeps its first estimate of a moving rotor."""
    estimator = Estimator((ANGLE, SPEED), "kalman", load=LOAD)
    loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE, delay=4 * H),), estimators=(estimator,))
    run = seen(played([0.0] * 8, loop, x0=(0.0, 2.0), modelled=True))
    np.testing.assert_array_equal(run[:5], run[:1].repeat(5, 0))
    assert np.all(np.diff(run[4:, 0]) > H)


@pytest.mark.parametrize("loop", [filtered(1e-12, 1e-3), filtered(1e-3, of=SPEED)])
def test_a_filter_that_cannot_be_is_refused(loop: Loop) -> None:
    """Numbers too far apart, for which SciPy finds a filter that diverges; a hidden position."""
    with pytest.raises(GainError, match="kalman: no steady filter"):
        gain_of(loop)
