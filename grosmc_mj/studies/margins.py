"""Gain and delay that each law tolerates: by its task's requirements, and by its sensitivity."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.user_code import is_named, sources
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import input_limits
from grosmc_mj.loop import Loop
from grosmc_mj.machine import MachinePart
from grosmc_mj.margins.changes import DELAY, GAIN_DOWN, GAIN_UP
from grosmc_mj.margins.chatter import Chatter, chatter
from grosmc_mj.margins.frequency_response import Margins, interpolated
from grosmc_mj.margins.sensitivity import FEWEST, LEAVES, REALIZATIONS, Place, RunningLoop
from grosmc_mj.margins.task import Task, TaskMargin
from grosmc_mj.margins.together import disk_together
from grosmc_mj.margins.trust import measure_with_tests
from grosmc_mj.results.result import (
    MEASURED,
    OPEN,
    Answer,
    LineChart,
    ReportTable,
    Series,
    StudyVerdict,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, names, number, numbers, phrases, table, words
from grosmc_mj.simulation.disturbances import Table as Injected
from grosmc_mj.studies.cells import Cells, study_key
from grosmc_mj.studies.studied import (
    BENCH,
    MACHINE,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
    of_system,
)
from grosmc_mj.units import number_in

IDEAL = "ideal loop"
# Sizes of the injections, over the largest: half decades.
LEVELS = 10 ** np.linspace(-2, 0, 5)
# The largest injection, over the limit of the input or over the range of a state in its task.
_SHARE = 0.25
# Seed of the injected phases.
SEED = 0
LEGEND = (
    "gain down, gain up, delay: the largest change with which the task is kept, and the case that "
    "decides. The others by S at the plant's input; ±: standard error. ≥: nothing more was tried."
)
# |L| up to which a Nyquist plot goes, and from which a Bode plot begins.
_NYQUIST = 3.0
_LEAST = 0.01


@dataclass(frozen=True, eq=False)
class Setup:
    """A loop and a machine in which laws are studied.

    Attributes:
        target: SYSTEM/CASE.
        label: ``ideal loop``; empty for loop and machine of the case.
        case: The case as it is built.
        conditions: Plants and loads in this loop, the nominal one first.
        laws: The laws.
    """

    target: str
    label: str
    case: Experiment
    conditions: Sequence[Condition]
    laws: Sequence[StudiedLaw]

    @property
    def name(self) -> str:
        """Name for people."""
        return ", ".join(filter(None, (self.target, self.label)))

    @property
    def nominal(self) -> Experiment:
        """Experiment of the nominal plant in this loop."""
        return self.conditions[0].experiment

    @property
    def loop(self) -> Loop:
        """The loop."""
        return self.nominal.loop or Loop()

    @property
    def plant_name(self) -> PlantName:
        """The equations where they have all that the plant has, else physics."""
        if "corrected" in self.case.nominal.names and not self.nominal.parts:
            return "corrected"
        return self.case.nominal.truest

    def task(self, law: StudiedLaw, condition: Condition) -> Task:
        """Return the task of a law under a condition."""
        experiment = condition.experiment
        limits = limits_in(self.case.file.requirement, law, condition, [self.plant_name])
        return Task(
            condition.name,
            experiment,
            experiment.plant(self.plant_name),
            self.plant_name,
            law.controller,
            law.predict,
            judgeable_in(limits, self.loop, self.case.loop),
        )

    def running(self, law: StudiedLaw, loop: Loop) -> RunningLoop:
        """Return a law on the nominal plant, where its reference is kept.

        Raises:
            GrosmcError: If the law does not fit into the loop, or has no design.
        """
        experiment = self.nominal
        controller = law.controller
        error = controller.designed.error
        loops = [
            experiment.loop_around(controller, loop, predict=law.predict, run=run)
            for run in range(REALIZATIONS if loop.random else 1)
        ]
        return RunningLoop(
            plant=experiment.plant(self.plant_name),
            controller=controller,
            x0=error.rest(controller.parameters),
            control_period=experiment.settings.control_period,
            timestep=experiment.settings.timestep,
            loops=loops,
            moving=getattr(getattr(error, "reference", None), "moves", False),
            engine=experiment.settings.engine_for(controller),
        )


@dataclass(frozen=True, eq=False)
class MarginStudy:
    """A target, ready to be studied.

    Attributes:
        target: The target on the command line.
        setups: Its loops and machines.
        injection: Largest injection at an input [unit of the input]; 0 for a quarter of its limit.
        period: Period of the injections [s]; 0 for the length of the task.
    """

    target: str
    setups: Sequence[Setup]
    injection: float = 0.0
    period: float = 0.0

    @property
    def steps(self) -> list[tuple[Setup, StudiedLaw]]:
        """All setups with their laws."""
        return [(setup, law) for setup in self.setups for law in setup.laws]

    def places(self, setup: Setup) -> dict[Place, float]:
        """Return the largest injection at each place: inputs, then measured states.

        A measured state gets a share of its range in the nominal task under the first law.

        Raises:
            ArgumentError: If an input has no limit, or the injection is beyond it.
        """
        case = setup.case
        plant = case.plant(setup.plant_name)
        allowed = [limit.number for limit in case.limits if limit.of_actuators]
        largest: dict[Place, float] = {}
        for signal, limit in zip(plant.system.inputs, input_limits(plant, case)[1], strict=True):
            bound = float(min([limit, *allowed]))
            if self.injection > bound:
                raise ArgumentError(
                    f"--injection {self.injection:g} {signal.unit} is beyond the limit of "
                    f"{signal.name}, {bound:g} {signal.unit}"
                )
            largest[Place(signal.name)] = self.injection or _SHARE * bound
            if math.isinf(largest[Place(signal.name)]):
                raise ArgumentError(
                    f"{case.path}: {signal.name} has no limit to size an injection by: give it "
                    "an [[actuator]] with a limit, or the command an --injection"
                )

        measured = [sensor.of for sensor in case.loop.sensors] if case.loop else []
        for state, size in zip(plant.system.states, _ranges(setup), strict=True):
            if size > 0 and (state.name in measured or not measured):
                largest[Place(state.name, output=True)] = _SHARE * size
        return largest

    def configuration(self) -> dict[str, Any]:
        """Return the configuration that rows depend on."""
        setups = []
        for setup in self.setups:
            bases = [setup.case.file.law(law.base).law for law in setup.laws]
            content = {
                "setup": setup.name,
                "file": setup.case.document(),
                "sources": sources(filter(is_named, bases), setup.case.path.parent),
                "model": setup.nominal.plant(setup.plant_name).digest,
            }
            setups.append(content)
        return {
            "target": self.target,
            "injection": self.injection,
            "period": self.period,
            "setups": setups,
        }


def _ranges(setup: Setup) -> Array:
    """Range of each state in the nominal task under the first law, (n,)."""
    loop = setup.running(setup.laws[0], setup.loop)
    nothing = [Injected((0.0,), loop.control_period)]
    place = Place(loop.plant.system.inputs[0].name)
    started = replace(loop, x0=np.array(setup.nominal.x0))
    run = started.run(place, nothing, 0, setup.nominal.duration)
    return np.ptp(run.state[0], axis=0)


def margin_study(
    target: str,
    chosen: Sequence[str] = (),
    *,
    rivals: bool = False,
    injection: str = "",
    period: str = "",
) -> MarginStudy:
    """Return the loops and machines of a target: ideal loop, its loop, its machine.

    Args:
        target: A system, which means its bench and its machine, ``SYSTEM/CASE``, or the path of a
            case file.
        chosen: Names of laws; all by default.
        rivals: Whether the default includes the rivals.
        injection: Largest injection at an input with its unit; a quarter of the limit by default.
        period: Period of the injections with its unit; the length of the task by default.

    Raises:
        ArgumentError: If there is no such target or law, nothing is required, or a number has not
            the unit of the input.
    """
    case = case_for(target, BENCH)
    cases = [case]
    machine = of_system(case, MACHINE)
    if target == case.system and machine is not None:
        cases.append(machine)

    setups = []
    for built in cases:
        edits = tuple(edit for edit in built.edits if edit not in built.parts)
        bare = built.varied(loop=None, edits=edits)
        laws = chosen_laws(bare, chosen, rivals=rivals)
        if built is case:
            conditions = _in_loop(bare, Loop(), None, ())
            setups.append(Setup(built.target, IDEAL, built, conditions, laws))
        if built.loop is not None or built.parts:
            conditions = _in_loop(bare, built.loop or Loop(), built.known_loop, built.parts)
            setups.append(Setup(built.target, "", built, conditions, laws))

    largest = number_in(injection, case.nominal.system.inputs[0].unit) if injection else 0.0
    seconds = number_in(period, "s") if period else 0.0
    if (injection and largest <= 0) or (period and seconds <= 0):
        raise ArgumentError("--injection and --period must be positive")
    return MarginStudy(target, setups, largest, seconds)


def _in_loop(
    bare: Experiment, loop: Loop, known: Loop | None, parts: Sequence[MachinePart]
) -> list[Condition]:
    """Conditions of an experiment with a loop and the parts of a machine."""
    conditions = []
    for condition in conditions_of(bare):
        edits = (*condition.experiment.edits, *parts)
        changed = condition.experiment.varied(loop=loop, known_loop=known, edits=edits)
        conditions.append(replace(condition, experiment=changed))
    return conditions


# Runs: each law in each setup gives a row


class Level(BaseModel):
    """S at a place at one amplitude.

    Attributes:
        place: Name of the input or of the measured state.
        output: Whether it is a measured state.
        rms: Size of the injection.
        unit: Its unit.
        margins: Margins of the loop.
        errors: Their standard errors.
        doubt: Reason why they cannot be trusted; empty if they can.
        frequency: Frequencies of the lines that count [Hz], (lines,).
        real: Real part of S at all inputs, or all states, (lines, signals).
        imaginary: Imaginary part.
        index: Index of the place among the signals.
    """

    model_config = ConfigDict(frozen=True)
    place: str
    output: bool
    rms: float
    unit: str
    margins: Margins
    errors: Margins
    doubt: str
    frequency: list[float]
    real: list[list[float]]
    imaginary: list[list[float]]
    index: int

    @property
    def left(self) -> bool:
        """Whether the loop left its region."""
        return LEAVES in self.doubt

    @property
    def column(self) -> NDArray[np.complex128]:
        """S at all signals, (lines, signals)."""
        return np.array(self.real) + 1j * np.array(self.imaginary)


class LawMargins(BaseModel):
    """Margins of a law in a setup.

    Attributes:
        setup: Name of the setup.
        law: Name of the law.
        impossible: Why there can be no such run; empty if there can.
        refused: What breaks without any change, by the condition under which it does.
        task: Margins of the task.
        chatter: Where chatter begins; None of a law that does not switch.
        levels: S at all places and amplitudes.
    """

    model_config = ConfigDict(frozen=True)
    setup: str
    law: str
    impossible: str = ""
    refused: dict[str, str] = {}
    task: list[TaskMargin] = []
    chatter: Chatter | None = None
    levels: list[Level] = []

    @property
    def key(self) -> tuple[str, str]:
        """Key among all rows."""
        return self.setup, self.law

    def at(self, index: int) -> list[Level]:
        """S at each input at the amplitude of this index."""
        inputs = [level for level in self.levels if not level.output]
        return inputs[index :: len(LEVELS)]

    @property
    def trusted(self) -> list[int]:
        """Indices of the amplitudes that can be trusted at all inputs."""
        indices = range(len(LEVELS)) if self.levels else ()
        return [i for i in indices if not any(level.doubt for level in self.at(i))]


def cells_of(studied: MarginStudy, folder: Path) -> Cells[LawMargins]:
    """Return the finished rows of a study in a folder."""
    conditions = [condition for setup in studied.setups for condition in setup.conditions]
    return Cells(folder, LawMargins, study_key(studied.configuration(), conditions))


def law_margins(studied: MarginStudy, setup: Setup, law: StudiedLaw) -> LawMargins:
    """Search the margins of a law's task, and measure S at all places.

    Raises:
        SetupError: If the computer, not the law, is at fault.
        ArgumentError: If an injection cannot be sized, or the loop leaves its region under each.
    """
    row = LawMargins(setup=setup.name, law=law.name)
    places = studied.places(setup)
    try:
        running = setup.running(law, setup.loop)
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    refused: dict[str, str] = {}
    margins: list[TaskMargin] = []
    for condition in setup.conditions:
        task = setup.task(law, condition)
        (breaks,) = task.breaking([task.loop])
        if breaks:
            refused[condition.name] = breaks
        else:
            margins += task.margins()

    period = studied.period or setup.nominal.duration
    begins = None
    if law.controller.designed.switching:
        place, largest = next(iter(places.items()))
        size = largest / _SHARE
        begins = chatter(lambda loop: setup.running(law, loop), setup.loop, place, size, period)
    levels = []
    for place, largest in places.items():
        levels += [_level(running, place, period, rms) for rms in largest * LEVELS]
        if studied.injection and not place.output and levels[-1].left:
            raise ArgumentError(
                f"{setup.name}: the loop with {law.name} leaves its region under an injection of "
                f"{number(largest)} {levels[-1].unit} rms: give a smaller --injection"
            )
    update = {"refused": refused, "task": margins, "chatter": begins, "levels": levels}
    return row.model_copy(update=update)


def _level(running: RunningLoop, place: Place, period: float, rms: float) -> Level:
    """S at a place at one amplitude."""
    measured, doubt = measure_with_tests(running, place, period, rms, SEED)
    system = running.plant.system
    signals = system.states if place.output else system.inputs
    column = measured.column if measured.usable else np.zeros((0, len(signals)))
    counting = measured.counting if measured.usable else np.zeros(0, bool)
    return Level(
        place=place.name,
        output=place.output,
        rms=rms,
        unit=signals[measured.index].unit,
        margins=measured.margins,
        errors=measured.errors,
        doubt=doubt,
        frequency=measured.multisine.frequencies[: len(counting)][counting].tolist(),
        real=column[counting].real.tolist(),
        imaginary=column[counting].imag.tolist(),
        index=measured.index,
    )


# The answer: words, tables, charts, document


def shared_level(rows: Sequence[LawMargins]) -> int | None:
    """Return the lowest amplitude at which all laws that can be trusted somewhere can be.

    Args:
        rows: Rows of one setup.
    """
    lowest = [row.trusted[0] for row in rows if row.trusted]
    return max(lowest, default=None)


def _shown(row: LawMargins, shared: int | None) -> int | None:
    """Index of the amplitude that is shown of a law: the shared one, or its own lowest."""
    if not row.trusted or shared in row.trusted:
        return shared if row.trusted else None
    return row.trusted[0]


def margin_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return laws by margins of the task and of S at the plant's input.

    Args:
        setup: The setup.
        rows: Its rows.
    """
    shared = shared_level(rows)
    under = ", ".join(condition.name for condition in setup.conditions)
    title = f"{setup.name}: what the task tolerates ({under})"
    if shared is not None:
        (example, *_) = [row for row in rows if row.trusted]
        sizes = [f"{number(level.rms)} {level.unit}" for level in example.at(shared)]
        title += f", and S at {', '.join(sizes)} rms"

    several = len(setup.case.nominal.system.inputs) > 1
    columns = [*names("law"), *numbers(GAIN_DOWN, GAIN_UP, "delay\n[ms]")]
    columns += numbers("delay by\nS [ms]", "phase\n[°]", "disk")
    if several:
        columns += numbers("disk,\ntogether")
    columns += numbers("bandwidth\n[Hz]")

    cells = []
    for row in rows:
        law = row.law
        if row.refused:
            law += f" (not {', '.join(row.refused)})"
        cells.append([law, *_task_cells(setup, row), *_input_cells(row, shared, several)])
    return table(title, columns, cells)


