"""Largest input, and time at the limit of an actuator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.requirements.conditions import RecordedRun
from grosmc_mj.experiments.requirements.measured_run import MeasuredRun
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.theory.control.controller import Controller


@dataclass(frozen=True, kw_only=True)
class InputBelow(Requirement):
    """Largest input; where motors stand in its place, as it acts.

    Attributes:
        of_motors: Whether runs have motors, which give another input than they are asked for.
        stronger: Whether one of them may give more than the largest input.
    """

    key = "input_below"
    quantity = "input"
    figure = "input"
    usual_metric = "max_input"
    of_actuators = True

    of_motors: bool = False
    stronger: bool = False

    def on_motors(self, *, stronger: bool) -> Requirement:
        """Return the requirement on the input as it acts."""
        return replace(self, of_motors=True, stronger=stronger)

    @property
    def recorded(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether it is measured on a recorded run, not accumulated during the run."""
        return self.of_motors

    @property
    def metric(self) -> str:
        """Name of the largest input."""
        return "acting input" if self.of_motors else self.usual_metric

    @property
    def tolerated_as(self) -> str:
        """Name of the usual largest input."""
        return self.usual_metric

    def of_record(self, run: RecordedRun) -> float:
        """Return the largest input as it acts."""
        trajectory = run.trajectory
        acting = float(np.abs(trajectory.applied).max())
        if self.stronger:
            return acting
        # The lag of a current gives no more than is asked of it; computed it does, by 1e-8 of it.
        asked = as_rows(trajectory.input)
        if trajectory.input_disturbance is not None:
            asked = asked + as_rows(trajectory.input_disturbance)
        return min(acting, float(np.abs(asked).max()))

    @classmethod
    def refuse_undefined(cls, error: Any, laws: Sequence[str], signal: str) -> None:
        """Refuse inputs of different units."""
        units = {item.unit for item in error.system.inputs}
        if len(units) > 1:
            raise ArgumentError("the inputs have different units")

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that the actuators give no more than is allowed."""
        largest = float(np.abs(input_limits).max())
        if self.stronger or self.number < largest:
            return ""
        return f"the actuator gives {largest:g} {self.unit} at most"

    def note(self, run: MeasuredRun, *, kept: bool) -> str:
        """Say for how long an actuator gives the most that it can."""
        saturated = run.saturated
        if not saturated:
            return ""
        return f"at the actuator's limit {100 * saturated:.2g} % of the time"


class SaturatedForLessThan(Requirement):
    """Longest time in which an actuator gives the most that it can without a break [s]."""

    key = "saturated_for_less_than"
    quantity = "s"
    usual_metric = "longest_saturation"
    of_actuators = True
    recorded = True

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that the inputs have no limit."""
        if np.any(np.isfinite(input_limits)):
            return ""
        return "no input has a limit"

    def of_record(self, run: RecordedRun) -> float:
        """Return the longest time over all inputs."""
        commands = as_rows(run.trajectory.command)
        at_limit = run.conditions.at_limit(commands)

        longest = 0
        for saturated in at_limit.T:
            changes = np.flatnonzero(np.diff(saturated, prepend=False, append=False))
            lengths = changes[1::2] - changes[::2]
            longest = max(longest, int(lengths.max(initial=0)))
        return longest * float(run.trajectory.time[1])
