"""Design models: the plant as a law knows it, which observers and predictions move by a time."""

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

# Jitable (t, x, u, h, memory, p, own): move x, (n,), by h [s] under the input u, (m,), with memory
# and numbers p of the law and ``own`` of the model.
Advance = Callable[[float, Any, Any, float, Any, Any, Any], None]
# Step of a state and an input in central differences.
_STEP = 1e-6


class DesignModel(NamedTuple):
    """Motion of a design model.

    Attributes:
        advance: Moves a state.
        own: Scratch space of ``advance``, 2 n numbers, then the numbers of the model.
    """

    advance: Advance
    own: Array


def design_model(controller: Controller, reason: str) -> DesignModel:
    """Design model of a controller.

    Plants with equations move by one step of the midpoint rule, models about an operating point by
    the same rule on their linearization, robots by their accelerations, q + h q' + h^2/2 q''.

    Args:
        controller: Controller with a design.
        reason: Part of the loop that needs the model, for the message of an error.

    Raises:
        ArgumentError: If it has none.
    """
    if controller.design is None:
        raise ArgumentError(f"{controller.name} has no design model, which {reason} needs")
    error = controller.design.error
    scratch = np.zeros(2 * len(error.system.states))
    if isinstance(error, ErrorCoordinates):
        no_wrench = np.zeros(max(1, 6 * len(error.system.bodies)))
        return DesignModel(_of_equations(error), np.concatenate([scratch, no_wrench]))
    if isinstance(error, StateCoordinates):
        optimum = controller.design.lqr
        point = controller.parameters.reference
        numbers = [scratch, np.ravel(optimum.A), np.ravel(optimum.B), point.x, point.u]
        return DesignModel(_LINEAR, np.concatenate(numbers))
    return DesignModel(_of_robot(error), scratch)


def _midpoint(slope_at: Callable[[Any, Any, Any, Any, Any], None]) -> Advance:
    """One step of the midpoint rule with a jitable (x, u, numbers, p, slope)."""

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        n = len(x)
        slope = own[:n]
        stage = own[n : 2 * n]
        numbers = own[2 * n :]
        slope_at(x, u, numbers, p, slope)
        for i in range(n):
            stage[i] = x[i] + 0.5 * h * slope[i]
        slope_at(stage, u, numbers, p, slope)
        for i in range(n):
            x[i] += h * slope[i]

    return advance


# One compiled function serves all loops with the same coordinates.
@cache
def _of_equations(error: ErrorCoordinates) -> Advance:
    """Motion of a plant with equations, under no wrench."""
    equations = state_derivative(error.system)

    def slope_at(x: Any, u: Any, no_wrench: Any, p: Any, slope: Any) -> None:
        equations(x, u, no_wrench, p.plant, slope)

    return _midpoint(jitable(slope_at))


@jitable
def _linear_slope(x: Any, u: Any, numbers: Any, p: Any, slope: Any) -> None:
    """x' = A (x - x_e) + B (u - u_e) with the numbers A, B, x_e and u_e."""
    n = len(x)
    m = len(u)
    # Where each of them begins behind A.
    B = n * n
    x_e = B + n * m
    u_e = x_e + n
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += numbers[n * i + j] * (x[j] - numbers[x_e + j])
        for j in range(m):
            total += numbers[B + m * i + j] * (u[j] - numbers[u_e + j])
        slope[i] = total


_LINEAR = _midpoint(_linear_slope)


# One compiled function serves all loops with the same coordinates.
@cache
def _of_robot(error: Any) -> Advance:
    """Motion of a robot with ``RobotCoordinates``."""
    virtual_input = error.virtual_input
    accelerations = error.accelerations
    joints = error.inputs

    @jitable
    def advance(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        a = own[:joints]
        virtual_input(t, x, u, memory, p, a)
        accelerations(t, a, p, a)
        for i in range(joints):
            x[i] += h * x[i + joints] + 0.5 * h * h * a[i]
            x[i + joints] += h * a[i]

    return advance


def held(
    controller: Controller,
    model: DesignModel,
    rest: Array,
    period: float,
) -> Any:
    """Linearize the design model over a period, by central differences at zero error.

    Args:
        controller: Controller with the model.
        model: Motion of the model.
        rest: Input at which it is linearized, (m,).
        period: Control period [s].

    Returns:
        A_d (n, n) and B_d (n, m).
    """
    error = controller.designed.error
    p = controller.parameters
    memory, _workspace = controller.begin()
    if isinstance(error, StateCoordinates):
        x = p.reference.x
    else:
        x = error.place(0.0, np.zeros(error.size), p)
    n = len(x)

    def moved(point: Array) -> Array:
        """State after a period from a state and input, (n + m,)."""
        model.advance(0.0, point[:n], point[n:], period, memory, p, model.own)
        return point[:n]

    point = np.concatenate([x, rest])
    steps = _STEP * np.eye(len(point))
    columns = [(moved(point + step) - moved(point - step)) / (2 * _STEP) for step in steps]
    slopes = np.transpose(columns)
    return slopes[:, :n], slopes[:, n:]
