"""Where each law breaks on the way from its equations to the machine as built."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import mujoco
import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, computed_field

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.experiments.case import case_document
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.file.user_code import is_named, named_in, sources
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.metrics import settling_time
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import Limit, judge
from grosmc_mj.experiments.runs import RunResult, run_on
from grosmc_mj.files import written_aside
from grosmc_mj.films.film import MOST_TAKES, Film, Format
from grosmc_mj.loop import Computing, Loop, in_loop
from grosmc_mj.machine import (
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
from grosmc_mj.results.charts import cell_charts
from grosmc_mj.results.document import json_text
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    Sheet,
    Standing,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.studied import (
    UNDER_LOAD,
    Condition,
    StudiedLaw,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
)
from grosmc_mj.versions import source_digest, versions

# The case of a system whose loop and machine are those that one can buy.
MACHINE = "machine"
# What breaks first of a run that ended early.
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
# The numbers of each rung: tables of a case file, and which of their keys; None for all of them.
_TABLES: Mapping[str, tuple[Sequence[str], Collection[str] | None]] = {
    "sensors": (("sensor", "estimator"), None),
    **{name: (("computing",), (key,)) for key, name in _COMPUTING.items()},
    "actuator": (("actuator",), None),
    "motor": (("motor",), None),
    "friction": (("lugre",), None),
    "backlash": (("transmission",), ("backlash", "friction")),
    "flexibility": (("transmission",), ("stiffness", "damping", "inertia")),
    "loads": (("swinging_load", "sliding_load"), None),
    "stops": (("stop", "wall"), None),
}
_OWNERS = ("of", "joint", "input", "body")
# The part of a run that is its end; fewer swings than these are no cycle.
_END, _SWINGS = 0.2, 3
# A number that may be infinite, for which JSON has null.
Unlimited = Annotated[float, BeforeValidator(lambda x: math.inf if x is None else x)]


class Climb(BaseModel):
    """A law on a rung; None for what there is not.

    Attributes:
        law: Its name.
        rung: Name of the rung.
        together: Whether all rungs below are there too.
        condition: Name of the condition.
        share_of_the_tightest_limit: Above 1 it is not kept; infinite with nothing to measure.
        tightest: The requirement that it is of, or how the run ended.
        shares: The share used of each limit.
        amplitude: Half of the range of the error in the end, in its unit.
        frequency: Its swings a second [Hz].
        variation: Total variation of the input a second.
        deviation: Largest distance from the nominal optimum of a law that follows it.
        optimum_settles: Where the law does not settle in time: when the nominal optimum does [s].
        impossible: Why there is no such run.
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
        """Whether everything is kept."""
        return self.share_of_the_tightest_limit <= 1 and not self.impossible

    @property
    def key(self) -> tuple[str, str, str, bool]:
        """Its key among the others: law, rung, condition, together."""
        return self.law, self.rung, self.condition, self.together

    @property
    def share_text(self) -> str:
        """How much of the tightest limit is used, or why there is no number."""
        if self.impossible:
            return "-"
        if self.tightest == ENDED:
            return "ended"
        used = self.share_of_the_tightest_limit
        if math.isinf(used):
            return "never"
        return f"{number(used)}x" if used > 1 else number(used)

    @property
    def reason(self) -> str:
        """The requirement that breaks, and by how much, in words."""
        if self.impossible or self.tightest == ENDED:
            return self.impossible or ENDED
        used = self.share_of_the_tightest_limit
        often = "never" if math.isinf(used) else f"{number(used)} times"
        if number(used) == "1":
            often = "at its limit"
        optimum = self.optimum_settles
        needs = "" if optimum is None else f" (the nominal optimum needs {number(optimum)} s)"
        return f"{self.tightest.replace('_', ' ')}: {often}{needs}"


# The design: rungs


