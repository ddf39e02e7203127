"""A case as physics and task of dm_control: its plant, its start, its reward and its end."""

from __future__ import annotations

import copy
from collections import OrderedDict
from typing import Any

import mujoco
import numpy as np
from dm_control.mujoco import Physics, wrapper
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike

from grosmc_mj.environments.episode import Episode, EpisodeSetup
from grosmc_mj.environments.signals import input_label
from grosmc_mj.errors import ArgumentError
from grosmc_mj.simulation.steppers import PhysicsStepper, stepper_of


class CasePhysics(Physics):
    """dm_control's physics of a case, stepped as ``simulate`` steps it, to the last bit.

    Attributes:
        episode: What has happened since the last reset; None until the model is loaded.
    """

    episode: Episode | None = None

    @classmethod
    def of(cls, setup: EpisodeSetup) -> CasePhysics:
        """The physics of a case, on a model of its own: dm_control switches the model's flags."""
        physics = cls.from_model(wrapper.MjModel(copy.copy(setup.plant.model)))
        assert isinstance(physics, CasePhysics)
        physics.episode = Episode(setup, physics._stepper(setup))
        return physics

    @property
    def running(self) -> Episode:
        """The episode of a loaded model."""
        assert self.episode is not None
        return self.episode

    def step(self, nstep: int = 1) -> None:
        """Carry out timesteps under the held input, up to the case's duration.

        A diverged state is told by the episode, not raised.
        """
        self.running.advance(nstep)
        if self.legacy_step and not self.running.ended:
            # dm_control's promise: what depends on position and velocity is up to date.
            mujoco.mj_step1(self.model.ptr, self.data.ptr)

    def time(self) -> float:
        """Time since the reset [s]: a product, not a running sum."""
        return self.running.time if self.episode else 0.0

    def copy(self, share_model: bool = False) -> CasePhysics:
        """A copy that goes on from the same state, disturbances and all."""
        other = super().copy(share_model)
        assert isinstance(other, CasePhysics)
        other.episode = self.running.on(other._stepper(self.running.setup))
        return other

    def _stepper(self, setup: EpisodeSetup) -> PhysicsStepper:
        """What moves its data."""
        return PhysicsStepper(setup.plant.system, self.model.ptr, self.data.ptr)


# dm_control's base methods return nothing, so that only Any may override them.
class EquationPhysics(control.Physics):
    """A plant given by equations alone as physics of dm_control, stepped by RK4 as in a run.

    Args:
        setup: The case.

    Attributes:
        running: What has happened since the last reset.
    """

    def __init__(self, setup: EpisodeSetup) -> None:
        self._h = setup.problem.timestep
        self.running = Episode(setup, stepper_of(setup.plant, self._h))

    def reset(self) -> None:
        """Go back to the case's start; its task may take another."""
        self.running.restart(np.array(self.running.setup.case.x0))

    def after_reset(self) -> None:
        """Nothing depends on the state."""

    def set_control(self, control: ArrayLike) -> None:
        """Hold an input, (m,), from now on, without a reward."""
        self.running.stepper.hold(np.asarray(control, float))

    def step(self, n_sub_steps: int = 1) -> None:
        """Carry out timesteps under the held input, up to the case's duration."""
        self.running.advance(n_sub_steps)

    def time(self) -> Any:
        """Time since the reset [s]."""
        return self.running.time

    def timestep(self) -> Any:
        """Of RK4 [s]."""
        return self._h

    def render(self, *_size: Any, **_options: Any) -> Any:
        """Refuse to draw.

        Raises:
            ArgumentError: Always: equations have no body.
        """
        raise ArgumentError(self.running.setup.undrawable)


CaseDynamics = CasePhysics | EquationPhysics


def physics_of(setup: EpisodeSetup) -> CaseDynamics:
    """The physics of a case: MuJoCo's or, of a plant without a model, its equations."""
    return EquationPhysics(setup) if setup.undrawable else CasePhysics.of(setup)


class CaseTask(control.Task):
    """What a policy is asked for in a case.

    The reward is -T times the stage cost of the case's index. An episode ends at the case's
    duration with discount 1, and with discount 0 where no next step is defined.

    Args:
        setup: The case.
        seed: Of the starts; None for another one each time.

    Attributes:
        setup: The case.
        random: Draws the starts.
        ended: Why the episode ended before its time; empty if it didn't.
    """

    def __init__(self, setup: EpisodeSetup, seed: int | None = None) -> None:
        self.setup, self.random, self.ended = setup, np.random.RandomState(seed), ""

    def initialize_episode(self, physics: CaseDynamics) -> None:
        """Put the plant at a start."""
        start = self.setup.start(self.random)
        physics.running.restart(start, self.setup.run(self.random))
        self.ended = ""

    def before_step(self, action: ArrayLike, physics: CaseDynamics) -> None:
        """Hold an action, (m,), cut to the inputs' limits.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        physics.running.hold(action)

    def after_step(self, physics: CaseDynamics) -> None:
        """Note why there can be no next step, if there can't."""
        self.ended = physics.running.ended

    def action_spec(self, physics: CaseDynamics) -> Any:
        """The inputs with their bounds, (m,); infinite for an unlimited actuator."""
        setup = self.setup
        name = input_label(setup.plant.system)
        return specs.BoundedArray((setup.inputs,), np.float64, setup.low, setup.high, name)

    def get_observation(self, physics: CaseDynamics) -> Any:
        """Every state by its name, the time, the error and its reference."""
        return physics.running.observation()

    def observation_spec(self, physics: CaseDynamics) -> OrderedDict[str, specs.Array]:
        """The same entries; each spec's name ends with the units."""
        signals = self.setup.signals
        return OrderedDict(
            (name, specs.Array((size,), np.float64, signals.labelled(name)))
            for name, size in signals.sizes.items()
        )

    def get_reward(self, physics: CaseDynamics) -> Any:
        """-T times the stage cost at the start of the last interval."""
        return physics.running.reward

    def get_termination(self, physics: CaseDynamics) -> Any:
        """0 where no next step is defined, 1 at the case's duration, else None."""
        if physics.running.ended:
            return 0.0
        return 1.0 if physics.running.over else None
