"""The result of one run of a case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import Plant
from grosmc_mj.requirements.metrics import Metric
from grosmc_mj.requirements.optimum import Comparison
from grosmc_mj.requirements.run_metrics import cost_shares
from grosmc_mj.simulation.trajectory import Status, Trajectory


@dataclass(frozen=True, eq=False, kw_only=True)
class Run:
    """A run of a case on one plant under one controller, and what it measured.

    Attributes:
        case: Start, duration, edits, disturbances.
        plant: ``printed``, ``corrected`` or ``physics``.
        controller: Controller with the numbers of its design.
        trajectory: Trajectory up to the end or to the last valid instant.
        comparison: The run beside the optimum that its law was designed for.
        metrics: Metrics by name.
        ended: Reason why the run ended early; empty otherwise.
        true: The plant itself.
    """

    case: Case
    plant: PlantName
    controller: Controller
    trajectory: Trajectory
    comparison: Comparison
    metrics: Mapping[str, Metric]
    ended: str = ""
    true: Plant | None = None

    @property
    def simulated(self) -> bool:
        """Whether it is a simulation, not a log of the machine."""
        return True

    @property
    def switched(self) -> bool:
        """Whether a switching law made it, whose chatter amplifies rounding."""
        return self.controller.design is not None and bool(self.controller.design.switching)

    @property
    def onset(self) -> float:
        """Onset of the first disturbance of the case [s]; infinite without any."""
        return self.case.onset

    @property
    def input_limits(self) -> Array:
        """Least and largest of each input that the actuators give, (2, m); infinite for none."""
        if self.true is None:
            inputs = len(self.trajectory.system.inputs)
            return np.full((2, inputs), [[-np.inf], [np.inf]])
        return input_limits(self.true, self.case)

    @property
    def commands(self) -> Array:
        """Inputs that the law asked for, (N, m); a trajectory of one input has no axis for it."""
        return self.trajectory.command.reshape(len(self.trajectory.command), -1)

    @property
    def cut(self) -> Array:
        """Whether a sample's command of an input is beyond what its actuator gives, (N, m).

        Late, smoothed or rounded is not cut: the command is compared with the limits.
        """
        low, high = self.input_limits
        return (self.commands < low) | (self.commands > high)

    @property
    def saturated(self) -> float:
        """Share of the time in which the law asks an actuator for its limit or more."""
        low, high = self.input_limits
        at_limit = (self.commands <= low) | (self.commands >= high)
        return float(at_limit.any(axis=1).mean())

    @property
    def cost_shares(self) -> tuple[Metric, Metric]:
        """J(u_c)/J* and J(u_d)/J* a second, see ``run_metrics.cost_shares``."""
        return cost_shares(self.metrics, float(self.trajectory.time[-1]))

    def save(self, path: str | Path) -> Path:
        """Write the trajectory as ``.parquet`` or ``.csv``; see ``Trajectory.save``."""
        unit = self.controller.design.sliding_unit if self.controller.design else ""
        return self.trajectory.save(path, sliding_unit=unit)

    @property
    def key(self) -> str:
        """Name of the run in files: system/case/plant/controller."""
        return "/".join((self.case.system, self.case.name, self.plant, self.controller.name))

    @property
    def plant_parameters(self) -> Any:
        """Numbers of the true plant; None where it has no equations."""
        if self.true is None:
            return None
        return self.true.parameters

    @property
    def status(self) -> Status:
        """Status at the end of the run."""
        return self.trajectory.status  # pyright: ignore[reportReturnType]


def input_limits(plant: Plant, case: Case) -> Array:
    """Return least and largest of each input by a plant and the actuators of its loop, (2, m)."""
    limits = np.array(plant.input_limits)
    if case.loop is not None:
        names = [signal.name for signal in plant.system.inputs]
        for actuator in case.loop.actuators:
            index = names.index(actuator.of)
            limits[:, index] = np.clip(limits[:, index], -actuator.limit, actuator.limit)
    return limits
