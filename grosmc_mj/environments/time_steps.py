"""Observations of a simulation as dm_env time steps, for policies that take those."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from grosmc_mj.arrays import Array
from grosmc_mj.environments.index import Index
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    import dm_env


class TimeSteps:
    """Makes the time steps that the environment of the same case would give.

    Args:
        index: Gives the reward.

    Raises:
        SetupError: If dm_env is not installed.
    """

    def __init__(self, index: Index) -> None:
        try:
            import dm_env
        except ImportError as error:
            raise SetupError("time steps need dm_env: pip install dm_env") from error
        self._make, self._index = dm_env, index
        self.restart()

    def restart(self) -> None:
        """Begin a run."""
        self._last: tuple[float, float] | None = None

    def at(self, t: float, observation: Mapping[str, Any]) -> dm_env.TimeStep:
        """The time step at an instant [s]: the first of a run, or one with the reward so far."""
        if self._last is None:
            return self._make.restart(observation)
        before, cost = self._last
        return self._make.transition(-(t - before) * cost, observation)

    def book(self, t: float, x: Array, u: Array) -> None:
        """Keep what the next time step's reward is made of."""
        self._last = (t, self._index.stage_cost(t, x, u))
