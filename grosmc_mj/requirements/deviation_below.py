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
    usual_metric = "deviation"
    not_in_logs = "a log is not compared with the nominal optimum"