def _task_cells(setup: Setup, row: LawMargins) -> list[str]:
    """Texts of the task's margins: gain down, gain up, delay."""
    return [_task_text(setup, row, kind) for kind in (GAIN_DOWN, GAIN_UP, DELAY)]


def worst_of_task(row: LawMargins, kind: str) -> TaskMargin | None:
    """Return the least margin of a kind over the conditions; None of a task that is not kept."""
    of_kind = [margin for margin in row.task if margin.kind == kind]
    return min(of_kind, key=lambda margin: margin.kept, default=None)


def _task_text(setup: Setup, row: LawMargins, kind: str) -> str:
    """The least margin of a kind, with the condition that decides if it is not the first one."""
    worst = worst_of_task(row, kind)
    if worst is None:
        return "-"
    text = _change_text(worst)
    if math.isfinite(worst.failed) and worst.condition != setup.conditions[0].name:
        text += f" {worst.condition}"
    return text


def _change_text(margin: TaskMargin) -> str:
    """The largest change that is kept: a factor, or milliseconds."""
    if margin.kind == GAIN_DOWN:
        text = f"1/{number(margin.kept)}"
    elif margin.kind == DELAY:
        text = number(1e3 * margin.kept)
    else:
        text = number(margin.kept)
    if math.isfinite(margin.failed):
        return text
    return f"≤{text}" if margin.kind == GAIN_DOWN else f"≥{text}"


