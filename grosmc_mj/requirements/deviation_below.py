"""Largest distance from the nominal optimum."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class DeviationBelow(Requirement):
    """Largest distance from the law's own nominal optimum."""

    key = "deviation_below"
    quantity = "output"
    figure = "deviation"

    @property
    def metric(self) -> str:
        """Name of the largest distance."""
        return "deviation"
