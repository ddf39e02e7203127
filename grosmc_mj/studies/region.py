"""From which starts a law converges: maps of two axes to outcomes, confirmed in MuJoCo."""

from __future__ import annotations

import math
import time
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import binary_dilation, maximum_filter, minimum_filter

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law, around
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant, System
from grosmc_mj.results.palette import BLACK, BLUE, ORANGE, PURPLE, YELLOW
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.sweep.agreement import model_mismatch

Mask = NDArray[np.bool_]
Letters = NDArray[np.str_]

SCREENS = ("auto", "none")
POINTS = (2, 1000)
LONGEST = 1000.0  # s
# Where starts end on an axis, by its unit.
LIMITS: Mapping[str, float] = {"rad": math.pi / 2, "rad/s": 10.0, "m": 1.0, "m/s": 2.0}
# How near zero every regulated error must be at the end, by its unit. It is far above the chatter
# that a switching law leaves at a control period of 1 ms (below 0.2 degrees and 0.01 rad/s) and
# some hundredth of the default starts. Position and rate count together: what only swings through
# zero is fast there.
TOLERANCES: Mapping[str, float] = {"rad": math.radians(1.0), "rad/s": 0.1, "m": 0.02, "m/s": 0.1}
# Starts in one batch: bounds memory and the wait between two advances of the progress bar.
BATCH = 1000
# Starts on the first axis alone, for each cell of the map along it.
_LINE = 4
# Runs are looked at after these parts of the duration; those that have been decided end there.
# Most that leave the region do so in the first look.
_LOOKS = (1 / 16, 1 / 4, 1.0)
# To count as converged before the end, errors must be within this part of their tolerances.
_EARLY = 0.25
# Of the starts away from boundaries this part is confirmed, drawn at random.
_RANDOM = 0.02
# An implicit step evaluates the physics once, RK4 four times. On 256 starts of each map of the
# pendulum both give the same outcome but for up to two on a boundary.
REGION_SETTINGS = Settings(integrator="implicitfast")


# One run


class Outcome(Enum):
    """Outcome of a start; the value is its letter in the file."""

    CONVERGED = "c"
    LEFT = "l"
    SINGULAR = "s"
    NOT_CONVERGED = "n"
    DIVERGED = "d"

    @property
    def title(self) -> str:
        """For people."""
        return _OUTCOMES[self][0]

    @property
    def meaning(self) -> str:
        """One sentence."""
        return _OUTCOMES[self][1]

    @property
    def colour(self) -> str:
        """In figures; they differ in lightness too."""
        return _OUTCOMES[self][2]


_OUTCOMES: Mapping[Outcome, tuple[str, str, str]] = {
    Outcome.CONVERGED: (
        "converged", "every regulated error is within its tolerance at the end", BLUE
    ),
    Outcome.LEFT: (
        "left the region",
        "a sample of the law fell outside the region where the laws are defined",
        ORANGE,
    ),
    Outcome.SINGULAR: (
        "singular plant", "the plant reached a state where its equations break down", PURPLE
    ),
    Outcome.NOT_CONVERGED: (
        "not converged",
        "the run stayed in the region and is beyond a tolerance at the end",
        YELLOW,
    ),
    Outcome.DIVERGED: ("diverged", "the state grew without bound", BLACK),
}  # fmt: skip
_ENDED_EARLY = {
    Status.UNDEFINED_LAW: Outcome.LEFT,
    Status.SINGULAR_PLANT: Outcome.SINGULAR,
    Status.DIVERGED: Outcome.DIVERGED,
    # No law of the package ends so while its state is bounded.
    Status.UNDEFINED_INPUT: Outcome.DIVERGED,
}


def judge(status: Status, error: ArrayLike, tolerance: ArrayLike) -> Outcome:
    """The outcome of one run of a guarded law.

    Args:
        status: How the run ended.
        error: Error state at its end, (errors,).
        tolerance: Largest size of each error that counts as none, (errors,).
    """
    if status in _ENDED_EARLY:
        return _ENDED_EARLY[status]
    near = np.all(np.abs(np.asarray(error)) <= np.asarray(tolerance))
    return Outcome.CONVERGED if near else Outcome.NOT_CONVERGED


