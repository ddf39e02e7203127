"""The rung on which each law breaks, from its equations up to the machine as built."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, computed_field

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.experiments.experiment import Experiment, RunResult, run_on
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.file.user_code import is_named, named_in, sources
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.films.film import MOST_TAKES, Film, Format
from grosmc_mj.loop import Computing, Loop
from grosmc_mj.machine import (
    DriveFriction,
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.requirements.judging import judge_run
from grosmc_mj.results.charts import cell_charts
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    StudyVerdict,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.cells import Cells, study_key
from grosmc_mj.studies.studied import (
    MACHINE,
    UNDER_LOAD,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
)

# Stands for the requirement that breaks first of a run that ended early.
ENDED = "the run ended"
STANDS = "stands"
LEGEND = (
    "How much of the tightest limit is used; above 1 it is not kept. ended: the run ended early; "
    "never: it does not settle; -: there is no such law."
)
NOTE = (
    f"{LEGEND} Green: every requirement is met; the redder, the further beyond a limit. *: rests "
    "on assumptions."
)
CLAIMS = "Rung on which each claim fails"
_TITLES = {
    True: "Rungs added one by one",
    False: "Each alone on the sampled plant",
}
# Decades beyond a limit in a chart.
_MOST = 2.0
_COMPUTING = {"delay": "delay", "jitter": "jitter", "missed": "missed samples"}
# The numbers of each rung: tables of a case file, and the keys in them; None for all keys.
_TABLES: Mapping[str, tuple[Sequence[str], Collection[str] | None]] = {
    "sensors": (("sensor", "estimator"), None),
    **{name: (("computing",), (key,)) for key, name in _COMPUTING.items()},
    "actuator": (("actuator",), None),
    "motor": (("motor",), None),
    "friction": (("lugre", "drive_friction"), None),
    "backlash": (("transmission",), ("backlash", "friction")),
    "flexibility": (("transmission",), ("stiffness", "damping", "inertia")),
    "loads": (("swinging_load", "sliding_load"), None),
    "stops": (("stop", "wall"), None),
}
# Keys of a case file's tables that name the owner of a part.
_OWNERS = ("of", "joint", "input", "body")
# Share of a run that is its end.
_END = 0.2
# Fewer swings than these are no cycle.
_SWINGS = 3
# A number that may be infinite, for which JSON has null.
Unlimited = Annotated[float, BeforeValidator(lambda x: math.inf if x is None else x)]


class RungResult(BaseModel):
    """Result of a law on a rung; None for a number that the run does not have.

    Attributes:
        law: Name of the law.
        rung: Name of the rung.
        together: Whether all rungs below count too.
        condition: Name of the condition.
        share_of_the_tightest_limit: Above 1 it is not kept; infinite with nothing to measure.
        tightest: The requirement with the tightest limit, or how the run ended.
        shares: The share used of each limit.
        amplitude: Half of the range of the error in the end, in its unit.
        frequency: Its swings a second [Hz].
        variation: Total variation of the input a second.
        deviation: Largest distance from the nominal optimum of a law that follows it.
        optimum_settles: Settling time of the nominal optimum, if the law does not settle in time
            [s].
        impossible: Why such a run cannot exist.
        claims: The share used of the limits of each claim about this law, by its id; above 1 it has
            fallen.
    """

    model_config = ConfigDict(frozen=True)
    law: str
    rung: str
    together: bool
    condition: str
    share_of_the_tightest_limit: Unlimited = math.inf
    tightest: str = ""
    shares: dict[str, Unlimited] = {}
    amplitude: float | None = None
    frequency: float | None = None
    variation: float | None = None
    deviation: float | None = None
    optimum_settles: float | None = None
    impossible: str | None = None
    claims: dict[str, Unlimited] = {}

    @computed_field
    @property
    def kept(self) -> bool:
        """Whether all requirements are kept."""
        return self.share_of_the_tightest_limit <= 1 and not self.impossible

    @property
    def key(self) -> tuple[str, str, str, bool]:
        """Key among all rows: law, rung, condition, together."""
        return self.law, self.rung, self.condition, self.together

    @property
    def share_text(self) -> str:
        """The share of the tightest limit that is used, or why there is no number."""
        if self.impossible:
            return "-"
        if self.tightest == ENDED:
            return "ended"
        share = self.share_of_the_tightest_limit
        if math.isinf(share):
            return "never"
        if share > 1:
            return f"{number(share)}x"
        return number(share)

    @property
    def reason(self) -> str:
        """The requirement that breaks, and by how much, in words."""
        if self.impossible:
            return self.impossible
        if self.tightest == ENDED:
            return ENDED

        share = self.share_of_the_tightest_limit
        excess = f"{number(share)} times"
        if math.isinf(share):
            excess = "never"
        if number(share) == "1":
            excess = "at its limit"
        words = f"{self.tightest.replace('_', ' ')}: {excess}"
        if self.optimum_settles is not None:
            words += f" (the nominal optimum needs {number(self.optimum_settles)} s)"
        return words


# The design: rungs


@dataclass(frozen=True)
class Rung:
    """A plant with a part of the loop and of the machine.

    Attributes:
        name: Name for people.
        plant: ``printed``, ``corrected`` or ``physics``.
        sampled: Whether the law has its own control period; else it runs at every timestep.
        loop: Part of the loop as built.
        parts: Parts of the machine as built.
        assumed: Numbers that this rung adds and that nobody has published, in words.
    """

    name: str
    plant: PlantName
    sampled: bool = True
    loop: Loop = field(default_factory=Loop)
    parts: tuple[MachinePart, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def looped(self) -> bool:
        """Whether any part of the loop is not ideal."""
        return self.loop != Loop(seed=self.loop.seed)

    @property
    def title(self) -> str:
        """The name, with a mark where it rests on numbers that nobody has published."""
        return f"{self.name}*" if self.assumed else self.name

    def document(self) -> dict[str, Any]:
        """Return it as plain values."""
        loop = asdict(self.loop) if self.looped else None
        parts = [{"kind": part.kind, **asdict(part)} for part in self.parts]
        return {**vars(self), "loop": loop, "parts": parts}


def rungs_of(machine: Experiment) -> tuple[list[Rung], list[Rung]]:
    """Return the rungs of a machine: one on top of the other, and each part alone.

    Args:
        machine: A case with its loop and the parts of its machine; a missing part makes no rung.
    """
    plants = machine.nominal.names
    climbing = [Rung(plant, plant, sampled=False) for plant in plants]
    climbing.append(Rung("sampled", plants[-1]))

    alone: list[Rung] = []
    for name, loop, parts in _additions(machine):
        rung = Rung(
            name,
            plants[-1],
            loop=loop or Loop(),
            parts=parts,
            assumed=tuple(_assumed(machine, name)),
        )
        alone.append(rung)

        # On top, a part replaces the part of its type on the same joint or input.
        below = climbing[-1]
        replaced = {(type(part), part.of) for part in parts}
        kept = [part for part in below.parts if (type(part), part.of) not in replaced]
        all_of_loop = below.loop
        if loop is not None:
            all_of_loop = _merged(below.loop, loop)
        climbing.append(replace(rung, loop=all_of_loop, parts=(*kept, *parts)))
    return climbing, alone


def _assumed(machine: Experiment, rung: str) -> Iterator[str]:
    """Yield the numbers that a rung adds and nobody has published, by the part that has them."""
    kinds, keys = _TABLES[rung]
    for kind in kinds:
        tables = getattr(machine.file, kind)
        if not isinstance(tables, list):
            tables = [tables]
        for entry in tables:
            assumed = [name for name in entry.assumed if keys is None or name in keys]
            if assumed:
                yield f"{_owner(entry, kind)}: {', '.join(assumed)}"


def _owner(entry: Any, kind: str) -> str:
    """The state, joint, input or body that a part of the file is of; else its kind."""
    for key in _OWNERS:
        if hasattr(entry, key):
            owner = getattr(entry, key)
            if isinstance(owner, str):
                return owner
            return " and ".join(owner)
    return kind


def _additions(machine: Experiment) -> Iterator[tuple[str, Loop | None, tuple[MachinePart, ...]]]:
    """Yield the additions in the order of the ladder: a name, and a part of loop or machine."""
    loop = machine.loop
    if loop:
        for name, part in _loop_additions(loop):
            yield name, part, ()
    for name, parts in _machine_additions(machine.parts):
        if parts:
            yield name, None, tuple(parts)


def _loop_additions(loop: Loop) -> Iterator[tuple[str, Loop]]:
    """Yield the parts of a loop that are not ideal, each as a loop."""
    seed = loop.seed
    if loop.sensors or loop.estimators:
        yield "sensors", Loop(sensors=loop.sensors, estimators=loop.estimators, seed=seed)
    for key, name in _COMPUTING.items():
        amount = getattr(loop.computing, key)
        if amount:
            yield name, Loop(Computing(**{key: amount}), seed=seed)
    if loop.actuators:
        yield "actuator", Loop(actuators=loop.actuators, seed=seed)


def _machine_additions(parts: Sequence[MachinePart]) -> Iterator[tuple[str, list[MachinePart]]]:
    """Yield the parts of a machine by rung; a transmission is rigid on the rung of its backlash."""
    gears = [part for part in parts if isinstance(part, Transmission)]
    yield "motor", [part for part in parts if isinstance(part, Motor)]
    yield "friction", [part for part in parts if isinstance(part, (LuGre, DriveFriction))]
    yield "backlash", [replace(gear, stiffness=math.inf) for gear in gears if gear.backlash]
    yield "flexibility", [gear for gear in gears if math.isfinite(gear.stiffness)]
    yield "loads", [part for part in parts if isinstance(part, (SwingingLoad, SlidingLoad))]
    yield "stops", [part for part in parts if isinstance(part, (Stop, Wall))]


def _merged(below: Loop, added: Loop) -> Loop:
    """Two loops that have different kinds of parts, as one."""
    computing = {name: value for name, value in vars(added.computing).items() if value}
    return Loop(
        replace(below.computing, **computing),
        below.sensors or added.sensors,
        below.estimators or added.estimators,
        below.actuators or added.actuators,
        added.seed,
    )


@dataclass(frozen=True, eq=False)
class Ladder:
    """A target, ready to be climbed.

    Attributes:
        experiment: Experiment of the target, without loop and machine.
        machine: Experiment of the target, with both.
        laws: Laws that climb.
        climbing: Rungs, each with all rungs below it.
        alone: Rungs, each alone on a sampled plant.
        conditions: Plants and loads, the file's own first.
        statements: Statements of the chapter, by the ids of the file's claims.
    """

    experiment: Experiment
    machine: Experiment
    laws: Sequence[StudiedLaw]
    climbing: Sequence[Rung]
    alone: Sequence[Rung]
    conditions: Sequence[Condition]
    statements: Mapping[str, str] = field(default_factory=dict)

    def steps(self) -> Iterator[tuple[StudiedLaw, Rung, Condition, bool]]:
        """Yield all runs; the last entry says whether all rungs below count too."""
        for law in self.laws:
            for condition in self.conditions:
                for rung in self.climbing:
                    yield law, rung, condition, True
                if condition is self.conditions[0]:
                    for rung in self.alone:
                        yield law, rung, condition, False

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.machine.system}/{self.machine.name}"

    @property
    def units(self) -> tuple[str, str]:
        """Units of the output and of the input."""
        error = self.laws[0].controller.designed.error
        output = error.units[error.output_rows[0]]
        return output, self.experiment.nominal.system.input.unit

    def configuration(self) -> dict[str, Any]:
        """Return the configuration that rows depend on, as the result has it."""
        settings = self.experiment.settings
        file = self.machine.file
        named = [*named_in(file), *(file.law(law.base).law for law in self.laws)]
        return {
            "target": self.target,
            "title": self.machine.title,
            "model": self.experiment.plant(self.experiment.nominal.truest).digest,
            "sources": sources(filter(is_named, named), self.machine.path.parent),
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "integrator": settings.integrator,
            "file": self.machine.document(),
        }


def ladder(
    target: str,
    chosen: Sequence[str] = (),
    *,
    loaded: bool = False,
    rivals: bool = False,
) -> Ladder:
    """Return the ladder of a target.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        loaded: Whether laws climb under every condition; else as the file says, with its own edits
            and disturbances.
        rivals: Whether the default includes the rivals.

    Raises:
        ArgumentError: If there is no such target or law, neither loop nor machine, or nothing is
            required.
    """
    machine = case_for(target, MACHINE)
    edits = tuple(edit for edit in machine.edits if edit not in machine.parts)
    bare = machine.varied(loop=None, edits=edits)
    climbing, alone = rungs_of(machine)
    if not alone:
        raise ArgumentError(
            f"{machine.path}: there is nothing to climb to: give the file a loop ([computing], "
            "[[sensor]], [[actuator]]) or a machine ([[motor]], [[lugre]], [[transmission]], "
            "[[stop]])"
        )

    conditions = sorted(conditions_of(bare), key=lambda condition: condition.name != UNDER_LOAD)
    if not loaded:
        conditions = conditions[:1]
    return Ladder(
        experiment=bare,
        machine=machine,
        laws=chosen_laws(bare, chosen, rivals=rivals),
        climbing=climbing,
        alone=alone,
        conditions=conditions,
    )


def cells_of(studied: Ladder, folder: Path) -> Cells[RungResult]:
    """Return the finished rows of a ladder in a folder."""
    return Cells(folder, RungResult, study_key(studied.configuration(), studied.conditions))


# Runs: each gives a row


def run_rung(
    studied: Ladder,
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
    *,
    together: bool,
) -> RungResult:
    """Run a law on a rung and judge the run.

    Raises:
        SetupError: If the computer, not the law, is at fault.
    """
    row = RungResult(law=law.name, rung=rung.name, together=together, condition=condition.name)
    try:
        run = run_of(studied, law, rung, condition)
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    limits = limits_in(studied.experiment.file.requirement, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.loop)
    shares = {limit.name: judge_run(limit, run).share for limit in limits}
    claims = _shares_of_claims(studied.machine, law, condition, run)
    row = row.model_copy(update={"shares": shares, "claims": claims, "tightest": ENDED})
    if run.ended:
        return row

    tightest = max(shares, key=lambda key: shares[key], default="")
    share = shares.get(tightest, 0.0)
    optimum_settles = None
    if share > 1:
        broken = next(limit for limit in limits if limit.name == tightest)
        optimum = broken.of_optimum(run)
        optimum_settles = None if optimum is None else optimum.value
    deviation = None
    if law.controller.designed.follows_optimum:
        deviation = run.metrics["deviation"].value

    amplitude, frequency = oscillation(run.comparison.time, run.comparison.error)
    measured = {
        "share_of_the_tightest_limit": share,
        "tightest": tightest,
        "amplitude": amplitude,
        "frequency": frequency,
        "variation": run.metrics["total_variation"].value,
        "deviation": deviation,
        "optimum_settles": optimum_settles,
    }
    return row.model_copy(update=measured)


def run_of(
    studied: Ladder,
    law: StudiedLaw,
    rung: Rung,
    condition: Condition,
) -> RunResult:
    """Run a law on a rung.

    Raises:
        GrosmcError: If the law cannot be designed or put into the loop.
    """
    bare = condition.experiment
    timestep = bare.settings.timestep
    if not rung.sampled:
        bare = bare.with_settings(control_period=timestep)

    controller = bare.with_settings(**law.sampled).law(rung.plant, law.base)
    loop = None
    if rung.looped:
        loop = bare.loop_around(controller, rung.loop, predict=law.predict)
    built = bare.varied(edits=(*bare.edits, *rung.parts))
    return run_on(built, rung.plant, controller, built.plant(rung.plant), loop)


def _shares_of_claims(
    machine: Experiment, law: StudiedLaw, condition: Condition, result: RunResult
) -> dict[str, float]:
    """The largest share of each claim's limits that a run uses, infinite if it ended early.

    Claims about other laws or conditions, and those that a run of this length cannot decide, are
    left out.
    """
    shares: dict[str, float] = {}
    for claim in machine.file.claim:
        if claim.under != condition.name or not _is_about(machine, claim, law):
            continue
        for limit in limits_in([claim], law, condition, [result.plant]):
            share = judge_run(limit, result).share
            shares[claim.id] = max(share, shares.get(claim.id, share))
    return shares


def _is_about(machine: Experiment, claim: ClaimTable, law: StudiedLaw) -> bool:
    """Whether a claim is about a law, however that law switches."""
    bases = {controller.called: controller.law for controller in machine.file.controller}
    names = claim.of or machine.controllers
    return law.base in names or law.base in [bases.get(name, name) for name in names]


def oscillation(time: Array, signal: Array) -> tuple[float, float | None]:
    """Return amplitude and frequency of a signal in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: The signal, (N,).

    Returns:
        Half of its range, in its unit, and its swings a second [Hz]; None for no cycle.
    """
    tail = signal[-max(2, round(_END * len(signal))) :]
    about = tail - tail.mean()
    amplitude = float(np.ptp(tail) / 2)

    # A crossing of the mean counts once it is left by a tenth of the amplitude.
    side = np.sign(about)[np.abs(about) > 0.1 * amplitude]
    crossings = int(np.count_nonzero(np.diff(side)))
    if amplitude == 0 or crossings < 2 * _SWINGS:
        return amplitude, None
    duration = len(tail) * float(time[1] - time[0])
    return amplitude, crossings / 2 / duration


# The answer: words, tables, charts, document, film


def way(rows: Iterable[RungResult], law: str, condition: str) -> list[RungResult]:
    """Return a law's rows rung by rung, from equations that are true."""
    of_law = [row for row in rows if (row.law, row.condition) == (law, condition)]
    return [row for row in of_law if row.together and row.rung != "printed"]


