"""Largest distance from the nominal optimum."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class DeviationBelow(Requirement):
    """Largest distance from the law's own nominal optimum."""

    key = "deviation_below"
    quantity = "output"
    figure = "deviation"

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Say that the optimum is the model's."""
        return "a log is not compared with the nominal optimum"

    @property
    def metric(self) -> str:
        """Name of the largest distance."""
        return "deviation"
