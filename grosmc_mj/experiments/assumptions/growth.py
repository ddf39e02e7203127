"""States that grow by themselves: modes that no input reaches, and unstable internal dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, PremiseError, name_list
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.modes import Mode, internal_modes, unreached_modes
from grosmc_mj.theory.plants import OperatingPoint, Plant, equilibrium

# Growth over a run that counts.
_LEAST = 0.01


def growth(experiment: Experiment, laws: Iterable[Controller]) -> list[str]:
    """Return a line for each motion that grows by itself, whatever a verdict says.

    It is that of the linearization about the operating point of the case: of the plant, where no
    input reaches it, and of feedback linearization, where the outputs do not show it.

    Args:
        experiment: The experiment.
        laws: Its laws.
    """
    plant = _linear_plant(experiment)
    designed = [law for law in laws if law.design is not None]
    point = _operating_point(experiment, plant, designed)
    if point is None:
        return []

    A, B = plant.jacobian(point.x, point.u)
    if not np.isfinite(A).all() or not np.isfinite(B).all():
        return []
    least = _LEAST / experiment.duration
    states = [state.name for state in plant.system.states]
    lines = [mode.unreached(states) for mode in unreached_modes(A, B, least)]

    of_laws: dict[Mode, list[str]] = {}
    for law in designed:
        for mode in _internal(law, A, B, point.x, least):
            names = of_laws.setdefault(mode, [])
            if law.name not in names:
                names.append(law.name)
    lines += [_hidden(mode, states, names) for mode, names in of_laws.items()]
    return lines


def _linear_plant(experiment: Experiment) -> Plant:
    """The plant that is linearized: equations as they are true, else the nominal model."""
    nominal = experiment.nominal
    if nominal.plant.kind != "physics":
        return experiment.plant(nominal.truest)
    if nominal.system.read_parameters is not None:
        return nominal.equations(nominal.truest)
    return nominal.plant


def _operating_point(
    experiment: Experiment, plant: Plant, laws: Iterable[Controller]
) -> OperatingPoint | None:
    """Operating point that the case's laws hold; None if there is no rest near it."""
    nominal = experiment.nominal
    if nominal.at is not None:
        return nominal.at
    # Each joint of a robot has an input of its own: there is nothing to find.
    if nominal.robot is not None:
        return None
    try:
        near = np.array(experiment.x0)
        for law in laws:
            near = law.designed.error.rest(law.parameters)
        return equilibrium(plant, near=near)
    # The outputs determine no state, or there is no rest.
    except (ArithmeticError, ArgumentError, PremiseError, ValueError):
        return None


def _internal(law: Controller, A: Array, B: Array, x: Array, least: float) -> list[Mode]:
    """Modes behind the outputs of a law with feedback linearization."""
    design = law.designed
    error = design.error
    if not design.linearizing or not isinstance(error, ErrorCoordinates):
        return []
    if error.size >= len(A):
        return []
    slope = np.reshape(error.linearization.slope(x, law.parameters.plant), (error.size, -1))
    if not np.isfinite(slope).all():
        return []
    return internal_modes(A, B, slope, least)


def _hidden(mode: Mode, states: Sequence[str], laws: Sequence[str]) -> str:
    """Line on internal dynamics behind the outputs of some laws."""
    return (
        f"{mode.grows(states)} at {mode.rate:.3g} 1/s behind the outputs of {name_list(laws)}: "
        "unstable internal dynamics, which no feedback of the outputs sees"
    )
