"""The limit cycle of a switching law behind two lags, beside the harmonic balance."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from looped import CURRENT, nominal, servo
from scipy.optimize import brentq

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.loop import Actuator, Loop, in_loop
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


def at_the_end(run: Trajectory, law: Controller, rows: int) -> tuple[Array, Array]:
    """s, and the switching gain rho = eta + gamma0 + gamma1 |z|, at the end of a run."""
    q, sliding = law.parameters, run.sliding
    assert sliding is not None
    z = run.state[-rows - 1 : -1] - np.array([1.0, 0.0])
    return sliding[-rows:], q.eta + q.gamma0 + q.gamma1 * np.linalg.norm(z, axis=1)


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

    solution: Any = brentq(crossing, 0.5 / TAU, 1.5 / TAU)
    return solution


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
