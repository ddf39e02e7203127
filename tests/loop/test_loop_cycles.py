"""Limit cycles of switching laws behind a dead time or a lag, beside the harmonic balance."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from looped import CURRENT, H, closed, nominal, servo
from scipy.optimize import brentq

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.loop import Actuator, Computing, Loop, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


def at_the_end(run: Trajectory, law: Controller, rows: int) -> tuple[Array, Array]:
    """s, and the switching gain rho = eta + gamma0 + gamma1 |z|, at the end of a run."""
    q, sliding = law.parameters, run.sliding
    assert sliding is not None
    z = run.state[-rows - 1 : -1] - np.array([1.0, 0.0])
    return sliding[-rows:], q.eta + q.gamma0 + q.gamma1 * np.linalg.norm(z, axis=1)


def root(function: Callable[[float], float], low: float, high: float) -> float:
    solution: Any = brentq(function, low, high)
    return solution


# The implicit law one sample late.
#
# With u_{k-1} at work, s_{k+1} = s_k + G B_d (v_{k-1} + K (z_k - z_{k-1})) on the discrete-time
# surface. In its linear zone |s| <= h rho the law demands v_k = -s_k / (h G B): but for K, which
# is of order h, s_{k+1} = s_k - s_{k-1}. With z, whose poles are 1 but for h, that is
# (z^2 - z + 1) (z - 1)^2: a pair on the unit circle, 60 degrees a sample, period six.


def late_response(law: Controller, angle: float) -> complex:
    """From v to s, one sample late, at an angle a sample."""
    optimum, q, z = law.designed.lqr, law.parameters, np.exp(1j * angle)
    rates = np.vstack([np.hstack([optimum.A, optimum.B]), np.zeros((1, 3))])
    A, B = np.split(scipy.linalg.expm(rates * H)[:2], [2], axis=1)
    moved = np.linalg.solve(z * np.eye(2) - A + B @ q.K / z, B)
    return (q.G @ B).item() * (1 + (q.K @ moved).item() * (1 - 1 / z)) / z / (z - 1)


def saturated(a: float) -> float:
    """Describing function of a saturation at 1 for an amplitude a above it."""
    return 2 / math.pi * (math.asin(1 / a) + math.sqrt(1 - 1 / a**2) / a)


@pytest.mark.slow
def test_the_implicit_law_one_sample_late_circles_as_the_harmonic_balance_says() -> None:
    """1 + N(a) W(e^j angle) = 0, for the saturation is met at all phases: the period is no six.

    The balance leaves out that rho is not constant, and the third harmonic in s.
    """
    law = nominal(switching="implicit", surface="discrete").law("corrected", "grosmc")
    GB = law.parameters.GB.item()
    angle = root(lambda x: late_response(law, x).imag, 0.9, 1.2)
    assert abs(angle - math.pi / 3) < 0.05
    N = -H * GB / late_response(law, angle).real
    a = root(lambda x: saturated(x) - N, 1 + 1e-9, 3)
    s, rho = at_the_end(closed(law, Loop(Computing(delay=H)), (0.0, 0.0), 20.0), law, 4096)
    x = (np.arange(20_000) + 0.5) * math.pi / 20_000
    third = 2 * np.mean(np.clip(a * np.sin(x), -1, 1) * np.sin(3 * x))
    harmonic = abs(third * late_response(law, 3 * angle)) / (H * GB) / a
    left_out = harmonic + np.ptp(rho) / 2 / np.mean(rho)
    assert left_out < 0.03
    # The angle at which a sine explains most of s.
    angles, k, window = np.linspace(0.98, 1.1, 1201), np.arange(len(s)), np.hanning(len(s))
    sizes = [2 * abs(np.sum(window * s * np.exp(-1j * w * k))) / window.sum() for w in angles]
    best = int(np.argmax(sizes))
    assert abs(angles[best] / angle - 1) < harmonic
    assert abs(saturated(sizes[best] / (H * float(np.mean(rho)))) - N) < left_out
    # Twenty times the size on time.
    on_time, _ = at_the_end(closed(law, Loop(), (0.0, 0.0), 20.0), law, 4096)
    assert np.abs(on_time).max() < 0.05 * sizes[best]


# The sign law behind two lags: a relay and an integrator, which oscillates where two lags turn
# the phase by 90 degrees, w = 1 / tau, with the amplitude 2 rho tau / pi, but for K and sampling.
TAU, STEP = 2e-3, 1e-4


def lagged_response(law: Controller, w: float, delay: float) -> complex:
    """From v to s behind two lags, and a delay by sampling, at w [rad/s]."""
    optimum, s = law.designed.lqr, 1j * w
    lag = 1 / (TAU * s + 1) ** 2 * np.exp(-s * delay)
    moved = np.linalg.solve(s * np.eye(2) - optimum.A + lag * optimum.B @ optimum.K, optimum.B)
    return law.parameters.GB.item() * lag * (1 + (1 - lag) * (optimum.K @ moved).item()) / s


def relay_frequency(law: Controller, delay: float, harmonics: int) -> float:
    """Where a relay oscillates, by Tsypkin: sum of Im W(n w) / n = 0; its first term alone is
    the describing function's."""

    def crossing(w: float) -> float:
        numbers = range(1, harmonics + 1, 2)
        return sum(lagged_response(law, n * w, delay).imag / n for n in numbers)

    return root(crossing, 0.5 / TAU, 1.5 / TAU)


@pytest.mark.slow
def test_a_relay_behind_two_lags_oscillates_as_its_describing_function_says() -> None:
    """A sampled relay switches between 0 and one sample late, a half on average.

    The describing function leaves out the third harmonic, of e3 in s, and that rho swings.
    """
    law = nominal().law("corrected", "grosmc")
    loop = Loop(actuators=(Actuator(CURRENT, lag=TAU, order=2),))
    periods: dict[str, Any] = {"control_period": STEP, "timestep": STEP}
    looped = in_loop(law, loop, SERVO, **periods)
    run = simulate(servo(), looped, (0.0, 0.0), duration=6.0, **periods)
    s, rho = at_the_end(run, law, 20_000)
    up = np.flatnonzero((s[:-1] < 0) & (s[1:] >= 0))
    measured = 2 * math.pi * (len(up) - 1) / ((up[-1] - up[0]) * STEP)
    k = np.arange(up[0], up[-1])
    size = 2 * abs(np.mean(s[k] * np.exp(-1j * measured * STEP * k)))
    w = relay_frequency(law, STEP / 2, 1)
    W = abs(lagged_response(law, w, STEP / 2))
    e3 = abs(lagged_response(law, 3 * w, STEP / 2)) / 3 / W
    assert e3 < 0.025
    assert abs(measured / w - 1) < e3
    expected = 4 * np.mean(rho) / math.pi / law.parameters.GB.item() * W
    assert abs(size / expected - 1) < e3 + np.std(rho) / np.mean(rho)
    # With all harmonics the frequency is exact but for the sampling.
    assert relay_frequency(law, STEP, 199) < measured < relay_frequency(law, 0.0, 199)