@dataclass(frozen=True, eq=False)
class RegionLoop:
    """A law on the physics of an experiment, stopped where it leaves the region of the laws.

    Attributes:
        experiment: The true plant, and how it is run.
        controller: The law, guarded; designed for the nominal plant.
        on_equations: Whether it runs on the plant's equations instead, which take steps of RK4.
    """

    experiment: Experiment
    controller: Controller
    on_equations: bool = False

    @classmethod
    def of(cls, experiment: Experiment, controller: str) -> RegionLoop:
        """The loop of a named controller."""
        law = experiment.law("physics", controller)
        return cls(experiment, guarded(law, experiment.nominal.system))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

    @cached_property
    def plant(self) -> Plant:
        """The experiment's plant, or its equations."""
        physics = self.experiment.plant("physics")
        return physics.analytic() if self.on_equations else physics

    def run(self, starts: Array, duration: float) -> Trajectory:
        """Start and end of the runs from the starts (nsim, n)."""
        settings = self.experiment.settings
        return simulate(
            self.plant,
            self.controller,
            starts,
            duration=duration,
            control_period=settings.control_period,
            timestep=settings.timestep,
            disturbances=self.experiment.case.disturbances,
            record=False,
        )

    @cached_property
    def sensitivity(self) -> Array:
        """C of the error state at the start, z = C x + c: 1, -1 or 0, (errors, n)."""
        n = len(self.system.states)
        return (self.errors(0.0, np.eye(n)) - self.errors(0.0, np.zeros((1, n)))).T

    @cached_property
    def equilibrium(self) -> Array:
        """The state without error at t = 0; what the law does not regulate is zero there, (n,)."""
        offset = self.errors(0.0, np.zeros((1, len(self.system.states))))[0]
        return -np.linalg.pinv(self.sensitivity) @ offset

    @property
    def regulated(self) -> list[int]:
        """The state that each error is measured on."""
        return np.abs(self.sensitivity).argmax(axis=1).tolist()

    @property
    def tolerances(self) -> dict[str, tuple[float, str]]:
        """The largest size of each regulated error that counts as none: by state, with unit."""
        states = [self.system.states[state] for state in self.regulated]
        for state in states:
            require_known("unit of an error with a tolerance", state.unit, TOLERANCES)
        return {state.symbol: (TOLERANCES[state.unit], state.unit) for state in states}

    def errors(self, time: float, states: Array) -> Array:
        """Error states at one time [s] of states (nsim, n); returns (nsim, errors).

        Raises:
            ArgumentError: If the law regulates something that is no state.
        """
        error = self.controller.designed.error
        if error.outputs is not None:
            raise ArgumentError(
                f"{self.controller.name} in {self.experiment.case.name} of {self.system.name} "
                "regulates outputs that are no states: take another case"
            )
        return error.along(np.full(len(states), time), states, self.controller.parameters)


def guarded(controller: Controller, system: System) -> Controller:
    """The same controller, whose run ends at the first sample outside the region.

    The Jacobian LQR is defined everywhere and could swing the pole right round; its run ends
    where those of the linearizing laws do.
    """
    return replace(controller, law=_guarded_law(controller.law, system))


@cache
def _guarded_law(law: Law, system: System) -> Law:
    inner, linearizable = jitable(law), system.linearizable

    def guarded_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        inner(t, x, memory, p, u)
        if not linearizable(x):
            memory.undefined = 1.0

    return around(guarded_law, law)


