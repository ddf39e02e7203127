"""Starts from which a law converges: maps of two axes to outcomes, confirmed in MuJoCo."""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from grosmc_mj.arguments import require_known
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law, wrapped
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.experiments.catalogue import find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.fields import Positive, Range, checked
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant, Signal, System
from grosmc_mj.results.charts import write_panels
from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.palette import BLACK, BLUE, ORANGE, PURPLE, YELLOW, label_of
from grosmc_mj.results.result import (
    MEASURED,
    OPEN,
    Answer,
    GridChart,
    Letter,
    ReportTable,
    Result,
    Value,
    result,
)
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.sweep.agreement import model_mismatch
from grosmc_mj.sweep.confirmation import (
    Confirmation,
    Mask,
    Rows,
    confirmation_words,
    drawn_at_random,
)
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows

Letters = NDArray[np.str_]

# Largest start on an axis, by its unit.
LIMITS: Mapping[str, float] = {"rad": math.pi / 2, "rad/s": 10.0, "m": 1.0, "m/s": 2.0}
# Largest size of a regulated error at the end that counts as none, by its unit. It is far above the
# chatter that a switching law leaves at a control period of 1 ms (below 0.2 degrees and 0.01 rad/s)
# and about a hundredth of the default starts. Position and rate count together: a swing through
# zero is fast there.
TOLERANCES: Mapping[str, float] = {"rad": math.radians(1.0), "rad/s": 0.1, "m": 0.02, "m/s": 0.1}
# Starts in one batch: bounds memory and the wait between two advances of the progress bar.
BATCH = 1000
# Parts of the duration after which runs are judged; those that are decided end there. Most that
# leave the region do so in the first part.
_LOOKS = (1 / 16, 1 / 4, 1.0)
# To count as converged before the end, errors must be within this part of their tolerances.
_EARLY = 0.25
# An implicit step evaluates the physics once, RK4 four times. On 256 starts of each map of the
# pendulum both give the same outcomes, but for up to two on a boundary.
INTEGRATOR = "implicitfast"


# One run


class Outcome(Enum):
    """Outcome of a start: its letter in the file, its name and its colour."""

    CONVERGED = ("c", "converged", BLUE)
    LEFT = ("l", "left the region", ORANGE)
    SINGULAR = ("s", "singular plant", PURPLE)
    NOT_CONVERGED = ("n", "not converged", YELLOW)
    DIVERGED = ("d", "diverged", BLACK)

    def __init__(self, letter: str, title: str, colour: str) -> None:
        self.letter = letter
        self.title = title
        self.colour = colour


# Outcomes by the status of a run. No law of the package ends with an undefined input while its
# state is bounded.
_ENDED_EARLY = {
    "undefined_law": Outcome.LEFT,
    "singular_plant": Outcome.SINGULAR,
    "diverged": Outcome.DIVERGED,
    "undefined_input": Outcome.DIVERGED,
}


def judge(status: Iterable[str], errors: Array, tolerance: ArrayLike) -> Letters:
    """Return the outcomes of runs of a guarded law, as letters.

    Args:
        status: How each run ended, a status of ``Outcomes``, (nsim,).
        errors: Error states at the end, (nsim, errors).
        tolerance: Largest size of each error that counts as none, (errors,).
    """
    near = np.all(np.abs(errors) <= np.asarray(tolerance), axis=1)
    letters = []
    for name, is_near in zip(status, near, strict=True):
        at_end = Outcome.CONVERGED if is_near else Outcome.NOT_CONVERGED
        outcome = _ENDED_EARLY.get(name, at_end)
        letters.append(outcome.letter)
    return np.array(letters)


