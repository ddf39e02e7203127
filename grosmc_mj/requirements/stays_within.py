"""Largest error, or largest magnitude of a state."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.metrics import largest_of
from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class StaysWithin(Requirement):
    """Largest error, or |x_i| of a state, from ``after`` on."""

    key = "stays_within"
    quantity = "output"
    options = ("state", "after", "periodic")
    figure = "output"

    @property
    def metric(self) -> str:
        """Name of the largest magnitude."""
        return largest_of(self.signal, self.after, periodic=self.periodic)
