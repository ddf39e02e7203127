"""Time until an error is in a band for good."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.errors import ArgumentError
from grosmc_mj.requirements.event_requirement import EventRequirement
from grosmc_mj.requirements.metrics import DWELL


@dataclass(frozen=True, kw_only=True)
class ReachesWithin(EventRequirement):
    """The error, or |x_i| of a state, enters a band by then [s] and stays to the end of the run.

    Unlike ``settles_within`` it counts the whole run, and any state or output.
    """

    key = "reaches_within"
    quantity = "s"
    figure = "output"
    measures = "reached"

    @property
    def words(self) -> str:
        """The requirement in words."""
        return f"{self.title} {self.written} to {self.band_in_words}"

    @property
    def tolerated_as(self) -> str:
        """Name of the usual settling time."""
        return "settling_time"

    def refuse_duration(self, duration: float) -> None:
        """Refuse runs without a tenth left in which the error is seen to stay."""
        latest = (1 - DWELL) * duration
        if self.number > latest * (1 + 1e-12):
            raise ArgumentError(
                f"{self.key}: a run of {duration:g} s tells up to {latest:g} s, since an error "
                "must stay in the band for its last tenth: require that at most"
            )
