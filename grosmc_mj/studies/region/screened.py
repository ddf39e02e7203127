"""A map made on equations, its boundaries confirmed in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

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
        overturned = np.asarray(binary_dilation(letters != first, np.ones((3, 3))), bool)
        wanted = beside_another(letters) | overturned
    return ScreenedArea(letters, confirmed, letters != first)


def beside_another(letters: Letters) -> Mask:
    """Which places have another letter among the eight around them."""
    codes = np.unique(letters, return_inverse=True)[1].reshape(letters.shape)
    return maximum_filter(codes, 3, mode="nearest") != minimum_filter(codes, 3, mode="nearest")


def _at_random(shape: tuple[int, ...], seed: int) -> Mask:
    """Some of the places."""
    chosen, size = np.zeros(shape, bool), math.prod(shape)
    few = np.random.default_rng(seed).permutation(size)[: math.ceil(RANDOM * size)]
    chosen.reshape(-1)[few] = True
    return chosen
