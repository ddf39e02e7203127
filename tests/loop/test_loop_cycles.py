"""Limit cycles of switching laws behind a dead time or a lag, beside what theory says of them."""

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

LAST = 4096


def cycle(run: Trajectory, rows: int = LAST) -> Array:
    """s at the end of a run."""
    assert run.sliding is not None
    return run.sliding[-rows:]


def gains_of(run: Trajectory, law: Controller, rows: int = LAST) -> Array:
    """The switching gain rho = eta + gamma0 + gamma1 |z| at the end of a run."""
    q = law.parameters
    z = run.state[-rows - 1 : -1] - np.array([1.0, 0.0])
    return q.eta + q.gamma0 + q.gamma1 * np.linalg.norm(z, axis=1)


def fundamental(s: Array, angles: Any) -> tuple[float, float]:
    """Angle a sample and amplitude of a periodic signal: where a sine explains most of it."""
    k = np.arange(len(s))
    window = np.hanning(len(s))

    def size(angle: float) -> float:
        return 2 * abs(np.sum(window * s * np.exp(-1j * angle * k))) / window.sum()

    sizes = [size(angle) for angle in angles]
    best = int(np.argmax(sizes))
    assert 0 < best < len(sizes) - 1
    return float(angles[best]), sizes[best]


def root(function: Callable[[float], float], low: float, high: float) -> float:
    found: Any = brentq(function, low, high)
    return found


# The implicit law one sample late.
#
# With u_{k-1} at work, s_{k+1} = s_k + G B_d (v_{k-1} + K (z_k - z_{k-1})) on the discrete-time
# surface. In its linear zone |s| <= h rho the law asks for v_k = -s_k / (h G B): but for K, which
# is of order h, s_{k+1} = s_k - s_{k-1}. With z, whose poles are 1 but for h, that is
# (z^2 - z + 1) (z - 1)^2: a pair on the unit circle, 60 degrees a sample, period six.


def late_implicit() -> Controller:
    return nominal(switching="implicit", surface="discrete").law("corrected", "grosmc")


def held(law: Controller) -> tuple[Array, Array]:
    """A_d, B_d of the error state over a sample."""
    optimum = law.designed.lqr
    n = len(optimum.A)
    both = np.block([[optimum.A, optimum.B], [np.zeros((1, n + 1))]])
    transition = scipy.linalg.expm(both * H)
    return transition[:n, :n], transition[:n, n:]


def late_response(law: Controller, angle: float) -> complex:
    """From v to s, one sample late, at an angle a sample."""
    (A, B), q, z = held(law), law.parameters, np.exp(1j * angle)
    moved = np.linalg.solve(z * np.eye(2) - A + B @ q.K / z, B)
    through_z = (q.K @ moved).item() * (1 - 1 / z)
    return (q.G @ B).item() * (1 + through_z) / z / (z - 1)


def saturated(a: float) -> float:
    """Describing function of a saturation at 1 for an amplitude a above it."""
    return 2 / math.pi * (math.asin(1 / a) + math.sqrt(1 - 1 / a**2) / a)


def test_the_linear_zone_one_sample_late_has_the_poles_of_period_six() -> None:
    law = late_implicit()
    (A, B), q = held(law), law.parameters
    F = np.zeros((4, 4))  # of z, the input on its way and s
    F[:2, :2], F[:2, 2:3], F[2, :2] = A, B, -q.K
    F[2, 3] = -1 / (H * q.GB.item())
    F[3, :2], F[3, 2:3] = q.G @ (A - np.eye(2)) - H * q.S, q.G @ B
    F[3, 3] = 1.0
    by_hand = np.polymul([1, -1, 1], [1, -2, 1])
    size = H * abs((q.K @ law.designed.lqr.B).item())
    np.testing.assert_allclose(np.poly(F), by_hand, rtol=0, atol=2 * size)
    poles = np.linalg.eigvals(F)
    fast = poles[np.argmax(poles.imag)]
    assert abs(np.angle(fast) - math.pi / 3) < size
    # Unstable, so that saturation decides the amplitude.
    assert 1 < abs(fast) < 1 + size