def ways(rows: Sequence[RungResult], condition: str) -> dict[str, list[RungResult]]:
    """Return the way of each law that has begun to climb under a condition."""
    climbs = {law: way(rows, law, condition) for law in dict.fromkeys(row.law for row in rows)}
    return {law: rungs for law, rungs in climbs.items() if rungs}


def first_failed(climbs: Sequence[RungResult]) -> RungResult | None:
    """Return the first rung on which a requirement is not kept; None if all are kept."""
    for row in climbs:
        if not row.kept:
            return row
    return None


def fallen(climbs: Sequence[RungResult], claim: str) -> RungResult | None:
    """Return the first rung on which a claim is not kept; None if it is kept wherever judged."""
    for row in climbs:
        if row.claims.get(claim, 0.0) > 1:
            return row
    return None


def verdict(studied: Ladder, rows: Sequence[RungResult], condition: str) -> str:
    """Return one sentence: how many laws pass, and which rungs break most of them."""
    climbed = ways(rows, condition).values()
    top = studied.climbing[-1].name
    complete = 0
    every = 0
    broken_by = Counter[str]()
    for rungs in climbed:
        failed = first_failed(rungs)
        last = rungs[-1]
        if failed is not None:
            broken_by[failed.rung] += 1
        if last.rung == top and last.kept:
            complete += 1
            every += failed is None

    answer = f"{every} of {len(climbed)} laws pass every rung, {complete} the complete machine"
    breaks = ", ".join(f"{rung} breaks {count}" for rung, count in broken_by.most_common(3))
    if breaks:
        answer += f"; {breaks}"
    return f"{answer}."


