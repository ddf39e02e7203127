"""The loop as built between an agent and the plant: its observations, and its actions' inputs."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.loop.actuators import actuate
from grosmc_mj.loop.controllers import loop_of, relooped
from grosmc_mj.loop.delay import send
from grosmc_mj.loop.stages import observe, remember


class AgentLoop:
    """A case's loop with an agent in place of its law.

    Args:
        law: A controller in its loop, whose design model observers run.
    """

    def __init__(self, law: Controller) -> None:
        self._law = replace(law, loop=replace(loop_of(law), predicts=False))
        self.restart(0)

    def restart(self, run: int) -> None:
        """Begin an episode with the noise of a run."""
        law = relooped(self._law, loop_of(self._law).loop, run)
        applied, (memory, self._kept_alive) = loop_of(law), law.begin()
        n, m = len(applied.system.states), len(applied.system.inputs)
        self._loop = applied.begin_uncompiled(law, memory, np.zeros(n), np.zeros(n))
        self._step, self._action, self._given = 0, np.zeros(m), np.zeros(m)

    def ask(self, u: Array) -> None:
        """Take an action as the agent's output from its next sample on, (m,)."""
        self._action = u.copy()

    def given(self, x: Array) -> Array:
        """The actuators' inputs in the next timestep from a state (n,), (m,)."""
        i, loop = self._step, self._loop
        remember(i, x, loop)
        if i >= loop.computer[0].due:
            observe(i, loop)
            send(self._action, loop)
        actuate(i, loop, self._given)
        self._step += 1
        return self._given

    def seen(self, x: Array) -> Array:
        """The state by sensors and estimators if they were read now in a state (n,), (n,)."""
        ahead = deepcopy(self._loop)
        remember(self._step, x, ahead)
        observe(self._step, ahead)
        return ahead.seen

    def copied(self) -> AgentLoop:
        """The same so far, to go on by itself."""
        other = AgentLoop.__new__(AgentLoop)
        other.__dict__.update(self.__dict__)
        other._loop, other._given = deepcopy(self._loop), self._given.copy()
        return other
