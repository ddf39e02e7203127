"""A loop and the runs that it is for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.simulation.loop.actuators import Actuator
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.sensors import Sensor
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.design_model import DesignModel
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.plants import Signal, System


@dataclass(frozen=True, eq=False)
class LoopTask:
    """A loop around the law of a controller, and the runs that it is for.

    Attributes:
        controller: Controller, with the control period in its parameters.
        loop: Parts of the loop.
        known: Loop that the law knows.
        system: System of the plant.
        model: Design model; None where nothing runs it.
        timestep: [s].
        period: Control period [s].
        stride: Timesteps in a control period.
        run: Number of the run.
        predicts: Whether the law gets the state at the instant when its output arrives.
    """

    controller: Controller
    loop: Loop
    known: Loop
    system: System
    model: DesignModel | None
    timestep: float
    period: float
    stride: int
    run: int
    predicts: bool

    @property
    def sensors(self) -> list[Sensor]:
        """Sensor of each state, an ideal one where the loop has none."""
        return _one_each(self.system.states, Sensor, self.loop.sensors)

    @property
    def actuators(self) -> list[Actuator]:
        """Actuator of each input, an ideal one where the loop has none."""
        return _one_each(self.system.inputs, Actuator, self.loop.actuators)

    @property
    def known_actuators(self) -> list[Actuator]:
        """Actuator of each input, as the law knows it."""
        return _one_each(self.system.inputs, Actuator, self.known.actuators)

    @property
    def rest(self) -> Array:
        """Input before the first output arrives, (m,): that of an operating point, or zero."""
        m = len(self.system.inputs)
        design = self.controller.design
        if design is not None and isinstance(design.error, StateCoordinates):
            return np.zeros(m) + self.controller.parameters.reference.u
        return np.zeros(m)


def _one_each(signals: Sequence[Signal], kind: Any, parts: Sequence[Any]) -> list[Any]:
    """Part of each state or input, an ideal one where there is none."""
    named = {part.of: part for part in parts}
    return [named.get(signal.name, kind(signal.name)) for signal in signals]