def answer_table(studied: Ladder, rows: Sequence[RungResult], condition: Condition) -> Table:
    """Return which laws pass every rung and the complete machine, and where each breaks first."""
    climbed = ways(rows, condition.name)
    top = studied.climbing[-1].name
    ordered = sorted(climbed, key=lambda law: _height(climbed[law]), reverse=True)
    output, input_unit = studied.units
    columns = [
        *names("law"),
        *words("passes\nevery rung", "passes the\ncomplete\nmachine"),
        *text("breaks first at"),
        *numbers(f"swings by\n[{output}]", "at\n[Hz]", f"variation\n[{input_unit}/s]"),
    ]
    return table(condition.title, columns, [_answer_row(law, climbed[law], top) for law in ordered])


def _height(rungs: Sequence[RungResult]) -> int:
    """Number of rungs below the first that is not kept."""
    failed = first_failed(rungs)
    if failed is None:
        return len(rungs)
    return rungs.index(failed)


def _answer_row(law: str, rungs: Sequence[RungResult], top: str) -> list[str]:
    """The row of one law, with the swings on the rung where it breaks or on its last."""
    failed = first_failed(rungs)
    last = rungs[-1]
    every = ""
    machine = ""
    if last.rung == top:
        every = "yes"
        machine = f"{'yes' if last.kept else 'no'} ({last.share_text})"

    breaks = ""
    measured = last
    if failed is not None:
        every = "no"
        breaks = f"{failed.rung}: {failed.reason}"
        measured = failed
    values = (measured.amplitude, measured.frequency, measured.variation)
    swings = ["" if value is None else number(value) for value in values]
    return [law, every, machine, breaks, *swings]


