"""A case as something to be acted on, and the course of an episode, action by action.

The instants, the wrenches and the numbers are those that ``simulate`` would have.
"""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.environments.signals import Index, Signals, input_label
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arguments import reals, require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, SetupError, placed
from grosmc_mj.ground.fields import Range
from grosmc_mj.ground.units import number_in
from grosmc_mj.ground.wording import titled
from grosmc_mj.mechanics.physics.hooks import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.output.films.offscreen import BACKENDS, render_here
from grosmc_mj.output.films.scene import default_camera, pose
from grosmc_mj.simulation.loop.loop import LARGEST_SEED
from grosmc_mj.simulation.loop.software import observe
from grosmc_mj.simulation.loop.world import remember, sense
from grosmc_mj.simulation.prepare import prepare
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.steppers import Steppers
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.plants import Signal, find_system

# The law whose index gives the reward.
INDEX_LAW = "grosmc"
# Starts drawn before giving up on finding one where plant and index are defined.
_TRIES = 1000

# NumPy's new and old generators alike.
Random = np.random.Generator | np.random.RandomState


# A system, SYSTEM/CASE, the path of a case file, or an experiment.
Target = str | Path | Experiment


class EpisodeOptions(TypedDict, total=False):
    """Options of an environment; numbers are in SI units, texts have their own, ``"10 ms"``.

    Attributes:
        control_period: Time between two actions [s], a multiple of the timestep; the case's own
            by default.
        timestep: Physics timestep [s]; the case's own by default.
        spread: Half widths of the starts about the case's own, (n,), in the states' units, or
            one number for all of them; 0 by default.
        action_limit: Largest magnitude of each action, (m,) or one number, in the inputs' units,
            where the actuators' own limits are wider.
    """

    control_period: float | str | None
    timestep: float | str | None
    spread: ArrayLike
    action_limit: ArrayLike | None


def refuse_unknown_options(options: Mapping[str, Any], further: Sequence[str] = ()) -> None:
    """Refuse an option that no environment has.

    Args:
        options: The options.
        further: Options beside those of an episode.

    Raises:
        ArgumentError: With the valid options.
    """
    for name in options:
        require_known("option", name, [*EpisodeOptions.__annotations__, *further])


class HeldAction:
    """A law (t, x, memory, p, u) that holds an input.

    Args:
        inputs: Number of inputs m.

    Attributes:
        action: The input, (m,).
    """

    python_only = True

    def __init__(self, inputs: int) -> None:
        self.action = np.zeros(inputs)

    def __call__(self, t: float, x: Array, memory: Any, p: Any, u: Array) -> None:
        """Write the input."""
        u[:] = self.action