def _input_cells(row: LawMargins, shared: int | None, several: bool) -> list[str]:
    """Texts of the margins by S at the inputs, of the input with the least disk margin."""
    shown = _shown(row, shared)
    count = 5 if several else 4
    if shown is None:
        return ["-"] * count

    levels = row.at(shown)
    worst = min(levels, key=lambda level: level.margins.disk)
    margins = worst.margins
    errors = worst.errors
    mark = "" if shown == shared else "*"
    cells = [
        _with_error(1e3 * margins.delay, 1e3 * errors.delay) + mark,
        _with_error(margins.phase, 0.0),
        _with_error(margins.disk, errors.disk),
    ]
    if several:
        cells.append(number(together(levels)))
    return [*cells, number(finite(margins.bandwidth))]


def _with_error(value: float, error: float) -> str:
    """A number with its standard error, if that is more than half a percent of it."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "∞"
    if not error > 0.005 * value:
        return number(value)
    return f"{number(value)}±{error:.1g}"


def together(levels: Sequence[Level]) -> float | None:
    """Return the disk margin of all inputs at once; None if they have too few lines in common.

    Args:
        levels: S at each input, at one amplitude.
    """
    common = set(levels[0].frequency)
    for level in levels:
        common &= set(level.frequency)
    if len(common) < FEWEST:
        return None

    columns = []
    for level in levels:
        shared = [frequency in common for frequency in level.frequency]
        columns.append(level.column[shared])
    return disk_together(np.stack(columns, axis=2))


def notes(rows: Sequence[LawMargins]) -> list[str]:
    """Return lines about laws: what breaks, chatter, and what cannot be trusted.

    Args:
        rows: Rows of one setup.
    """
    laws: dict[str, list[str]] = {}
    for row in rows:
        for note in _notes_of(row):
            laws.setdefault(note, []).append(row.law)
    return [f"{'; '.join(names)}: {note}" for note, names in laws.items()]


def _notes_of(row: LawMargins) -> Iterator[str]:
    if row.impossible:
        yield row.impossible
    if row.chatter is not None and row.chatter.at_rest:
        yield "chatters at rest; S tells how it answers slow signals"
    elif row.chatter is not None:
        gain = row.chatter.gain
        delay = row.chatter.delay
        begins = [f"gain {number(gain)}"] if math.isfinite(gain) else []
        begins += [f"delay {number(1e3 * delay)} ms"] if math.isfinite(delay) else []
        yield f"begins to chatter at {', '.join(begins)}" if begins else "does not chatter"
    if row.levels and not row.trusted:
        doubts = [level.doubt for level in row.at(len(LEVELS) - 1) if level.doubt]
        yield f"S is not trustworthy, because {(doubts or ['it is not at all inputs'])[0]}"


def level_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return the margins by S at every place and amplitude."""
    quantities = ("gain down", "gain up", "phase [°]", "delay [ms]", "modulus", "disk")
    columns = [
        *words("law", "injected at"),
        *numbers("rms", *quantities, "crossover [Hz]", "bandwidth [Hz]"),
        *phrases("not trustworthy, because"),
    ]
    cells = []
    for row in rows:
        for level in row.levels:
            scaled = [level.margins.delay * 1e3, level.errors.delay * 1e3]
            margins = level.margins._replace(delay=scaled[0])
            errors = level.errors._replace(delay=scaled[1])
            values = [_with_error(*pair) for pair in zip(margins, errors, strict=True)]
            rms = f"{number(level.rms)} {level.unit}"
            cells.append([row.law, level.place, rms, *values, level.doubt])
    return table(f"{setup.name}: S at each amplitude", columns, cells, grouped=True)