def _by_law(
    title: str,
    rows: Sequence[RungResult],
    columns: Mapping[str, str],
    column_of: Callable[[RungResult], str],
    cell: Callable[[RungResult], str] = lambda row: row.share_text,
) -> Table:
    """A row for each law, a column for each key of its header; a cell is the text of a row."""
    texts = {(row.law, column_of(row)): cell(row) for row in rows}
    laws = dict.fromkeys(row.law for row in rows)
    cells = [[law, *(texts.get((law, key), "") for key in columns)] for law in laws]
    return table(title, [*words("law"), *numbers(*columns.values())], cells)


def share_table(
    studied: Ladder, rows: Sequence[RungResult], condition: str, *, together: bool
) -> Table:
    """Return laws by rungs: the share of the tightest limit that is used."""
    selected = [row for row in rows if (row.condition, row.together) == (condition, together)]
    rungs = studied.climbing if together else studied.alone
    titles = {rung.name: rung.title for rung in rungs}
    return _by_law(_TITLES[together], selected, titles, lambda row: row.rung)


def load_table(studied: Ladder, rows: Sequence[RungResult]) -> Table:
    """Return laws by conditions: the share on the complete machine."""
    top = studied.climbing[-1].name
    selected = [row for row in rows if row.together and row.rung == top]
    loads = "; ".join(f"{load.name}: {load.title}" for load in studied.conditions[1:])
    title = f"The complete machine, nominally and under load ({loads})"
    columns = {condition.name: condition.name for condition in studied.conditions}
    return _by_law(title, selected, columns, lambda row: row.condition)


