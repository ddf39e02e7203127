"""Overshoot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.requirements.measured_run import MeasuredRun
from grosmc_mj.requirements.requirement import Requirement, require_initial_error


@dataclass(frozen=True, kw_only=True)
class OvershootBelow(Requirement):
    """Largest error beyond zero, in the transient, as a share of the error at the start."""

    key = "overshoot_below"
    quantity = "1"
    usual_metric = "overshoot"

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse several outputs."""
        if len(error.output_rows) > 1:
            raise ArgumentError("several outputs have no one overshoot")

    def refuse_start(self, law: Controller, x0: Sequence[float]) -> None:
        """Refuse a start without error."""
        require_initial_error(law, x0, f"{self.key}: it is a share")

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the overshoot as a share; among the metrics of a run it is in percent."""
        share = self.replayed(run)
        if math.isfinite(share):
            return share, ""
        return None, "there is no error at the start"
