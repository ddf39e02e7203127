"""The extreme loops and machines that a campaign can draw, made before anything is run."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.bisection import narrowed
from grosmc_mj.campaign.family.family import Family, Quantity
from grosmc_mj.campaign.family.sampling import inside
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, MistakesError
from grosmc_mj.experiments.file.parts import LOOP_UNITS, MACHINE_UNITS
from grosmc_mj.loop import Loop, relooped
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant

# Uncertain numbers that can make a machine impossible; a start can lie beyond a stop.
_OF_MACHINES = ("body", "joint", "start", *MACHINE_UNITS)
# To which share a scale is found.
_FINE = 1e-3


def refuse_impossible_loops(
    family: Family, laws: Mapping[str, Controller], loop_at: Callable[[Array], Loop | None]
) -> None:
    """Refuse uncertain numbers of a loop that a law cannot meet at their extremes.

    Args:
        family: The uncertain numbers.
        laws: The controllers, in the file's loop, by name.
        loop_at: The loop that values of the numbers (d,) make.

    Raises:
        ArgumentError: In one line, the first such loop, why there is none, and what to do.
    """
    for values in _extremes(family, LOOP_UNITS):
        if (loop := loop_at(values)) is None:
            return
        for name, law in laws.items():
            try:
                relooped(law, loop)
            except GrosmcError as error:
                why = error.mistakes[0] if isinstance(error, MistakesError) else str(error)
                raise ArgumentError(
                    f"uncertain: {_words(family, values, LOOP_UNITS)} can occur, where there is no "
                    f"loop for {name}: {why}; narrow the ranges or, where delays must be equal, "
                    "let that of computing = true vary instead"
                ) from error


def refuse_impossible_machines(family: Family, plant_at: Callable[[Array], Plant]) -> None:
    """Refuse uncertain numbers whose extremes make a machine that cannot be, or be simulated.

    Args:
        family: The uncertain numbers.
        plant_at: The plant that values of the numbers (d,) make.

    Raises:
        ArgumentError: In one line, the first such machine, and why there is none.
    """
    for values in _extremes(family, _OF_MACHINES):
        try:
            if not _machine(plant_at(values)):
                return
        except GrosmcError as error:
            raise ArgumentError(
                f"uncertain: {_words(family, values, _OF_MACHINES)} can occur, where there is no "
                f"such machine: {error}; narrow the ranges"
            ) from error


def largest_machine(family: Family, plant_at: Callable[[Array], Plant], most: float) -> float:
    """The scale of the uncertainty up to which its extremes are machines that can be simulated.

    Args:
        family: The uncertain numbers, whose extremes at scale 1 can be.
        plant_at: The plant that values of the numbers (d,) make.
        most: The largest scale that is asked about.
    """

    def can_be(scale: float) -> bool:
        try:
            for each in _extremes(family, _OF_MACHINES):
                if not _machine(plant_at(family.scaled(each, scale))):
                    return True
        except GrosmcError:
            return False
        return True

    if can_be(most):
        return most
    return narrowed(lambda scale: not can_be(scale), min(1.0, most), most, _FINE)[0]


def _machine(plant: Plant) -> bool:
    """Whether a plant is a machine, which can be simulated.

    Raises:
        ModelError: If it is one that cannot.
    """
    if not isinstance(plant, MujocoPlant) or not plant.parts:
        return False
    _ = plant.undrawn_model
    return True


def _extremes(family: Family, owners: Collection[str]) -> Iterator[Array]:
    """Values (d,) with all numbers of these at their ends: alike, and each unlike the others."""
    ends = {i: _ends(each) for i, each in enumerate(family.quantities) if each.owner in owners}
    if not ends:
        return
    for unlike in (None, *ends) if len(ends) > 1 else (None,):
        for side in (0, 1):
            values = family.nominal
            for i, pair in ends.items():
                values[i] = pair[1 - side if i == unlike else side]
            yield values


def _ends(quantity: Quantity) -> tuple[float, float]:
    """The smallest and the largest value that can be drawn."""
    low, high = quantity.distribution.support
    least, most = quantity.distribution.quantiles(inside(np.array([0.0, 1.0]))).tolist()
    return (low if math.isfinite(low) else least), (high if math.isfinite(high) else most)


def _words(family: Family, values: Array, owners: Collection[str]) -> str:
    """The numbers of these."""
    pairs = zip(family.quantities, values.tolist(), strict=True)
    return " and ".join(each.words(value) for each, value in pairs if each.owner in owners)