@dataclass(frozen=True)
class Rung:
    """A plant with a part of the loop and of the machine.

    Attributes:
        name: For people.
        plant: ``printed``, ``corrected`` or ``physics``.
        sampled: Whether the law has its own control period; else it runs at every timestep.
        loop: Part of the loop as built.
        parts: Parts of the machine as built.
        assumed: Which numbers that this rung adds nobody has published, in words.
    """

    name: str
    plant: PlantName
    sampled: bool = True
    loop: Loop = field(default_factory=Loop)
    parts: tuple[MachinePart, ...] = ()
    assumed: tuple[str, ...] = ()

    @property
    def looped(self) -> bool:
        """Whether there is anything of the loop."""
        return self.loop != Loop(seed=self.loop.seed)

    @property
    def title(self) -> str:
        """The name, with a mark where it rests on numbers that nobody has published."""
        return f"{self.name}*" if self.assumed else self.name

    def document(self) -> dict[str, Any]:
        """It as plain values."""
        loop = asdict(self.loop) if self.looped else None
        parts = [{"kind": part.kind, **asdict(part)} for part in self.parts]
        return {**vars(self), "loop": loop, "parts": parts}


def rungs_of(machine: Experiment) -> tuple[list[Rung], list[Rung]]:
    """The rungs of a machine: one on top of the other, and each part alone.

    Args:
        machine: A case with its loop and the parts of its machine; what it lacks makes no rung.
    """
    names = machine.nominal.names
    climbing = [*(Rung(name, name, sampled=False) for name in names), Rung("sampled", names[-1])]
    alone: list[Rung] = []
    for name, loop, parts in _additions(machine):
        below, new = climbing[-1], {(type(part), part.of) for part in parts}
        kept = tuple(part for part in below.parts if (type(part), part.of) not in new)
        rung = Rung(name, names[-1], True, loop or Loop(), parts, tuple(_assumed(machine, name)))
        on_top = below.loop if loop is None else _merged(below.loop, loop)
        climbing.append(replace(rung, loop=on_top, parts=(*kept, *parts)))
        alone.append(rung)
    return climbing, alone


def _assumed(machine: Experiment, rung: str) -> Iterator[str]:
    """The numbers that a rung adds and nobody has published, by the part that has them."""
    kinds, numbers = _TABLES[rung]
    for kind in kinds:
        tables = getattr(machine.file, kind)
        for entry in tables if isinstance(tables, list) else [tables]:
            own = [name for name in entry.assumed if numbers is None or name in numbers]
            if own:
                of = next((getattr(entry, key) for key in _OWNERS if hasattr(entry, key)), kind)
                yield f"{' and '.join([of] if isinstance(of, str) else of)}: {', '.join(own)}"


def _additions(machine: Experiment) -> Iterator[tuple[str, Loop | None, tuple[MachinePart, ...]]]:
    """What is added, in the order of the ladder: a name, and a part of loop or machine."""
    if loop := machine.case.loop:
        seed = loop.seed
        if loop.sensors or loop.estimators:
            yield "sensors", Loop(sensors=loop.sensors, estimators=loop.estimators, seed=seed), ()
        for key, name in _COMPUTING.items():
            if amount := getattr(loop.computing, key):
                yield name, Loop(Computing(**{key: amount}), seed=seed), ()
        if loop.actuators:
            yield "actuator", Loop(actuators=loop.actuators, seed=seed), ()
    parts = machine.case.parts
    gears = [part for part in parts if isinstance(part, Transmission)]
    loads, stops = (SwingingLoad, SlidingLoad), (Stop, Wall)
    for name, own in (
        ("motor", [part for part in parts if isinstance(part, Motor)]),
        ("friction", [part for part in parts if isinstance(part, LuGre)]),
        ("backlash", [replace(gear, stiffness=math.inf) for gear in gears if gear.backlash]),
        ("flexibility", [gear for gear in gears if math.isfinite(gear.stiffness)]),
        ("loads", [part for part in parts if isinstance(part, loads)]),
        ("stops", [part for part in parts if isinstance(part, stops)]),
    ):
        if own:
            yield name, None, tuple(own)


def _merged(below: Loop, added: Loop) -> Loop:
    """Two loops that have different kinds of parts, as one."""
    late = {name: value for name, value in vars(added.computing).items() if value}
    return Loop(
        replace(below.computing, **late),
        below.sensors or added.sensors,
        below.estimators or added.estimators,
        below.actuators or added.actuators,
        added.seed,
    )


