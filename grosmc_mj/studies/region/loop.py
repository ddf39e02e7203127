"""The closed loop of a region map: all that a map needs to know about systems and laws."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law, around
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class RegionLoop:
    """A law on the physics of an experiment, stopped where it leaves the region of the laws.

    Attributes:
        experiment: What is changed against the nominal plant, and how it is run.
        controller: The law, guarded; designed for the nominal plant.
        on_equations: Whether it runs on the plant's equations instead, which take steps of RK4.
    """

    experiment: Experiment
    controller: Controller
    on_equations: bool = False

    @classmethod
    def of(cls, experiment: Experiment, controller: str) -> RegionLoop:
        """The loop of a named controller."""
        law = experiment.law("physics", controller)
        return cls(experiment, guarded(law, experiment.nominal.system))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

    @cached_property
    def plant(self) -> Plant:
        """The experiment's plant, or its equations."""
        physics = self.experiment.plant("physics")
        return physics.analytic() if self.on_equations else physics

    def run(self, starts: Array, duration: float) -> Trajectory:
        """Start and end of the runs from the starts (nsim, n)."""
        return simulate(
            self.plant,
            self.controller,
            starts,
            duration=duration,
            control_period=self.experiment.settings.control_period,
            timestep=self.experiment.settings.timestep,
            disturbances=self.experiment.case.disturbances,
            record=False,
        )

    @cached_property
    def _affine(self) -> tuple[Array, Array]:
        """(C, c) of the error state at the start, z = C x + c."""
        n = len(self.system.states)
        c = self.errors(0.0, np.zeros((1, n)))[0]
        return (self.errors(0.0, np.eye(n)) - c).T, c

    @property
    def sensitivity(self) -> Array:
        """How each error moves with each state, (errors, n): 1, -1 or 0."""
        return self._affine[0]

    @property
    def equilibrium(self) -> Array:
        """The state without error at t = 0; what the law does not regulate is zero there, (n,)."""
        sensitivity, offset = self._affine
        return -np.linalg.pinv(sensitivity) @ offset

    @property
    def regulated(self) -> list[int]:
        """The state that each error is measured on."""
        return np.abs(self.sensitivity).argmax(axis=1).tolist()

    def errors(self, time: float, states: Array) -> Array:
        """Error states at one time [s] of states (nsim, n); returns (nsim, errors).

        Raises:
            ArgumentError: If the law regulates something that is no state.
        """
        error = self.controller.designed.error
        if error.outputs is not None:
            raise ArgumentError(
                f"{self.controller.name} in {self.experiment.case.name} of {self.system.name} "
                "regulates outputs that are no states: take another case"
            )
        times = np.full(len(states), time)
        return error.along(times, states, self.controller.parameters)


def guarded(controller: Controller, system: System) -> Controller:
    """The same controller, whose run ends at the first sample outside the region.

    The Jacobian LQR is defined everywhere and could swing the pole right round; its run ends
    where those of the linearizing laws do.
    """
    return replace(controller, law=_guarded_law(controller.law, system))


@cache
def _guarded_law(law: Law, system: System) -> Law:
    """The law, undefined outside the region."""
    inner, linearizable = jitable(law), system.linearizable

    def guarded_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        inner(t, x, memory, p, u)
        if not linearizable(x):
            memory.undefined = 1.0

    return around(guarded_law, law)


def outside(system: System, starts: Array) -> NDArray[np.bool_]:
    """Which starts (nsim, n) are singular for the plant or outside the laws' region."""
    return np.array([system.singular(x) or not system.linearizable(x) for x in starts], bool)


def state_names(system: System) -> Sequence[str]:
    """The states' symbols in ASCII, in order: p, theta, p_dot, theta_dot."""
    return [_ascii(state.symbol) for state in system.states]


def _ascii(symbol: str) -> str:
    """θ̇ as theta_dot, q₁ as q1."""
    words, dots = "", ""
    for character in unicodedata.normalize("NFD", symbol):
        name = unicodedata.name(character)
        if name == "COMBINING DOT ABOVE":
            dots = "_dot"
        elif character.isdigit():
            words += str(unicodedata.digit(character))
        else:
            words += character if character.isascii() else name.split()[-1].lower()
    return words + dots
