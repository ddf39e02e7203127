"""Largest error at the end of a run."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.metrics import DWELL, largest_of
from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class FinalErrorBelow(Requirement):
    """Largest error, or |x_i| of a state, in the last tenth of the run."""

    key = "final_error_below"
    quantity = "output"
    options = ("state", "periodic")
    figure = "output"

    @classmethod
    def holds_from(cls, after: float, duration: float) -> float:
        """Return the beginning of the last tenth [s]."""
        return (1 - DWELL) * duration

    @property
    def metric(self) -> str:
        """Name of the largest magnitude."""
        return largest_of(self.signal, self.after, periodic=self.periodic)
