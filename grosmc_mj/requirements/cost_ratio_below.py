"""Cost of a run over the least one."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.measured_run import MeasuredRun
from grosmc_mj.requirements.requirement import Requirement


@dataclass(frozen=True, kw_only=True)
class CostRatioBelow(Requirement):
    """J with the whole input over J*.

    Under a law that chatters it grows with the run's length: the number belongs to a file's
    duration.
    """

    key = "cost_ratio_below"
    quantity = "1"

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Say that the index weighs an input of the law."""
        return "a log does not have the input that the index weighs"

    @property
    def metric(self) -> str:
        """Name of J over J*."""
        return "cost_ratio"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the ratio, or that J* is zero."""
        cost = run.metrics["cost_whole"].value
        optimal_cost = run.metrics["cost_optimal"].value
        if cost is None or not optimal_cost:
            return None, "J* is zero: the run starts where it shall end"
        return cost / optimal_cost, ""
