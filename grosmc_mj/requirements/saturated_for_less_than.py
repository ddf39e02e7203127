"""Time at the limit of an actuator."""

from __future__ import annotations

from dataclasses import dataclass

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
    usual_metric = "longest_saturation"
    of_actuators = True
    recorded = True

    def why_unfailing(self, law: Controller, input_limits: Array) -> str:
        """Say that the inputs have no limit."""
        if np.any(np.isfinite(input_limits)):
            return ""
        return "no input has a limit"

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
