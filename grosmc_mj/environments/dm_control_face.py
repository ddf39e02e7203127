"""A case as physics and task of dm_control: its plant, its start, its reward and its end."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike

from grosmc_mj.environments.episode import Episode
from grosmc_mj.environments.signals import input_label


# dm_control's base methods return nothing, so that only Any may override them.
class CasePhysics(control.Physics):
    """A plant, in MuJoCo or by equations, as physics of dm_control, stepped as by ``simulate``.

    Args:
        episode: The case.

    Attributes:
        episode: Course of the run since the last reset.
    """

    def __init__(self, episode: Episode) -> None:
        self.episode = episode

    def reset(self) -> None:
        """Go back to the case's start; its task may take another."""
        self.episode.restart(np.array(self.episode.case.x0))

    def after_reset(self) -> None:
        """Nothing depends on the state."""

    def set_control(self, control: ArrayLike) -> None:
        """Hold an input, (m,), from now on."""
        self.episode.hold(np.atleast_1d(control))

    def step(self, n_sub_steps: int = 1) -> None:
        """Carry out timesteps under the held input, up to the case's duration."""
        self.episode.advance(n_sub_steps)

    def time(self) -> Any:
        """Time since the reset [s]: a product, not a running sum."""
        return self.episode.time

    def timestep(self) -> Any:
        """Physics timestep [s]."""
        return self.episode.problem.timestep

    def render(
        self,
        height: int = 480,
        width: int = 640,
        **_options: Any,
    ) -> np.ndarray:
        """A picture of the state, (height, width, 3).

        Raises:
            ArgumentError: For equations, which have no body.
            SetupError: If nothing here can draw.
        """
        return self.episode.picture(width, height)


class CaseTask(control.Task):
    """Task of a policy in a case.

    The reward is -T times the stage cost of the case's index. An episode ends at the case's
    duration with discount 1, and with discount 0 where no next step is defined.

    Args:
        episode: The case.
        seed: Of the starts; None for other starts each time.

    Attributes:
        episode: The case.
        random: Draws the starts.
    """

    def __init__(self, episode: Episode, seed: int | None = None) -> None:
        self.episode = episode
        self.random = np.random.RandomState(seed)

    @property
    def ended(self) -> str:
        """Why the episode ended before its time; empty if it didn't."""
        return self.episode.ended

    def initialize_episode(self, physics: Any) -> None:
        """Put the plant at a start."""
        self.episode.reset(self.random)

    def before_step(self, action: ArrayLike, physics: Any) -> None:
        """Hold an action, (m,), cut to the inputs' limits.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        self.episode.hold(action)

    def action_spec(self, physics: Any) -> Any:
        """The inputs with their bounds, (m,); infinite for an unlimited actuator."""
        low = self.episode.low
        name = input_label(self.episode.plant.system)
        return specs.BoundedArray(low.shape, np.float64, low, self.episode.high, name)

    def get_observation(self, physics: Any) -> Any:
        """Every state by its name, the time, the error and its reference."""
        return self.episode.observation()

    def observation_spec(self, physics: Any) -> OrderedDict[str, specs.Array]:
        """Specification of each entry of an observation; its name ends with the units."""
        signals = self.episode.signals
        entries = OrderedDict[str, specs.Array]()
        for name, size in signals.sizes.items():
            label = f"{name} [{signals.units[name]}]"
            entries[name] = specs.Array((size,), np.float64, label)
        return entries

    def get_reward(self, physics: Any) -> Any:
        """-T times the stage cost at the start of the last interval."""
        return self.episode.reward

    def get_termination(self, physics: Any) -> Any:
        """0 where no next step is defined, 1 at the case's duration, else None."""
        if self.episode.ended:
            return 0.0
        if self.episode.over:
            return 1.0
        return None
