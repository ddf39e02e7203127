"""From which starts a law converges: maps of two axes to outcomes, confirmed in MuJoCo."""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law, around
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case, case_document
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.fields import Positive, Range, checked
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant, Signal, System
from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.palette import BLACK, BLUE, ORANGE, PURPLE, YELLOW, label_of
from grosmc_mj.results.result import MEASURED, Answer, GridChart, Letter, Sheet, Value, result
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.studies.figures import write_panels
from grosmc_mj.sweep.agreement import model_mismatch

Mask = NDArray[np.bool_]
Letters = NDArray[np.str_]

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
SETTINGS = Settings(integrator="implicitfast")


# One run


class Outcome(Enum):
    """Outcome of a start: its letter in the file, its name, its meaning, and its colour."""

    CONVERGED = ("c", "converged", "every regulated error is within its tolerance at the end", BLUE)
    LEFT = (
        "l", "left the region",
        "a sample of the law fell outside the region where the laws are defined", ORANGE,
    )  # fmt: skip
    SINGULAR = (
        "s", "singular plant", "the plant reached a state where its equations break down", PURPLE
    )  # fmt: skip
    NOT_CONVERGED = (
        "n", "not converged",
        "the run stayed in the region and is beyond a tolerance at the end", YELLOW,
    )  # fmt: skip
    DIVERGED = ("d", "diverged", "the state grew without bound", BLACK)

    def __init__(self, letter: str, title: str, meaning: str, colour: str) -> None:
        self.letter, self.title, self.meaning, self.colour = letter, title, meaning, colour


_ENDED_EARLY = {
    Status.UNDEFINED_LAW: Outcome.LEFT,
    Status.SINGULAR_PLANT: Outcome.SINGULAR,
    Status.DIVERGED: Outcome.DIVERGED,
    # No law of the package ends so while its state is bounded.
    Status.UNDEFINED_INPUT: Outcome.DIVERGED,
}


def judge(status: Iterable[Status], errors: Array, tolerance: ArrayLike) -> Letters:
    """The outcomes of runs of a guarded law, as letters.

    Args:
        status: How each run ended, (nsim,).
        errors: Error states at the end, (nsim, errors).
        tolerance: Largest size of each error that counts as none, (errors,).
    """
    near = np.all(np.abs(errors) <= np.asarray(tolerance), axis=1)
    ends = [Outcome.CONVERGED if x else Outcome.NOT_CONVERGED for x in near]
    return np.array([_ENDED_EARLY.get(s, end).letter for s, end in zip(status, ends, strict=True)])


@dataclass(frozen=True, eq=False)
class RegionLoop:
    """A law on the physics of an experiment, stopped where it leaves the region of the laws.

    Attributes:
        experiment: Its case, and how it is run.
        controller: The law, guarded; designed for the nominal plant.
        plant: The experiment's plant, or its equations, which take steps of RK4.
    """

    experiment: Experiment
    controller: Controller
    plant: Plant

    @classmethod
    def of(cls, experiment: Experiment, controller: str) -> RegionLoop:
        """The loop of a named controller."""
        law = experiment.law("physics", controller)
        system = experiment.nominal.system
        return cls(experiment, guarded(law, system), experiment.plant("physics"))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

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
    away = np.any(np.abs(loop.errors(0.0, starts)) > tolerance, axis=1)
    early = away & (not loop.experiment.case.disturbances)
    letters = np.full(len(starts), Outcome.NOT_CONVERGED.letter)
    for look in looks:
        undecided = np.flatnonzero(letters == Outcome.NOT_CONVERGED.letter)
        if not len(undecided):
            break
        run, last = loop.run(starts[undecided], look * duration), look == looks[-1]
        errors = loop.errors(float(run.time[-1]), run.state[:, -1])
        ends = judge(run.status, errors, tolerance if last else _EARLY * tolerance)
        decided = (ends != Outcome.CONVERGED.letter) | last | early[undecided]
        letters[undecided[decided]] = ends[decided]
    return letters


