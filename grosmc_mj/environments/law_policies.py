"""A law as a policy: from observations to actions, in any environment."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.environments.signals import Observation, seen_state, state_names
from grosmc_mj.errors import ArgumentError, UndefinedLawError
from grosmc_mj.plants import System, find_system
from grosmc_mj.simulation.inputs import write_inputs


class LawPolicy:
    """A controller's law, called with observations; its memory starts anew at time 0.

    Args:
        controller: The controller.
        system: Its plant, which names the states.
        control_period: Of the environment [s].
    """

    def __init__(self, controller: Controller, system: System, control_period: float) -> None:
        self._controller = replace(controller, loop=None).sampled(control_period)
        self._names = state_names(system)
        self._u = np.zeros(len(system.inputs))
        self.reset()

    def reset(self) -> None:
        """Forget the run so far."""
        self._memory, self._kept_alive = self._controller.begin()
        self._last = math.nan

    def __call__(self, observation: Observation) -> Array:
        """The law's inputs, (m,).

        Args:
            observation: As the environments give it, or any mapping of ``time`` and the states'
                names to numbers.

        Raises:
            ArgumentError: If an entry is missing, or the sampling is not what the law needs.
            UndefinedLawError: If the law is not defined at this state.
        """
        t, x = seen_state(self._names, observation)
        if t == 0:
            self.reset()
        self._check_period(t)
        write_inputs(self._controller, t, x, self._memory, self._u)
        if self._memory.undefined:
            name = self._controller.name
            raise UndefinedLawError(f"t = {t:g} s: {name} is undefined at this state", t)
        return self._u.copy()

    def _check_period(self, t: float) -> None:
        """Refuse another sampling time than the one that the law is made for."""
        design, found = self._controller.design, t - self._last
        p, wanted = self._controller.parameters, design.control_period if design else None
        if isinstance(p, Sampled):
            wanted = p.period
        # Differences of instants are rounded in the instants' last place.
        if wanted is not None and abs(found - wanted) > 1e-9 * max(1.0, t):
            raise ArgumentError(
                f"{self._controller.name} is for a control period of {wanted:g} s, not {found:g} s:"
                f" load the environment, or make the policy, with control_period={wanted:g}"
            )
        self._last = t


def law_policy(
    controller: Controller, system: str | None = None, *, control_period: float = 1e-3
) -> LawPolicy:
    """A law as a policy ``policy(observation) -> action``, for dm_control and Gymnasium alike.

    A law in a loop is taken without it: that is the environment's.

    It takes ``time_step.observation`` of the one and the observation of the other, and starts
    its memory anew when the observed time is 0.

    Args:
        controller: Any controller.
        system: Its system's name; needed if the controller has no design.
        control_period: Of the environment [s], which a law of one's own may read.

    Raises:
        ArgumentError: If the system is not known.
    """
    if system is not None:
        return LawPolicy(controller, find_system(system), control_period)
    if controller.design is None:
        raise ArgumentError(
            f"{controller.name} does not say which plant it is for: give law_policy its system"
        )
    return LawPolicy(controller, controller.design.error.system, control_period)