@dataclass(frozen=True, eq=False)
class Ladder:
    """A target, ready to be climbed.

    Attributes:
        experiment: The target's, without loop and machine.
        machine: The same with both.
        laws: Those that climb.
        climbing: Rungs, each with all that is below it.
        alone: What is added, each alone on a sampled plant.
        conditions: The one that the file asks for first.
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
        """All that is to be run; the last tells whether all rungs below are there too."""
        for law in self.laws:
            for condition in self.conditions:
                yield from ((law, rung, condition, True) for rung in self.climbing)
                if condition is self.conditions[0]:
                    yield from ((law, rung, condition, False) for rung in self.alone)

    @property
    def target(self) -> str:
        """SYSTEM/CASE."""
        return f"{self.machine.case.system}/{self.machine.case.name}"

    @property
    def units(self) -> tuple[str, str]:
        """Units of the output and of the input."""
        error = self.laws[0].controller.designed.error
        return error.units[error.output_rows[0]], self.experiment.nominal.system.input.unit

    def configuration(self) -> dict[str, Any]:
        """What rows depend on, in its result."""
        settings, file = self.experiment.settings, self.machine.file
        named = [*named_in(file), *(file.law(law.base).law for law in self.laws)]
        return {
            "target": self.target,
            "title": self.machine.case.title,
            "model": self.experiment.plant(self.experiment.nominal.truest).digest,
            "sources": sources(filter(is_named, named), self.machine.path.parent),
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "integrator": settings.integrator,
            "file": self.machine.document(),
        }


def ladder(
    target: str, chosen: Sequence[str] = (), *, loaded: bool = False, rivals: bool = False
) -> Ladder:
    """The ladder of a target.

    Args:
        target: A system, which means its machine, ``SYSTEM/CASE``, or the path of a case file.
        chosen: Names of laws; all by default.
        loaded: Whether laws climb under every condition; else as the file says, with its own edits
            and disturbances.
        rivals: Whether all includes the rivals.

    Raises:
        ArgumentError: If there is no such target or law, neither loop nor machine, or nothing is
            required.
    """
    machine = case_for(target, MACHINE)
    own = tuple(edit for edit in machine.case.edits if edit not in machine.case.parts)
    bare = machine.varied(loop=None, edits=own)
    climbing, alone = rungs_of(machine)
    if not alone:
        raise ArgumentError(
            f"{machine.path}: there is nothing to climb to: give the file a loop ([computing], "
            "[[sensor]], [[actuator]]) or a machine ([[motor]], [[lugre]], [[transmission]], "
            "[[stop]])"
        )
    conditions = sorted(conditions_of(bare), key=lambda condition: condition.name != UNDER_LOAD)
    return Ladder(
        experiment=bare,
        machine=machine,
        laws=chosen_laws(bare, chosen, rivals=rivals),
        climbing=climbing,
        alone=alone,
        conditions=conditions if loaded else conditions[:1],
    )


@dataclass(frozen=True)
class Cells:
    """Finished rows of a ladder, a file each, so that a killed ladder goes on where it was.

    A file is named by all that its row depends on: that of another case, law, version or code of
    the package is another.

    Attributes:
        folder: Where they lie.
        ladder: Configuration of the ladder and versions, as JSON.
    """

    folder: Path
    ladder: str

    @classmethod
    def of(cls, studied: Ladder, folder: Path) -> Cells:
        """The cells of a ladder in a folder."""
        conditions = [
            [case_document(condition.experiment.case), condition.experiment.document()]
            for condition in studied.conditions
        ]
        own = [studied.configuration(), conditions, versions(), source_digest()]
        return cls(folder, json_text(own))

    def read(self, *key: str | bool) -> Climb | None:
        """The row with a key; None if it is not there, or cannot be read."""
        with contextlib.suppress(OSError, ValueError):
            return Climb.model_validate(json.loads(self._path(key).read_text(encoding="utf-8")))
        return None

    def write(self, row: Climb) -> None:
        """Write a row aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        with written_aside(self._path(row.key)) as part:
            # Not by `json_text`: what is infinite must come back as it was.
            part.write_text(json.dumps(row.model_dump()), encoding="utf-8")

    def _path(self, key: tuple[str | bool, ...]) -> Path:
        name = hashlib.sha256(json.dumps([self.ladder, key]).encode()).hexdigest()
        return self.folder / f"{name[:32]}.json"


# The reduction: a run as a row


