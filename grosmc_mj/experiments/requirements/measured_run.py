"""A run that can be judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.requirements.conditions import Conditions
from grosmc_mj.experiments.requirements.metrics import Metric
from grosmc_mj.experiments.requirements.optimum import Comparison
from grosmc_mj.experiments.requirements.run_metrics import cost_shares
from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredRun:
    """A run on one plant under one controller, and its metrics.

    Attributes:
        case: The experiment that was run, see ``experiments``.
        plant: ``printed``, ``corrected`` or ``physics``.
        controller: Controller with the numbers of its design.
        trajectory: Trajectory up to the end or to the last valid instant.
        comparison: The run beside the optimum that its law was designed for.
        metrics: Metrics by name.
        true: The plant itself.
        ended: Reason why the run ended early; empty otherwise.
    """

    case: Any
    plant: str
    controller: Controller
    trajectory: Trajectory
    comparison: Comparison
    metrics: Mapping[str, Metric]
    true: Plant
    ended: str = ""

    @property
    def onset(self) -> float:
        """End of the transient [s], see ``end_of_transient``."""
        return self.case.onset

    @property
    def conditions(self) -> Conditions:
        """Loads and actuators of the run."""
        return self.case.conditions(self.true)

    @property
    def input_limits(self) -> Array:
        """Least and largest of each input that the actuators give, (2, m); infinite for none."""
        return self.conditions.input_limits

    @property
    def simulated(self) -> bool:
        """Whether it is a simulation, not a log of the machine."""
        return True

    @property
    def switched(self) -> bool:
        """Whether a switching law made it, whose chatter amplifies rounding."""
        return self.controller.design is not None and bool(self.controller.design.switching)

    @property
    def commands(self) -> Array:
        """Inputs that the law asked for, (N, m); a trajectory of one input has no axis for it."""
        return as_rows(self.trajectory.command)

    @property
    def demanded(self) -> Array:
        """Inputs that the actuators would give at last if they had no limits, (N, m)."""
        return self.conditions.demanded(self.commands)

    @property
    def cut(self) -> Array:
        """Whether an input that a sample demands is beyond what its actuator gives, (N, m).

        Late, smoothed or rounded is not cut.
        """
        low, high = self.input_limits
        return (self.demanded < low) | (self.demanded > high)

    @property
    def saturated(self) -> float:
        """Share of the time in which an actuator gives the most that it can."""
        at_limit = self.conditions.at_limit(self.commands)
        return float(at_limit.any(axis=1).mean())

    @property
    def cost_shares(self) -> tuple[Metric, Metric]:
        """J(u_c)/J* and J(u_d)/J* a second, see ``run_metrics.cost_shares``."""
        return cost_shares(self.metrics, float(self.trajectory.time[-1]))

    @property
    def status(self) -> Status:
        """Status at the end of the run."""
        return self.trajectory.status  # pyright: ignore[reportReturnType]

    def save(self, path: str | Path) -> Path:
        """Write the trajectory as ``.parquet`` or ``.csv``; see ``Trajectory.save``."""
        unit = self.controller.design.sliding_unit if self.controller.design else ""
        return self.trajectory.save(path, sliding_unit=unit)