def deviation_table(studied: Ladder, rows: Sequence[RungResult]) -> Table:
    """Return laws by rungs: the distance from the nominal optimum, of laws that follow it."""
    condition = studied.conditions[0].name
    laws = {law.name for law in studied.laws if law.controller.designed.follows_optimum}
    climbed = [row for row in rows if row.together and row.condition == condition]
    selected = [row for row in climbed if row.law in laws]

    unit, _ = studied.units
    scale = 1.0
    if unit in ("rad", "m"):
        unit = f"m{unit}"
        scale = 1e3
    title = f"Largest distance from the nominal optimum [{unit}], of the laws that follow it"
    rungs = {rung.name: rung.name for rung in studied.climbing}
    cell = partial(_deviation_text, scale=scale)
    return _by_law(title, selected, rungs, lambda row: row.rung, cell)


def _deviation_text(row: RungResult, scale: float) -> str:
    if row.deviation is not None:
        return number(row.deviation * scale)
    if row.tightest == ENDED:
        return "ended"
    return "-"


def claims_table(studied: Ladder, rows: Sequence[RungResult], condition: str) -> Table | None:
    """Return the rung on which each claim falls, for each law that it is about; None without."""
    climbed: dict[str, list[RungResult]] = {}
    claims: dict[str, None] = {}
    for law, rungs in ways(rows, condition).items():
        for row in rungs:
            if row.claims:
                climbed[law] = rungs
                claims |= dict.fromkeys(row.claims)
    if not claims:
        return None

    cells = [[law, *(_fate(rungs, claim) for claim in claims)] for law, rungs in climbed.items()]
    columns = words("law", *(f"`{claim}`" for claim in claims))
    legend = "; ".join(f"`{claim}`: {studied.statements.get(claim, '')}" for claim in claims)
    title = CLAIMS
    if condition != studied.conditions[0].name:
        title += f" ({condition})"
    return table(title, columns, cells, legend=f"{legend}.")