def climb(
    studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool
) -> Climb:
    """How a law stands on a rung."""
    row = Climb(law=law.name, rung=rung.name, together=together, condition=condition.name)
    try:
        run = run_of(studied, law, rung, condition)
    except SetupError:  # of this computer, not of the law
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})
    limits = limits_in(studied.experiment.file.requirement, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.case.loop)
    shares = {limit.key: judge(limit, run).share for limit in limits if limit.value}
    claims = _shares_of_claims(studied.machine, law, condition, run)
    row = row.model_copy(update={"shares": shares, "claims": claims, "tightest": ENDED})
    if run.ended:
        return row
    worst = max(shares, key=lambda key: shares[key], default="")
    used, comparison = shares.get(worst, 0.0), run.comparison
    amplitude, frequency = oscillation(comparison.time, comparison.error)
    follows = law.controller.designed.follows_optimum
    slow = next((limit for limit in limits if limit.key == worst and used > 1), None)
    return row.model_copy(
        update={
            "share_of_the_tightest_limit": used,
            "tightest": worst,
            "amplitude": amplitude,
            "frequency": frequency,
            "variation": run.metrics["total_variation"].value,
            "deviation": run.metrics["deviation"].value if follows else None,
            "optimum_settles": _optimum_settles(run, slow) if slow else None,
        }
    )


def _optimum_settles(run: RunResult, limit: Limit) -> float | None:
    """When the nominal optimum of a run's law settles as a limit means it [s]."""
    if limit.kind != "settles_within":
        return None
    optimum = run.comparison._replace(z=run.comparison.optimal)
    return settling_time(optimum.time, optimum.error, limit.band).value


def run_of(studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition) -> RunResult:
    """The run of a law on a rung.

    Raises:
        GrosmcError: If the law cannot be designed or put into the loop.
    """
    bare = condition.experiment
    h = bare.settings.timestep
    if not rung.sampled:
        bare = bare.with_settings(control_period=h)
    controller = bare.with_settings(**law.sampled).law(rung.plant, law.base)
    here = bare.varied(edits=(*bare.case.edits, *rung.parts))
    if rung.looped:
        controller = in_loop(
            controller, rung.loop, bare.nominal.system, timestep=h, predict=law.predict,
            control_period=bare.settings.control_period,
        )  # fmt: skip
    return run_on(here, rung.plant, controller, here.plant(rung.plant))


def _shares_of_claims(
    machine: Experiment, law: StudiedLaw, condition: Condition, result: RunResult
) -> dict[str, float]:
    """The largest share of each claim's limits that a run uses, infinite if it ended early.

    Claims about other laws or conditions, and what a run of this length does not tell, are left
    out.
    """
    shares: dict[str, float] = {}
    for claim in machine.file.claim:
        if claim.under == condition.name and _is_about(machine, claim, law):
            for limit in limits_in([claim], law, condition, [result.plant]):
                share = judge(limit, result).share
                shares[claim.id] = max(share, shares.get(claim.id, share))
    return shares


def _is_about(machine: Experiment, claim: ClaimTable, law: StudiedLaw) -> bool:
    """Whether a claim is about a law, however that law switches."""
    written = {controller.called: controller.law for controller in machine.file.controller}
    named = claim.of or machine.controllers
    return law.base in {*named, *(written.get(name, name) for name in named)}


def oscillation(time: Array, signal: Array) -> tuple[float, float | None]:
    """How a signal swings in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: (N,).

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
    return amplitude, crossings / 2 / (len(tail) * float(time[1] - time[0]))


# The answer: words, tables, charts, document, film


def way(rows: Iterable[Climb], law: str, condition: str) -> list[Climb]:
    """A law's way up, rung by rung, from equations that are true."""
    return [
        row
        for row in rows
        if row.together and row.rung != "printed" and (row.law, row.condition) == (law, condition)
    ]


def ways(rows: Sequence[Climb], condition: str) -> dict[str, list[Climb]]:
    """The way of each law that has begun to climb under a condition."""
    climbs = {law: way(rows, law, condition) for law in dict.fromkeys(row.law for row in rows)}
    return {law: rungs for law, rungs in climbs.items() if rungs}


def first_failed(climbs: Sequence[Climb]) -> Climb | None:
    """The first rung on which something is not kept; None if all is kept on all."""
    return next((row for row in climbs if not row.kept), None)


def fallen(climbs: Sequence[Climb], claim: str) -> Climb | None:
    """The first rung on which a claim is not kept; None if it is kept wherever it is judged."""
    return next((row for row in climbs if row.claims.get(claim, 0.0) > 1), None)


