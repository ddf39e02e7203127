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

# Jitable (t, x, u, h, memory, p, own): move x, (n,), by h [s] under the input u, (m,); memory and p
# are the law's, own the model's.
Advance = Callable[[float, Any, Any, float, Any, Any, Any], None]
# Of a state and an input, to differentiate by.
_STEP = 1e-6


class DesignModel(NamedTuple):
    """How a design model moves.

    Attributes:
        advance: Moves it.
        own: Room for ``advance`` to compute in, 2 n numbers, then the model's own numbers.
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
    if isinstance(error, ErrorCoordinates):
        advance, numbers = _of_equations(error), [np.zeros(max(1, 6 * len(error.system.bodies)))]
    elif isinstance(error, StateCoordinates):
        point = controller.parameters.reference
        advance, numbers = _LINEAR, [np.ravel(optimum.A), np.ravel(optimum.B), point.x, point.u]
    else:
        advance, numbers = _of_robot(error), []
    room = np.zeros(2 * len(error.system.states))
    return DesignModel(advance, np.concatenate([room, *numbers]))


def _midpoint(slope_at: Callable[[Any, Any, Any, Any, Any], None]) -> Advance:
    """One step of the midpoint rule with a jitable (x, u, numbers, p, slope)."""

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        n = len(x)
        slope, stage, numbers = own[:n], own[n : 2 * n], own[2 * n :]
        slope_at(x, u, numbers, p, slope)
        for i in range(n):
            stage[i] = x[i] + 0.5 * h * slope[i]
        slope_at(stage, u, numbers, p, slope)
        for i in range(n):
            x[i] += h * slope[i]

    return advance


@cache
def _of_equations(error: ErrorCoordinates) -> Advance:
    """Of a plant with equations, under no wrench."""
    equations = state_derivative(error.system)

    def slope_at(x: Any, u: Any, calm: Any, p: Any, slope: Any) -> None:
        equations(x, u, calm, p.plant, slope)

    return _midpoint(jitable(slope_at))


@jitable
def _linear_slope(x: Any, u: Any, numbers: Any, p: Any, slope: Any) -> None:
    """x' = A (x - x_e) + B (u - u_e) with the numbers A, B, x_e and u_e."""
    n, m = len(x), len(u)
    B, x_e, u_e = n * n, n * n + n * m, n * n + n * m + n
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += numbers[n * i + j] * (x[j] - numbers[x_e + j])
        for j in range(m):
            total += numbers[B + m * i + j] * (u[j] - numbers[u_e + j])
        slope[i] = total


_LINEAR = _midpoint(_linear_slope)


@cache
def _of_robot(error: Any) -> Advance:
    """Of ``RobotCoordinates``."""
    virtual_input, accelerations, joints = error.virtual_input, error.accelerations, error.inputs

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        a = own[:joints]
        virtual_input(t, x, u, memory, p, a)
        accelerations(t, a, p, a)
        for i in range(joints):
            x[i] += h * x[i + joints] + 0.5 * h * h * a[i]
            x[i + joints] += h * a[i]

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
    x = p.reference.x if of_state else error.place(0.0, np.zeros(error.size), p)
    n, point = len(x), np.concatenate([x, rest])

    def moved(both: Array) -> Array:
        model.advance(0.0, both[:n], both[n:], period, memory, p, model.own)
        return both[:n]

    steps = _STEP * np.eye(len(point))
    both = np.transpose([(moved(point + h) - moved(point - h)) / (2 * _STEP) for h in steps])
    return both[:, :n], both[:, n:]