# The axes


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        key: Its symbol in ASCII, as on the command line.
        signal: The state's name, symbol and unit.
        limit: Starts lie between minus this and this, in the state's unit.
        direction: How the state moves with the axis: -1 for an error y_r - y.
        origin: Value of the state at zero of the axis.
        is_error: Whether zero of the axis is zero error of a regulated state.
    """

    state: int
    key: str
    signal: Signal
    limit: float
    direction: float
    origin: float
    is_error: bool

    @property
    def name(self) -> str:
        """For people."""
        return f"error of {self.signal.name}" if self.is_error else self.signal.name

    @property
    def unit(self) -> str:
        """Unit for people: degrees for angles."""
        return {"rad": "°"}.get(self.signal.unit, self.signal.unit)

    def shown(self, value: float) -> float:
        """A value on the axis in the unit for people."""
        return math.degrees(value) if self.signal.unit == "rad" else value

    def cells(self, count: int) -> Array:
        """Centres of equal cells from minus to plus the limit."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)

    def document(self) -> dict[str, Any]:
        """It as plain values."""
        own = {name: getattr(self, name) for name in ("name", "limit", "direction", "origin")}
        measures = "error" if self.is_error else "state"
        return {"state": self.key, "measures": measures, "unit": self.signal.unit, **own}


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
        ArgumentError: If a state is unknown or named twice, or of a unit without a limit.
    """
    system, keys = loop.system, state_names(loop.system)
    known = {name: i for i, name in enumerate(keys)}
    for name in names or ():
        require_known(f"state of {system.name}", name, known)
    first = loop.regulated[0]
    chosen = [known[x] for x in names] if names else [first, first + system.degrees_of_freedom]
    if chosen[0] == chosen[1]:
        raise ArgumentError(
            f"axes {', '.join(keys[i] for i in chosen)} must be two different states of "
            f"{system.name}: {', '.join(keys)}"
        )

    def axis(state: int) -> Axis:
        signal, is_error = system.states[state], state in loop.regulated
        ends = {**LIMITS, **limits}
        require_known(f"unit of an axis, of {keys[state]},", signal.unit, ends)
        row = loop.sensitivity[loop.regulated.index(state)] if is_error else None
        direction = 1.0 if row is None else float(row[state])
        origin = float(loop.equilibrium[state])
        return Axis(state, keys[state], signal, ends[signal.unit], direction, origin, is_error)

    return axis(chosen[0]), axis(chosen[1])


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
            f"{axis.signal.symbol} = {axis.shown(wrong[0][axis.state]):.4g} {axis.unit}"
            for axis in axes
        )
        raise ArgumentError(
            f"{len(wrong)} of {len(starts)} starts, as {values}, lie outside {system.region}, "
            "where law and plant are defined: lower the limits of the axes"
        )
    return starts


# Maps on equations, their boundaries confirmed in MuJoCo


def confirmed_area(
    first: Letters, confirm: Callable[[Mask], Letters], seed: int
) -> tuple[Letters, Mask]:
    """Confirm every start beside another outcome, and some of the others.

    Of an outcome that MuJoCo overturns every neighbour is confirmed: one that the equations told
    apart from it was beside another outcome before, any other one is beside another outcome now.

    Args:
        first: Outcomes by the equations, (rows, columns).
        confirm: The outcomes in MuJoCo of some starts, in the order of the area.
        seed: Of the random ones.

    Returns:
        The outcomes, and which of them are MuJoCo's, (rows, columns).
    """
    letters, confirmed = first.copy(), np.zeros(first.shape, bool)
    chosen = beside_another(first)
    drawn = np.random.default_rng(seed).permutation(first.size)[: math.ceil(_RANDOM * first.size)]
    chosen.reshape(-1)[drawn] = True
    while np.any(new := chosen & ~confirmed):
        letters[new] = confirm(new)
        confirmed |= new
        chosen = beside_another(letters)
    return letters, confirmed


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
        confirmed: Starts that MuJoCo judged, of all.
        overturned: Those of them for which the equations gave another outcome.
    """

    case: Case
    controller: str
    grid: Letters
    line: Letters
    line_starts: Array
    confirmed: int = 0
    overturned: int = 0

    @property
    def counts(self) -> dict[Outcome, int]:
        """Starts of the grid with each outcome."""
        letters = Counter(self.grid.ravel().tolist())
        return {outcome: letters[outcome.letter] for outcome in Outcome}

    @property
    def converged(self) -> float:
        """Share of the grid that converges [%]."""
        return 100 * self.counts[Outcome.CONVERGED] / self.grid.size

    @property
    def rows(self) -> list[str]:
        """A string for each value of the second axis, from the lowest."""
        return ["".join(row) for row in self.grid.tolist()]

    def rest_interval(self) -> tuple[float, float] | None:
        """The farthest starts on the first axis from which, and from all between, it converges.

        None if it does not converge from those next to zero.
        """
        good, middle = self.line == Outcome.CONVERGED.letter, len(self.line) // 2
        if not (good[middle - 1] and good[middle]):
            return None
        wrong = np.flatnonzero(~good)
        low = max(wrong[wrong < middle], default=-1) + 1
        high = min(wrong[wrong >= middle], default=len(good)) - 1
        return float(self.line_starts[low]), float(self.line_starts[high])