def task_table(setup: Setup, rows: Sequence[LawMargins]) -> Table:
    """Return the margins of the task under each condition, and what breaks."""
    cells = []
    for row in rows:
        for margin in row.task:
            kept = _change_text(margin)
            cells.append([row.law, margin.condition, margin.kind, kept, margin.breaks])
        for condition, breaks in row.refused.items():
            cells.append([row.law, condition, "as it is", "not kept", breaks])
    columns = words("law", "under", "change", "kept up to", "then breaks")
    return table(f"{setup.name}: the task under each condition", columns, cells, grouped=True)


def charts(setup: Setup, rows: Sequence[LawMargins]) -> list[LineChart]:
    """Return Bode and Nyquist plots of L at the first input, and the delay over amplitude."""
    shared = shared_level(rows)
    gains: list[Series] = []
    phases: list[Series] = []
    nyquist: list[Series] = []
    delays: list[Series] = []
    smallest: tuple[float, str] = (2.0, "")
    for row in rows:
        shown = _shown(row, shared)
        delays += _delay_series(row)
        if shown is None:
            continue

        level = row.at(shown)[0]
        loop = interpolated(level.frequency, level.column[:, level.index])
        seen = np.abs(loop.L) > _LEAST
        x = loop.frequency[seen].tolist()
        phase = np.mod(np.degrees(loop.phase[seen]), -360.0)
        gains.append(Series(name=row.law, x=x, y=np.abs(loop.L)[seen].tolist()))
        phases.append(Series(name=row.law, x=x, y=phase.tolist()))
        inside = loop.L[np.abs(loop.L) < _NYQUIST]
        nyquist.append(Series(name=row.law, x=inside.real.tolist(), y=inside.imag.tolist()))
        smallest = min(smallest, (level.margins.disk, row.law))

    if smallest[1]:
        nyquist.append(_disk(*smallest))
    unit = setup.case.nominal.system.inputs[0].unit
    frequency = "f [Hz]"
    return [
        LineChart(name=f"{setup.name}: gain", titles=(frequency, "|L|"), lines=gains, limit=1.0),
        LineChart(name="phase", titles=(frequency, "[deg]"), lines=phases, limit=-180.0),
        LineChart(name="Nyquist", titles=("Re L", "Im L"), lines=nyquist, equal=True),
        LineChart(
            name="delay margin; hollow: not trustworthy",
            titles=(f"injected [{unit} rms]", "[ms]"),
            lines=delays,
        ),
    ]


