"""From which starts a law converges: maps of two axes to outcomes, confirmed in MuJoCo."""

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
from grosmc_mj.control.law import Law, around
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case, case_document
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
    Sheet,
    Value,
    result,
)
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.sweep.agreement import model_mismatch
from grosmc_mj.sweep.runs import Outcomes, Row, run_rows

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
# Runs are looked at after these parts of the duration; those that have been decided end there.
# Most that leave the region do so in the first look.
_LOOKS = (1 / 16, 1 / 4, 1.0)
# To count as converged before the end, errors must be within this part of their tolerances.
_EARLY = 0.25
# Of the starts away from boundaries this part is confirmed, drawn at random.
_RANDOM = 0.02
# An implicit step evaluates the physics once, RK4 four times. On 256 starts of each map of the
# pendulum both give the same outcome but for up to two on a boundary.
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
        self.letter, self.title, self.colour = letter, title, colour


# By the status of a run. No law of the package ends with an undefined input while its state is
# bounded.
_ENDED_EARLY = {
    "undefined_law": Outcome.LEFT,
    "singular_plant": Outcome.SINGULAR,
    "diverged": Outcome.DIVERGED,
    "undefined_input": Outcome.DIVERGED,
}


def judge(status: Iterable[str], errors: Array, tolerance: ArrayLike) -> Letters:
    """The outcomes of runs of a guarded law, as letters.

    Args:
        status: How each run ended, as of ``Outcomes``, (nsim,).
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
        return cls(experiment, guarded(law, experiment.nominal.system), experiment.plant("physics"))

    @property
    def system(self) -> System:
        """The plant's system."""
        return self.experiment.nominal.system

    def run(self, starts: Array, duration: float) -> Outcomes:
        """The runs from the starts (nsim, n)."""
        # The guard is around the law in its loop.
        case = replace(self.experiment.case, loop=None, duration=duration)
        rows = [
            Row(self.controller, case=replace(case, x0=tuple(start)), plant=self.plant)
            for start in starts.tolist()
        ]
        return run_rows(self.experiment, rows, ())

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
        runs, last = loop.run(starts[undecided], look * duration), look == looks[-1]
        errors = loop.errors(look * duration, runs["last"])
        ends = judge(runs["status"], errors, tolerance if last else _EARLY * tolerance)
        decided = (ends != Outcome.CONVERGED.letter) | last | early[undecided]
        letters[undecided[decided]] = ends[decided]
    return letters


# The design: starts on two axes


