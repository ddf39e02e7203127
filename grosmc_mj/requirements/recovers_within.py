"""Recovery from disturbances."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.measured_run import MeasuredRun
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.requirements.signals import ERROR, signals_of
from grosmc_mj.simulation.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class RecoversWithin(Requirement):
    """Longest time from the onset of a disturbance until the error is in a band for good [s].

    A disturbance begins where all of them were zero before. For good is up to the next onset, or
    to the end of the run. An onset at which the error is outside the band already prolongs the
    recovery from the one before; an onset is not asked if the run ends before the time is over.

    Attributes:
        band: Half width of the band in the unit of the state or output.
        band_written: The band as written in the file.
    """

    key = "recovers_within"
    quantity = "s"
    options = ("state", "band")
    needs_band = True
    is_level = False
    recorded = True

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

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Say that a log does not tell when it was disturbed."""
        return "a log does not have the onsets of disturbances"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the longest recovery, and say if there was none to make."""
        value = self.replayed(run)
        if not len(self._onsets(run.trajectory)):
            return value, "no disturbance begins in time"
        return value, ""

    def of_record(self, run: Trajectory, law: Controller, input_limits: Array) -> float:
        """Return the longest recovery; one that is not over counts up to the end of the run."""
        (name,) = self.watched(law.designed.error) if self.signal else (ERROR,)
        outside = np.abs(signals_of(run, law, [name])[name]) > self.band
        onsets = self._onsets(run)
        # The first onset counts wherever the error is.
        counting = [onset for i, onset in enumerate(onsets) if i == 0 or not outside[onset]]

        longest = 0
        ends = [*counting[1:], len(outside)]
        for onset, end in zip(counting, ends, strict=False):
            late = np.flatnonzero(outside[onset:end])
            if len(late):
                longest = max(longest, int(late[-1]) + 1)
        return longest * float(run.time[1])

    def _onsets(self, run: Trajectory) -> list[int]:
        """Return the indices of the instants at which a disturbance begins, in time."""
        acts: Any = run.disturbed
        if acts is None:
            return []
        begins = np.flatnonzero(np.diff(acts, prepend=False) & acts)
        in_time = run.time[begins] + self.number <= run.time[-1] * (1 + 1e-12)
        return begins[in_time].tolist()
