"""The physics of a case for dm_control: its model, and its disturbances at every timestep."""

from __future__ import annotations

import copy

import mujoco
from dm_control.mujoco import Physics, wrapper

from grosmc_mj.environments.episode import Episode
from grosmc_mj.environments.experiment import EpisodeSetup


class CasePhysics(Physics):
    """dm_control's physics of a case, stepped as ``simulate`` steps it, to the last bit.

    Attributes:
        episode: What has happened since the last reset; None until the model is loaded.
    """

    episode: Episode | None = None

    @classmethod
    def of(cls, experiment: EpisodeSetup) -> CasePhysics:
        """The physics of a case, on a model of its own: dm_control switches the model's flags."""
        physics = cls.from_model(wrapper.MjModel(copy.copy(experiment.plant.model)))
        assert isinstance(physics, CasePhysics)
        physics.episode = Episode(experiment, physics.model.ptr, physics.data.ptr)
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
        other.episode = self.running.on(other.model.ptr, other.data.ptr)
        return other
