"""How one run of a region map is judged."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.errors import ArgumentError
from grosmc_mj.simulation.trajectory import Status

# How near zero every regulated error must be at the end, by its unit. It is far above the chatter
# that a switching law leaves at a control period of 1 ms (below 0.2 degrees and 0.01 rad/s) and
# some hundredth of the default starts. Position and rate are asked for together: what only swings
# through zero is fast there.
TOLERANCES: Mapping[str, float] = {
    "rad": math.radians(1.0),
    "rad/s": 0.1,
    "m": 0.02,
    "m/s": 0.1,
}


class Outcome(Enum):
    """What became of a start; the value is its letter in the file."""

    CONVERGED = "c"
    LEFT = "l"
    SINGULAR = "s"
    NOT_CONVERGED = "n"
    DIVERGED = "d"

    @property
    def title(self) -> str:
        """For people."""
        return _TITLES[self]

    @property
    def meaning(self) -> str:
        """One sentence."""
        return _MEANINGS[self]


_TITLES = {
    Outcome.CONVERGED: "converged",
    Outcome.LEFT: "left the region",
    Outcome.SINGULAR: "singular plant",
    Outcome.NOT_CONVERGED: "not converged",
    Outcome.DIVERGED: "diverged",
}
_MEANINGS = {
    Outcome.CONVERGED: "every regulated error is within its tolerance at the end",
    Outcome.LEFT: "a sample of the law fell outside the region where the laws are defined",
    Outcome.SINGULAR: "the plant reached a state where its equations break down",
    Outcome.NOT_CONVERGED: "the run stayed in the region and is beyond a tolerance at the end",
    Outcome.DIVERGED: "the state grew without bound",
}
_ENDED_EARLY = {
    Status.UNDEFINED_LAW: Outcome.LEFT,
    Status.SINGULAR_PLANT: Outcome.SINGULAR,
    Status.DIVERGED: Outcome.DIVERGED,
    # No law of the package ends so while its state is bounded.
    Status.UNDEFINED_INPUT: Outcome.DIVERGED,
}


def judge(status: Status, error: ArrayLike, tolerance: ArrayLike) -> Outcome:
    """The outcome of one run of a guarded law.

    Args:
        status: How the run ended.
        error: Error state at its end, (errors,).
        tolerance: Largest size of each error that counts as none, (errors,).
    """
    if status in _ENDED_EARLY:
        return _ENDED_EARLY[status]
    near = np.all(np.abs(np.asarray(error)) <= np.asarray(tolerance))
    return Outcome.CONVERGED if near else Outcome.NOT_CONVERGED


def tolerance_of(unit: str) -> float:
    """The tolerance of an error with this unit.

    Raises:
        ArgumentError: If none is declared for it.
    """
    if unit not in TOLERANCES:
        raise ArgumentError(f"no tolerance for errors in {unit}: valid: {', '.join(TOLERANCES)}")
    return TOLERANCES[unit]
