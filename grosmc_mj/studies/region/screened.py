"""A map made on equations, its boundaries confirmed in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]
Letters = NDArray[np.str_]

# Of the starts away from boundaries this part is confirmed, drawn at random.
RANDOM = 0.02


@dataclass(frozen=True, eq=False)
class ScreenedArea:
    """Starts side by side, whose outcomes the equations gave and MuJoCo confirmed.

    Attributes:
        letters: Their outcomes, (rows, columns).
        confirmed: Which of them are MuJoCo's.
        overturned: Of which of these the equations had said something else.
    """

    letters: Letters
    confirmed: Mask
    overturned: Mask

    @classmethod
    def by_physics(cls, letters: Letters) -> ScreenedArea:
        """Outcomes that are all MuJoCo's."""
        return cls(letters, np.ones(letters.shape, bool), np.zeros(letters.shape, bool))


def confirmed_area(first: Letters, confirm: Callable[[Mask], Letters], seed: int) -> ScreenedArea:
    """Confirm every start beside another outcome, and some of the others.

    The starts beside an outcome that is overturned are confirmed, too, until none is.

    Args:
        first: Outcomes by the equations, (rows, columns).
        confirm: The outcomes in MuJoCo of some starts, in the order of the area.
        seed: Of the random ones.
    """
    letters, confirmed = first.copy(), np.zeros(first.shape, bool)
    wanted = beside_another(first) | _at_random(first.shape, seed)
    while np.any(new := wanted & ~confirmed):
        letters[new] = confirm(new)
        confirmed |= new
        wanted = beside_another(letters) | _grown(letters != first)
    return ScreenedArea(letters, confirmed, letters != first)


def beside_another(letters: Letters) -> Mask:
    """Which places have another letter among the eight around them."""
    different = np.zeros(letters.shape, bool)
    for shifted in _around(letters):
        different |= shifted != letters
    return different


def _grown(places: Mask) -> Mask:
    """The places and the eight around each."""
    grown = places.copy()
    for shifted in _around(places):
        grown |= shifted
    return grown


def _around(area: NDArray) -> list[NDArray]:
    """The area moved by one place in each of eight directions; its edges are repeated."""
    rows, columns = area.shape
    padded = np.pad(area, 1, mode="edge")
    return [
        padded[1 + i : 1 + i + rows, 1 + j : 1 + j + columns]
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
        if i or j
    ]


def _at_random(shape: tuple[int, ...], seed: int) -> Mask:
    """Some of the places."""
    chosen, size = np.zeros(shape, bool), math.prod(shape)
    few = np.random.default_rng(seed).permutation(size)[: math.ceil(RANDOM * size)]
    chosen.reshape(-1)[few] = True
    return chosen
