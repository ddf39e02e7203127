"""Time at the limit of an actuator."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.simulation.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class SaturatedForLessThan(Requirement):
    """Longest time in which the law asks an actuator for its limit or more without a break [s]."""

    key = "saturated_for_less_than"
    quantity = "s"
    is_level = False
    of_actuators = True
    recorded = True

    @property
    def metric(self) -> str:
        """Name of the longest time."""
        return "longest_saturation"

    def watched(self, error: Any) -> list[str]:
        """Return the names of the inputs."""
        return [signal.name for signal in error.system.inputs]

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that the inputs have no limit."""
        if np.any(np.isfinite(input_limits)):
            return ""
        return "no input has a limit"

    def why_not_measured(self, law: Controller, known: Set[str]) -> str:
        """Return nothing: a log has the inputs."""
        return ""

    def of_record(self, run: Trajectory, law: Controller, input_limits: Array) -> float:
        """Return the longest time over all inputs."""
        low, high = input_limits
        commands = run.command.reshape(len(run.command), -1)
        at_limit = (commands <= low) | (commands >= high)

        longest = 0
        for saturated in at_limit.T:
            changes = np.flatnonzero(np.diff(saturated, prepend=False, append=False))
            lengths = changes[1::2] - changes[::2]
            longest = max(longest, int(lengths.max(initial=0)))
        return longest * float(run.time[1])
