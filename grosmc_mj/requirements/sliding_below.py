"""Largest sliding variable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grosmc_mj.requirements.requirement import SurfaceRequirement
from grosmc_mj.requirements.signals import sliding_names


@dataclass(frozen=True, kw_only=True)
class SlidingBelow(SurfaceRequirement):
    """Largest |s|; by default of the laws that have a surface."""

    key = "sliding_below"
    quantity = "sliding"
    figure = "sliding"
    usual_metric = "max_sliding"

    def watched(self, error: Any) -> list[str]:
        """Return the names of the sliding variables."""
        return sliding_names(error.inputs)
