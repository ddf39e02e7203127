"""One curve for each run of a robot: the size of many coordinates, surfaces or torques."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.rendering.film import Film, Take

# More signals than this of one kind are shown by their size.
FEW = 2


class Size(NamedTuple):
    """What stands for many signals.

    Attributes:
        title: Its name with its unit.
        curves: Its values of each take, (N,) each.
    """

    title: str
    curves: tuple[Array, ...]


def distances(film: Film) -> Size | None:
    """The norm of the controlled coordinates' distances from the ghost.

    Of a robot with hinges and slides, only those with the first one's unit count.

    Returns:
        None for few coordinates, or if a take has no ghost to be measured from.
    """
    system = film.takes[0].run.system
    signals = [system.states[index] for index in system.controlled]
    if len(signals) <= FEW or any(take.ghost is None for take in film.takes):
        return None
    unit, counted, which = _alike([signal.unit for signal in signals])
    columns = np.array(system.controlled)[counted]

    def distance(take: Take) -> Array:
        return np.linalg.norm(take.run.state[:, columns] - take.ghosts[:, counted], axis=1)

    title = f"distance of {which} |q − {film.ghost_symbol}| [{unit}]"
    return Size(title, tuple(map(distance, film.takes)))


def loads(film: Film) -> Size | None:
    """The largest torque of all joints: as a share of its limit, if all of them have one.

    Without limits those with the first one's unit count.

    Returns:
        None for few inputs.
    """
    inputs, model = film.takes[0].run.system.inputs, film.model
    if len(inputs) <= FEW:
        return None
    limits = np.abs(model.actuator_ctrlrange).max(axis=1)
    if np.all(model.actuator_ctrllimited) and np.all(limits > 0):
        title, counted, scale = "largest torque, of its limit [%]", slice(None), 100 / limits
    else:
        unit, counted, which = _alike([signal.unit for signal in inputs])
        title, scale = f"largest input of {which} |τ| [{unit}]", np.ones(len(inputs))
    curves = [np.abs(take.run.input * scale)[:, counted].max(axis=1) for take in film.takes]
    return Size(title, tuple(curves))


def _alike(units: list[str]) -> tuple[str, list[int], str]:
    """The first unit, which joints have it, and how many these are in words."""
    counted = [index for index, unit in enumerate(units) if unit == units[0]]
    every = len(counted) == len(units)
    return units[0], counted, "all joints" if every else f"{len(counted)} joints"
