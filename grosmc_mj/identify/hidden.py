"""Parameters that a log does not show, alone or together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.identify.parameters import Parameters

# A direction whose standard deviation is more than this share of the parameters is not visible.
_WEAK = 0.5
# A parameter belongs to that direction if its component is above this share of the largest one.
_PART = 0.3


class HiddenParameter(NamedTuple):
    """Parameters that the log does not show.

    Attributes:
        held: The one that is held at its value in the case.
        others: Those that it cannot be told apart from; empty if it has no effect of its own.
        words: Which combination of them is visible, and which log would show them.
    """

    held: str
    others: tuple[str, ...]
    words: str


def hidden_parameter(
    parameters: Parameters, free: NDArray[np.bool_], jacobian: Array
) -> HiddenParameter | None:
    """The parameters that are the least visible, if that is not enough; None if all are."""
    count = int(free.sum())
    low, high = parameters.bounds
    by_size = jacobian[:, :count] * (parameters.scales[free] / (high - low)[free])

    # A residual that other starts of the windows could explain counts for no parameter.
    by_start = jacobian[:, count:]
    by_start = by_start[:, np.abs(by_start).max(axis=0) > 0]
    by_size = by_size - by_start @ np.linalg.lstsq(by_start, by_size, rcond=None)[0]

    # The least singular value is the inverse of the largest standard deviation of a direction.
    _, s, v = np.linalg.svd(by_size, full_matrices=False)
    if s[-1] * _WEAK >= 1.0:
        return None

    direction = v[-1]
    members = np.flatnonzero(np.abs(direction) > _PART * np.abs(direction).max())
    held = members[np.abs(direction[members]).argmax()]
    names = np.array(parameters.names)[free]
    name = str(names[held])
    alike = tuple(str(names[i]) for i in members if i != held)
    same_sign = bool(np.prod(np.sign(direction[members])) > 0)
    return HiddenParameter(name, alike, _unseen_words(name, alike, same_sign))


def _unseen_words(name: str, alike: Sequence[str], same_sign: bool) -> str:
    """Words on a held parameter and those that it cannot be told apart from.

    Args:
        name: Name of the held parameter.
        alike: Names of the other parameters.
        same_sign: Whether their changes that cancel each other have the same sign.
    """
    if not alike:
        return f"{name} is not visible in this log: give it a run that moves it more, or faster"

    relation = "a combination of them"
    if len(alike) == 1:
        relation = "their ratio" if same_sign else "their sum or product"
    listed = " and ".join([name, *alike])
    return (
        f"{listed}: only {relation} is visible in this log; {name} is held at its value in the "
        "case. A run with a known load, or a measurement of one of them, tells them apart"
    )
