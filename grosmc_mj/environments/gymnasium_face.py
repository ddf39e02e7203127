"""A case as an environment of Gymnasium; dm_control is not needed for it."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.environments.episode import Episode, EpisodeSetup
from grosmc_mj.environments.signals import input_label
from grosmc_mj.errors import ArgumentError, SetupError, unknown_name
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.simulation.steppers import PhysicsStepper, stepper_of

# Named arrays; Gymnasium's own types say no more than Any.
Named = dict[str, Any]


class CaseEnv(gymnasium.Env[Named, Array]):
    """A case with the observations, actions, rewards and ends of ``environments.load``.

    An episode is truncated at the case's duration and terminated where no next step is defined.
    ``info["ended"]`` says why, ``info["units"]`` gives the unit of every entry observed.

    Args:
        system: A system, SYSTEM/CASE or the path of a case file.
        task: Name of one of a system's cases, or an experiment.
        control_period: Time between two actions [s]; the case's own by default.
        timestep: Physics timestep [s]; the case's own by default.
        spread: Half widths of the starts about the case's own, (n,) or one number.
        action_limit: Largest magnitude of each action, (m,) or one number; by default the
            actuators' own limits, which may be none.
        normalized: Whether actions are parts of their limits, from -1 to 1, instead of inputs in
            their own units.
        render_mode: ``rgb_array`` for pictures by ``render()`` of a model in MuJoCo, or None.
        size: Width and height of a picture.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case, or an argument does not fit.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as Gymnasium has it
        "render_modes": ["rgb_array"],
        "render_fps": 30,
    }

    def __init__(
        self,
        system: str,
        task: str | Experiment | None = None,
        control_period: float | None = None,
        timestep: float | None = None,
        spread: ArrayLike = 0.0,
        action_limit: ArrayLike | None = None,
        *,
        normalized: bool = False,
        render_mode: str | None = None,
        size: tuple[int, int] = (640, 480),
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ArgumentError(unknown_name("render_mode", render_mode, ["rgb_array"]))
        self.setup = EpisodeSetup(
            system,
            task,
            control_period=control_period,
            timestep=timestep,
            spread=spread,
            action_limit=action_limit,
        )
        setup = self.setup
        if setup.undrawable:
            self.metadata = {**self.metadata, "render_modes": []}
            if render_mode is not None:
                raise ArgumentError(f"{setup.undrawable}, so render_mode must be None")
        self._episode = Episode(setup, stepper_of(setup.plant, setup.problem.timestep))
        self.render_mode = render_mode
        self._size, self._renderer = size, None
        self._shown: tuple[mujoco.MjModel, mujoco.MjData] | None = None
        self._scale = _scale(setup) if normalized else None
        low, high = (setup.low, setup.high) if self._scale is None else (-1.0, 1.0)
        shape = (setup.inputs,)
        self.action_space = spaces.Box(
            np.broadcast_to(low, shape), np.broadcast_to(high, shape), shape, np.float64
        )
        # There are no bounds; Gymnasium takes infinite ones for a slip.
        most = float(np.finfo(np.float64).max)
        self.observation_space = spaces.Dict(
            {
                name: spaces.Box(0.0 if name == "time" else -most, most, (size,), np.float64)
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
        start = self.setup.start(self.np_random)
        self._episode.restart(start, self.setup.run(self.np_random))
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
        episode.hold(action if self._scale is None else self._inputs(action))
        episode.advance(self.setup.problem.stride)
        terminated = bool(episode.ended)
        truncated = episode.over and not terminated
        return episode.observation(), episode.reward, terminated, truncated, self._info()

    def render(self) -> Any:
        """A picture of the state, (height, width, 3), with ``render_mode="rgb_array"``; else None.

        Raises:
            SetupError: If nothing here can draw: MUJOCO_GL says what does, read once at start.
        """
        stepper = self._episode.stepper
        if self.render_mode is None or not isinstance(stepper, PhysicsStepper):
            return None
        if self._renderer is None or self._shown is None:
            # The plant's own model is not to be changed, and the one that moves has no looks.
            model = copy.copy(self.setup.plant.model)
            self._renderer = _renderer(model, *self._size)
            self._shown = model, mujoco.MjData(model)
        model, data = self._shown
        mujoco.mj_setState(model, data, stepper.physics(), mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_forward(model, data)
        self._renderer.update_scene(data, 0 if model.ncam else -1)
        return self._renderer.render()

    def close(self) -> None:
        """Free what draws."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = self._shown = None

    def _inputs(self, action: ArrayLike) -> Array:
        """Inputs of a normalized action."""
        middle, half = self._scale or (np.zeros(1), np.ones(1))
        return middle + half * self.setup.checked(action)

    def _info(self) -> dict[str, Any]:
        """What is known beside the observation."""
        return {"ended": self._episode.ended, "units": dict(self.setup.signals.units)}


def _scale(setup: EpisodeSetup) -> tuple[Array, Array]:
    """Middle and half width of the actions, (m,) each.

    Raises:
        ArgumentError: If one has no limit.
    """
    if not np.all(np.isfinite([setup.low, setup.high])):
        raise ArgumentError(
            f"normalized actions need limits, {input_label(setup.plant.system)} has none: give "
            "action_limit=..."
        )
    return (setup.low + setup.high) / 2, (setup.high - setup.low) / 2


def _renderer(model: mujoco.MjModel, width: int, height: int) -> mujoco.Renderer:
    """What draws a model.

    Raises:
        SetupError: If it cannot be had.
    """
    buffer = model.vis.global_
    buffer.offwidth, buffer.offheight = max(buffer.offwidth, width), max(buffer.offheight, height)
    try:
        return mujoco.Renderer(model, height, width)
    # Each backend has errors of its own.
    except Exception as error:
        raise SetupError(
            f"nothing here can draw ({error}): start Python with MUJOCO_GL=egl or "
            "MUJOCO_GL=osmesa; grosmc-mj doctor tells what works"
        ) from error
