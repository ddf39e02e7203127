"""The plant that a law believes in, moved by a time: observers and predictions run it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.errors import ArgumentError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants.runge_kutta import state_derivative
from grosmc_mj.robots.coordinates import RobotCoordinates
from grosmc_mj.vectors import each

# Jitable (t, x, u, h, memory, p, own): move x, (n,), by h [s] under the input u, (m,); memory and p
# are the law's, own the model's.
Advance = Callable[[float, Any, Any, float, Any, Any, Any], None]
# Of a state and an input, to differentiate by.
_STEP = 1e-6


class DesignModel(NamedTuple):
    """How a design model moves.

    Attributes:
        advance: Moves it.
        own: Room for ``advance`` to compute in, and its numbers, flat.
    """

    advance: Advance
    own: Array


def design_model(controller: Controller, reason: str) -> DesignModel:
    """How the design model of a controller moves.

    Plants with equations by one step of the midpoint rule, models about an operating point by the
    same on their linearization, robots by their accelerations, q + h q' + h^2/2 q''.

    Args:
        controller: Whose.
        reason: What needs it.

    Raises:
        ArgumentError: If it has none.
    """
    if controller.design is None:
        raise ArgumentError(f"{controller.name} has no design model, which {reason} needs")
    error, optimum = controller.design.error, controller.design.lqr
    room = np.zeros(2 * len(error.system.states))
    if isinstance(error, ErrorCoordinates):
        calm = np.zeros(max(1, 6 * len(error.system.bodies)))
        return DesignModel(_of_equations(error), np.concatenate([room, calm]))
    if isinstance(error, StateCoordinates):
        point = controller.parameters.reference
        numbers = np.ravel(optimum.A), np.ravel(optimum.B), point.x, point.u
        return DesignModel(_linear, np.concatenate([room, *numbers]))
    if isinstance(error, RobotCoordinates):
        return DesignModel(_of_robot(error), room)
    raise ArgumentError(f"{type(error).__name__} have no design model to predict by")


@cache
def _of_equations(error: ErrorCoordinates) -> Advance:
    slope_at = state_derivative(error.system)

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        n = len(x)
        slope, stage, calm = own[:n], own[n : 2 * n], own[2 * n :]
        slope_at(x, u, calm, p.plant, slope)
        for i in range(n):
            stage[i] = x[i] + 0.5 * h * slope[i]
        slope_at(stage, u, calm, p.plant, slope)
        for i in range(n):
            x[i] += h * slope[i]

    return advance


@jitable
def _linear_slope(x: Any, u: Any, own: Any, slope: Any) -> None:
    """x' = A (x - x_e) + B (u - u_e), with A, B, x_e and u_e behind the room of ``own``."""
    n, m = len(x), len(u)
    A, B = 2 * n, 2 * n + n * n
    x_e, u_e = B + n * m, B + n * m + n
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += own[A + n * i + j] * (x[j] - own[x_e + j])
        for j in range(m):
            total += own[B + m * i + j] * (u[j] - own[u_e + j])
        slope[i] = total


@jitable
def _linear(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
    n = len(x)
    slope, stage = own[:n], own[n : 2 * n]
    _linear_slope(x, u, own, slope)
    for i in range(n):
        stage[i] = x[i] + 0.5 * h * slope[i]
    _linear_slope(stage, u, own, slope)
    for i in range(n):
        x[i] += h * slope[i]


@cache
def _of_robot(error: RobotCoordinates) -> Advance:
    driven, reference, joints = error.driven, error.reference, error.inputs
    accelerations, vector = error.accelerations, each(joints, lambda i, u: u[i])

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        v = driven(t, x, vector(u), memory, p)
        moved = accelerations(v, reference(t, p.reference))
        for i in range(joints):
            x[i] += h * x[i + joints] + 0.5 * h * h * moved[i]
            x[i + joints] += h * moved[i]

    return advance


def held(controller: Controller, model: DesignModel, rest: Array, period: float) -> Any:
    """(A_d, B_d) of the design model over a period, by central differences at zero error.

    Args:
        controller: Whose model it is.
        model: How it moves.
        rest: Input about which, (m,).
        period: [s].

    Returns:
        A_d (n, n) and B_d (n, m).
    """
    error, p = controller.designed.error, controller.parameters
    memory, _kept_alive = controller.begin()
    of_state = isinstance(error, StateCoordinates)
    x = np.array(p.reference.x if of_state else error.place(0.0, np.zeros(error.size), p), float)
    n, columns = len(x), []
    for i in range(n + len(rest)):
        ends = []
        for sign in (1.0, -1.0):
            both = np.concatenate([x, rest])
            both[i] += sign * _STEP
            model.advance(0.0, both[:n], both[n:], period, memory, p, model.own)
            ends.append(both[:n].copy())
        columns.append((ends[0] - ends[1]) / (2 * _STEP))
    whole = np.column_stack(columns)
    return whole[:, :n], whole[:, n:]
