"""A run that can be judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.requirements.accumulator import Rows
from grosmc_mj.experiments.requirements.conditions import Conditions, RecordedRun
from grosmc_mj.experiments.requirements.measurement import NO_WINDOWS, Windows, bands
from grosmc_mj.experiments.requirements.metrics import Metric, Metrics, settled_in, stays
from grosmc_mj.experiments.requirements.optimum import Comparison
from grosmc_mj.experiments.requirements.run_metrics import (
    cost_shares,
    metrics_of_rows,
    rows_of,
    usual_metrics,
)
from grosmc_mj.experiments.requirements.signals import references_and_errors
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
        true: The plant itself.
        ended: Reason why the run ended early; empty otherwise.
    """

    case: Any
    plant: str
    controller: Controller
    trajectory: Trajectory
    true: Plant
    ended: str = ""

    # The requirements on rows share it.
    @cached_property
    def record(self) -> RecordedRun:
        """The recorded run with its loads and actuators."""
        return RecordedRun(self.trajectory, self.controller, self.case.conditions(self.true))

    @property
    def comparison(self) -> Comparison:
        """The run beside the optimum that its law was designed for."""
        return self.record.comparison

    # Tables, figures and documents ask for them.
    @cached_property
    def metrics(self) -> Mapping[str, Metric]:
        """Usual metrics by name."""
        return Metrics(usual_metrics(self.trajectory, self.controller, self.values()))

    # Most requirements are about the usual metrics.
    @cached_property
    def _replays(self) -> dict[Windows, dict[str, float]]:
        """Metrics of the run so far by their windows."""
        return {}

    def values(self, windows: Windows = NO_WINDOWS) -> Mapping[str, float]:
        """Return the metrics by name, see ``metrics_of_rows``; nothing of a run without a timestep.

        Args:
            windows: Further windows, bands and signals.
        """
        if len(self.trajectory.time) < 2:
            return {}
        if windows not in self._replays:
            rows = rows_of(self.trajectory, self.comparison.z)
            self._replays[windows] = metrics_of_rows(rows, self.controller, self.onset, windows)
        return self._replays[windows]

    def errors(self, z: Array, windows: Windows = NO_WINDOWS) -> Mapping[str, float]:
        """Return the metrics of error states over the whole run, whatever disturbs it.

        Args:
            z: Error states of this run or of its optimum, (N + 1, n).
            windows: Further windows, bands and signals.
        """
        rows = Rows(self.trajectory.time, z, self.trajectory.state)
        return metrics_of_rows(rows, self.controller, windows=windows)

    def settled(self, z: Array, band: float | None = None) -> float | None:
        """Return when an error is in a band for good [s], over the whole run; None if never.

        Args:
            z: Error states, see ``errors``.
            band: Half width; None for the usual band.
        """
        settled = self.errors(z, bands(band))[settled_in(band)]
        return settled if stays(settled, self.trajectory.time[-1]) else None

    @property
    def onset(self) -> float:
        """End of the transient [s], see ``end_of_transient``."""
        return self.case.onset

    @property
    def conditions(self) -> Conditions:
        """Loads and actuators of the run."""
        return self.record.conditions

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
        """Write the trajectory as ``.parquet`` or ``.csv``, see ``Trajectory.save``.

        Of a law that follows a reference there is also a column of each reference and error.
        """
        design = self.controller.design
        if design is None:
            return self.trajectory.save(path)
        return self.trajectory.save(
            path,
            sliding_unit=design.sliding_unit,
            further=references_and_errors(self.trajectory, self.controller),
        )
