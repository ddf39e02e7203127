"""Least squares at ever shorter timesteps, until the intervals hide what a timestep does.

Dry friction stops a joint within two timesteps, later than the machine does: an error of first
order, which at 1 ms may be as large as the interval of an inertia. Each halving of the timestep h
moves the fit by a step of Gauss and Newton with the derivatives J of the first timestep,

    x_(h/2) = x_h - (J'J)^-1 J' r_(h/2)(x_h).

An error of first order leaves as much after a halving as the halving has changed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.identify.residual import Residual
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# Halvings of the timestep, at most: each costs twice the one before.
_MOST_HALVINGS = 5
# Share of an interval's half width that the timestep may change.
SMALL = 0.1
# A parameter this near to an end of its range stays there, as a share of that.
_AT_END = 1e-9


@dataclass(frozen=True, eq=False)
class Refined:
    """A fit at a timestep that is short enough.

    Attributes:
        residual: At that timestep.
        x: Its point of least squares.
        left: Change of the fitted parameters by the last halving, as shares of their ranges, (d,).
        shift: Their change by all of them, (d,).
    """

    residual: Residual
    x: Array
    left: Array
    shift: Array


def refined(
    residual: Residual,
    x: Array,
    jacobian: Array,
    half: Array,
    progress: Callable[[str], None],
) -> Refined:
    """Move a point of least squares to a timestep that is short enough.

    Args:
        residual: At the case's timestep.
        x: Its point of least squares.
        jacobian: Its derivatives there, (r, p).
        half: Half widths of the intervals of the fitted parameters, as shares of their ranges.
        progress: Told what is going on.
    """
    count = len(half)
    at_end = (x[:count] < _AT_END) | (x[:count] > 1 - _AT_END)
    slopes = jacobian.copy()
    slopes[:, :count][:, at_end] = 0.0

    first = x
    left = np.zeros(count)
    for _ in range(_MOST_HALVINGS):
        finer = _halved(residual)
        progress(f"fitting at a timestep of {1e3 * finer.predictor.timestep:.3g} ms")
        (errors,) = finer.of([x])
        moved = x - np.linalg.lstsq(slopes, errors, rcond=None)[0]
        moved[:count] = moved[:count].clip(0.0, 1.0)
        left = moved[:count] - x[:count]

        # Far from a minimum, or where a motion is not predictable, a step of Gauss and Newton
        # leads away: the values stay, and the intervals count its size.
        (nearer,) = finer.of([moved])
        if not nearer @ nearer <= errors @ errors:
            break
        residual = finer
        x = moved
        if (np.abs(left) <= SMALL * half).all():
            break
    return Refined(residual, x, left, x[:count] - first[:count])


def _halved(residual: Residual) -> Residual:
    """The residual at half the timestep."""
    timestep = residual.predictor.timestep / 2
    plant = residual.plant
    if isinstance(plant, MujocoPlant):
        plant = replace(plant, timestep=timestep)
    return replace(residual, plant=plant, predictor=replace(residual.predictor, timestep=timestep))