def outcomes(
    loop: RegionLoop, starts: Array, duration: float, looks: Sequence[float] = _LOOKS
) -> Letters:
    """The outcome of each start (nsim, n), as letters.

    A run ends at a look if it has left the region, met a singularity or diverged. It also ends
    there as converged if it began beyond a tolerance and is well within all of them, unless a
    disturbance could still carry it away.

    Args:
        loop: The law on its plant.
        starts: Starts.
        duration: Of a run that is not decided before [s].
        looks: Parts of it after which to look, ending with 1.
    """
    tolerance = np.array([value for value, _ in loop.tolerances.values()])
    disturbed = bool(loop.experiment.case.disturbances)
    moved = np.any(np.abs(loop.errors(0.0, starts)) > tolerance, axis=1)
    letters = np.full(len(starts), Outcome.NOT_CONVERGED.value)
    for look in looks:
        undecided = np.flatnonzero(letters == Outcome.NOT_CONVERGED.value)
        if not len(undecided):
            break
        run, last = loop.run(starts[undecided], look * duration), look == looks[-1]
        errors = loop.errors(float(run.time[-1]), run.state[:, -1])
        bound = tolerance if last else _EARLY * tolerance
        for start, status, error in zip(undecided, run.status, errors, strict=True):
            outcome = judge(status, error, bound)
            if outcome is not Outcome.CONVERGED or last or (moved[start] and not disturbed):
                letters[start] = outcome.value
    return letters


# The axes


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        key: Its symbol in ASCII, as on the command line.
        name: Its name for people.
        symbol: Its symbol.
        unit: Unit of the state and of ``limit``.
        limit: Starts lie between minus this and this.
        direction: How the state moves with the axis: -1 for an error y_r - y.
        origin: Value of the state at zero of the axis.
        is_error: Whether zero of the axis is zero error of a regulated state.
    """

    state: int
    key: str
    name: str
    symbol: str
    unit: str
    limit: float
    direction: float
    origin: float
    is_error: bool

    @property
    def shown_unit(self) -> str:
        """Unit for people: degrees for angles."""
        return {"rad": "°"}.get(self.unit, self.unit)

    def shown(self, value: float) -> float:
        """A value on the axis in the unit for people."""
        return math.degrees(value) if self.unit == "rad" else value

    @property
    def label(self) -> str:
        """Title of the axis."""
        return f"start {self.name} {self.symbol} [{self.shown_unit}]"

    def cells(self, count: int) -> Array:
        """Centres of equal cells from minus to plus the limit."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)


def state_names(system: System) -> list[str]:
    """The states' symbols in ASCII, in order: p, theta, p_dot, theta_dot."""
    return [_ascii(state.symbol) for state in system.states]


def _ascii(symbol: str) -> str:
    """θ̇ as theta_dot, q₁ as q1."""
    words, dots = "", ""
    for character in unicodedata.normalize("NFD", symbol):
        name = unicodedata.name(character)
        if name == "COMBINING DOT ABOVE":
            dots = "_dot"
        elif character.isdigit():
            words += str(unicodedata.digit(character))
        else:
            words += character if character.isascii() else name.split()[-1].lower()
    return words + dots


def choose_axes(
    loop: RegionLoop, names: Sequence[str] | None, limits: Mapping[str, float]
) -> tuple[Axis, Axis]:
    """Two axes: the named states, or the first regulated state and its rate.

    Args:
        loop: Whose errors the axes are.
        names: Two states by symbol, as ``theta`` and ``theta_dot``; None for the default.
        limits: Largest start by unit, instead of ``LIMITS``.

    Raises:
        ArgumentError: If a state is unknown or named twice, or a limit is not positive.
    """
    for unit, limit in limits.items():
        if not (math.isfinite(limit) and limit > 0):
            raise ArgumentError(f"limit {limit:g} {unit} of the starts must be finite and positive")
    system, keys = loop.system, state_names(loop.system)
    known = {state.symbol: i for i, state in enumerate(system.states)}
    known |= {key: i for i, key in enumerate(keys)}
    first = loop.regulated[0]
    chosen = [first, first + system.degrees_of_freedom]
    if names is not None:
        for name in names:
            if name not in known:
                raise ArgumentError(unknown_name(f"state of {system.name}", name, keys))
        chosen = [known[name] for name in names]
    if len(set(chosen)) != 2:
        raise ArgumentError(
            f"axes {', '.join(keys[i] for i in chosen)} must be two different states of "
            f"{system.name}: {', '.join(keys)}"
        )
    across, down = (_axis(loop, state, keys[state], {**LIMITS, **limits}) for state in chosen)
    return across, down


