"""A case as an environment of Gymnasium; dm_control is not needed for it."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.environments.episode import Episode, EpisodeSetup
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case

# Named arrays; Gymnasium's own types say no more than Any.
Named = dict[str, Any]


class CaseEnv(gymnasium.Env[Named, Array]):
    """A case with the observations, actions, rewards and ends of ``environments.load``.

    An episode is truncated at the case's duration and terminated where no next step is defined.
    ``info["ended"]`` says why, ``info["units"]`` gives the unit of every entry observed.

    Args:
        system: Name of the system.
        task: Name of one of its cases, or a case.
        control_period: Time between two actions [s].
        timestep: Physics timestep [s].
        spread: Half widths of the starts about the case's own, (n,) or one number.
        render_mode: None; films are made of recorded runs, by ``grosmc_mj.write_film``.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case, or an argument does not fit.
    """

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": []
    }

    def __init__(
        self,
        system: str,
        task: str | Case = "nominal",
        control_period: float = 1e-3,
        timestep: float = 1e-3,
        spread: ArrayLike = 0.0,
        render_mode: None = None,
    ) -> None:
        if render_mode is not None:
            raise ArgumentError(
                f"render_mode = {render_mode!r}: the environments do not render; film a recorded "
                "run with grosmc_mj.write_film"
            )
        self.setup = EpisodeSetup(
            system, task, control_period=control_period, timestep=timestep, spread=spread
        )
        setup, model = self.setup, self.setup.plant.model
        self._model, self._data = model, mujoco.MjData(model)
        self._episode = Episode(setup, model, self._data)
        self.render_mode = render_mode
        self.action_space = spaces.Box(setup.low, setup.high, dtype=np.float64)
        self.observation_space = spaces.Dict(
            {
                name: spaces.Box(0.0 if name == "time" else -np.inf, np.inf, (size,), np.float64)
                for name, size in setup.signals.sizes.items()
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Named, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Of the starts.
            options: None are known.

        Returns:
            Observation and info.
        """
        super().reset(seed=seed)
        mujoco.mj_resetData(self._model, self._data)
        self._episode.restart(self.setup.start(self.np_random))
        return self._episode.observation(), self._info()

    def step(self, action: ArrayLike) -> tuple[Named, float, bool, bool, dict[str, Any]]:
        """Hold an action, (m,), for one control period.

        Returns:
            Observation, reward, terminated, truncated and info.

        Raises:
            ArgumentError: If the action is not m finite numbers.
        """
        episode, ended = self._episode, self._episode.ended
        if ended or episode.over:
            raise ArgumentError(f"the episode is over{ended and ' at ' + ended}: reset it")
        episode.hold(action)
        episode.advance(self.setup.problem.stride)
        terminated = bool(episode.ended)
        truncated = episode.over and not terminated
        return episode.observation(), episode.reward, terminated, truncated, self._info()

    def _info(self) -> dict[str, Any]:
        """What is known beside the observation."""
        return {"ended": self._episode.ended, "units": dict(self.setup.signals.units)}