def verdict(studied: Ladder, rows: Sequence[Climb], condition: str) -> str:
    """How many laws pass, and what breaks most of them."""
    climbed, top = ways(rows, condition).values(), studied.climbing[-1].name
    failed = [row.rung for rungs in climbed if (row := first_failed(rungs))]
    complete = [rungs for rungs in climbed if rungs[-1].rung == top and rungs[-1].kept]
    every = sum(first_failed(rungs) is None for rungs in complete)
    answer = f"{every} of {len(climbed)} laws pass every rung, {len(complete)} the complete machine"
    breaks = ", ".join(f"{name} breaks {n}" for name, n in Counter(failed).most_common(3))
    return f"{answer}; {breaks}." if breaks else f"{answer}."


def answer_table(studied: Ladder, rows: Sequence[Climb], condition: Condition) -> Table:
    """Which laws pass every rung and which the complete machine, and where each breaks first."""
    climbed, top = ways(rows, condition.name), studied.climbing[-1].name

    def height(law: str) -> int:
        row = first_failed(climbed[law])
        return len(climbed[law]) if row is None else climbed[law].index(row)

    cells = []
    for law in sorted(climbed, key=height, reverse=True):
        row, last = first_failed(climbed[law]), climbed[law][-1]
        shown, complete = row or last, last.rung == top
        every = "no" if row else "yes" if complete else ""
        machine = f"{'yes' if last.kept else 'no'} ({last.share_text})" if complete else ""
        breaks = f"{row.rung}: {row.reason}" if row else ""
        measured = (shown.amplitude, shown.frequency, shown.variation)
        cells.append(
            [law, every, machine, breaks, *("" if x is None else number(x) for x in measured)]
        )
    output, input_unit = studied.units
    columns = [
        *names("law"),
        *words("passes\nevery rung", "passes the\ncomplete\nmachine"),
        *text("breaks first at"),
        *numbers(f"swings by\n[{output}]", "at\n[Hz]", f"variation\n[{input_unit}/s]"),
    ]
    return table(condition.title, columns, cells)


def _by_law(
    title: str,
    rows: Sequence[Climb],
    columns: Mapping[str, str],
    column_of: Callable[[Climb], str],
    cell: Callable[[Climb], str] = lambda row: row.share_text,
) -> Table:
    """A row for each law, a column for each key of its header; a cell says something of a row."""
    known = {(row.law, column_of(row)): cell(row) for row in rows}
    laws = dict.fromkeys(row.law for row in rows)
    cells = [[law, *(known.get((law, key), "") for key in columns)] for law in laws]
    return table(title, [*words("law"), *numbers(*columns.values())], cells)


def share_table(studied: Ladder, rows: Sequence[Climb], condition: str, *, together: bool) -> Table:
    """Laws by rungs: how much of the tightest limit is used."""
    own = [x for x in rows if (x.condition, x.together) == (condition, together)]
    rungs = {rung.name: rung.title for rung in (studied.climbing if together else studied.alone)}
    return _by_law(_TITLES[together], own, rungs, lambda row: row.rung)


def load_table(studied: Ladder, rows: Sequence[Climb]) -> Table:
    """Laws by conditions: the complete machine."""
    own = [row for row in rows if row.together and row.rung == studied.climbing[-1].name]
    loads = "; ".join(f"{c.name}: {c.title}" for c in studied.conditions[1:])
    title = f"The complete machine, nominally and under load ({loads})"
    return _by_law(
        title, own, {c.name: c.name for c in studied.conditions}, lambda row: row.condition
    )


def deviation_table(studied: Ladder, rows: Sequence[Climb]) -> Table:
    """How far each law that follows the nominal optimum is from it, climbing."""
    first, unit = studied.conditions[0].name, studied.units[0]
    unit, scale = (f"m{unit}", 1e3) if unit in ("rad", "m") else (unit, 1.0)
    follow = {law.name for law in studied.laws if law.controller.designed.follows_optimum}
    own = [x for x in rows if x.together and x.condition == first and x.law in follow]

    def cell(row: Climb) -> str:
        if row.deviation is not None:
            return number(row.deviation * scale)
        return "ended" if row.tightest == ENDED else "-"

    title = f"Largest distance from the nominal optimum [{unit}], of the laws that follow it"
    rungs = {rung.name: rung.name for rung in studied.climbing}
    return _by_law(title, own, rungs, lambda row: row.rung, cell)