def _delay_series(row: LawMargins) -> list[Series]:
    """Delay margin over the amplitude at the first input, where there is one."""
    inputs = [level for level in row.levels if not level.output][: len(LEVELS)]
    finite_levels = [level for level in inputs if math.isfinite(level.margins.delay)]
    if not finite_levels:
        return []
    return [
        Series(
            name=row.law,
            x=[float(f"{level.rms:.3g}") for level in finite_levels],
            y=[1e3 * level.margins.delay for level in finite_levels],
            good=[not level.doubt for level in finite_levels],
        )
    ]


def _disk(disk: float, law: str) -> Series:
    """Disk that L of a law touches, of all with its shape about -1 the largest."""
    circle = disk * np.exp(1j * np.linspace(0, 2 * np.pi, 181)) / 2
    excluded = -(1 - circle) / (1 + circle)
    inside = excluded[np.abs(excluded) < _NYQUIST]
    name = f"disk {number(disk)} ({law})"
    return Series(name=name, x=inside.real.tolist(), y=inside.imag.tolist())


def sheets(studied: MarginStudy, rows: Sequence[LawMargins]) -> list[ReportTable]:
    """Return the tables of each setup, the first one with charts."""
    parts = []
    for setup in studied.setups:
        own = [row for row in rows if row.setup == setup.name]
        if own:
            parts.append(ReportTable(table=margin_table(setup, own), charts=charts(setup, own)))
            parts.append(ReportTable(table=task_table(setup, own)))
            parts.append(ReportTable(table=level_table(setup, own)))
    return parts


