"""Loads and actuators of a run, which some requirements are judged by."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop.actuators import Actuator


@dataclass(frozen=True, eq=False)
class Conditions:
    """Loads and actuators of a run.

    Attributes:
        loads: First and last instant at which each disturbance acts [s].
        input_limits: Least and largest of each input that the actuators give, (2, m); infinite
            for none.
        actuators: Actuators of a loop, each with the index of its input.
    """

    loads: Sequence[tuple[float, float]]
    input_limits: Array
    actuators: Sequence[tuple[int, Actuator]] = ()

    def demanded(self, commands: Array) -> Array:
        """Return the inputs that the actuators would give at last if they had no limits.

        Args:
            commands: Outputs of the law, (N, m).

        Returns:
            Commands times the actuators' gains, in steps of their resolutions, (N, m). Lags, rate
            limits and delays change when an input comes, and are left out.
        """
        demanded = commands.copy()
        for index, actuator in self.actuators:
            demanded[:, index] = actuator.demanded(commands[:, index])
        return demanded

    def at_limit(self, commands: Array) -> NDArray[np.bool_]:
        """Return whether an actuator gives the most that it can, (N, m).

        Args:
            commands: Outputs of the law, (N, m).
        """
        low, high = self.input_limits
        demanded = self.demanded(commands)
        return (demanded <= low) | (demanded >= high)


def end_of_transient(onsets: Iterable[tuple[float, float]]) -> float:
    """Return the instant at which the first later load begins [s]; infinite if none does.

    A load that acts from the start is part of the transient; one that begins after it ends it.

    Args:
        onsets: Earliest and latest instant at which each disturbance begins, over all runs [s].
    """
    ends = [math.inf]
    for earliest, latest in onsets:
        if latest > 0:
            ends.append(max(earliest, 0.0))
    return min(ends)
