"""Recovery from disturbances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.experiments.requirements.signals import ERROR
from grosmc_mj.simulation.trajectory import Trajectory

# Rounding of an instant k h, as a share of it.
_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True)
class RecoversWithin(Requirement):
    """Longest time from a change of the disturbances until the error is in a band for good [s].

    A change is an instant at which a disturbance begins to act or at which the last one ends; one
    that acts from the start is part of the transient until it ends, and hides no later one. For
    good is up to the next change, or to the end of the run. A change at which the error is outside
    the band already prolongs the recovery from the one before; a recovery is not asked if the run
    ends before its time is over.

    Attributes:
        band: Half width of the band in the unit of the state or output.
        band_written: The band as written in the file.
    """

    key = "recovers_within"
    quantity = "s"
    options = ("state", "band")
    needs_band = True
    recorded = True
    of_onsets = True
    not_in_logs = "a log does not have the onsets of disturbances"

    band: float
    band_written: str = ""

    @property
    def metric(self) -> str:
        """Name of the longest recovery."""
        return f"{self.words} [s]"

    @property
    def words(self) -> str:
        """The requirement in words."""
        return f"{super().words} of each disturbance to {self.band_written}"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the longest recovery, and say if there was none to make."""
        value = self.value_of(run)
        changes = _changes(run.trajectory, run.conditions.loads)
        if not any(self._in_time(run.trajectory, change) for change in changes):
            return value, "no disturbance begins in time"
        return value, ""

    def of_record(self, run: RecordedRun) -> float:
        """Return the longest recovery; one that is not over counts up to the end of the run."""
        (name,) = self.watched(run.controller.designed.error) if self.signal else (ERROR,)
        outside = np.abs(run.signals([name])[name]) > self.band
        # The first change counts wherever the error is.
        changes = _changes(run.trajectory, run.conditions.loads)
        begins = [i for n, i in enumerate(changes) if n == 0 or not outside[i]]
        ends = [*begins[1:], len(outside)]

        longest = 0
        for begin, end in zip(begins, ends, strict=False):
            late = np.flatnonzero(outside[begin:end])
            if len(late) and self._in_time(run.trajectory, begin):
                longest = max(longest, int(late[-1]) + 1)
        return longest * float(run.trajectory.time[1])

    def _in_time(self, run: Trajectory, index: int) -> bool:
        """Whether the run is long enough to recover from a change at an instant."""
        return bool(run.time[index] + self.number <= run.time[-1] * (1 + 1e-12))


def _changes(run: Trajectory, loads: Sequence[tuple[float, float]]) -> list[int]:
    """Return the indices of the instants at which loads begin to act or the last one ends.

    A load that acts from the start hides no later one.
    """
    later = [load for load in loads if load[0] > 0]
    period = float(run.time[1])
    changes = {math.floor(begin / period * (1 + _ROUNDING)) for begin, _end in later}
    for _begin, end in loads:
        others_act = any(first <= end < last for first, last in later)
        if math.isfinite(end) and not others_act:
            changes.add(math.ceil(end / period * (1 - _ROUNDING)))
    return sorted(index for index in changes if 0 < index < len(run.time) - 1)
