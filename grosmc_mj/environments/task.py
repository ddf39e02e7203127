"""A case as a task of dm_control: its start, its reward and its end."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import numpy as np
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike

from grosmc_mj.environments.experiment import EpisodeSetup
from grosmc_mj.environments.physics import CasePhysics
from grosmc_mj.environments.signals import input_label


# dm_control's base methods return nothing, so that only Any may override them.
class CaseTask(control.Task):
    """What a policy is asked for in a case.

    The reward is -T times the stage cost of the case's index. An episode ends at the case's
    duration with discount 1, and with discount 0 where no next step is defined.

    Args:
        experiment: The case.
        seed: Of the starts; None for another one each time.

    Attributes:
        experiment: The case.
        random: Draws the starts.
        ended: Why the episode ended before its time; empty if it didn't.
    """

    def __init__(self, experiment: EpisodeSetup, seed: int | None = None) -> None:
        self.experiment, self.random, self.ended = experiment, np.random.RandomState(seed), ""

    def initialize_episode(self, physics: CasePhysics) -> None:
        """Put the plant at a start."""
        physics.running.restart(self.experiment.start(self.random))
        self.ended = ""

    def before_step(self, action: ArrayLike, physics: CasePhysics) -> None:
        """Hold an action, (m,), clamped by MuJoCo to the actuators' range.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        physics.running.hold(action)

    def after_step(self, physics: CasePhysics) -> None:
        """Note why there can be no next step, if there can't."""
        self.ended = physics.running.ended

    def action_spec(self, physics: CasePhysics) -> Any:
        """The inputs with their bounds, (m,); infinite for an unlimited actuator."""
        it = self.experiment
        name = input_label(it.plant.system)
        return specs.BoundedArray((it.inputs,), np.float64, it.low, it.high, name)

    def get_observation(self, physics: CasePhysics) -> Any:
        """Every state by its name, the time, the error and its reference."""
        return physics.running.observation()

    def observation_spec(self, physics: CasePhysics) -> OrderedDict[str, specs.Array]:
        """The same entries; each spec's name ends with the units."""
        signals = self.experiment.signals
        return OrderedDict(
            (name, specs.Array((size,), np.float64, signals.labelled(name)))
            for name, size in signals.sizes.items()
        )

    def get_reward(self, physics: CasePhysics) -> Any:
        """-T times the stage cost at the start of the last interval."""
        return physics.running.reward

    def get_termination(self, physics: CasePhysics) -> Any:
        """0 where no next step is defined, 1 at the case's duration, else None."""
        if physics.running.ended:
            return 0.0
        return 1.0 if physics.running.over else None