def claims_table(studied: Ladder, rows: Sequence[Climb], condition: str) -> Table | None:
    """On which rung each claim falls for each law that it is about; None without a claim."""
    climbed = {law: x for law, x in ways(rows, condition).items() if any(row.claims for row in x)}
    claims = list(
        dict.fromkeys(x for rungs in climbed.values() for row in rungs for x in row.claims)
    )
    if not claims:
        return None

    def cell(rungs: Sequence[Climb], claim: str) -> str:
        row = fallen(rungs, claim)
        judged = any(claim in row.claims for row in rungs)
        return row.rung if row else STANDS if judged else ""

    cells = [[law, *(cell(rungs, claim) for claim in claims)] for law, rungs in climbed.items()]
    columns = words("law", *(f"`{claim}`" for claim in claims))
    legend = "; ".join(f"`{claim}`: {studied.statements.get(claim, '')}" for claim in claims)
    where = "" if condition == studied.conditions[0].name else f" ({condition})"
    return table(CLAIMS + where, columns, cells, legend=f"{legend}.")


def assumed_text(studied: Ladder) -> str:
    """Which numbers nobody has published, by the rung that adds them; empty if there is none."""
    rungs = [f"{x.name} ({'; '.join(x.assumed)})" for x in studied.climbing if x.assumed]
    return f"* rests on numbers that are assumed: {', '.join(rungs)}." if rungs else ""


def charts(studied: Ladder, rows: Sequence[Climb]) -> dict[str, CellChart]:
    """A map for each condition, climbing and alone: below zero is kept, then decades beyond."""
    rungs = {rung.name: rung.title for rung in (*studied.climbing, *studied.alone)}
    cells = []
    for row in rows:
        if not row.impossible:
            beyond = math.log10(max(row.share_of_the_tightest_limit, 1.0))
            redness = 0.1 * _MOST + 0.9 * min(beyond, _MOST)
            value = -0.5 * _MOST if row.kept else redness
            place = (_map_key(row.condition, row.together), row.law, rungs[row.rung])
            cells.append((*place, value, row.share_text, row.reason))
    titles = {
        _map_key(condition.name, together): f"{title} ({condition.name}: {condition.title})"
        for condition in studied.conditions
        for together, title in _TITLES.items()
    }
    return cell_charts(titles, cells, _MOST)


def _map_key(condition: str, together: bool) -> str:
    return f"{condition}, {'climbing' if together else 'alone'}"


def sheets(studied: Ladder, rows: Sequence[Climb]) -> list[Sheet]:
    """Every table with its charts: shares, the machine under load, distances, claims."""
    maps, (first, *loads) = charts(studied, rows), studied.conditions
    shares = [
        Sheet(table=share_table(studied, rows, first.name, together=together), charts=[chart])
        for together in (True, False)
        if (chart := maps.get(_map_key(first.name, together)))
    ]
    tables = [deviation_table(studied, rows)]
    tables += [x for c in studied.conditions if (x := claims_table(studied, rows, c.name))]
    under = [chart for c in loads if (chart := maps.get(_map_key(c.name, True)))]
    loaded = [Sheet(table=load_table(studied, rows), charts=under)] if loads else []
    return [*shares, *loaded, *(Sheet(table=x) for x in tables)]


def _standings(studied: Ladder, rows: Sequence[Climb], *, complete: bool) -> Iterator[Standing]:
    """The first rung on which each law breaks, under the first condition."""
    condition = studied.conditions[0].name
    for law, rungs in ways(rows, condition).items():
        row = first_failed(rungs)
        stands = "stands on every rung" if complete else "stands on every rung so far"
        yield Standing(
            case=studied.target,
            law=law,
            breaks_at=row.rung if row else "",
            words=f"{row.reason} ({condition})" if row else stands,
            complete=complete or row is not None,
        )


def _values(target: str, rows: Sequence[Climb]) -> Iterator[Value]:
    for row in rows:
        if not row.impossible:
            how = "up to" if row.together else "alone"
            name = f"{target} {row.condition} {row.law}, {how} {row.rung}"
            yield Value(name=name, value="kept" if row.kept else "not kept")
            used = finite(row.share_of_the_tightest_limit)
            yield Value(name=f"{name}: share of the limit", value=used, better=-1, relative=0.1)