def _fate(rungs: Sequence[RungResult], claim: str) -> str:
    """The rung on which a claim falls, or that it stands; empty if it is not judged."""
    row = fallen(rungs, claim)
    if row is not None:
        return row.rung
    if any(claim in row.claims for row in rungs):
        return STANDS
    return ""


def assumed_text(studied: Ladder) -> str:
    """Return the numbers that nobody has published, by rung; empty if there are none."""
    assumed = [rung for rung in studied.climbing if rung.assumed]
    if not assumed:
        return ""
    words = ", ".join(f"{rung.name} ({'; '.join(rung.assumed)})" for rung in assumed)
    return f"* rests on numbers that are assumed: {words}."


def charts(studied: Ladder, rows: Sequence[RungResult]) -> dict[str, CellChart]:
    """Return a map for each condition, climbing and alone: below zero is kept, then decades."""
    rungs = {rung.name: rung.title for rung in (*studied.climbing, *studied.alone)}
    cells = []
    for row in rows:
        if not row.impossible:
            place = (_map_key(row.condition, row.together), row.law, rungs[row.rung])
            cells.append((*place, _redness(row), row.share_text, row.reason))

    titles = {}
    for condition in studied.conditions:
        for together, title in _TITLES.items():
            key = _map_key(condition.name, together)
            titles[key] = f"{title} ({condition.name}: {condition.title})"
    return cell_charts(titles, cells, _MOST)