@pytest.mark.slow
def test_the_implicit_law_one_sample_late_circles_as_the_harmonic_balance_says() -> None:
    """1 + N(a) W(e^j angle) = 0, for the saturation is met at all phases: the period is no six.

    What the balance leaves out: that rho is not constant, and the third harmonic in s.
    """
    law = late_implicit()
    q = law.parameters
    angle = root(lambda x: late_response(law, x).imag, 0.9, 1.2)
    N = -H * q.GB.item() / late_response(law, angle).real
    a = root(lambda x: saturated(x) - N, 1 + 1e-9, 3)
    run = closed(law, Loop(Computing(delay=H)), (0.0, 0.0), 20.0)
    rho = gains_of(run, law)
    x = (np.arange(20_000) + 0.5) * math.pi / 20_000
    third = 2 * np.mean(np.clip(a * np.sin(x), -1, 1) * np.sin(3 * x))
    harmonic = abs(third * late_response(law, 3 * angle)) / (H * q.GB.item()) / a
    left_out = harmonic + np.ptp(rho) / 2 / np.mean(rho)
    assert left_out < 0.03
    found, size = fundamental(cycle(run), np.linspace(0.98, 1.1, 1201))
    assert abs(found / angle - 1) < harmonic
    assert abs(saturated(size / (H * float(np.mean(rho)))) - N) < left_out
    # Twenty times what it is on time.
    on_time = closed(law, Loop(), (0.0, 0.0), 20.0)
    assert np.abs(cycle(on_time)).max() < 0.05 * size


# The sign law behind two lags: a relay and an integrator, which oscillates where two lags turn
# the phase by 90 degrees, w = 1 / tau, with the amplitude 2 rho tau / pi, but for K and sampling.
TAU, STEP, ROWS = 2e-3, 1e-4, 20_000


def lagged_response(law: Controller, w: float, delay: float) -> complex:
    """From v to s behind two lags, and a delay by sampling, at w [rad/s]."""
    optimum, s = law.designed.lqr, 1j * w
    lag = 1 / (TAU * s + 1) ** 2 * np.exp(-s * delay)
    moved = np.linalg.solve(s * np.eye(2) - optimum.A + lag * optimum.B @ optimum.K, optimum.B)
    return law.parameters.GB.item() * lag * (1 + (1 - lag) * (optimum.K @ moved).item()) / s


def relay_frequency(law: Controller, delay: float, harmonics: int) -> float:
    """Where a relay oscillates, by Tsypkin: sum of Im W(n w) / n = 0; its first term alone is
    the describing function's."""
    numbers = range(1, harmonics + 1, 2)

    def crossing(w: float) -> float:
        return sum(lagged_response(law, n * w, delay).imag / n for n in numbers)

    return root(crossing, 0.5 / TAU, 1.5 / TAU)


@pytest.mark.slow
def test_a_relay_behind_two_lags_oscillates_as_its_describing_function_says() -> None:
    """A sampled relay switches between 0 and one sample late, a half on average.

    The describing function leaves out the third harmonic, of e3 in s, and that rho swings.
    """
    law = nominal().law("corrected", "grosmc")
    loop = Loop(actuators=(Actuator(CURRENT, lag=TAU, order=2),))
    looped = in_loop(law, loop, SERVO, control_period=STEP, timestep=STEP)
    run = simulate(servo(), looped, (0.0, 0.0), duration=6.0, control_period=STEP, timestep=STEP)
    s, rho = cycle(run, ROWS), gains_of(run, law, ROWS)
    up = np.flatnonzero((s[:-1] < 0) & (s[1:] >= 0))
    measured = 2 * math.pi * (len(up) - 1) / ((up[-1] - up[0]) * STEP)
    k = np.arange(up[0], up[-1])
    size = 2 * abs(np.mean(s[k] * np.exp(-1j * measured * STEP * k)))
    w = relay_frequency(law, STEP / 2, 1)
    W = lagged_response(law, w, STEP / 2)
    e3 = abs(lagged_response(law, 3 * w, STEP / 2)) / 3 / abs(W)
    assert e3 < 0.025
    assert abs(measured / w - 1) < e3
    wanted = 4 * np.mean(rho) / math.pi / law.parameters.GB.item() * abs(W)
    assert abs(size / wanted - 1) < e3 + np.std(rho) / np.mean(rho)
    # With all harmonics the frequency is exact but for the sampling.
    assert relay_frequency(law, STEP, 199) < measured < relay_frequency(law, 0.0, 199)