# The maps of a system


@checked(eq=False)
class Region:
    """The maps of one system: every law, on the nominal and on the perturbed plant.

    Attributes:
        target: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        points: Starts along each axis.
        duration: Of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start by unit (rad, rad/s, m, m/s), where it is not the default.
        settings: Control period, timestep, integrator and switching.
        controllers: Laws by name; none for those that validate runs.
        screen: ``auto`` makes maps on equations, where these agree with MuJoCo, and confirms
            their boundaries; ``none`` makes all of them in MuJoCo.

    Raises:
        ModelError: If the system is unknown.
        ArgumentError: If a name or a number does not fit, or a start lies beyond a stop.
    """

    target: str
    points: Annotated[int, Range(2, 1000, whole=True)] = 100
    duration: Annotated[float, Range(0, 1000, unit="s", above=True)] = 12.0
    axes: tuple[str, str] | None = None
    limits: Mapping[str, Positive] = field(default_factory=dict)
    settings: Settings = SETTINGS
    controllers: tuple[str, ...] = ()
    screen: Literal["auto", "none"] = "auto"

    def __post_init__(self) -> None:
        """Lay out the starts at once, so that a mistake is told before the first run."""
        physics = self.experiments[1].plant("physics")
        try:
            for start in self.starts:
                physics.require_start(start)
        except ArgumentError as error:
            raise ArgumentError(f"{error}, or lower the limits of the axes") from error

    @cached_property
    def experiments(self) -> list[Experiment]:
        """With the nominal plant, and with the perturbed one."""
        perturbed = _perturbed(self.target, self.duration)
        both = (_unperturbed(perturbed), perturbed)
        return [experiment.with_settings(**self.settings.changes()) for experiment in both]

    @property
    def system(self) -> System:
        """Whose starts they are."""
        return self.experiments[1].nominal.system

    @cached_property
    def loops(self) -> list[RegionLoop]:
        """The loops of the maps, every law on the nominal plant first."""
        laws = dict.fromkeys(self.controllers or self.experiments[1].controllers)
        return [RegionLoop.of(experiment, law) for experiment in self.experiments for law in laws]

    @cached_property
    def plane(self) -> tuple[Axis, Axis]:
        """The two axes."""
        return choose_axes(self.loops[0], self.axes, self.limits)

    @cached_property
    def line(self) -> Array:
        """Values of the starts on the first axis alone, (4 * points,)."""
        return self.plane[0].cells(_LINE * self.points)

    @cached_property
    def starts(self) -> Array:
        """The starts of a map row by row, then those on the first axis alone, (nsim, n)."""
        first, second = np.meshgrid(*(axis.cells(self.points) for axis in self.plane))
        across = np.concatenate([first.ravel(), self.line])
        up = np.concatenate([second.ravel(), np.zeros(len(self.line))])
        return starts_on(self.loops[0], self.plane, across, up)

    @property
    def batches(self) -> int:
        """Batches of all maps, for a progress bar."""
        return len(self.loops) * math.ceil(len(self.starts) / BATCH)

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Why no map of a case is made on equations, by its name; empty where they are."""
        none = self.screen == "none"
        return {
            x.case.name: "screen is none" if none else model_mismatch(x.plant("physics"))
            for x in self.experiments
        }

    def maps(self, advance: Callable[[str], object] = lambda _: None) -> Iterator[RegionMap]:
        """Compute the maps, one by one; ``advance`` is called after each batch."""
        size = self.points**2
        for physics in self.loops:
            case, law, loop = physics.experiment.case, physics.controller.name, physics
            if screened := not self.why_not[case.name]:
                loop = replace(physics, plant=physics.plant.analytic())
            letters = self._outcomes(loop, self.starts, partial(advance, f"{case.name}/{law}"))
            grid, line = letters[:size].reshape(self.points, -1), letters[None, size:]
            confirmed, overturned = len(letters), 0
            if screened:
                areas = ((grid, self.starts[:size]), (line, self.starts[size:]))
                (grid, of_grid), (line, of_line) = (
                    confirmed_area(first, partial(self._some_outcomes, physics, starts), seed)
                    for seed, (first, starts) in enumerate(areas)
                )
                confirmed = int(of_grid.sum() + of_line.sum())
                overturned = int((np.concatenate([grid.ravel(), line[0]]) != letters).sum())
            yield RegionMap(case, law, grid, line[0], self.line, confirmed, overturned)

    def _some_outcomes(self, loop: RegionLoop, starts: Array, chosen: Mask) -> Letters:
        """The outcomes of some starts of an area."""
        return self._outcomes(loop, starts[chosen.reshape(-1)])

    def _outcomes(
        self, loop: RegionLoop, starts: Array, advance: Callable[[], object] = lambda: None
    ) -> Letters:
        """The outcome of each start, a batch at a time."""
        parts = []
        for first in range(0, len(starts), BATCH):
            parts.append(outcomes(loop, starts[first : first + BATCH], self.duration))
            advance()
        return np.concatenate(parts)


def _is_edited(experiment: Experiment) -> bool:
    """Whether its plant is edited, and its laws regulate states, on which starts are laid out."""
    law = experiment.law("physics", experiment.controllers[0])
    return bool(experiment.case.edits) and law.coordinates.outputs is None


def _unperturbed(perturbed: Experiment) -> Experiment:
    """The same laws on the nominal plant: the case of the package for it, if there is one."""
    case, laws = perturbed.case, (perturbed.controllers, perturbed.file.controller)
    if perturbed.path in shipped_files().values():
        for other in find_experiments(case.system):
            calm = not other.case.edits and not other.case.disturbances
            if calm and (other.controllers, other.file.controller) == laws:
                return other
    return perturbed.varied(name="nominal", title="nothing is changed", edits=(), disturbances=())


def _perturbed(target: str, duration: float) -> Experiment:
    """The experiment with the perturbed plant; of a system its first case that edits the plant.

    Raises:
        ArgumentError: If it is unknown, does not run in MuJoCo, or nothing differs from the
            nominal plant.
    """
    known = find_experiments(target)
    if len(known) > 1:
        return next(experiment for experiment in known if _is_edited(experiment))
    (experiment,) = known
    case = experiment.case
    if "physics" not in experiment.nominal.names:
        raise ArgumentError(f"{target}: it does not run in MuJoCo, where maps are made")
    if not case.edits and case.onset >= duration:
        why = f"disturbed from {case.onset:g} s on" if case.disturbances else "not changed"
        others = find_experiments(case.system) if experiment.nominal.shipped else []
        names = ", ".join(x.case.name for x in others if _is_edited(x)) or "one with an edit"
        raise ArgumentError(
            f"{case.name} of {case.system} is the nominal plant, {why}, and a run takes "
            f"{duration:g} s: take {names}"
        )
    return experiment


# The answer: table, charts, figure, document


def region_table(region: Region, maps: Sequence[RegionMap]) -> Table:
    """A row a map, from the fewest starts that converge on; how far at rest it converges."""
    axis, rows = region.plane[0], []
    for found in sorted(maps, key=lambda found: found.converged):
        ends = [f"{axis.shown(end):+.1f}" for end in found.rest_interval() or ()]
        _, *others = found.counts.values()
        share = f"{found.converged:.1f}"
        at_rest = " to ".join(ends) or "none"
        rows.append([found.case.name, found.controller, share, *map(str, others), at_rest])
    outcomes = ("\n".join(outcome.title.rsplit(" ", 1)) for outcome in list(Outcome)[1:])
    columns = [
        *words("plant", "law"),
        *numbers("converged\n%", *outcomes, f"at rest\n[{axis.unit}]"),
    ]
    return table(f"{region.system.title}: outcomes of the starts", columns, rows)


def legend(region: Region, maps: Sequence[RegionMap]) -> str:
    """Which engine judged the starts, and what the words of the table mean."""
    starts = sum(found.grid.size + found.line.size for found in maps)
    confirmed = sum(found.confirmed for found in maps)
    bounds = sorted(
        {
            f"|error of {symbol}| <= {value:.3g} {unit}"
            for loop in region.loops
            for symbol, (value, unit) in loop.tolerances.items()
        }
    )
    judged = (
        f"{starts - confirmed:,} of {starts:,} starts judged by the equations, {confirmed:,} in "
        f"MuJoCo, all beside another outcome among them; it overturned "
        f"{sum(found.overturned for found in maps)}. "
    )
    return (judged if confirmed < starts else "") + (
        f"converged: {' and '.join(bounds)} after {region.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region}); at rest: the "
        f"widest interval of starts of {region.plane[0].signal.symbol} alone, about zero, that all "
        "converge."
    )


def charts(region: Region, maps: Sequence[RegionMap]) -> list[list[GridChart]]:
    """A row for each plant, a map for each law."""
    across, up = (
        (f"start {x.name} {x.signal.symbol} [{x.unit}]", x.shown(x.limit)) for x in region.plane
    )
    letters = [Letter(letter=x.letter, name=x.title, colour=x.colour) for x in Outcome]

    def chart(found: RegionMap) -> GridChart:
        name = f"{label_of(found.controller)}, {found.case.name}: {found.converged:.1f} % converge"
        return GridChart(name=name, axes=(across, up), grid=found.rows, legend=letters)

    cases = dict.fromkeys(found.case.name for found in maps)
    return [[chart(found) for found in maps if found.case.name == case] for case in cases]


def write_region_figure(region: Region, maps: Sequence[RegionMap], path: Path) -> Path:
    """Draw the maps, plants below each other; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    how = f"{region.settings.switching} switching"
    title = f"{region.system.title}: from where each law converges ({how})"
    return write_panels(path, in_lines(title, 60), charts(region, maps))


