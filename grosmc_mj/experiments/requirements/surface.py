"""The sliding variable: its largest value, and its start at zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.requirement import ROUNDING, Requirement
from grosmc_mj.experiments.requirements.signals import sliding_names
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.task import GrosmcParameters


class SurfaceRequirement(Requirement):
    """A requirement on the sliding variable, which is asked of laws with a surface only."""

    not_in_logs = "a log does not have the sliding variable"

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return the limited value, or that the law has no surface."""
        if run.trajectory.sliding is None:
            return None, "no surface"
        return super().measured(run)

    @classmethod
    def can_be_asked_of(cls, law: Controller, value: Any) -> bool:
        """Whether a law has a surface."""
        return bool(law.designed.sliding_unit)

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse laws without a surface."""
        if not laws:
            raise ArgumentError("no law that it is asked of has a surface")


class SlidingBelow(SurfaceRequirement):
    """Largest |s|; by default of the laws that have a surface."""

    key = "sliding_below"
    quantity = "sliding"
    figure = "sliding"
    usual_metric = "max_sliding"

    def watched(self, error: Any) -> list[str]:
        """Return the names of the sliding variables."""
        return sliding_names(error.inputs)


@dataclass(frozen=True, kw_only=True)
class NoReachingPhase(SurfaceRequirement):
    """The sliding variable starts at zero, as an integral surface does by its definition.

    By default it is asked of the laws that have a surface.
    """

    key = "no_reaching_phase"
    figure = "sliding"
    usual_metric = "sliding_start"

    number: float = ROUNDING

    @property
    def words(self) -> str:
        """The requirement in words."""
        return "no reaching phase: s(0) = 0"

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that an integral surface starts at zero."""
        if isinstance(law.parameters, GrosmcParameters):
            return "an integral surface starts at zero"
        return ""