def _axis(loop: RegionLoop, state: int, key: str, limits: Mapping[str, float]) -> Axis:
    """The axis of one state."""
    signal, is_error = loop.system.states[state], state in loop.regulated
    require_known(f"unit of an axis, of {key},", signal.unit, limits)
    row = loop.sensitivity[loop.regulated.index(state)] if is_error else None
    return Axis(
        state=state,
        key=key,
        name=f"error of {signal.name}" if is_error else signal.name,
        symbol=signal.symbol,
        unit=signal.unit,
        limit=limits[signal.unit],
        direction=1.0 if row is None else float(row[state]),
        origin=float(loop.equilibrium[state]),
        is_error=is_error,
    )


def starts_on(loop: RegionLoop, axes: tuple[Axis, Axis], first: Array, second: Array) -> Array:
    """States (nsim, n) at pairs of values on the axes, (nsim,) each; the rest at equilibrium.

    Raises:
        ArgumentError: If one lies where the plant is singular or the laws are undefined.
    """
    system, starts = loop.system, np.tile(loop.equilibrium, (len(first), 1))
    for axis, values in zip(axes, (first, second), strict=True):
        starts[:, axis.state] += axis.direction * values
    wrong = [x for x in starts if system.singular(x) or not system.linearizable(x)]
    if wrong:
        values = ", ".join(
            f"{axis.symbol} = {axis.shown(wrong[0][axis.state]):.4g} {axis.shown_unit}"
            for axis in axes
        )
        raise ArgumentError(
            f"{len(wrong)} of {len(starts)} starts, as {values}, lie outside {system.region}, "
            "where law and plant are defined: lower the limits of the axes"
        )
    return starts


# Maps on equations, their boundaries confirmed in MuJoCo


@dataclass(frozen=True, eq=False)
class ScreenedArea:
    """Starts side by side, whose outcomes the equations gave and MuJoCo confirmed.

    Attributes:
        letters: Their outcomes, (rows, columns).
        confirmed: Which of them are MuJoCo's.
        overturned: For which of these the equations gave another outcome.
    """

    letters: Letters
    confirmed: Mask
    overturned: Mask


def confirmed_area(first: Letters, confirm: Callable[[Mask], Letters], seed: int) -> ScreenedArea:
    """Confirm every start beside another outcome, and some of the others.

    The starts beside an outcome that is overturned are confirmed, too, until none is.

    Args:
        first: Outcomes by the equations, (rows, columns).
        confirm: The outcomes in MuJoCo of some starts, in the order of the area.
        seed: Of the random ones.
    """
    letters, confirmed = first.copy(), np.zeros(first.shape, bool)
    drawn = np.zeros(first.shape, bool)
    few = np.random.default_rng(seed).permutation(drawn.size)[: math.ceil(_RANDOM * drawn.size)]
    drawn.reshape(-1)[few] = True
    wanted = beside_another(first) | drawn
    while np.any(new := wanted & ~confirmed):
        letters[new] = confirm(new)
        confirmed |= new
        overturned = np.asarray(binary_dilation(letters != first, np.ones((3, 3))), bool)
        wanted = beside_another(letters) | overturned
    return ScreenedArea(letters, confirmed, letters != first)


def beside_another(letters: Letters) -> Mask:
    """Which places have another letter among the eight around them."""
    codes = np.unique(letters, return_inverse=True)[1].reshape(letters.shape)
    return maximum_filter(codes, 3, mode="nearest") != minimum_filter(codes, 3, mode="nearest")


