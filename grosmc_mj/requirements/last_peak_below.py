"""Last peak before a band is reached."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.event_requirement import SwingRequirement


@dataclass(frozen=True, kw_only=True)
class LastPeakBelow(SwingRequirement):
    """Magnitude at the last reversal before the error is in a band for good; 0 without one.

    It is that of the state itself, also where the state is an output; of an output that is no
    state it is that of its error.
    """

    key = "last_peak_below"
    quantity = "output"
    measures = "last_peak"