def _standings(rows: Sequence[LawMargins], *, complete: bool) -> Iterator[StudyVerdict]:
    for row in rows:
        breaks_at = ", ".join(row.refused)
        words = "; ".join(f"{condition}: {why}" for condition, why in row.refused.items())
        yield StudyVerdict(
            case=row.setup, law=row.law, breaks_at=breaks_at, words=words, complete=complete
        )


def _values(rows: Sequence[LawMargins]) -> Iterator[Value]:
    for row in rows:
        setup = row.setup.replace(",", "")
        for margin in row.task:
            name = f"{setup} {row.law} {margin.condition}: {margin.kind}"
            yield Value(name=name, value=margin.kept, better=1, relative=0.1)
        for level in row.levels:
            if not level.doubt:
                name = f"{setup} {row.law}, {level.place} {number(level.rms)}: disk margin"
                yield Value(name=name, value=finite(level.margins.disk), better=1, relative=0.1)


def margins_document(
    studied: MarginStudy, rows: Sequence[LawMargins], *, complete: bool
) -> dict[str, Any]:
    """Return the content of margins_NAME.json.

    Args:
        studied: The target.
        rows: Finished rows.
        complete: Whether nothing was interrupted.
    """
    answer = Answer(
        question=f"Margins of {studied.target}",
        verdict=MEASURED if complete else OPEN,
        words=verdict(rows),
        notes=[note for setup in studied.setups for note in notes(_rows_of(setup, rows))],
    )
    return result(
        "margins",
        studied.configuration(),
        seed=SEED,
        complete=complete,
        answers=[answer],
        standings=_standings(rows, complete=complete),
        sheets=sheets(studied, rows),
        values=_values(rows),
        target=studied.target,
        rows=[_row_document(row) for row in rows],
    )


