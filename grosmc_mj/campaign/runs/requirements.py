"""What every run of a campaign must keep, and by how much it does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.metrics import DWELL
from grosmc_mj.experiments.requirements import Limit

# What is asked of every run, beside the file's requirements.
COMPLETES = "completes"
# How the columns of margins begin.
MARGIN = "margin "


@dataclass(frozen=True)
class Recording:
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
Measure = Callable[[Any, Recording], Array]


def outside_until(meters: Any, recording: Recording) -> Array:
    """First sample from which on each run stays in the 2 % band, in its transient [s], (n,)."""
    settled = np.where(meters["outside"] < 0, 0.0, meters["outside"] + recording.control_period)
    return np.where(meters["start"] == 0, 0.0, settled)


def settling_time(meters: Any, recording: Recording) -> Array:
    """The same, if that is soon enough to be sure, else infinity; as in ``validation.metrics``."""
    settled = outside_until(meters, recording)
    return np.where(settled > (1 - DWELL) * recording.transient, np.inf, settled)


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

    def margins(self, meters: Any, completed: Array, recording: Recording) -> Array:
        """Limit less measured, (n,); -inf for runs that ended early."""
        return np.where(completed, self.limit - self.measured(meters, recording), -np.inf)


def afters(limits: Sequence[Limit]) -> list[float]:
    """From when on largest errors are asked for [s]."""
    return sorted({limit.after for limit in limits if limit.kind == "stays_within"})


def required(
    limits: Sequence[Limit], laws: Mapping[str, Controller], transient: float
) -> tuple[Requirement, ...]:
    """The requirements of a case file, of the laws that are run.

    Args:
        limits: The file's.
        laws: Those that are run.
        transient: How long every run goes on before a disturbance begins, or until its end [s].

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
        if limit.kind == "settles_within" and limit.value > (1 - DWELL) * transient:
            raise ArgumentError(
                f"{limit.words}: there are {transient:g} s before a run ends or a disturbance "
                f"begins; they tell up to {(1 - DWELL) * transient:g} s, since an error counts as "
                "settled after a tenth of them in the band"
            )
        same = sum(each.key.rsplit(" ", 1)[0] == limit.kind for each in found)
        key = limit.kind if not same else f"{limit.kind} {same + 1}"
        found.append(
            Requirement(key, limit.words, limit.unit, limit.value, of, _measure(limit, limits))
        )
    return tuple(found)


def _measure(limit: Limit, limits: Sequence[Limit]) -> Measure:
    """What a limit is about."""
    if limit.kind == "settles_within":
        return outside_until
    if limit.kind != "stays_within":
        return METRICS[_LIMITED[limit.kind]][1]
    place = afters(limits).index(limit.after)
    return lambda meters, _: meters["error"][:, place]


def relative(margins: Array, limits: Array, completed: Array) -> Array:
    """One number a run, the smaller the worse: its least margin in parts of the limit.

    Args:
        margins: (n, k); NaN where a requirement is not the controller's.
        limits: (k,).
        completed: Which runs did, (n,).

    Returns:
        (n,): at most 1, which is all of a limit; -inf for runs that ended early.
    """
    shares = np.where(np.isnan(margins), 1.0, margins / limits)
    return np.where(completed, shares.min(axis=1, initial=1.0), -np.inf)
