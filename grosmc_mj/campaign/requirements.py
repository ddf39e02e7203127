"""What every run of a campaign must keep, and by how much it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.validation.metrics import DWELL
from grosmc_mj.validation.requirements import Limit

# What is asked of every run, beside the file's requirements.
COMPLETES = "completes"


@dataclass(frozen=True)
class Meaning:
    """What is needed, besides its meters, to say what a run did.

    Attributes:
        control_period: [s].
        duration: [s].
        onset: When the first disturbance of each run begins [s], (n,).
    """

    control_period: float
    duration: float
    onset: Array

    @property
    def transient(self) -> Array:
        """How long the transient lasts, in which a run settles [s], (n,)."""
        onset = self.onset
        return np.where((onset > 0) & (onset < self.duration), onset, self.duration)


# From the meters of n runs, what is measured of each, (n,).
Measure = Callable[[Any, Meaning], Array]


def settling_time(meters: Any, meaning: Meaning) -> Array:
    """When each run enters the 2 % band for good [s], (n,); infinite if it does not.

    As in ``validation.metrics.settled``, to the sample.
    """
    settled = np.where(meters["outside"] < 0, 0.0, meters["outside"] + meaning.control_period)
    settled = np.where(meters["start"] == 0, 0.0, settled)
    return np.where(settled > (1 - DWELL) * meaning.transient, np.inf, settled)


# What is kept of every run: its name, its unit ("output", "input" and "sliding" stand for those of
# the law) and how it is measured.
METRICS: Mapping[str, tuple[str, Measure]] = {
    "deviation": ("output", lambda meters, _: meters["deviation"]),
    "settling_time": ("s", settling_time),
    "max_sliding": ("sliding", lambda meters, _: meters["sliding"]),
    "sliding_start": ("sliding", lambda meters, _: meters["sliding_start"]),
    "max_input": ("input", lambda meters, _: meters["input"]),
    "cart_travel": ("m", lambda meters, _: meters["travel"]),
}
_LIMITED = {
    "settles_within": "settling_time",
    "deviation_below": "deviation",
    "input_below": "max_input",
    "sliding_below": "max_sliding",
    "cart_travel_below": "cart_travel",
    "no_reaching_phase": "sliding_start",
}


@dataclass(frozen=True)
class Requirement:
    """One requirement of the file.

    Attributes:
        key: Its name in files.
        words: For people.
        unit: Of its limit.
        limit: Largest value allowed.
        of: Controllers that must keep it.
        measured: What it limits.
    """

    key: str
    words: str
    unit: str
    limit: float
    of: tuple[str, ...]
    measured: Measure

    def margins(self, meters: Any, completed: Array, meaning: Meaning) -> Array:
        """Limit less measured, (n,); -inf for runs that ended early or never settled."""
        measured = self.measured(meters, meaning)
        return np.where(completed & np.isfinite(measured), self.limit - measured, -np.inf)


def afters(limits: Sequence[Limit]) -> list[float]:
    """From when on largest errors are asked for [s]."""
    return sorted({limit.after for limit in limits if limit.kind == "stays_within"})


def required(
    limits: Sequence[Limit], laws: Mapping[str, Controller], duration: float
) -> tuple[Requirement, ...]:
    """The requirements of a case file, of the laws that are run.

    Raises:
        ArgumentError: If one cannot be measured while a run goes on, or holds after its end.
    """
    found: list[Requirement] = []
    for limit in limits:
        of = tuple(name for name in limit.of if name in laws)
        if not of:
            continue
        if limit.kind == "cost_ratio_below":
            raise ArgumentError(
                "cost_ratio_below is measured on recorded runs only, not in campaigns: leave it out"
            )
        if limit.kind == "settles_within" and limit.value > (1 - DWELL) * duration:
            raise ArgumentError(
                f"{limit.words}: an error counts as settled after a tenth of the run in the band, "
                f"so a run of {duration:g} s tells up to {(1 - DWELL) * duration:g} s only"
            )
        same = sum(each.key.rsplit(" ", 1)[0] == limit.kind for each in found)
        key = limit.kind if not same else f"{limit.kind} {same + 1}"
        found.append(
            Requirement(key, limit.words, limit.unit, limit.value, of, _measure(limit, limits))
        )
    return tuple(found)


def _measure(limit: Limit, limits: Sequence[Limit]) -> Measure:
    """What a limit is about."""
    if limit.kind != "stays_within":
        return METRICS[_LIMITED[limit.kind]][1]
    place = afters(limits).index(limit.after)
    return lambda meters, _: meters["error"][:, place]


def relative(margins: Array, limits: Array, ended: Array, duration: float) -> Array:
    """One number a run, the smaller the worse: its least margin in parts of the limit.

    Below -1 lie what never settled and, below -2, the runs that ended early: the earlier, the
    lower. What is not limited is 1.

    Args:
        margins: (n, k); NaN where a requirement is not the controller's.
        limits: (k,).
        ended: When each run ended [s], (n,).
        duration: [s].

    Returns:
        (n,).
    """
    if margins.shape[1]:
        shares = np.where(np.isnan(margins), np.inf, margins / limits)
        least = np.clip(shares.min(axis=1), None, 1.0)
        # -1 is twice the limit; what is beyond comes closer and closer to -2, and infinity is -2.
        beyond = -2.0 + 1.0 / np.clip(-least, 1.0, None)
        found = np.where(least < -1, beyond, least)
    else:
        found = np.ones(len(ended))
    cut = ended < duration * (1 - 1e-12)
    return np.where(cut, -3.0 + ended / duration, found)