def _rows_of(setup: Setup, rows: Sequence[LawMargins]) -> list[LawMargins]:
    return [row for row in rows if row.setup == setup.name]


def _row_document(row: LawMargins) -> dict[str, Any]:
    """A row as plain values, with the names of the margins."""
    levels = [
        {**level.model_dump(), "margins": level.margins._asdict(), "errors": level.errors._asdict()}
        for level in row.levels
    ]
    return {
        **row.model_dump(),
        "task": [margin._asdict() for margin in row.task],
        "chatter": row.chatter and row.chatter._asdict(),
        "levels": levels,
    }


def verdict(rows: Sequence[LawMargins]) -> str:
    """Return one sentence about the last setup: the laws with the least and the largest delay."""
    last = [row for row in rows if row.setup == rows[-1].setup]
    delays = {row.law: worst.kept for row in last if (worst := worst_of_task(row, DELAY))}
    if not delays:
        return f"{last[0].setup}: no law keeps its task."
    least = min(delays, key=delays.__getitem__)
    most = max(delays, key=delays.__getitem__)
    sentence = f"{last[0].setup}: {least} tolerates {number(1e3 * delays[least])} ms more delay"
    if most != least:
        sentence += f", {most} {number(1e3 * delays[most])} ms"
    return f"{sentence}."
