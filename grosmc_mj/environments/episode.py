"""One episode: a case as something to be acted on, and its course, action by action.

The instants, the wrenches and the numbers are those that ``simulate`` would have.
"""

from __future__ import annotations

from collections import OrderedDict
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arguments import reals, require
from grosmc_mj.arrays import Array
from grosmc_mj.environments.agent_loop import AgentLoop
from grosmc_mj.environments.reward import Index
from grosmc_mj.environments.signals import Signals, input_label, state_names
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop.loop import LARGEST_SEED
from grosmc_mj.physics.quiet import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.plants import Plant, find_system
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.steppers import Stepper

# The law whose index gives the reward.
INDEX_LAW = "grosmc"
# Starts drawn before giving up on finding one where plant and index are defined.
_TRIES = 1000


# NumPy's new and old generators alike.
Random = np.random.Generator | np.random.RandomState


class EpisodeSetup:
    """One case of one system, ready to be run by somebody else's loop.

    The instants and the wrenches are those that ``simulate`` lays out for the same case.

    Args:
        target: A system, with one of its cases as the task; or SYSTEM/CASE or the path of a case
            file, which is a task itself.
        task: Name of one of a system's cases, or an experiment.
        control_period: Time between two actions [s], a multiple of the timestep; the case's own
            by default.
        timestep: Physics timestep [s]; the case's own by default.
        spread: Half widths of the starts about the case's own, (n,), in the states' units, or
            one number for all of them.
        action_limit: Largest magnitude of each action, (m,) or one number, in the inputs' units,
            where the actuators' own limits are wider.

    Attributes:
        case: The case.
        plant: Its edited model in MuJoCo, or its equations where it has none.
        law: The controller whose index gives the reward, without a loop.
        looped: The same in the case's loop; None for a case without.
        signals: What is observed.
        index: What is to be minimized.
        problem: Instants and wrenches, as for ``simulate``.
        low: Least action, (m,): the declared or the actuators' limit; infinite without one.
        high: The largest one, (m,).

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case, or a number does not fit.
    """

    def __init__(
        self,
        target: str,
        task: str | Experiment | None = None,
        *,
        control_period: float | None = None,
        timestep: float | None = None,
        spread: ArrayLike = 0.0,
        action_limit: ArrayLike | None = None,
    ) -> None:
        experiment = _experiment(target, task)
        experiment = experiment.with_settings(control_period=control_period, timestep=timestep)
        settings, where = experiment.settings, experiment.nominal.truest
        self.case, self.plant = experiment.case, experiment.plant(where)
        law = experiment.law(where, _index_law(experiment))
        self.looped, self.law = law if law.loop else None, replace(law, loop=None)
        self.signals, self.index = Signals(self.law), Index(self.law)
        self.problem, _ = prepare(
            self.plant,
            self.law,
            self.case.x0,
            duration=self.case.duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=self.case.disturbances,
        )
        self.low, self.high = _limited(self.plant, action_limit)
        self._spread = _half_widths(self.plant, spread)
        self._require_start()

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.low)

    @property
    def undrawable(self) -> str:
        """Why it can't be drawn; empty if it can."""
        if self.plant.kind == "physics":
            return ""
        return f"{self.plant.system.name} is given by equations: only a model in MuJoCo is drawn"

    def start(self, random: Random) -> Array:
        """The case's start, or one drawn uniformly about it, (n,).

        Raises:
            ArgumentError: If the plant or the index is defined at next to none of them.
        """
        x0 = np.array(self.case.x0)
        if not self._spread.any():
            return x0
        for _ in range(_TRIES):
            drawn = random.uniform(x0 - self._spread, x0 + self._spread)
            with suppress(ArgumentError):
                self.plant.require_start(drawn)
                if not self.undefined(drawn):
                    return drawn
        raise ArgumentError(
            f"spread = {self._spread.tolist()}: the plant is not defined at {_TRIES} starts drawn; "
            "take a smaller one"
        )

    def run(self, random: Random) -> int:
        """Number of a run, for what a loop draws; 0 where there is none."""
        if self.looped is None:
            return 0
        return int(random.uniform(np.zeros(1), np.full(1, float(LARGEST_SEED)))[0])

    def undefined(self, x: Array) -> str:
        """Why an episode can't go on from a state; empty if it can."""
        system = self.plant.system
        if system.singular(x):
            return f"the plant is singular at {system.singularity}"
        if not self.index.defined(x):
            return f"the index is undefined outside {system.region}"
        return ""

    def checked(self, action: ArrayLike) -> Array:
        """An action as the inputs that are commanded, (m,).

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        u = reals(action)
        if u.shape != (self.inputs,) or not np.all(np.isfinite(u)):
            raise ArgumentError(
                f"action {action!r} must be {self.inputs} finite number(s) in an array of shape "
                f"({self.inputs},): {input_label(self.plant.system)}"
            )
        return u

    def _require_start(self) -> None:
        """Refuse a case that could not take its first step.

        Raises:
            ArgumentError: If its start is undefined.
        """
        why = self.undefined(np.array(self.case.x0))
        if why:
            raise ArgumentError(f"{self.case.system}/{self.case.name} can't start: {why}")


class Episode:
    """What happens to one plant between two resets.

    Args:
        setup: The case.
        stepper: What moves its plant.

    Attributes:
        setup: The case.
        stepper: What moves its plant.
        x: The last valid state, (n,).
        done: Timesteps that were carried out.
        reward: Of the last action; 0 before the first.
        ended: Why there can be no next step; empty while there can.
    """

    def __init__(self, setup: EpisodeSetup, stepper: Stepper) -> None:
        self.setup, self.stepper = setup, stepper
        self._loop = AgentLoop(setup.looped) if setup.looped else None
        self.x = np.array(setup.case.x0)
        self.done, self.reward, self.ended = 0, 0.0, ""

    def on(self, stepper: Stepper) -> Episode:
        """The same episode so far, to go on with another stepper in the same state."""
        other = Episode(self.setup, stepper)
        other.x[:], other.done = self.x, self.done
        other.reward, other.ended = self.reward, self.ended
        other._loop = self._loop.copied() if self._loop else None
        return other

    @property
    def time(self) -> float:
        """Time of the last valid state [s]: k T at a sample, not a running sum."""
        problem = self.setup.problem
        samples, rest = divmod(self.done, problem.stride)
        if rest:
            return self.done * problem.timestep
        return samples * problem.control_period

    @property
    def over(self) -> bool:
        """Whether the case's duration is reached."""
        return self.done >= self.setup.problem.steps

    def restart(self, x0: Array, run: int = 0) -> None:
        """Begin again from a state, (n,), with the noise of a run.

        Raises:
            SetupError: If somebody else's control callback is installed.
        """
        refuse_foreign_callback()
        self.stepper.restart(x0)
        self.x[:] = x0
        if self._loop:
            self._loop.restart(run)
        self.done, self.reward, self.ended = 0, 0.0, ""

    def hold(self, action: ArrayLike) -> None:
        """Command an input until the next one, and book what that costs.

        The reward is -T times the stage cost at the start of the interval, of the input that is
        applied: what is beyond the limits is cut.

        Args:
            action: (m,), in the units of the system's inputs.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        setup, problem = self.setup, self.setup.problem
        u = np.clip(setup.checked(action), setup.low, setup.high)
        if self._loop:
            self._loop.ask(u)
        else:
            self.stepper.hold(u)
        left = problem.steps - self.done
        whole = left >= problem.stride
        interval = problem.control_period if whole else left * problem.timestep
        cost = setup.index.stage_cost(self.time, self.x, u)
        self.reward = -interval * cost

    def advance(self, steps: int) -> None:
        """Carry out timesteps under the held input, up to the case's duration.

        Args:
            steps: How many.
        """
        problem, stepper = self.setup.problem, self.stepper
        # A diverging state overflows quietly; the stepper tells.
        with np.errstate(all="ignore"), warnings_counted_only():
            for _ in range(min(steps, problem.steps - self.done)):
                if self._loop:
                    stepper.hold(self._loop.given(self.x))
                if problem.disturbed:
                    stepper.push(problem.wrench(0, self.done))
                if not stepper.step():
                    self.ended = self._say("the state grew without bound")
                    return
                self.x[:] = stepper.x
                self.done += 1
        why = self.setup.undefined(self.x)
        self.ended = self._say(why) if why else ""

    def observation(self) -> OrderedDict[str, Array]:
        """What is seen of the last valid state; in a loop as sensors and estimators tell it."""
        x = self._loop.seen(self.x) if self._loop else self.x
        return self.setup.signals.observe(self.time, x)

    def _say(self, why: str) -> str:
        """A reason with its time."""
        return f"t = {self.time:g} s: {why}"


def _experiment(target: str, task: str | Experiment | None) -> Experiment:
    """The experiment of a target, or of a case of a system."""
    require("target", target, str, "a system, SYSTEM/CASE or the path of a case file")
    if isinstance(task, Experiment):
        system = find_system(target).name
        if (case := task.case).system != system:
            raise ArgumentError(f"case {case.name!r} is one of {case.system}, not of {system}")
        return task
    if "/" in target or target.endswith(".toml"):
        if task is not None:
            raise ArgumentError(f"{shown(target, str)} is a task itself: leave out task={task!r}")
        return Experiment.load(target)
    return find_experiment(find_system(target).name, "nominal" if task is None else task)


def _index_law(experiment: Experiment) -> str:
    """The law whose index gives the reward: the chapter's, or the last one of the file."""
    known = {*experiment.controllers, *experiment.file.laws}
    return INDEX_LAW if INDEX_LAW in known else experiment.controllers[-1]


def _limited(plant: Plant, declared: ArrayLike | None) -> tuple[Array, Array]:
    """Bounds of the actions, (m,) each."""
    low, high = plant.input_limits
    if declared is None:
        return low, high
    limit = reals(declared)
    if limit.shape not in {(), low.shape} or not np.all(np.isfinite(limit) & (limit > 0)):
        raise ArgumentError(
            f"action_limit = {declared!r} must be positive and finite, one number or {len(low)}: "
            f"{input_label(plant.system)}"
        )
    low, high = np.maximum(low, -limit), np.minimum(high, limit)
    if np.any(low > high):
        raise ArgumentError(
            f"action_limit = {declared!r} leaves nothing of the actuators' own range: "
            f"{input_label(plant.system)}"
        )
    return low, high


def _half_widths(plant: Plant, spread: ArrayLike) -> Array:
    """Half widths of every state, (n,)."""
    n, widths = len(plant.system.states), reals(spread)
    if widths.shape not in {(), (n,)} or not np.all(np.isfinite(widths) & (widths >= 0)):
        raise ArgumentError(
            f"spread = {spread!r} must be one number, or {n} of them, not negative: "
            f"{', '.join(state_names(plant.system))}"
        )
    return np.broadcast_to(widths, (n,))
