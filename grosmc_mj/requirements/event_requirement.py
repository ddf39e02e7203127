"""The base class of requirements on an event, see ``events``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError
from grosmc_mj.requirements.measured_run import MeasuredRun
from grosmc_mj.requirements.measurement import Windows
from grosmc_mj.requirements.metrics import Event
from grosmc_mj.requirements.requirement import Requirement

# Margin, in parts of the number, of a run without the event: searches compare finite numbers.
_NEVER = -1e3


@dataclass(frozen=True, kw_only=True)
class EventRequirement(Requirement):
    """A requirement on what a run does until an error is in a band for good.

    Attributes:
        band: Half width of the band in the unit of the state or output.
        band_written: The band as written in the file.
    """

    options = ("state", "band", "periodic")
    needs_band = True

    band: float = math.inf
    band_written: str = ""

    @property
    def event(self) -> Event:
        """The event."""
        return Event(self.signal, self.band, self.periodic)

    @property
    def windows(self) -> Windows:
        """The event."""
        return Windows(events=(self.event,))

    @property
    def band_in_words(self) -> str:
        """The band in words."""
        turn = " modulo a turn" if self.periodic else ""
        return f"{self.band_written}{turn}"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the limited value of a run, or that the band is not reached."""
        value = self.replayed(run)
        if math.isinf(value):
            return None, f"does not come to {self.band_in_words} and stay"
        return value, ""

    def order_share(
        self, share: Array, metrics: Mapping[str, Array], transient: Array, start: float
    ) -> Array:
        """Return margins in parts of the number, finite ones of runs without the event too."""
        return np.maximum(share, _NEVER)


class SwingRequirement(EventRequirement):
    """A requirement on the swings of one state or output before the event."""

    @property
    def words(self) -> str:
        """The requirement in words."""
        number = f"{self.number:g}" if self.unit == "1" else self.written
        return f"{self.title} {number} before it is within {self.band_in_words}"

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse several outputs together."""
        if len(error.output_rows) > 1 and not signal:
            raise ArgumentError("several outputs swing together: name one of them as state")