def region_document(region: Region, maps: Sequence[RegionMap]) -> dict[str, Any]:
    """The content of region_SYSTEM.json."""
    settings, cases = region.settings, {}
    for experiment in region.experiments:
        content = case_document(experiment.case)
        keys = ("case", "title", "source", "edits", "disturbances")
        cases[experiment.case.name] = {key: content[key] for key in keys}
    least: dict[str, RegionMap] = {}
    for found in maps:
        other = least.get(found.controller, found)
        least[found.controller] = min(other, found, key=lambda each: each.converged)
    said = [
        f"{law} converges from "
        + (
            f"{number(x.converged)} % of the starts in {x.case.name}"
            if x.converged < 100
            else "every start"
        )
        for law, x in least.items()
    ]
    system = region.system.name
    return result(
        "region",
        {
            "duration": {"value": region.duration, "unit": "s"},
            "points": region.points,
            "control_period": settings.control_period,
            "timestep": settings.timestep,
            "integrator": settings.integrator,
            "switching": settings.switching,
            "surface": settings.surface,
            "region": region.system.region,
            "axes": [axis.document() for axis in region.plane],
            "cases": list(cases.values()),
        },
        answers=[
            Answer(
                question=f"Region of {system}",
                verdict=MEASURED,
                words="; ".join(said),
                more=f"the worst of {', '.join(cases)}",
            )
        ],
        sheets=[
            Sheet(
                table=region_table(region, maps).model_copy(
                    update={"legend": legend(region, maps)}
                ),
                charts=[chart for row in charts(region, maps) for chart in row],
            )
        ],
        values=[
            Value(
                name=f"{system}/{found.case.name} {found.controller}: starts that converge",
                value=found.converged, unit="%", better=1, relative=0.1,
            )
            for found in maps
        ],
        system=system,
        outcomes={x.letter: {"name": x.title, "meaning": x.meaning} for x in Outcome},
        maps=[_map(region, found) for found in maps],
    )  # fmt: skip


def _map(region: Region, found: RegionMap) -> dict[str, Any]:
    """One map as plain values."""
    low, high = found.rest_interval() or (None, None)
    return {
        "case": found.case.name,
        "controller": found.controller,
        "counts": {outcome.title: count for outcome, count in found.counts.items()},
        "converges_on_first_axis": {
            "from": low,
            "to": high,
            "spacing": float(found.line_starts[1] - found.line_starts[0]),
            "unit": region.plane[0].signal.unit,
        },
        "judged_in_mujoco": found.confirmed,
        "overturned": found.overturned,
        "grid": found.rows,
    }
