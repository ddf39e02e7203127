"""One episode: a case moved action by action, with the numbers that ``simulate`` would get."""

from __future__ import annotations

from collections import OrderedDict

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.environments.experiment import EpisodeSetup
from grosmc_mj.simulation.engines.control_callback import refuse_foreign_callback
from grosmc_mj.simulation.quiet import warnings_counted_only


class Episode:
    """What happens to one mjData between two resets.

    Args:
        experiment: The case.
        model: Its compiled model, or a copy of it.
        data: What is moved; it may belong to somebody else.

    Attributes:
        x: The last valid state, (n,).
        done: Timesteps that were carried out.
        reward: Of the last action; 0 before the first.
        ended: Why there can be no next step; empty while there can.
    """

    def __init__(
        self, experiment: EpisodeSetup, model: mujoco.MjModel, data: mujoco.MjData
    ) -> None:
        self.experiment, self._model, self._data = experiment, model, data
        self._bodies = [model.body(name).id for name in experiment.plant.system.bodies]
        self._wrenches = experiment.problem.wrench(0)
        self.x = np.array(experiment.case.x0)
        self.done, self.reward, self.ended = 0, 0.0, ""

    def on(self, model: mujoco.MjModel, data: mujoco.MjData) -> Episode:
        """The same episode so far, to go on with another mjData in the same state."""
        other = Episode(self.experiment, model, data)
        other.x[:], other.done = self.x, self.done
        other.reward, other.ended = self.reward, self.ended
        return other

    @property
    def time(self) -> float:
        """Time of the last valid state [s]: k T at a sample, not a running sum."""
        problem = self.experiment.problem
        samples, rest = divmod(self.done, problem.stride)
        if rest:
            return self.done * problem.timestep
        return samples * problem.control_period

    @property
    def over(self) -> bool:
        """Whether the case's duration is reached."""
        return self.done >= self.experiment.problem.steps

    def restart(self, x0: Array) -> None:
        """Begin again from a state, (n,); the mjData must have been reset.

        Raises:
            SetupError: If somebody else's control callback is installed.
        """
        refuse_foreign_callback()
        n = self.experiment.plant.system.degrees_of_freedom
        self._data.qpos[:], self._data.qvel[:] = x0[:n], x0[n:]
        self.x[:] = x0
        self.done, self.reward, self.ended = 0, 0.0, ""

    def hold(self, action: ArrayLike) -> None:
        """Command an input until the next one, and book what that costs.

        The reward is -T times the stage cost at the start of the interval, of the input that the
        actuators apply: MuJoCo clamps what is beyond their range.

        Args:
            action: (m,), in the units of the system's inputs.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        it, problem = self.experiment, self.experiment.problem
        u = it.checked(action)
        self._data.ctrl[:] = u
        left = problem.steps - self.done
        whole = left >= problem.stride
        interval = problem.control_period if whole else left * problem.timestep
        cost = it.index.stage_cost(self.time, self.x, np.clip(u, it.low, it.high))
        self.reward = -interval * cost

    def advance(self, steps: int) -> None:
        """Carry out timesteps under the held input, up to the case's duration.

        Args:
            steps: How many.
        """
        problem, n = self.experiment.problem, self.experiment.plant.system.degrees_of_freedom
        model, data, wrenches = self._model, self._data, self._wrenches
        with warnings_counted_only():
            for _ in range(min(steps, problem.steps - self.done)):
                if wrenches is not None:
                    data.xfrc_applied[self._bodies] = wrenches[self.done].reshape(-1, 6)
                mujoco.mj_step(model, data)
                if np.any(data.warning.number):
                    self.ended = self._say("the state grew without bound")
                    return
                self.x[:n], self.x[n:] = data.qpos, data.qvel
                self.done += 1
        why = self.experiment.undefined(self.x)
        self.ended = self._say(why) if why else ""

    def observation(self) -> OrderedDict[str, Array]:
        """What is seen of the last valid state."""
        return self.experiment.signals.observe(self.time, self.x)

    def _say(self, why: str) -> str:
        """A reason with its time."""
        return f"t = {self.time:g} s: {why}"