@dataclass(frozen=True)
class Axis:
    """One axis: a state, or the error that is measured on it.

    Attributes:
        state: Index of the state.
        signal: The state's name, symbol and unit.
        limit: Starts lie between minus this and this, in the state's unit.
        direction: How the state moves with the axis: -1 for an error y_r - y.
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
        """With symbol and unit; degrees for angles."""
        name = f"error of {self.signal.name}" if self.is_error else self.signal.name
        return f"start {name} {self.signal.symbol} [{shown(self.signal, 0.0)[1]}]"

    def cells(self, count: int) -> Array:
        """Centres of equal cells from minus to plus the limit."""
        return self.limit * ((2 * np.arange(count) + 1) / count - 1)


def shown(signal: Signal, value: float) -> tuple[float, str]:
    """A value of a signal for people, and its unit: degrees for angles."""
    return (math.degrees(value), "°") if signal.unit == "rad" else (value, signal.unit)


def ascii_symbol(signal: Signal) -> str:
    """The symbol as on the command line: θ̇ as theta_dot, q₁ as q1."""
    words, dots = "", ""
    for character in unicodedata.normalize("NFD", signal.symbol):
        name = unicodedata.name(character)
        if name == "COMBINING DOT ABOVE":
            dots = "_dot"
        elif character.isdigit():
            words += str(unicodedata.digit(character))
        else:
            words += character if character.isascii() else name.split()[-1].lower()
    return words + dots


def choose_axes(
    loop: RegionLoop,
    names: tuple[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> tuple[Axis, Axis]:
    """Two axes: the named states, or the first regulated state and its rate.

    Args:
        loop: Whose errors the axes are.
        names: Two states by symbol, as ``theta`` and ``theta_dot``.
        limits: Largest start on each axis, in degrees or the state's unit; instead of ``LIMITS``.

    Raises:
        ArgumentError: If a state is unknown or named twice, or of a unit without a limit.
    """
    system, keys = loop.system, [ascii_symbol(state) for state in loop.system.states]
    for name in names or ():
        require_known(f"state of {system.name}", name, dict.fromkeys(keys))
    first = loop.regulated[0]
    chosen = [keys.index(x) for x in names] if names else [first, first + system.degrees_of_freedom]
    if chosen[0] == chosen[1]:
        raise ArgumentError(
            f"axes {', '.join(keys[i] for i in chosen)} must be two different states of "
            f"{system.name}: {', '.join(keys)}"
        )

    def axis(state: int, limit: float | None) -> Axis:
        signal, is_error = system.states[state], state in loop.regulated
        if limit is None:
            require_known(f"unit of an axis, of {keys[state]},", signal.unit, LIMITS)
            limit = LIMITS[signal.unit]
        elif signal.unit == "rad":
            limit = math.radians(limit)
        row = loop.sensitivity[loop.regulated.index(state)] if is_error else np.ones(state + 1)
        return Axis(
            state, signal, limit, float(row[state]), float(loop.equilibrium[state]), is_error
        )

    across, up = limits or (None, None)
    return axis(chosen[0], across), axis(chosen[1], up)


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
        pairs = [(axis.signal, *shown(axis.signal, wrong[0][axis.state])) for axis in axes]
        values = ", ".join(f"{signal.symbol} = {value:.4g} {unit}" for signal, value, unit in pairs)
        raise ArgumentError(
            f"{len(wrong)} of {len(starts)} starts, as {values}, lie outside {system.region}, "
            "where law and plant are defined: lower the limits of the axes"
        )
    return starts


# The reduction: maps on equations, their boundaries confirmed in MuJoCo


def confirmed_map(first: Letters, confirm: Callable[[Mask], Letters]) -> tuple[Letters, int]:
    """Confirm every start beside another outcome, and some of the others.

    Of an outcome that MuJoCo overturns every neighbour is confirmed: one that the equations told
    apart from it was beside another outcome before, any other one is beside another outcome now.

    Args:
        first: Outcomes by the equations, (rows, columns).
        confirm: The outcomes in MuJoCo of some starts, in the order of the map.

    Returns:
        The outcomes, (rows, columns), and how many of them are MuJoCo's.
    """
    letters, confirmed = first.copy(), np.zeros(first.shape, bool)
    chosen = beside_another(first)
    drawn = np.random.default_rng(0).permutation(first.size)[: math.ceil(_RANDOM * first.size)]
    chosen.reshape(-1)[drawn] = True
    while np.any(new := chosen & ~confirmed):
        letters[new] = confirm(new)
        confirmed |= new
        chosen = beside_another(letters)
    return letters, int(confirmed.sum())


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
        confirmed: Starts that MuJoCo judged, of all.
        overturned: Those of them for which the equations gave another outcome.
    """

    case: Case
    controller: str
    grid: Letters
    confirmed: int = 0
    overturned: int = 0

    @property
    def counts(self) -> dict[Outcome, int]:
        """Starts with each outcome."""
        letters = Counter(self.grid.ravel().tolist())
        return {outcome: letters[outcome.letter] for outcome in Outcome}

    @property
    def converged(self) -> float:
        """Share of the starts that converges [%]."""
        return 100 * self.counts[Outcome.CONVERGED] / self.grid.size

    @property
    def rows(self) -> list[str]:
        """A string for each value of the second axis, from the lowest."""
        return ["".join(row) for row in self.grid.tolist()]