def _redness(row: RungResult) -> float:
    """Colour of a row in a map: negative if it is kept, else by the decades beyond its limit."""
    if row.kept:
        return -0.5 * _MOST
    beyond = math.log10(max(row.share_of_the_tightest_limit, 1.0))
    return 0.1 * _MOST + 0.9 * min(beyond, _MOST)


def _map_key(condition: str, together: bool) -> str:
    return f"{condition}, {'climbing' if together else 'alone'}"


def sheets(studied: Ladder, rows: Sequence[RungResult]) -> list[ReportTable]:
    """Return every table with its charts: shares, the machine under load, distances, claims."""
    maps = charts(studied, rows)
    first, *loads = studied.conditions
    parts: list[ReportTable] = []
    for together in (True, False):
        chart = maps.get(_map_key(first.name, together))
        if chart is not None:
            shares = share_table(studied, rows, first.name, together=together)
            parts.append(ReportTable(table=shares, charts=[chart]))

    if loads:
        keys = [_map_key(load.name, True) for load in loads]
        under_load = [maps[key] for key in keys if key in maps]
        parts.append(ReportTable(table=load_table(studied, rows), charts=under_load))

    parts.append(ReportTable(table=deviation_table(studied, rows)))
    for condition in studied.conditions:
        claims = claims_table(studied, rows, condition.name)
        if claims is not None:
            parts.append(ReportTable(table=claims))
    return parts


def _standings(
    studied: Ladder, rows: Sequence[RungResult], *, complete: bool
) -> Iterator[StudyVerdict]:
    """Yield the first rung on which each law breaks, under the first condition."""
    condition = studied.conditions[0].name
    for law, rungs in ways(rows, condition).items():
        failed = first_failed(rungs)
        breaks_at = ""
        answer = "stands on every rung"
        if failed is not None:
            breaks_at = failed.rung
            answer = f"{failed.reason} ({condition})"
        elif not complete:
            answer += " so far"
        yield StudyVerdict(
            case=studied.target,
            law=law,
            breaks_at=breaks_at,
            words=answer,
            complete=complete or failed is not None,
        )


def _values(target: str, rows: Sequence[RungResult]) -> Iterator[Value]:
    for row in rows:
        if not row.impossible:
            how = "up to" if row.together else "alone"
            name = f"{target} {row.condition} {row.law}, {how} {row.rung}"
            yield Value(name=name, value="kept" if row.kept else "not kept")
            used = finite(row.share_of_the_tightest_limit)
            yield Value(name=f"{name}: share of the limit", value=used, better=-1, relative=0.1)


def ladder_document(
    studied: Ladder, rows: Sequence[RungResult], *, complete: bool
) -> dict[str, Any]:
    """Return the content of ladder_NAME.json.

    Args:
        studied: The target.
        rows: Finished rows.
        complete: Whether nothing was interrupted.
    """
    case = studied.machine
    return result(
        "ladder",
        studied.configuration(),
        seed=case.loop.seed if case.loop else None,
        complete=complete,
        answers=[_document_answer(studied, rows, complete=complete)],
        standings=_standings(studied, rows, complete=complete),
        sheets=sheets(studied, rows),
        values=_values(studied.target, rows),
        target=studied.target,
        title=case.title,
        units=studied.units,
        conditions=[{"name": x.name, "title": x.title} for x in studied.conditions],
        laws=[_law_document(law) for law in studied.laws],
        climbing=[rung.document() for rung in studied.climbing],
        alone=[rung.document() for rung in studied.alone],
        assumed=assumed_text(studied),
        claims=[_claim_document(studied, claim) for claim in studied.machine.file.claim],
        climbs=[row.model_dump() for row in rows],
    )