def ladder_document(studied: Ladder, rows: Sequence[Climb], *, complete: bool) -> dict[str, Any]:
    """The content of ladder_NAME.json.

    Args:
        studied: The target.
        rows: What was climbed.
        complete: Whether nothing was interrupted.
    """
    case, top = studied.machine.case, studied.climbing[-1].name
    conditions = [c.name for c in studied.conditions if ways(rows, c.name)]
    lasts = [rungs[-1] for name in conditions for rungs in ways(rows, name).values()]
    passed = all(row.rung == top and row.kept for row in lasts)
    answer = "; ".join(f"{name}: {verdict(studied, rows, name)}" for name in conditions)
    return result(
        "ladder",
        studied.configuration(),
        seed=case.loop.seed if case.loop else None,
        complete=complete,
        answers=[
            Answer(
                question=f"Ladder of {studied.target}",
                verdict=(KEPT if passed else NOT_KEPT) if complete else OPEN,
                words=answer if complete else f"{answer} Interrupted: not complete.",
            )
        ],
        standings=_standings(studied, rows, complete=complete),
        sheets=sheets(studied, rows),
        values=_values(studied.target, rows),
        target=studied.target,
        title=case.title,
        units=studied.units,
        conditions=[{"name": c.name, "title": c.title} for c in studied.conditions],
        laws=[
            {"name": law.name, "predicts": law.predict, "sampled": law.sampled}
            for law in studied.laws
        ],
        climbing=[rung.document() for rung in studied.climbing],
        alone=[rung.document() for rung in studied.alone],
        assumed=assumed_text(studied),
        claims=[
            {"claim": claim.id, "statement": studied.statements.get(claim.id, ""),
             "under": claim.under, "of": list(claim.of or studied.machine.controllers)}
            for claim in studied.machine.file.claim
        ],
        climbs=[row.model_dump() for row in rows],
    )  # fmt: skip


def ladders_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Headings and tables of each document, for ``docs/ladder_tables.md``."""
    parts: list[str] = []
    for document in documents:
        tables = [Table.model_validate(sheet["table"]) for sheet in document["sheets"]]
        parts.append(f"**{document['target']}**: {document['title']}")
        parts += [_titled(shown) for shown in tables if not shown.legend]
        # A star would begin a list.
        parts += [f"\\{document['assumed']}"] if document["assumed"] else []
        for claims in (shown for shown in tables if shown.title == CLAIMS):
            parts += [_titled(claims), claims.legend]
    return "\n\n".join(parts)


def _titled(shown: Table) -> str:
    return "\n".join([f"{shown.title}:", "", *shown.markdown()])


def ladder_film(
    studied: Ladder, law: StudiedLaw, rows: Sequence[Climb], form: Format | None = None
) -> Film:
    """A law on MuJoCo's ideal plant, around where it breaks first, and on the whole machine.

    The rigid machine is drawn: motors behind their transmissions are not seen.

    Args:
        studied: The target.
        law: One of its laws.
        rows: Its rows.
        form: How the film is cut.

    Raises:
        ArgumentError: If nothing of it runs in MuJoCo.
    """
    condition = studied.conditions[0]
    rungs = [rung for rung in studied.climbing if rung.plant == "physics"]
    if not rungs:
        raise ArgumentError("a film is of runs in MuJoCo: this target has none")
    failed, last = first_failed(way(rows, law.name, condition.name)), len(rungs) - 1
    at = next((i for i, rung in enumerate(rungs) if failed and rung.name == failed.rung), last)
    chosen = [rungs[i] for i in sorted({0, max(at - 1, 0), at, last})[:MOST_TAKES]]
    results = [_rigid(run_of(studied, law, rung, condition)) for rung in chosen]
    return film_of(results, form, [rung.name for rung in chosen])


def _rigid(run: RunResult) -> RunResult:
    """The same run, without the states that the rigid plant does not have."""
    plant, trajectory = run.true, run.trajectory
    assert isinstance(plant, MujocoPlant)
    assert trajectory.physics is not None
    n, model, rigid = plant.system.degrees_of_freedom, plant.undrawn_model, plant.rigid
    columns = [0, *range(1, 1 + n), *range(1 + model.nq, 1 + model.nq + n)]
    size = mujoco.mj_stateSize(rigid.undrawn_model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert len(columns) == size
    seen = np.ascontiguousarray(trajectory.physics[:, columns])
    return replace(run, true=rigid, trajectory=replace(trajectory, physics=seen))
