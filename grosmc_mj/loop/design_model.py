"""The plant that a law believes in, moved by a time: observers and predictions run it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
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
        own: Its numbers and room to compute in, a dataclass.
    """

    advance: Advance
    own: Any


@dataclass
class _Room:
    """Room for the midpoint rule: a slope and a state, (n,), and no wrench."""

    slope: Array
    stage: Array
    calm: Array

    @classmethod
    def of(cls, n: int, bodies: int, **more: Any) -> Any:
        return cls(np.zeros(n), np.zeros(n), np.zeros(max(1, 6 * bodies)), **more)


@dataclass
class _Linear(_Room):
    """x' = A (x - x_e) + B (u - u_e)."""

    A: Array
    B: Array
    x_e: Array
    u_e: Array


@dataclass
class _Nothing:
    nothing: float = field(default=0.0)


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
    n, bodies = len(error.system.states), len(error.system.bodies)
    if isinstance(error, ErrorCoordinates):
        return DesignModel(_of_equations(error), _Room.of(n, bodies))
    if isinstance(error, StateCoordinates):
        point = controller.parameters.reference
        A, B = np.ascontiguousarray(optimum.A), np.ascontiguousarray(optimum.B)
        own = _Linear.of(n, bodies, A=A, B=B, x_e=np.array(point.x), u_e=np.array(point.u))
        return DesignModel(_linear, own)
    if isinstance(error, RobotCoordinates):
        return DesignModel(_of_robot(error), _Nothing())
    raise ArgumentError(f"{type(error).__name__} have no design model to predict by")


@cache
def _of_equations(error: ErrorCoordinates) -> Advance:
    slope_at = state_derivative(error.system)

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        slope_at(x, u, own.calm, p.plant, own.slope)
        for i in range(len(x)):
            own.stage[i] = x[i] + 0.5 * h * own.slope[i]
        slope_at(own.stage, u, own.calm, p.plant, own.slope)
        for i in range(len(x)):
            x[i] += h * own.slope[i]

    return advance


@jitable
def _linear_slope(x: Any, u: Any, own: Any) -> None:
    for i in range(len(x)):
        total = 0.0
        for j in range(len(x)):
            total += own.A[i, j] * (x[j] - own.x_e[j])
        for j in range(len(u)):
            total += own.B[i, j] * (u[j] - own.u_e[j])
        own.slope[i] = total


@jitable
def _linear(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
    _linear_slope(x, u, own)
    for i in range(len(x)):
        own.stage[i] = x[i] + 0.5 * h * own.slope[i]
    _linear_slope(own.stage, u, own)
    for i in range(len(x)):
        x[i] += h * own.slope[i]


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
