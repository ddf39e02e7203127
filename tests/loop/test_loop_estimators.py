"""Estimators of a rate and the Kalman filter: exactness, noise and gain."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest
import scipy.linalg
from looped import ANGLE, CURRENT, SPEED, H, applied, played, scripted, seen, servo

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GainError
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.loop.estimators import levant
from grosmc_mj.loop.kalman import kalman_gain
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.disturbances import Disturbance

EPS = np.finfo(float).eps
L, RATE = 10.0, 2.0
# Readings of up to 3 rad, rounded, over a period: a factor for the roundings on the way.
ROUNDING = 16 * EPS * 3 / H


def differentiated(y: Array) -> Array:
    """The rates that Levant's differentiator gives."""
    position, rate, rates = float(y[0]), 0.0, []
    for reading in y.tolist():
        position, rate = levant(position, rate, reading, L, H)
        rates.append(rate)
    return np.array(rates)


def test_levant_is_exact_below_its_bound_and_noise_costs_the_root_of_itself() -> None:
    """Without chatter: once there it is the slope of the secant, sample by sample.

    e sin(sqrt(L / e) t) might be the signal itself: it must be followed, to a rate sqrt(L e). Left
    out are the secant instead of the slope, less (w T)^2 / 24, and that samples miss the crest,
    less (w T)^2 / 8.
    """
    t = np.arange(2000) * H
    for acceleration in (-9.0, 9.0):
        y = 0.5 * acceleration * t**2
        # A difference of two readings over T, each of them rounded.
        rounding = 4 * EPS * (np.abs(y).max() + 1.0) / H
        expected = acceleration * (t[-1000:] - H / 2)
        np.testing.assert_allclose(differentiated(y)[-1000:], expected, rtol=0, atol=rounding)
    # Beyond its bound it turns its rate by 1.1 L at most, and is left behind.
    late = differentiated(L * t**2)
    assert np.abs(np.diff(late)).max() == pytest.approx(1.1 * L * H, rel=1e-9)
    assert 2 * L * t[-1] - late[-1] >= 0.9 * L * t[-1] * (1 - 1e-2)
    for e in (1e-4, 1e-2):
        w = math.sqrt(L / e)
        t = np.arange(round(20 * 2 * math.pi / (w * H))) * H
        largest = np.abs(differentiated(e * np.sin(w * t))[len(t) // 2 :]).max()
        assert 1 - (w * H) ** 2 / 6 <= largest / math.sqrt(L * e) <= 1 + 1e-9


def coasting(law: Any, samples: int = 1500, *, settled: bool = False, **number: float) -> Array:
    """Error of an estimate while the rotor turns at a constant rate, held by its input.

    Of an extended observer 0.3 A that a constant load makes up for.
    """
    p, estimator = servo().parameters, Estimator((SPEED,), law, settled=settled, **number)
    u, pushes = p.B * RATE / p.Kt, []
    if law == "eso":
        u, load = 0.3, p.Kt * 0.3 - p.B * RATE
        pushes = [Disturbance("rotor", (0, 0, 0, 0, load, 0))]
    run = played(
        np.full(samples, u), Loop(estimators=(estimator,)), x0=(0.0, RATE),
        modelled=law == "eso", disturbances=pushes,
    )  # fmt: skip
    np.testing.assert_allclose(run.state[:, 1], RATE, rtol=1e-12)
    return seen(run)[:, 1] - run.state[:-1, 1]


@pytest.mark.parametrize(
    ("law", "number"),
    [
        ("difference", {}),
        ("filtered", {"time_constant": 5e-3}),
        ("levant", {"slope": 20.0}),
        ("high-gain", {"bandwidth": 50.0}),
        ("eso", {"bandwidth": 50.0}),
    ],
)
def test_a_constant_rate_is_estimated_exactly(law: str, number: dict[str, Any]) -> None:
    """After a transient with the poles that it is tuned for."""
    error = coasting(law, **number)
    assert error[0] == -RATE
    assert np.abs(error[-100:]).max() < ROUNDING
    if law == "filtered":
        decay = -RATE * np.exp(-np.arange(50) / 5)
        np.testing.assert_allclose(error[:50], decay, rtol=0, atol=ROUNDING)
    if law == "high-gain":
        pole = math.exp(-50.0 * H)
        rest = error[2:] - 2 * pole * error[1:-1] + pole**2 * error[:-2]
        assert np.abs(rest).max() < 4 * ROUNDING
        assert error[20] < -0.5
    if law != "eso":
        assert np.abs(coasting(law, 200, settled=True, **number)).max() < ROUNDING


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
    errors, p = [], servo().parameters
    for predict in (True, False):
        run = played(u, loop, stride=stride, modelled=True, predict=predict)
        # A measurement is 2 timesteps old; between samples it grows older.
        errors.append(np.abs((seen(run)[2:, 1] - run.state[:-3, 1])[::stride]).max())
    bound = 4 * p.Kt / p.J * H * p.B * H / p.J * stride**2
    assert errors[0] < bound < 0.1 * errors[1]


# The Kalman filter: as much load in a sample as noise, so that it forgets at once

NOISE, LOAD = 1e-5, 1.0


def held_servo() -> tuple[Array, Array]:
    p = servo().parameters
    rates = np.array([[0.0, 1.0, 0.0], [0.0, -p.B / p.J, p.Kt / p.J], [0.0, 0.0, 0.0]])
    transition = scipy.linalg.expm(rates * H)
    return transition[:2, :2], transition[:2, 2:]


def gain_of(noise: float, load: float, of: str = ANGLE, resolution: float = 0.0) -> Array:
    sensor = Sensor(of, resolution, noise=noise)
    loop = Loop(
        sensors=(sensor,), estimators=(Estimator((ANGLE, SPEED), "kalman", load=load),)
    )  # fmt: skip
    return applied(in_loop(scripted([0.0], modelled=True), loop, SERVO)).start.gain


@pytest.mark.parametrize(("noise", "load"), [(1e-3, 1e-2), (1e-7, 1.0)])
def test_the_gain_is_python_control_s(noise: float, load: float) -> None:
    """Theirs is of the predicted state, A times ours; two solvers of one Riccati equation."""
    A, B = held_servo()
    gain = kalman_gain(A, B, [0], np.array([noise**2]), load)
    theirs, *_ = control.dlqe(A, B, [[1.0, 0.0]], [[load**2]], [[noise**2]])
    np.testing.assert_allclose(A @ gain, theirs, rtol=1e-6)
    # Differences over 1e-6 of a linear model are off by rounding: 1e-16 / 1e-6, over h.
    ours = gain_of(noise, load)
    np.testing.assert_allclose(ours, np.hstack([gain, np.zeros((2, 1))]), rtol=1e-6)
    # A resolution counts as noise of a twelfth of its square.
    rounded = gain_of(0.0, load, resolution=noise * 12**0.5)
    np.testing.assert_allclose(ours, rounded, rtol=1e-9)


def test_a_filter_begins_at_the_true_state_or_at_zero_and_waits_for_news() -> None:
    gain = kalman_gain(*held_servo(), [0], np.array([NOISE**2]), LOAD)
    for settled, start in ((False, 0.0), (True, 2.0)):
        estimator = Estimator((SPEED,), "kalman", load=LOAD, settled=settled)
        loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE),), estimators=(estimator,))
        run = played([0.0] * 50, loop, x0=(0.0, 2.0), modelled=True)
        # Its error is of the order of what a load of 1 A does to the rate in a sample.
        assert seen(run)[-1, 1] == pytest.approx(run.state[-2, 1], abs=0.05)
        # A first reading of pure noise, within five of its deviations.
        assert abs(seen(run)[0, 1] - start) < 5 * gain[1, 0] * NOISE
        # A state that the filter does not give stays as it was measured.
        assert seen(run)[0, 0] != 0.0
    # Until its oldest measurement is of another instant than the start of a moving rotor.
    estimator = Estimator((ANGLE, SPEED), "kalman", load=LOAD)
    loop = Loop(sensors=(Sensor(ANGLE, noise=NOISE, delay=4 * H),), estimators=(estimator,))
    run = seen(played([0.0] * 8, loop, x0=(0.0, 2.0), modelled=True))
    np.testing.assert_array_equal(run[:5], run[:1].repeat(5, 0))
    assert np.all(np.diff(run[4:, 0]) > H)


@pytest.mark.parametrize(("noise", "load", "of"), [(1e-12, 1e-3, ANGLE), (1e-3, LOAD, SPEED)])
def test_a_filter_that_cannot_be_is_refused(noise: float, load: float, of: str) -> None:
    """Numbers too far apart, for which SciPy finds a filter that diverges; a hidden position."""
    with pytest.raises(GainError, match="kalman: no steady filter"):
        gain_of(noise, load, of)