def _document_answer(studied: Ladder, rows: Sequence[RungResult], *, complete: bool) -> Answer:
    """The verdict under each condition, and whether all laws pass the complete machine."""
    top = studied.climbing[-1].name
    verdicts = []
    passed = True
    for condition in studied.conditions:
        climbed = ways(rows, condition.name)
        if climbed:
            verdicts.append(f"{condition.name}: {verdict(studied, rows, condition.name)}")
        for rungs in climbed.values():
            passed = passed and rungs[-1].rung == top and rungs[-1].kept

    answer = "; ".join(verdicts)
    judgement = KEPT if passed else NOT_KEPT
    if not complete:
        judgement = OPEN
        answer += " Interrupted: not complete."
    return Answer(question=f"Ladder of {studied.target}", verdict=judgement, words=answer)


def _law_document(law: StudiedLaw) -> dict[str, Any]:
    return {"name": law.name, "predicts": law.predict, "sampled": law.sampled}


def _claim_document(studied: Ladder, claim: ClaimTable) -> dict[str, Any]:
    return {
        "claim": claim.id,
        "statement": studied.statements.get(claim.id, ""),
        "under": claim.under,
        "of": list(claim.of or studied.machine.controllers),
    }


def ladders_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Return headings and tables of each document, for ``docs/ladder_tables.md``."""
    parts: list[str] = []
    for document in documents:
        tables = [Table.model_validate(sheet["table"]) for sheet in document["sheets"]]
        parts.append(f"**{document['target']}**: {document['title']}")
        parts += [_titled(part) for part in tables if not part.legend]
        if document["assumed"]:
            # A star would begin a list.
            parts.append(f"\\{document['assumed']}")
        for part in tables:
            if part.title == CLAIMS:
                parts += [_titled(part), part.legend]
    return "\n\n".join(parts)


def _titled(part: Table) -> str:
    return "\n".join([f"{part.title}:", "", *part.markdown()])


def ladder_film(
    studied: Ladder,
    law: StudiedLaw,
    rows: Sequence[RungResult],
    form: Format | None = None,
) -> Film:
    """Return a film of a law on MuJoCo's ideal plant, where it breaks first, and at the top.

    The rigid machine is drawn: motors behind their transmissions are not seen.

    Args:
        studied: The target.
        law: One of its laws.
        rows: Its rows.
        form: Format of the film.

    Raises:
        ArgumentError: If no rung runs in MuJoCo.
    """
    condition = studied.conditions[0]
    rungs = [rung for rung in studied.climbing if rung.plant == "physics"]
    if not rungs:
        raise ArgumentError("a film is of runs in MuJoCo: this target has none")

    last = len(rungs) - 1
    breaks_at = last
    failed = first_failed(way(rows, law.name, condition.name))
    for index, rung in enumerate(rungs):
        if failed is not None and rung.name == failed.rung:
            breaks_at = index

    # The ideal plant, the rung before the law breaks, that rung, and the complete machine.
    indices = sorted({0, max(breaks_at - 1, 0), breaks_at, last})
    chosen = [rungs[index] for index in indices[:MOST_TAKES]]
    results = [_rigid(run_of(studied, law, rung, condition)) for rung in chosen]
    return film_of(results, form, [rung.name for rung in chosen])


def _rigid(run: RunResult) -> RunResult:
    """The run without the states that the rigid plant does not have."""
    plant = run.true
    trajectory = run.trajectory
    assert isinstance(plant, MujocoPlant)
    assert trajectory.physics is not None

    # Time, positions and velocities of the rigid joints, which come first.
    n = plant.system.degrees_of_freedom
    velocities = 1 + plant.undrawn_model.nq
    columns = [0, *range(1, 1 + n), *range(velocities, velocities + n)]
    rigid = plant.rigid
    size = mujoco.mj_stateSize(rigid.undrawn_model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert len(columns) == size
    physics = np.ascontiguousarray(trajectory.physics[:, columns])
    return replace(run, true=rigid, trajectory=replace(trajectory, physics=physics))
