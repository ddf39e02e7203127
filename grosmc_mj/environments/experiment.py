"""A case as something to be acted on: its plant, its instants, its starts and its index."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.environments.index import Index
from grosmc_mj.environments.signals import Signals, input_label, state_names
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment, find_experiment
from grosmc_mj.plants import find_system
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.prepare import prepare

# The law whose index gives the reward.
INDEX_LAW = "grosmc"
# Starts drawn before giving up on finding one where plant and index are defined.
_TRIES = 1000


class Random(Protocol):
    """NumPy's old and new generators alike."""

    def uniform(self, low: Array, high: Array) -> Array:
        """Independent draws between the bounds."""
        ...


class EpisodeSetup:
    """One case of one system, ready to be run by somebody else's loop.

    The instants and the wrenches are those that ``simulate`` lays out for the same case.

    Args:
        system: Name of the system.
        task: Name of one of its cases, or an experiment.
        control_period: Time between two actions [s], a multiple of the timestep.
        timestep: Physics timestep [s].
        spread: Half widths of the starts about the case's own, (n,), in the states' units, or
            one number for all of them.

    Attributes:
        case: The case.
        plant: Its model, edited.
        law: The controller whose index gives the reward.
        signals: What is observed.
        index: What is to be minimized.
        problem: Instants and wrenches, as for ``simulate``.
        low: Least input that the actuators apply, (m,); infinite without a limit.
        high: The largest one, (m,).

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case, or a number does not fit.
    """

    def __init__(
        self,
        system: str,
        task: str | Experiment = "nominal",
        *,
        control_period: float = 1e-3,
        timestep: float = 1e-3,
        spread: ArrayLike = 0.0,
    ) -> None:
        found = _experiment(find_system(system).name, task)
        found = found.with_settings(control_period=control_period, timestep=timestep)
        self.case, plant = found.case, found.plant("physics")
        assert isinstance(plant, MujocoPlant)
        self.plant = plant
        self.law = found.law("physics", INDEX_LAW)
        self.signals, self.index = Signals(self.law), Index(self.law)
        self.problem, _ = prepare(
            plant,
            self.law,
            self.case.x0,
            duration=self.case.duration,
            control_period=control_period,
            timestep=timestep,
            disturbances=self.case.disturbances,
        )
        limited = plant.model.actuator_ctrllimited.astype(bool)[:, None]
        bounds = np.where(limited, plant.model.actuator_ctrlrange, [-np.inf, np.inf])
        self.low, self.high = bounds.T
        self._spread = _half_widths(self.plant, spread)
        self._require_start()

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.low)

    def start(self, random: Random) -> Array:
        """The case's start, or one drawn uniformly about it, (n,).

        Raises:
            ArgumentError: If the plant or the index is defined at next to none of them.
        """
        x0 = np.array(self.case.x0)
        if not self._spread.any():
            return x0
        for _ in range(_TRIES):
            drawn = random.uniform(x0 - self._spread, x0 + self._spread)
            if not self.undefined(drawn):
                return drawn
        raise ArgumentError(
            f"spread = {self._spread.tolist()}: the plant is not defined at {_TRIES} starts drawn; "
            "take a smaller one"
        )

    def undefined(self, x: Array) -> str:
        """Why an episode can't go on from a state; empty if it can."""
        system = self.plant.system
        if system.singular(x):
            return f"the plant is singular at {system.singularity}"
        if not self.index.defined(x):
            return f"the index is undefined outside {system.region}"
        return ""

    def checked(self, action: ArrayLike) -> Array:
        """An action as the inputs that are commanded, (m,).

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        try:
            u = np.asarray(action, float)
        except (TypeError, ValueError):
            u = np.full(0, np.nan)
        if u.shape != (self.inputs,) or not np.all(np.isfinite(u)):
            raise ArgumentError(
                f"action {action!r} must be {self.inputs} finite number(s) in an array of shape "
                f"({self.inputs},): {input_label(self.plant.system)}"
            )
        return u

    def _require_start(self) -> None:
        """Refuse a case that could not take its first step.

        Raises:
            ArgumentError: If its start is undefined.
        """
        why = self.undefined(np.array(self.case.x0))
        if why:
            raise ArgumentError(f"{self.case.system}/{self.case.name} can't start: {why}")


def _experiment(system: str, task: str | Experiment) -> Experiment:
    """The experiment of a system."""
    if not isinstance(task, Experiment):
        return find_experiment(system, task)
    if (case := task.case).system != system:
        raise ArgumentError(f"case {case.name!r} is one of {case.system}, not of {system}")
    return task


def _half_widths(plant: MujocoPlant, spread: ArrayLike) -> Array:
    """Half widths of every state, (n,)."""
    n = len(plant.system.states)
    try:
        widths = np.asarray(spread, float)
    except (TypeError, ValueError):
        widths = np.full(0, np.nan)
    if widths.shape not in {(), (n,)} or not np.all(np.isfinite(widths) & (widths >= 0)):
        raise ArgumentError(
            f"spread = {spread!r} must be one number, or {n} of them, not negative: "
            f"{', '.join(state_names(plant.system))}"
        )
    return np.broadcast_to(widths, (n,))
