"""One curve for each run of a robot: the size of many coordinates, surfaces or torques."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.film import Film, Take

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
    """The largest input of all joints: as a share of its limit, if all of them have one.

    Without limits those with the first one's unit count.

    Returns:
        None for few inputs.
    """
    inputs, model = film.takes[0].run.system.inputs, film.model
    if len(inputs) <= FEW:
        return None
    applied = [take.run.input for take in film.takes]
    low, high = model.actuator_ctrlrange.T
    if np.all(model.actuator_ctrllimited) and np.all((low < 0) & (high > 0)):
        title = "largest input, of its limit [%]"
        shares = (100 * np.maximum(tau / low, tau / high) for tau in applied)
        return Size(title, tuple(share.max(axis=1) for share in shares))
    unit, counted, which = _alike([signal.unit for signal in inputs])
    title = f"largest input of {which} |τ| [{unit}]"
    return Size(title, tuple(np.abs(tau[:, counted]).max(axis=1) for tau in applied))


def _alike(units: list[str]) -> tuple[str, list[int], str]:
    """The first unit, which joints have it, and how many these are in words."""
    counted = [index for index, unit in enumerate(units) if unit == units[0]]
    every = len(counted) == len(units)
    return units[0], counted, "all joints" if every else f"{len(counted)} joints"
