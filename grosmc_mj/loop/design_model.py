"""The plant that a law believes in, moved by a time: what observers and predictions run."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Design
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError, GainError, one_line
from grosmc_mj.jitable import jitable
from grosmc_mj.plants.runge_kutta import state_derivative
from grosmc_mj.robots.coordinates import RobotCoordinates

# Jitable (t, u, memory, p, h): move ``memory.loop.model`` by h [s] under the input u.
Advance = Callable[[float, Any, Any, Any, float], None]
# Of a state and an input, to differentiate by.
_STEP = 1e-6
# Poles of a filter from here on are 1 but for the rounding of such differences.
_FADES = 1 - 1e-9


def advance_of(error: OutputCoordinates | StateCoordinates) -> Advance:
    """How the design model of these error coordinates moves.

    Plants with equations by one step of the midpoint rule, models about an operating point by the
    same on their linearization, robots by their accelerations, q + h q' + h^2/2 q''.

    Raises:
        ArgumentError: If they have no design model.
    """
    if isinstance(error, ErrorCoordinates):
        return _by_equations(error)
    if isinstance(error, StateCoordinates):
        return _linear(error.size, error.inputs)
    if isinstance(error, RobotCoordinates):
        return _of_robot(error)
    raise ArgumentError(f"{type(error).__name__} have no design model to predict by")


@cache
def _by_equations(error: ErrorCoordinates) -> Advance:
    step = _midpoint(len(error.system.states), state_derivative(error.system))

    @jitable
    def advance(t: float, u: Any, memory: Any, p: Any, h: float) -> None:
        step(memory.loop, u, p.plant, h)

    return advance


@cache
def _linear(n: int, m: int) -> Advance:
    @jitable
    def slope_at(x: Any, u: Any, w: Any, q: Any, slope: Any) -> None:
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += q.A[i, j] * (x[j] - q.x_e[j])
            for j in range(m):
                total += q.B[i, j] * (u[j] - q.rest[j])
            slope[i] = total

    step = _midpoint(n, slope_at)

    @jitable
    def advance(t: float, u: Any, memory: Any, p: Any, h: float) -> None:
        step(memory.loop, u, p.loop, h)

    return advance


def _midpoint(n: int, slope_at: Callable[..., None]) -> Callable[..., None]:
    """Jitable (loop, u, p, h): move ``loop.model``, (n,), by h under u, without a wrench."""

    @jitable
    def step(loop: Any, u: Any, p: Any, h: float) -> None:
        slope_at(loop.model, u, loop.calm, p, loop.slope)
        for i in range(n):
            loop.stage[i] = loop.model[i] + 0.5 * h * loop.slope[i]
        slope_at(loop.stage, u, loop.calm, p, loop.slope)
        for i in range(n):
            loop.model[i] += h * loop.slope[i]

    return step


@cache
def _of_robot(error: RobotCoordinates) -> Advance:
    virtual_input, accelerations, joints = error.virtual_input, error.accelerations, error.inputs

    @jitable
    def advance(t: float, u: Any, memory: Any, p: Any, h: float) -> None:
        x, a = memory.loop.model, memory.loop.slope[:joints]
        virtual_input(t, x, u, memory, p, a)
        accelerations(t, a, p, a)
        for i in range(joints):
            x[i] += h * x[i + joints] + 0.5 * h * h * a[i]
            x[i + joints] += h * a[i]

    return advance


def held(
    design: Design, advance: Advance, memory: Any, p: Any, period: float
) -> tuple[Array, Array]:
    """(A_d, B_d) of the design model over a period, by central differences at zero error.

    Args:
        design: Whose model it is.
        advance: How it moves.
        memory: Of a run, with room to compute in.
        p: The law's parameters, with its loop's.
        period: [s].

    Returns:
        A_d (n, n) and B_d (n, m).
    """
    error = design.error
    of_state = isinstance(error, StateCoordinates)
    x = np.array(p.reference.x if of_state else error.place(0.0, np.zeros(error.size), p), float)
    u, columns = np.array(p.loop.rest, float), []
    for i in range(len(x) + len(u)):
        ends = []
        for sign in (1.0, -1.0):
            at, by = x.copy(), u.copy()
            (at if i < len(x) else by)[i if i < len(x) else i - len(x)] += sign * _STEP
            memory.loop.model[:] = at
            advance(0.0, by, memory, p, period)
            ends.append(memory.loop.model.copy())
        columns.append((ends[0] - ends[1]) / (2 * _STEP))
    found = np.column_stack(columns)
    return found[:, : len(x)], found[:, len(x) :]


def kalman_gain(
    A: Array, B: Array, measured: list[int], variances: Array, load: float
) -> tuple[Array, Array]:
    """Steady-state Kalman gain of x_{k+1} = A x + B (u + w), y = C x + v, and what it comes to.

    Args:
        A: (n, n).
        B: (n, m).
        measured: Rows of x that are measured.
        variances: Of their noise v, (len(measured),).
        load: Standard deviation of each entry of w.

    Returns:
        The gain on y - C x of the predicted state, (n, len(measured)), and the covariance of the
        estimate after it, (n, n).

    Raises:
        GainError: If there is no such filter.
    """
    C = np.eye(len(A))[measured]
    noise = np.diag(variances)
    try:
        P = scipy.linalg.solve_discrete_are(A.T, C.T, load**2 * B @ B.T, noise)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise GainError(
            "kalman: no steady filter: what has a [[sensor]] does not determine the other states; "
            f"measure another one ({one_line(str(error))})"
        ) from None
    gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + noise)
    kept = np.eye(len(A)) - gain @ C
    # Numbers too far apart make a solution that is none.
    steady = np.all(np.isfinite(gain)) and np.abs(np.linalg.eigvals(kept @ A)).max() < _FADES
    if not steady:
        raise GainError(
            "kalman: no steady filter for what is measured: noise and load are too far apart, or "
            "a state that the load does not reach is not seen"
        )
    return gain, kept @ P
