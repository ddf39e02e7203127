"""Largest sliding variable."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.requirement import SurfaceRequirement


@dataclass(frozen=True, kw_only=True)
class SlidingBelow(SurfaceRequirement):
    """Largest |s|; by default of the laws that have a surface."""

    key = "sliding_below"
    quantity = "sliding"
    figure = "sliding"

    @property
    def metric(self) -> str:
        """Name of the largest |s|."""
        return "max_sliding"