@dataclass(frozen=True, eq=False)
class RegionLoop:
    """A law on the physics of an experiment, stopped where it leaves the region of the laws.

    Attributes:
        experiment: Its case and settings.
        controller: The law, guarded; designed for the nominal plant.
        plant: The experiment's plant, or its equations, which take steps of RK4.
        predict: Whether the law knows the experiment's loop.
    """

    experiment: Experiment
    controller: Controller
    plant: Plant
    predict: bool = False

    @classmethod
    def of(cls, experiment: Experiment, controller: str) -> RegionLoop:
        """Return the loop of a named controller."""
        law = guarded(experiment.law("physics", controller), experiment.nominal.system)
        return cls(experiment, law, experiment.plant("physics"), experiment.predicts(controller))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

    def run(self, starts: Array, duration: float) -> Outcomes:
        """Return the runs from the starts (nsim, n)."""
        case = replace(self.experiment, duration=duration)
        rows = []
        for start in starts.tolist():
            row = Row(
                self.controller,
                case=replace(case, x0=tuple(start)),
                plant=self.plant,
                predict=self.predict,
            )
            rows.append(row)
        return run_rows(self.experiment, rows, ())

    @property
    def sensitivity(self) -> Array:
        """C of the error state at the start, z = C x + c: 1, -1 or 0, (errors, n)."""
        n = len(self.system.states)
        at_origin = self.errors(0.0, np.zeros((1, n)))
        return (self.errors(0.0, np.eye(n)) - at_origin).T

    @property
    def equilibrium(self) -> Array:
        """State without error at t = 0; states that the law does not regulate are zero, (n,)."""
        origin = np.zeros((1, len(self.system.states)))
        return -np.linalg.pinv(self.sensitivity) @ self.errors(0.0, origin)[0]

    @property
    def regulated(self) -> list[int]:
        """The state that each error is measured on."""
        return np.abs(self.sensitivity).argmax(axis=1).tolist()

    @property
    def tolerances(self) -> dict[str, tuple[float, str]]:
        """Largest size of each regulated error that counts as none: by state, with unit."""
        tolerances = {}
        for index in self.regulated:
            state = self.system.states[index]
            require_known("unit of an error with a tolerance", state.unit, TOLERANCES)
            tolerances[state.symbol] = (TOLERANCES[state.unit], state.unit)
        return tolerances

    def errors(self, time: float, states: Array) -> Array:
        """Return the error states (nsim, errors) of states (nsim, n) at one time [s].

        Raises:
            ArgumentError: If the law regulates outputs that are no states.
        """
        error = self.controller.designed.error
        if error.outputs is not None:
            raise ArgumentError(
                f"{self.controller.name} in {self.experiment.name} of {self.system.name} "
                "regulates outputs that are no states: take another case"
            )
        return error.along(np.full(len(states), time), states, self.controller.parameters)


def guarded(controller: Controller, system: System) -> Controller:
    """Return the controller with runs that end at the first sample outside the region.

    The Jacobian LQR is defined everywhere and could swing the pole right round; its run ends
    where those of the linearizing laws do.
    """
    return replace(controller, law=_guarded_law(controller.law, system))


