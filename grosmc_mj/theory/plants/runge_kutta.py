"""One step of the analytic plants under held input and disturbances."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.theory.plants import System


# One function serves all plants of a system, and is compiled once.
@cache
def runge_kutta_step(system: System) -> Callable[..., None]:
    """Compile the classical fourth-order step of x' = f(x) + g(x) u + d(x, w) + rates.

    Returns:
        A jitable (x, u, w, rates, p, h, slope, stage, total) that moves x, (n,), by h under u,
        (m,), and added rates, (n,); the last three are scratch space, (n,).
    """
    n = len(system.states)
    slope_at = state_derivative(system)

    # Nested, for numba takes n and slope_at as constants.
    @jitable
    def step(
        x: Any,
        u: Any,
        w: Any,
        rates: Any,
        p: Any,
        h: float,
        slope: Any,
        stage: Any,
        total: Any,
    ) -> None:
        # Most runs add nothing, and to add it in each stage takes a sixth of a step.
        disturbed = False
        for i in range(n):
            stage[i] = x[i]
            total[i] = 0.0
            if rates[i] != 0.0:
                disturbed = True

        for k in range(4):
            weight = 2.0 if k == 1 or k == 2 else 1.0
            reach = h if k == 2 else 0.5 * h
            slope_at(stage, u, w, p, slope)
            if disturbed:
                for i in range(n):
                    slope[i] += rates[i]
            for i in range(n):
                total[i] += weight * slope[i]
                stage[i] = x[i] + reach * slope[i]

        for i in range(n):
            x[i] += h / 6.0 * total[i]

    return step


@cache
def state_derivative(system: System) -> Callable[..., None]:
    """Jitable (x, u, w, p, slope): write x' = f(x) + g(x) u + d(x, w) into slope, (n,)."""
    n = len(system.states)
    m = len(system.inputs)
    drift = system.symbolic_equations.drift
    input_matrix = system.symbolic_equations.input_matrix
    disturbance = system.symbolic_equations.disturbance

    @jitable
    def slope_at(x: Any, u: Any, w: Any, p: Any, slope: Any) -> None:
        f = drift(x, p)
        g = input_matrix(x, p)
        d = disturbance(x, w, p)
        for i in range(n):
            rate = f[i]
            for j in range(m):
                rate += g[i * m + j] * u[j]
            slope[i] = rate + d[i]

    return slope_at