@dataclass(frozen=True, eq=False)
class RegionMap:
    """The outcome of every start under one law on one plant.

    Attributes:
        case: The case of the plant.
        controller: Name of the law.
        grid: Letters of ``Outcome``, (second axis, first axis).
        line: Those of starts on the first axis alone, (4 * points,).
        line_starts: Their values on the first axis.
        seconds: Wall time.
        confirmed: Starts that MuJoCo judged, of all.
        overturned: Those of them for which the equations gave another outcome.
    """

    case: Case
    controller: str
    grid: Letters
    line: Letters
    line_starts: Array
    seconds: float
    confirmed: int = 0
    overturned: int = 0

    @property
    def counts(self) -> dict[Outcome, int]:
        """Starts of the grid with each outcome."""
        letters = Counter(self.grid.ravel().tolist())
        return {outcome: letters[outcome.value] for outcome in Outcome}

    @property
    def converged(self) -> float:
        """Share of the grid that converges [%]."""
        return 100 * self.counts[Outcome.CONVERGED] / self.grid.size

    def rest_interval(self) -> tuple[float, float] | None:
        """The farthest starts on the first axis from which, and from all between, it converges.

        None if it does not converge from those next to zero.
        """
        good, middle = self.line == Outcome.CONVERGED.value, len(self.line) // 2
        if not (good[middle - 1] and good[middle]):
            return None
        wrong = np.flatnonzero(~good)
        low = max(wrong[wrong < middle], default=-1) + 1
        high = min(wrong[wrong >= middle], default=len(good)) - 1
        return float(self.line_starts[low]), float(self.line_starts[high])


# The maps of a system


@dataclass(frozen=True)
class RegionQuestion:
    """Which maps are made.

    Attributes:
        system: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        points: Starts along each axis.
        duration: Of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start by unit (rad, rad/s, m, m/s), where it is not the default.
        settings: Control period, timestep, integrator and switching.
        controllers: Laws by name; none for those that validate runs.
        screen: ``auto`` makes maps on equations, where these agree with MuJoCo, and confirms
            their boundaries; ``none`` makes all of them in MuJoCo.
    """

    system: str
    points: int = 100
    duration: float = 12.0
    axes: tuple[str, str] | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    settings: Settings = REGION_SETTINGS
    controllers: tuple[str, ...] = ()
    screen: str = "auto"


