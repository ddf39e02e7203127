"""The loop as built between an agent and the plant: what it observes, what comes of its actions."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import memory_of
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.in_loop import loop_of, relooped


class AgentLoop:
    """A case's loop with an agent in place of its law.

    Args:
        law: A controller in its loop, whose design model observers run.
    """

    def __init__(self, law: Controller) -> None:
        sampling, bare = loop_of(law), loop_of(law).bare
        m = len(sampling.system.inputs)
        agent = replace(
            bare,
            name="agent",
            law=_as_pending,
            memory=memory_of(m, pending=np.zeros(m)),
            sampling=None,
        )
        self._made = replace(law, sampling=replace(sampling, bare=agent, predicts=False))
        self.restart(0)

    def restart(self, run: int) -> None:
        """Begin an episode with the noise of a run."""
        made = relooped(self._made, loop_of(self._made).loop, run)
        self._law, self._memory, self._kept_alive = made, *made.begin()

    def ask(self, u: Array) -> None:
        """Take an action as what the agent asks for from its next sample on, (m,)."""
        self._memory.pending[:] = u  # pyright: ignore[reportAttributeAccessIssue]

    def given(self, x: Array) -> Array:
        """What the actuators give in the next timestep from a state (n,), (m,)."""
        return self._law.input_at(0.0, x, self._memory)

    def seen(self, x: Array) -> Array:
        """What sensors and estimators would tell now of a state (n,), (n,)."""
        ahead: Any = deepcopy(self._memory)
        ahead.loop.due = ahead.loop.step
        self._law.input_at(0.0, x, ahead)
        return ahead.loop.seen

    def copied(self) -> AgentLoop:
        """The same so far, to go on by itself."""
        other = AgentLoop.__new__(AgentLoop)
        other.__dict__.update(self.__dict__)
        other._memory = deepcopy(self._memory)
        return other


@jitable
def _as_pending(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """The law that asks for what is pending."""
    for i in range(len(u)):
        u[i] = memory.pending[i]
