"""The design model of a controller, and its linearization over a control period."""

from __future__ import annotations

from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.design_model import DesignModel

# Step of a state and an input in central differences.
_STEP = 1e-6


def design_model(controller: Controller, reason: str) -> DesignModel:
    """Design model of a controller.

    Args:
        controller: Controller with a design.
        reason: Part of the loop that needs the model, for the message of an error.

    Raises:
        ArgumentError: If it has none.
    """
    if controller.design is None:
        raise ArgumentError(f"{controller.name} has no design model, which {reason} needs")
    return controller.design.error.design_model(controller.design.lqr, controller.parameters)


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
    memory = controller.memory()
    x = error.rest(p)
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
