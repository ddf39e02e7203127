"""A run that can be judged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.requirements.metrics import Metric
from grosmc_mj.requirements.optimum import Comparison
from grosmc_mj.simulation.trajectory import Status, Trajectory


class MeasuredRun(Protocol):
    """A run that can be judged."""

    @property
    def simulated(self) -> bool:
        """Whether it is a simulation, not a log of the machine."""
        ...

    @property
    def plant(self) -> str:
        """Name of the plant."""
        ...

    @property
    def controller(self) -> Controller:
        """The law."""
        ...

    @property
    def trajectory(self) -> Trajectory:
        """The recorded run."""
        ...

    @property
    def comparison(self) -> Comparison:
        """The run beside its optimum."""
        ...

    @property
    def metrics(self) -> Mapping[str, Metric]:
        """The usual metrics."""
        ...

    @property
    def onset(self) -> float:
        """Onset of the first disturbance [s]."""
        ...

    @property
    def status(self) -> Status:
        """Status at the end of the run."""
        ...

    @property
    def input_limits(self) -> Array:
        """Least and largest of each input, (2, m); infinite for none."""
        ...

    @property
    def saturated(self) -> float:
        """Share of the time in which the law asks an actuator for its limit or more."""
        ...