# Cached since each law that is made here is compiled once.
@cache
def _guarded_law(law: Law, system: System) -> Law:
    inner = jitable(law)
    linearizable = system.linearizable

    # numba compiles the law with both functions as constants.
    def guarded_law(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        inner(t, x, memory, p, u)
        if not linearizable(x):
            memory.undefined = 1.0

    return wrapped(guarded_law, law)


def outcomes(
    loop: RegionLoop, starts: Array, duration: float, looks: Sequence[float] = _LOOKS
) -> Letters:
    """Return the outcome of each start (nsim, n), as letters.

    A run ends at a look if it has left the region, met a singularity or diverged. It also ends
    there as converged if it began beyond a tolerance and is well within all of them, unless a
    disturbance could still carry it away.

    Args:
        loop: The law on its plant.
        starts: Starts.
        duration: Duration of a run that is not decided before [s].
        looks: Parts of it after which runs are judged, ending with 1.
    """
    tolerance = np.array([value for value, _ in loop.tolerances.values()])
    away = np.any(np.abs(loop.errors(0.0, starts)) > tolerance, axis=1)
    may_end_early = away & (not loop.experiment.disturbances)

    letters = np.full(len(starts), Outcome.NOT_CONVERGED.letter)
    for look in looks:
        undecided = np.flatnonzero(letters == Outcome.NOT_CONVERGED.letter)
        if not len(undecided):
            break
        last = look == looks[-1]
        bound = tolerance if last else _EARLY * tolerance
        runs = loop.run(starts[undecided], look * duration)
        errors = loop.errors(look * duration, runs["last"])
        ends = judge(runs["status"], errors, bound)

        decided = (ends != Outcome.CONVERGED.letter) | last | may_end_early[undecided]
        letters[undecided[decided]] = ends[decided]
    return letters


# The design: starts on two axes


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        signal: The state's name, symbol and unit.
        limit: Largest start to both sides, in the state's unit.
        direction: Change of the state along the axis: -1 for an error y_r - y.
        origin: Value of the state at zero of the axis.
        is_error: Whether zero of the axis is zero error of a regulated state.
    """

    state: int
    signal: Signal
    limit: float
    direction: float
    origin: float
    is_error: bool

    @property
    def title(self) -> str:
        """Title with symbol and unit; degrees for angles."""
        name = self.signal.name
        if self.is_error:
            name = f"error of {name}"
        _, unit = shown(self.signal, 0.0)
        return f"start {name} {self.signal.symbol} [{unit}]"

    def cells(self, count: int) -> Array:
        """Return the centres of equal cells from minus to plus the limit, (count,)."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)


def shown(signal: Signal, value: float) -> tuple[float, str]:
    """Return a value of a signal for people, and its unit: degrees for angles."""
    if signal.unit == "rad":
        return math.degrees(value), "°"
    return value, signal.unit


def ascii_symbol(signal: Signal) -> str:
    """Return the symbol that the command line has: theta_dot for θ̇, q1 for q₁."""
    symbol = ""
    suffix = ""
    for character in unicodedata.normalize("NFD", signal.symbol):
        name = unicodedata.name(character)
        if name == "COMBINING DOT ABOVE":
            suffix = "_dot"
        elif character.isdigit():
            symbol += str(unicodedata.digit(character))
        elif character.isascii():
            symbol += character
        else:
            # GREEK SMALL LETTER THETA
            symbol += name.split()[-1].lower()
    return symbol + suffix


def choose_axes(
    loop: RegionLoop,
    names: tuple[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> tuple[Axis, Axis]:
    """Return two axes: the named states, or the first regulated state and its rate.

    Args:
        loop: Loop whose errors the axes measure.
        names: Two states by symbol, such as ``theta`` and ``theta_dot``.
        limits: Largest start on each axis, in degrees or the state's unit; instead of ``LIMITS``.

    Raises:
        ArgumentError: If a state is unknown or named twice, or of a unit without a limit.
    """
    system = loop.system
    symbols = [ascii_symbol(state) for state in system.states]
    first = loop.regulated[0]
    second = first + system.degrees_of_freedom
    if names is not None:
        for name in names:
            require_known(f"state of {system.name}", name, dict.fromkeys(symbols))
        first = symbols.index(names[0])
        second = symbols.index(names[1])

    if first == second:
        raise ArgumentError(
            f"axes {symbols[first]}, {symbols[second]} must be two different states of "
            f"{system.name}: {', '.join(symbols)}"
        )
    across, up = limits or (None, None)
    return _axis(loop, first, across), _axis(loop, second, up)


def _axis(loop: RegionLoop, state: int, limit: float | None) -> Axis:
    """The axis of a state, up to a limit in degrees or its unit; by default that of ``LIMITS``."""
    signal = loop.system.states[state]
    if limit is None:
        require_known(f"unit of an axis, of {ascii_symbol(signal)},", signal.unit, LIMITS)
        limit = LIMITS[signal.unit]
    elif signal.unit == "rad":
        limit = math.radians(limit)

    is_error = state in loop.regulated
    direction = 1.0
    if is_error:
        error = loop.regulated.index(state)
        direction = float(loop.sensitivity[error, state])
    origin = float(loop.equilibrium[state])
    return Axis(state, signal, limit, direction, origin, is_error)


def starts_on(
    loop: RegionLoop,
    axes: tuple[Axis, Axis],
    first: Array,
    second: Array,
) -> Array:
    """Return states (nsim, n) at pairs of values on the axes, else at the equilibrium.

    Args:
        loop: Loop whose equilibrium counts.
        axes: The axes.
        first: Values on the first axis, (nsim,).
        second: Values on the second axis, (nsim,).

    Raises:
        ArgumentError: If one lies where the plant is singular or the laws are undefined.
    """
    system = loop.system
    starts = np.tile(loop.equilibrium, (len(first), 1))
    for axis, values in zip(axes, (first, second), strict=True):
        starts[:, axis.state] += axis.direction * values

    outside = [x for x in starts if system.singular(x) or not system.linearizable(x)]
    if outside:
        words = []
        for axis in axes:
            value, unit = shown(axis.signal, outside[0][axis.state])
            words.append(f"{axis.signal.symbol} = {value:.4g} {unit}")
        raise ArgumentError(
            f"{len(outside)} of {len(starts)} starts, as {', '.join(words)}, lie outside "
            f"{system.region}, where law and plant are defined: lower the limits of the axes"
        )
    return starts


# The reduction: maps on equations, their boundaries confirmed in MuJoCo


def confirmed_map(
    first: Letters, confirm: Callable[[Rows], Letters]
) -> tuple[Letters, Confirmation]:
    """Confirm every start beside another outcome, and some of the other starts.

    Around a start that MuJoCo overturns, every neighbour is confirmed too. A neighbour that had
    another outcome by the equations was beside another outcome before; one that had the same is
    beside another outcome now.

    Args:
        first: Outcomes by the equations, (rows, columns).
        confirm: Function that returns the outcomes in MuJoCo of starts by their indices in the
            flat map.

    Returns:
        The outcomes, (rows, columns), and which of them are MuJoCo's.
    """
    letters = first.copy()
    confirmation = Confirmation(beside_another(first).ravel(), drawn_at_random(first.size))
    while True:
        starts = confirmation.rows()
        if not len(starts):
            return letters, confirmation

        by_physics = confirm(starts)
        confirmation.note(starts, by_physics != letters.flat[starts])
        letters.flat[starts] = by_physics
        confirmation.doubt(beside_another(letters).ravel())


def beside_another(letters: Letters) -> Mask:
    """Return which places have another letter among the eight around them, (rows, columns)."""
    codes = np.unique(letters, return_inverse=True)[1].reshape(letters.shape)
    largest = maximum_filter(codes, 3, mode="nearest")
    smallest = minimum_filter(codes, 3, mode="nearest")
    return largest != smallest


@dataclass(frozen=True, eq=False)
class RegionMap:
    """The outcome of every start under one law on one plant.

    Attributes:
        case: The case of the plant.
        controller: Name of the law.
        grid: Letters of ``Outcome``, (second axis, first axis).
        confirmation: Which of them MuJoCo confirmed; None if it judged all.
    """

    case: Experiment
    controller: str
    grid: Letters
    confirmation: Confirmation | None = None

    @property
    def confirmed(self) -> int:
        """Number of starts that MuJoCo judged."""
        if self.confirmation is None:
            return self.grid.size
        return int(self.confirmation.confirmed.sum())

    @property
    def overturned(self) -> int:
        """Number of those for which the equations gave another outcome."""
        if self.confirmation is None:
            return 0
        return int(self.confirmation.overturned.sum())

    @property
    def counts(self) -> dict[Outcome, int]:
        """Number of starts with each outcome."""
        letters = Counter(self.grid.ravel().tolist())
        return {outcome: letters[outcome.letter] for outcome in Outcome}

    @property
    def converged(self) -> float:
        """Share of the starts that converges [%]."""
        return 100 * self.counts[Outcome.CONVERGED] / self.grid.size

    @property
    def rows(self) -> list[str]:
        """One string for each value of the second axis, from the lowest."""
        return ["".join(row) for row in self.grid.tolist()]


@checked(eq=False)
class RegionStudy:
    """The maps of one system: every law, on the nominal and on the perturbed plant.

    Attributes:
        target: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        points: Starts along each axis.
        duration: Duration of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start on each axis, in degrees or the state's unit; None for the default.
        controllers: Names of laws; none for those that ``validate`` runs.

    Raises:
        ModelError: If the system is unknown.
        ArgumentError: If a name or a number does not fit, or a start lies beyond a stop.
    """

    target: str
    points: Annotated[int, Range(2, 1000, whole=True)] = 100
    duration: Annotated[float, Range(0, 1000, unit="s", above=True)] = 12.0
    axes: tuple[str, str] | None = None
    limits: tuple[Positive, Positive] | None = None
    controllers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Lay out the starts at once, to refuse a mistake before the first run."""
        physics = self.experiments[1].plant("physics")
        try:
            for start in self.starts:
                physics.require_start(start)
        except ArgumentError as error:
            raise ArgumentError(f"{error}, or lower the limits of the axes") from error

    # Cached: each of these is asked for many times, and reads files, designs laws or runs a check.
    @cached_property
    def experiments(self) -> list[Experiment]:
        """The experiment with the nominal plant, and with the perturbed one."""
        perturbed = _perturbed(self.target, self.duration).with_settings(integrator=INTEGRATOR)
        nominal = perturbed.varied(
            name="nominal", title="nothing is changed", edits=(), disturbances=()
        )
        return [nominal, perturbed]

    # Designed once for all maps.
    @cached_property
    def loops(self) -> list[RegionLoop]:
        """The loops of the maps, every law on the nominal plant first."""
        laws = dict.fromkeys(self.controllers or self.experiments[1].controllers)
        return [RegionLoop.of(experiment, law) for experiment in self.experiments for law in laws]

    @cached_property
    def starts(self) -> Array:
        """The starts of a map row by row, (nsim, n)."""
        across, up = self.plane
        first, second = np.meshgrid(across.cells(self.points), up.cells(self.points))
        return starts_on(self.loops[0], self.plane, first.ravel(), second.ravel())

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Reason for making no map of a case on equations, by its name; empty where they are."""
        reasons = {}
        for experiment in self.experiments:
            reasons[experiment.name] = model_mismatch(experiment.plant("physics"))
        return reasons

    @property
    def system(self) -> System:
        """System of the starts."""
        return self.experiments[1].nominal.system

    @property
    def plane(self) -> tuple[Axis, Axis]:
        """The two axes."""
        return choose_axes(self.loops[0], self.axes, self.limits)

    @property
    def batches(self) -> int:
        """Number of batches of all maps, for a progress bar."""
        return len(self.loops) * math.ceil(len(self.starts) / BATCH)

    def maps(self, advance: Callable[[str], object] = lambda _: None) -> Iterator[RegionMap]:
        """Compute the maps, one by one; ``advance`` is called after each batch."""
        for loop in self.loops:
            case = loop.experiment
            law = loop.controller.name
            screened = not self.why_not[case.name]
            plant = loop.plant.analytic() if screened else loop.plant
            advance_batch = partial(advance, f"{case.name}/{law}")
            letters = self._outcomes(replace(loop, plant=plant), self.starts, advance_batch)
            grid = letters.reshape(self.points, -1)
            if screened:
                yield RegionMap(case, law, *confirmed_map(grid, partial(self._confirm, loop)))
            else:
                yield RegionMap(case, law, grid)

    def _confirm(self, loop: RegionLoop, chosen: Rows) -> Letters:
        """The outcomes in MuJoCo of some starts of a map."""
        return self._outcomes(loop, self.starts[chosen])

    def _outcomes(
        self,
        loop: RegionLoop,
        starts: Array,
        advance: Callable[[], object] = lambda: None,
    ) -> Letters:
        """The outcome of each start, a batch at a time."""
        parts = []
        for first in range(0, len(starts), BATCH):
            batch = starts[first : first + BATCH]
            parts.append(outcomes(loop, batch, self.duration))
            advance()
        return np.concatenate(parts)


def _is_edited(experiment: Experiment) -> bool:
    """Whether its plant is edited, and its laws regulate states, on which starts are laid out."""
    law = experiment.law("physics", experiment.controllers[0])
    return bool(experiment.edits) and law.coordinates.outputs is None


def _perturbed(target: str, duration: float) -> Experiment:
    """The experiment with the perturbed plant; of a system its first case that edits the plant.

    Raises:
        ArgumentError: If it is unknown, does not run in MuJoCo, or nothing differs from the
            nominal plant.
    """
    experiments = find_experiments(target)
    if len(experiments) > 1:
        return next(experiment for experiment in experiments if _is_edited(experiment))

    (experiment,) = experiments
    case = experiment
    if "physics" not in experiment.nominal.names:
        raise ArgumentError(f"{target}: it does not run in MuJoCo, where maps are made")
    if not case.edits and case.onset >= duration:
        why = "not changed"
        if case.disturbances:
            why = f"disturbed from {case.onset:g} s on"
        raise ArgumentError(
            f"{case.name} of {case.system} is the nominal plant, {why}, and a run takes "
            f"{duration:g} s: take {_edited_cases(experiment) or 'one with an edit'}"
        )
    return experiment


def _edited_cases(experiment: Experiment) -> str:
    """Names of the cases of an experiment's system that edit the plant."""
    if not experiment.nominal.shipped:
        return ""
    experiments = find_experiments(experiment.system)
    return ", ".join(edited.name for edited in experiments if _is_edited(edited))


# The answer: table, charts, figure, document


def region_table(region: RegionStudy, maps: Sequence[RegionMap]) -> Table:
    """Return the table of the maps, from the fewest starts that converge on."""
    failures = [outcome for outcome in Outcome if outcome is not Outcome.CONVERGED]
    rows = []
    for law_map in sorted(maps, key=lambda law_map: law_map.converged):
        counts = [str(law_map.counts[outcome]) for outcome in failures]
        converged = f"{law_map.converged:.1f}"
        rows.append([law_map.case.name, law_map.controller, converged, *counts])

    headers = ["\n".join(outcome.title.rsplit(" ", 1)) for outcome in failures]
    columns = [*words("plant", "law"), *numbers("converged\n%", *headers)]
    title = f"{region.system.title}: outcomes of the starts"
    return table(title, columns, rows)


def _remarks(region: RegionStudy, maps: Sequence[RegionMap]) -> Iterator[str]:
    """Yield which engine judged the starts, and the meaning of the table's words."""
    bounds = set()
    for loop in region.loops:
        for symbol, (value, unit) in loop.tolerances.items():
            bounds.add(f"|error of {symbol}| <= {value:.3g} {unit}")
    yield (
        f"converged: {' and '.join(sorted(bounds))} after {region.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region})."
    )

    screened = [law_map.confirmation for law_map in maps if law_map.confirmation is not None]
    if not screened:
        return
    starts = sum(law_map.grid.size for law_map in maps)
    confirmed = sum(law_map.confirmed for law_map in maps)
    overturned = sum(law_map.overturned for law_map in maps)
    drawn = sum(int(confirmation.drawn.sum()) for confirmation in screened)
    wrong = sum(int((item.drawn & item.overturned).sum()) for item in screened)
    yield (
        f"{starts - confirmed:,} of {starts:,} starts judged by the equations, {confirmed:,} in "
        f"MuJoCo, all beside another outcome among them; it overturned {overturned}, and "
        f"{confirmation_words(drawn, wrong)}."
    )


def charts(region: RegionStudy, maps: Sequence[RegionMap]) -> list[list[GridChart]]:
    """Return a row of charts for each plant, a map for each law."""
    first, second = region.plane
    across = (first.title, shown(first.signal, first.limit)[0])
    up = (second.title, shown(second.signal, second.limit)[0])
    legend = [Letter(letter=x.letter, name=x.title, colour=x.colour) for x in Outcome]

    rows: dict[str, list[GridChart]] = {}
    for law_map in maps:
        law = f"{label_of(law_map.controller)}, {law_map.case.name}"
        chart = GridChart(
            name=f"{law}: {law_map.converged:.1f} % converge",
            axes=(across, up),
            grid=law_map.rows,
            legend=legend,
        )
        rows.setdefault(law_map.case.name, []).append(chart)
    return list(rows.values())


def write_region_figure(region: RegionStudy, maps: Sequence[RegionMap], path: Path) -> Path:
    """Draw the maps, plants below each other; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    title = in_lines(f"{region.system.title}: from where each law converges", 60)
    return write_panels(path, title, charts(region, maps))


def region_result(
    region: RegionStudy, maps: Sequence[RegionMap], *, complete: bool = True
) -> Result:
    """Return the result of a region; ``complete`` if it has every map."""
    system = region.system
    sheet = ReportTable(
        table=region_table(region, maps),
        charts=[chart for row in charts(region, maps) for chart in row],
        brief=True,
    )
    return result(
        "region",
        _configuration(region),
        answers=[_answer(region, maps, complete=complete)],
        sheets=[sheet],
        remarks=_remarks(region, maps),
        values=_values(system, maps),
        system=system.name,
        complete=complete,
        maps=[_map_document(law_map) for law_map in maps],
    )


def _configuration(region: RegionStudy) -> dict[str, Any]:
    settings = region.experiments[1].settings
    keys = ("case", "title", "source", "edits", "disturbances")
    cases = []
    for experiment in region.experiments:
        document = case_document(experiment)
        cases.append({key: document[key] for key in keys})
    return {
        "duration": {"value": region.duration, "unit": "s"},
        "points": region.points,
        "control_period": settings.control_period,
        "timestep": settings.timestep,
        "integrator": settings.integrator,
        "region": region.system.region,
        "axes": [_axis_document(axis) for axis in region.plane],
        "cases": cases,
    }


def _axis_document(axis: Axis) -> dict[str, Any]:
    return {
        "state": ascii_symbol(axis.signal),
        "unit": axis.signal.unit,
        "measures": "error" if axis.is_error else "state",
        "limit": axis.limit,
        "direction": axis.direction,
        "origin": axis.origin,
    }


def _answer(region: RegionStudy, maps: Sequence[RegionMap], *, complete: bool) -> Answer:
    """The share of the starts from which each law converges, on its worst plant."""
    by_law: dict[str, list[RegionMap]] = {}
    for law_map in maps:
        by_law.setdefault(law_map.controller, []).append(law_map)

    shares = []
    for law, maps_of_law in by_law.items():
        least = min(maps_of_law, key=lambda law_map: law_map.converged)
        share = f"{number(least.converged)} % of the starts in {least.case.name}"
        if least.converged == 100:
            share = "every start"
        shares.append(f"{law} converges from {share}")

    verdict = MEASURED
    words = "; ".join(shares)
    if not complete:
        verdict = OPEN
        words += ", so far"
    plants = dict.fromkeys(law_map.case.name for law_map in maps)
    return Answer(
        question=f"Region of {region.system.name}",
        verdict=verdict,
        words=words,
        more=f"the worst of {', '.join(plants)}",
    )


def _values(system: System, maps: Sequence[RegionMap]) -> Iterator[Value]:
    for law_map in maps:
        name = f"{system.name}/{law_map.case.name} {law_map.controller}"
        yield Value(
            name=f"{name}: starts that converge",
            value=law_map.converged,
            unit="%",
            better=1,
            relative=0.1,
        )


def _map_document(law_map: RegionMap) -> dict[str, Any]:
    return {
        "case": law_map.case.name,
        "controller": law_map.controller,
        "counts": {outcome.title: count for outcome, count in law_map.counts.items()},
        "judged_in_mujoco": law_map.confirmed,
        "overturned": law_map.overturned,
        "wrong_at_most": law_map.confirmation and law_map.confirmation.wrong_at_most,
        "grid": law_map.rows,
    }
