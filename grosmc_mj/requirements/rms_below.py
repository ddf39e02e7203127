"""Root mean square of the error or of a state."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.metrics import rms_of
from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class RmsBelow(Requirement):
    """Root mean square of the error, or of a state, from ``after`` on."""

    key = "rms_below"
    quantity = "output"
    options = ("state", "after", "periodic")

    @property
    def metric(self) -> str:
        """Name of the root mean square."""
        return rms_of(self.signal, self.after, periodic=self.periodic)