class Region:
    """The maps of one system: every law, on the nominal and on the perturbed plant."""

    def __init__(self, question: RegionQuestion) -> None:
        """Check the question and lay out the starts.

        Raises:
            ModelError: If the system is unknown.
            ArgumentError: If a name or a number does not fit, or a start lies beyond a stop.
        """
        least, most = POINTS
        if not least <= question.points <= most:
            raise ArgumentError(f"{question.points} points per axis must be from {least} to {most}")
        if not 0 < question.duration <= LONGEST:
            raise ArgumentError(
                f"duration {question.duration:g} s must be positive, up to {LONGEST:g} s"
            )
        require_known("screen", question.screen, SCREENS)
        self.question = question
        perturbed = _perturbed(question)
        self.system: System = perturbed.nominal.system
        self.experiments = [
            experiment.with_settings(**question.settings.changes())
            for experiment in (_unperturbed(perturbed), perturbed)
        ]
        self.controllers = list(dict.fromkeys(question.controllers or perturbed.controllers))
        reference = RegionLoop.of(self.experiments[0], self.controllers[0])
        self.axes: tuple[Axis, Axis] = choose_axes(reference, question.axes, question.limits)
        first, second = np.meshgrid(*(axis.cells(question.points) for axis in self.axes))
        self._line = self.axes[0].cells(_LINE * question.points)
        self._starts = starts_on(
            reference,
            self.axes,
            np.concatenate([first.ravel(), self._line]),
            np.concatenate([second.ravel(), np.zeros(len(self._line))]),
        )
        physics = perturbed.plant("physics")
        try:
            for start in self._starts:
                physics.require_start(start)
        except ArgumentError as error:
            raise ArgumentError(f"{error}, or lower the limits of the axes") from error

    @cached_property
    def batches(self) -> int:
        """Batches of all maps, for a progress bar."""
        maps = len(self.experiments) * len(self.controllers)
        return maps * math.ceil(len(self._starts) / BATCH)

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Why no map of a case is made on equations, by its name; empty where they are."""
        none = self.question.screen == "none"
        return {
            x.case.name: "screen is none" if none else model_mismatch(x.plant("physics"))
            for x in self.experiments
        }

    def maps(self, advance: Callable[[str], None] = lambda _: None) -> Iterator[RegionMap]:
        """Compute the maps, one by one; ``advance`` is called after each batch."""
        for experiment in self.experiments:
            for name in self.controllers:
                yield self._map(experiment, name, advance)

    def _map(self, experiment: Experiment, name: str, advance: Callable[[str], None]) -> RegionMap:
        """One map."""
        began, physics = time.perf_counter(), RegionLoop.of(experiment, name)
        case, size = experiment.case, self.question.points
        screened = not self.why_not[case.name]
        loop = replace(physics, on_equations=True) if screened else physics
        letters = self._outcomes(loop, self._starts, lambda: advance(f"{case.name}/{name}"))
        cells = size * size
        grid, line = letters[:cells].reshape(size, size), letters[cells:]
        confirmed, overturned = len(letters), 0
        if screened:
            areas = [
                confirmed_area(first, partial(self._of_some, physics, starts), seed)
                for seed, (first, starts) in enumerate(
                    [(grid, self._starts[:cells]), (line[None], self._starts[cells:])]
                )
            ]
            grid, (line,) = (area.letters for area in areas)
            confirmed = sum(int(area.confirmed.sum()) for area in areas)
            overturned = sum(int(area.overturned.sum()) for area in areas)
        seconds = time.perf_counter() - began
        return RegionMap(case, name, grid, line, self._line, seconds, confirmed, overturned)

    def _of_some(self, loop: RegionLoop, starts: Array, chosen: Mask) -> Letters:
        """The outcomes of some starts."""
        return self._outcomes(loop, starts[chosen.reshape(-1)])

    def _outcomes(
        self, loop: RegionLoop, starts: Array, advance: Callable[[], object] = lambda: None
    ) -> Letters:
        """The outcome of each start, a batch at a time."""
        parts = []
        for first in range(0, len(starts), BATCH):
            parts.append(outcomes(loop, starts[first : first + BATCH], self.question.duration))
            advance()
        return np.concatenate(parts)


def _is_edited(experiment: Experiment) -> bool:
    """Whether its plant is edited, and its laws regulate states, on which starts are laid out."""
    law = experiment.law("physics", experiment.controllers[0])
    return bool(experiment.case.edits) and law.coordinates.outputs is None


def _unperturbed(perturbed: Experiment) -> Experiment:
    """The same laws on the nominal plant: the case of the package for it, if there is one."""
    case = perturbed.case
    if perturbed.path in shipped_files().values():
        for other in find_experiments(case.system):
            calm = not other.case.edits and not other.case.disturbances
            if calm and other.case.controllers == case.controllers:
                return other
    return perturbed.varied(name="nominal", title="nothing is changed", edits=(), disturbances=())


def _perturbed(question: RegionQuestion) -> Experiment:
    """The experiment with the perturbed plant; of a system its first case that edits the plant.

    Raises:
        ArgumentError: If it is unknown, does not run in MuJoCo, or nothing differs from the
            nominal plant.
    """
    known = find_experiments(question.system)
    if len(known) > 1:
        return next(experiment for experiment in known if _is_edited(experiment))
    (experiment,) = known
    case = experiment.case
    if "physics" not in experiment.nominal.names:
        raise ArgumentError(f"{question.system}: it does not run in MuJoCo, where maps are made")
    if not case.edits and case.onset >= question.duration:
        why = f"disturbed from {case.onset:g} s on" if case.disturbances else "not changed"
        others = find_experiments(case.system) if experiment.nominal.shipped else []
        names = ", ".join(x.case.name for x in others if _is_edited(x)) or "one with an edit"
        raise ArgumentError(
            f"{case.name} of {case.system} is the nominal plant, {why}, and a run takes "
            f"{question.duration:g} s: take {names}"
        )
    return experiment
