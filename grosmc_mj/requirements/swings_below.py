"""Number of swings before a band is reached."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.event_requirement import SwingRequirement


@dataclass(frozen=True, kw_only=True)
class SwingsBelow(SwingRequirement):
    """Number of reversals before the error is in a band for good, at most."""

    key = "swings_below"
    quantity = "1"
    measures = "swings"
