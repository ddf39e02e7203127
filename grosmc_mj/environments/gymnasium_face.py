"""A case as an environment of Gymnasium; dm_control is not needed for it."""

from __future__ import annotations

from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from grosmc_mj.environments.episode import Episode, EpisodeOptions, Target, refuse_unknown_options
from grosmc_mj.environments.signals import input_label
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, unknown_name

# Named arrays; Gymnasium's own types say no more than Any.
Named = dict[str, Any]


class CaseEnv(gymnasium.Env[Named, Array]):
    """A case with the observations, actions, rewards and ends of ``environments.load``.

    An episode is truncated at the case's duration and terminated where no next step is defined.
    ``info["ended"]`` says why, ``info["units"]`` gives the unit of every entry observed.

    Args:
        system: A system, SYSTEM/CASE, the path of a case file or an experiment.
        task: Name of one of a system's cases, or an experiment.
        normalized: Whether actions are parts of their limits, from -1 to 1, instead of inputs in
            their own units.
        render_mode: ``rgb_array`` for pictures by ``render()`` of a model in MuJoCo, or None.
        size: Width and height of a picture.
        options: ``control_period``, ``timestep``, ``spread`` and ``action_limit``, numbers in SI
            units or texts such as ``"10 ms"``; see ``EpisodeOptions``.

    Attributes:
        episode: What happens between two resets.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case or option, or an argument does not fit.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as Gymnasium has it
        "render_modes": ["rgb_array"],
        "render_fps": 30,
    }

    def __init__(
        self,
        system: Target,
        task: str | Experiment | None = None,
        *,
        normalized: bool = False,
        render_mode: str | None = None,
        size: tuple[int, int] = (640, 480),
        **options: Unpack[EpisodeOptions],
    ) -> None:
        refuse_unknown_options(options, ["normalized", "render_mode", "size"])
        self.episode = episode = Episode(system, task, **options)
        if episode.undrawable:
            self.metadata = {**self.metadata, "render_modes": []}
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ArgumentError(
                episode.undrawable or unknown_name("render_mode", render_mode, ["rgb_array"])
            )
        self.render_mode = render_mode
        self._size = size

        low = episode.low
        high = episode.high
        if normalized and not np.all(np.isfinite([low, high])):
            raise ArgumentError(
                f"normalized actions need limits, {input_label(episode.plant.system)} has none: "
                "give action_limit=..."
            )
        # An input is middle + half_width * action.
        self._middle: Any = 0.0
        self._half_width: Any = 1.0
        if normalized:
            self._middle = (low + high) / 2
            self._half_width = (high - low) / 2
            low = -np.ones_like(low)
            high = np.ones_like(high)
        self.action_space = spaces.Box(low, high, low.shape, np.float64)

        # There are no bounds; Gymnasium takes infinite ones for a slip.
        most = float(np.finfo(np.float64).max)
        entries: dict[str, spaces.Space[Any]] = {}
        for name, count in episode.signals.sizes.items():
            least = 0.0 if name == "time" else -most
            entries[name] = spaces.Box(least, most, (count,), np.float64)
        self.observation_space = spaces.Dict(entries)

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Named, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Of the starts.
            options: None are known.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed)
        self.episode.reset(self.np_random)
        return self.episode.observation(), self._info()

    def step(self, action: ArrayLike) -> tuple[Named, float, bool, bool, dict[str, Any]]:
        """Hold an action, (m,), for one control period.

        Returns:
            Observation, reward, terminated, truncated and info.

        Raises:
            ArgumentError: If the action is not m finite numbers.
        """
        episode = self.episode
        if episode.ended:
            raise ArgumentError(f"the episode is over at {episode.ended}: reset it")
        if episode.over:
            raise ArgumentError("the episode is over: reset it")

        episode.hold(self._middle + self._half_width * reals(action))
        episode.advance(episode.problem.stride)
        terminated = bool(episode.ended)
        truncated = episode.over and not terminated
        return episode.observation(), episode.reward, terminated, truncated, self._info()

    def render(self) -> Any:
        """A picture of the state, (height, width, 3), with ``render_mode="rgb_array"``; else None.

        Raises:
            SetupError: If nothing here can draw: MUJOCO_GL says what does, read once at start.
        """
        if self.render_mode is None:
            return None
        return self.episode.picture(*self._size)

    def close(self) -> None:
        """Free what draws."""
        self.episode.close()

    def _info(self) -> dict[str, Any]:
        """End and units, beside the observation."""
        return {"ended": self.episode.ended, "units": dict(self.episode.signals.units)}