@checked(eq=False)
class Region:
    """The maps of one system: every law, on the nominal and on the perturbed plant.

    Attributes:
        target: Name of the system; or an experiment, ``SYSTEM/CASE`` or the path of a case file.
        points: Starts along each axis.
        duration: Of each run [s].
        axes: Two states by symbol; None for the controlled position and its rate.
        limits: Largest start on each axis, in degrees or the state's unit; None for the default.
        controllers: Laws by name; none for those that validate runs.

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
        perturbed = _perturbed(self.target, self.duration).with_settings(integrator=INTEGRATOR)
        calm = {"name": "nominal", "title": "nothing is changed", "edits": (), "disturbances": ()}
        return [perturbed.varied(**calm), perturbed]

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
    def starts(self) -> Array:
        """The starts of a map row by row, (nsim, n)."""
        first, second = np.meshgrid(*(axis.cells(self.points) for axis in self.plane))
        return starts_on(self.loops[0], self.plane, first.ravel(), second.ravel())

    @property
    def batches(self) -> int:
        """Batches of all maps, for a progress bar."""
        return len(self.loops) * math.ceil(len(self.starts) / BATCH)

    @cached_property
    def why_not(self) -> dict[str, str]:
        """Why no map of a case is made on equations, by its name; empty where they are."""
        return {x.case.name: model_mismatch(x.plant("physics")) for x in self.experiments}

    def maps(self, advance: Callable[[str], object] = lambda _: None) -> Iterator[RegionMap]:
        """Compute the maps, one by one; ``advance`` is called after each batch."""
        for physics in self.loops:
            case, law, loop = physics.experiment.case, physics.controller.name, physics
            if screened := not self.why_not[case.name]:
                loop = replace(physics, plant=physics.plant.analytic())
            letters = self._outcomes(loop, self.starts, partial(advance, f"{case.name}/{law}"))
            grid = first = letters.reshape(self.points, -1)
            confirmed = grid.size
            if screened:
                grid, confirmed = confirmed_map(first, partial(self._some_outcomes, physics))
            yield RegionMap(case, law, grid, confirmed, int((grid != first).sum()))

    def _some_outcomes(self, loop: RegionLoop, chosen: Mask) -> Letters:
        """The outcomes of some starts of a map."""
        return self._outcomes(loop, self.starts[chosen.reshape(-1)])

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
    """A row a map, from the fewest starts that converge on, with what its words mean."""
    rows = []
    for law_map in sorted(maps, key=lambda law_map: law_map.converged):
        _, *others = law_map.counts.values()
        name = (law_map.case.name, law_map.controller)
        rows.append([*name, f"{law_map.converged:.1f}", *map(str, others)])
    titles = ("\n".join(outcome.title.rsplit(" ", 1)) for outcome in list(Outcome)[1:])
    columns = [*words("plant", "law"), *numbers("converged\n%", *titles)]
    title = f"{region.system.title}: outcomes of the starts"
    return table(title, columns, rows, legend=_legend(region, maps))


def _legend(region: Region, maps: Sequence[RegionMap]) -> str:
    """Which engine judged the starts, and what the words of the table mean."""
    starts, confirmed = (sum(x.grid.size for x in maps), sum(x.confirmed for x in maps))
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
        f"{sum(x.overturned for x in maps)}. "
    )
    return (judged if confirmed < starts else "") + (
        f"converged: {' and '.join(bounds)} after {region.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region})."
    )


def charts(region: Region, maps: Sequence[RegionMap]) -> list[list[GridChart]]:
    """A row for each plant, a map for each law."""
    across, up = ((axis.title, shown(axis.signal, axis.limit)[0]) for axis in region.plane)
    letters = [Letter(letter=x.letter, name=x.title, colour=x.colour) for x in Outcome]

    def chart(law_map: RegionMap) -> GridChart:
        law = f"{label_of(law_map.controller)}, {law_map.case.name}"
        name = f"{law}: {law_map.converged:.1f} % converge"
        return GridChart(name=name, axes=(across, up), grid=law_map.rows, legend=letters)

    cases = dict.fromkeys(law_map.case.name for law_map in maps)
    return [[chart(x) for x in maps if x.case.name == case] for case in cases]


def write_region_figure(region: Region, maps: Sequence[RegionMap], path: Path) -> Path:
    """Draw the maps, plants below each other; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    title = in_lines(f"{region.system.title}: from where each law converges", 60)
    return write_panels(path, title, charts(region, maps))


def region_document(
    region: Region, maps: Sequence[RegionMap], *, complete: bool = True
) -> dict[str, Any]:
    """The content of region_SYSTEM.json; ``complete`` if it has every map."""
    settings, system = region.experiments[1].settings, region.system
    keys = ("case", "title", "source", "edits", "disturbances")
    documents = [case_document(experiment.case) for experiment in region.experiments]
    shares = {}
    for law in dict.fromkeys(law_map.controller for law_map in maps):
        least = min((x for x in maps if x.controller == law), key=lambda x: x.converged)
        part = f"{number(least.converged)} % of the starts in {least.case.name}"
        shares[law] = "every start" if least.converged == 100 else part
    answer = "; ".join(f"{law} converges from {share}" for law, share in shares.items())
    return result(
        "region",
        {
            "duration": {"value": region.duration, "unit": "s"},
            "points": region.points,
            "control_period": settings.control_period,
            "timestep": settings.timestep,
            "integrator": settings.integrator,
            "region": system.region,
            "axes": [
                {
                    "state": ascii_symbol(axis.signal),
                    "unit": axis.signal.unit,
                    "measures": "error" if axis.is_error else "state",
                    "limit": axis.limit,
                    "direction": axis.direction,
                    "origin": axis.origin,
                }
                for axis in region.plane
            ],
            "cases": [{key: content[key] for key in keys} for content in documents],
        },
        answers=[
            Answer(
                question=f"Region of {system.name}",
                verdict=MEASURED if complete else OPEN,
                words=answer if complete else f"{answer}, so far",
                more=f"the worst of {', '.join(dict.fromkeys(x.case.name for x in maps))}",
            )
        ],
        sheets=[
            Sheet(
                table=region_table(region, maps),
                charts=[chart for row in charts(region, maps) for chart in row],
            )
        ],
        values=[
            Value(
                name=f"{system.name}/{x.case.name} {x.controller}: starts that converge",
                value=x.converged, unit="%", better=1, relative=0.1,
            )
            for x in maps
        ],
        system=system.name,
        complete=complete,
        maps=[
            {
                "case": x.case.name,
                "controller": x.controller,
                "counts": {outcome.title: count for outcome, count in x.counts.items()},
                "judged_in_mujoco": x.confirmed,
                "overturned": x.overturned,
                "grid": x.rows,
            }
            for x in maps
        ],
    )  # fmt: skip