class Episode:
    """One case under somebody else's actions: a closed loop whose law holds the last action.

    Args:
        target: A system, with one of its cases as the task; or an experiment, SYSTEM/CASE or the
            path of a case file, which are tasks themselves.
        task: Name of one of a system's cases, by default the nominal one, or an experiment.
        options: See ``EpisodeOptions``.

    Attributes:
        case: The case.
        plant: Its edited model in MuJoCo, or its equations where it has none.
        signals: The entries of an observation.
        index: The index whose stage cost is the reward.
        problem: Instants and disturbances, as for ``simulate``.
        low: Least action, (m,): the declared or the actuators' limit; infinite without one.
        high: The largest one, (m,).
        reward: Of the last action; 0 before the first.
        ended: Why there can be no next step; empty while there can.

    Raises:
        ModelError: If there is no such system.
        ArgumentError: If there is no such case or option, or a number does not fit.
    """

    def __init__(
        self,
        target: Target,
        task: str | Experiment | None = None,
        **options: Unpack[EpisodeOptions],
    ) -> None:
        refuse_unknown_options(options)
        experiment = _experiment(target, task).changed(
            control_period=options.get("control_period"), timestep=options.get("timestep")
        )
        settings = experiment.settings
        self.case = experiment
        self.plant = experiment.plant(experiment.nominal.truest)
        name = _index_law(experiment)
        law = experiment.law(experiment.nominal.truest, name)
        self.signals = Signals(law)
        self.index = Index(law)

        self._held = HeldAction(len(self.plant.system.inputs))
        agent = replace(law, law=self._held)
        loop = None
        if self.case.loop is not None:
            # The agent is given what its sensors and estimators see now.
            loop = experiment.loop_around(agent, self.case.loop)
        self.problem, _ = prepare(
            self.plant,
            agent,
            self.case.x0,
            duration=self.case.duration,
            loop=loop,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=self.case.disturbances,
        )

        self.low, self.high = self._limits(options.get("action_limit"))
        spread = options.get("spread", 0.0)
        self._spread = _numbers("spread", spread, self.plant.system.states, Range(0))
        x0 = np.array(self.case.x0)
        why = self.undefined(x0)
        if why:
            raise ArgumentError(f"{self.case.system}/{self.case.name} can't start: {why}")

        self._steppers = Steppers(self.problem.timestep)
        self._renderers: dict[Any, Any] = {}
        self.restart(x0)

    def _limits(self, action_limit: ArrayLike | None) -> tuple[Array, Array]:
        """Least and largest action, (m,) each: the actuators' limits, or narrower ones."""
        low, high = self.plant.input_limits
        if action_limit is None:
            return low, high
        inputs = self.plant.system.inputs
        limit = _numbers("action_limit", action_limit, inputs, Range(0, above=True))
        return np.maximum(low, -limit), np.minimum(high, limit)

    @property
    def x(self) -> Array:
        """The last valid state, (n,)."""
        return self._closed.run.x.copy()

    @property
    def time(self) -> float:
        """Time of the last valid state [s]: k T at a sample, not a running sum."""
        problem = self.problem
        steps = self._closed.steps
        samples, after_sample = divmod(steps, problem.stride)
        if after_sample:
            return steps * problem.timestep
        return samples * problem.control_period

    @property
    def over(self) -> bool:
        """Whether the case's duration is reached."""
        return self._closed.steps >= self.problem.steps

    @property
    def undrawable(self) -> str:
        """Why it can't be drawn; empty if it can."""
        if self.plant.kind == "physics":
            return ""
        return f"{self.plant.system.name} is given by equations: only a model in MuJoCo is drawn"

    def undefined(self, x: Array) -> str:
        """Why an episode can't go on from a state; empty if it can."""
        system = self.plant.system
        if system.singular(x):
            return f"the plant is singular at {system.singularity}"
        if not self.index.defined(x):
            return f"the index is undefined outside {system.region}"
        return ""

    def reset(self, random: Random) -> None:
        """Begin again at a start, and with noise, of a generator."""
        x0 = self.start(random)
        run = 0
        if self.problem.looped:
            run = int(random.uniform(0, LARGEST_SEED))
        self.restart(x0, run)

    def start(self, random: Random) -> Array:
        """Draw a start uniformly about the case's own, (n,); without a spread it is that one.

        Raises:
            ArgumentError: If the plant or the index is defined at next to none of them.
        """
        x0 = np.array(self.case.x0)
        for _ in range(_TRIES):
            start = x0
            if any(self._spread):
                start = random.uniform(x0 - self._spread, x0 + self._spread)
            with suppress(ArgumentError):
                self.plant.require_start(start)
                if not self.undefined(start):
                    return start
        raise ArgumentError(
            f"spread = {self._spread.tolist()}: the plant is not defined at {_TRIES} starts drawn; "
            "take a smaller one"
        )

    def restart(self, x0: Array, run: int = 0) -> None:
        """Begin again from a state, (n,), with the noise of a run.

        Raises:
            SetupError: If somebody else's control callback is installed.
        """
        refuse_foreign_callback()
        (loop,) = self.problem.loops
        if loop is not None:
            loop = loop.of_run(run)
        problem = replace(self.problem, loops=(loop,), x0=x0[None])
        self._held.action[:] = 0.0
        self._closed = ClosedLoop(problem, steppers=self._steppers)
        self.reward = 0.0
        self.ended = ""

    def hold(self, action: ArrayLike) -> None:
        """Command an input until the next one, and book what that costs.

        The reward is -T times the stage cost at the start of the interval, of the input that is
        applied: what is beyond the limits is cut.

        Args:
            action: (m,), in the units of the system's inputs; one number for a single input.

        Raises:
            ArgumentError: If it is not m finite numbers.
        """
        u = reals(action)
        if u.size != self.low.size or not np.all(np.isfinite(u)):
            raise ArgumentError(
                f"action {action!r} must be {len(self.low)} finite number(s) in an array of shape "
                f"{self.low.shape}: {input_label(self.plant.system)}"
            )
        applied = np.clip(u.reshape(self.low.shape), self.low, self.high)
        self._held.action[:] = applied

        # The case's duration may end before the next sample.
        problem = self.problem
        interval = problem.control_period
        steps_to_end = problem.steps - self._closed.steps
        if steps_to_end < problem.stride:
            interval = steps_to_end * problem.timestep
        self.reward = -interval * self.index.stage_cost(self.time, self.x, applied)

    def advance(self, steps: int) -> None:
        """Carry out timesteps under the held input, up to the case's duration.

        Args:
            steps: How many.
        """
        steps = min(steps, self.problem.steps - self._closed.steps)
        # A diverging state overflows quietly; the status tells.
        with np.errstate(all="ignore"), warnings_counted_only():
            status = self._closed.advance(steps)

        why = "the state grew without bound"
        if status is not Status.DIVERGED:
            why = self.undefined(self.x)
        self.ended = ""
        if why:
            self.ended = f"t = {self.time:g} s: {why}"

    def observation(self) -> OrderedDict[str, Array]:
        """Observation of the last valid state as it is measured.

        In a loop its sensors and estimators give it; without one it is the state with the
        disturbance of its measurement, if any.
        """
        x = self.x
        disturbance = self._closed.output_disturbance()
        if not self.problem.looped:
            if len(disturbance):
                x += disturbance
            return self.signals.observe(self.time, x)

        # The next sample is still to come: its sensors are asked in a copy of the loop.
        step = self._closed.steps
        ahead = copy.deepcopy(self._closed.run.loop)
        remember(step, x, disturbance, ahead.world)
        sample = sense(step, ahead.world, ahead.measured)
        observe(sample, ahead.measured, ahead.software)
        return self.signals.observe(self.time, ahead.software.seen)

    def picture(self, width: int = 640, height: int = 480) -> np.ndarray:
        """A picture of the state, (height, width, 3).

        Raises:
            ArgumentError: For equations, which have no body.
            SetupError: If nothing here can draw: MUJOCO_GL says what does, read once at start.
        """
        if self.undrawable:
            raise ArgumentError(self.undrawable)
        if (width, height) not in self._renderers:
            # The plant's own model is not to be changed, and the one that moves has no looks.
            model = copy.copy(self.plant.model)
            model.vis.global_.offwidth = width
            model.vis.global_.offheight = height
            render_here()
            try:
                self._renderers[width, height] = mujoco.Renderer(model, height, width)
            # Each backend has errors of its own.
            except Exception as error:
                remedy = BACKENDS["egl"][1]
                raise SetupError(
                    f"nothing here can draw ({error}): start Python with MUJOCO_GL=egl or "
                    f"MUJOCO_GL=osmesa; if neither works, run: {remedy}"
                ) from error
        renderer = self._renderers[width, height]
        data = mujoco.MjData(renderer.model)
        pose(renderer.model, data, self._closed.physics())
        renderer.update_scene(data, default_camera(renderer.model))
        return renderer.render()

    def close(self) -> None:
        """Close the renderers."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()


def _experiment(target: Target, task: str | Experiment | None) -> Experiment:
    """The experiment of a target, or of a case of a system."""
    if isinstance(target, Path):
        target = str(target)
    if isinstance(target, Experiment):
        if task is not None:
            raise ArgumentError(f"{target.target} is an experiment already: leave out task")
        return target
    if isinstance(task, Experiment):
        system = find_system(target).name
        if task.system != system:
            raise ArgumentError(f"case {task.name!r} is one of {task.system}, not of {system}")
        return task
    if task is None and ("/" in target or target.endswith(".toml")):
        return Experiment.load(target)
    if task is None:
        task = "nominal"
    return find_experiment(find_system(target).name, task)


def _index_law(experiment: Experiment) -> str:
    """Name of the law whose index gives the reward: GROSMC or, without it, the last one."""
    if INDEX_LAW in experiment.controllers or INDEX_LAW in experiment.file.laws:
        return INDEX_LAW
    return experiment.controllers[-1]


def _numbers(
    name: str,
    value: ArrayLike,
    signals: Sequence[Signal],
    bound: Range,
) -> Array:
    """A number for each signal, of which one may stand for all, within a bound."""
    with placed(f"{name}: "):
        numbers = reals(_without_units(value, signals))
    count = len(signals)
    fits = numbers.shape in {(), (count,)}
    if not fits or not all(map(bound.holds, numbers.ravel().tolist())):
        labels = ", ".join(titled(signal.name, signal.unit) for signal in signals)
        raise ArgumentError(
            f"{name} = {value!r} must be one number or {count}, {bound.wanted}: {labels}"
        )
    return np.broadcast_to(numbers, (count,))


def _without_units(value: Any, signals: Sequence[Signal]) -> Any:
    """Texts with a unit as numbers in the signals' units; a single text stands for all signals."""
    if isinstance(value, str):
        value = [value] * len(signals)
    if not isinstance(value, (list, tuple)) or len(value) != len(signals):
        return value
    return [
        number_in(item, signal.unit) if isinstance(item, str) else item
        for item, signal in zip(value, signals, strict=True)
    ]
