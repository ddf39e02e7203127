"""The extreme loops that a campaign can draw, made before anything is run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.family.family import Family, Quantity
from grosmc_mj.campaign.family.sampling import inside
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, GrosmcError, MistakesError
from grosmc_mj.experiments.file.tables.loop import LOOP_UNITS
from grosmc_mj.simulation.loop import Loop, relooped


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
    for values in _extremes(family):
        if (loop := loop_at(values)) is None:
            return
        for name, law in laws.items():
            try:
                relooped(law, loop)
            except GrosmcError as error:
                why = error.mistakes[0] if isinstance(error, MistakesError) else str(error)
                raise ArgumentError(
                    f"uncertain: {_words(family, values)} can occur, where there is no loop "
                    f"for {name}: {why}; narrow the ranges or, where delays must be equal, "
                    "let that of computing = true vary instead"
                ) from error


def _extremes(family: Family) -> Iterator[Array]:
    """Values (d,) with all numbers of the loop at their ends: alike, and each unlike the others."""
    ends = {i: _ends(each) for i, each in enumerate(family.quantities) if each.owner in LOOP_UNITS}
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


def _words(family: Family, values: Array) -> str:
    """The numbers of the loop."""
    pairs = zip(family.quantities, values.tolist(), strict=True)
    return " and ".join(each.words(value) for each, value in pairs if each.owner in LOOP_UNITS)
