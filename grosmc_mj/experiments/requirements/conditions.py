"""A recorded run with its loads and actuators, by which some requirements are judged."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.requirements.optimum import Comparison, compare_with_optimum
from grosmc_mj.experiments.requirements.signals import signals_of
from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop.actuators import Actuator
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller


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


@dataclass(frozen=True, eq=False)
class RecordedRun:
    """A recorded run; the requirements on its rows share what is computed of them.

    Attributes:
        trajectory: The run.
        controller: Its controller.
        conditions: Its loads and actuators.
    """

    trajectory: Trajectory
    controller: Controller
    conditions: Conditions

    # Metrics, figures and most requirements on rows ask for it.
    @cached_property
    def comparison(self) -> Comparison:
        """The run beside the optimum that its law was designed for."""
        return compare_with_optimum(self.trajectory, self.controller)

    def signals(self, names: Collection[str]) -> dict[str, Array]:
        """Return signals by name, (N + 1,) each, see ``signals_of``."""
        return signals_of(self.trajectory, self.controller, names, self.comparison)


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
