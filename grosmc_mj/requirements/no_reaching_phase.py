"""A sliding variable that starts at zero."""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.task import GrosmcParameters
from grosmc_mj.requirements.measured_run import MeasuredRun
from grosmc_mj.requirements.requirement import ROUNDING, SurfaceRequirement


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

    def measured(self, run: MeasuredRun) -> tuple[float | None, str]:
        """Return |s(0)|, or that the law has no surface."""
        if run.trajectory.sliding is None:
            return None, "the law has no surface"
        return super().measured(run)

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that an integral surface starts at zero."""
        if isinstance(law.parameters, GrosmcParameters):
            return "an integral surface starts at zero"
        return ""
