"""Where each law breaks on the way from its equations to the machine as built."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, computed_field
from scipy.ndimage import uniform_filter1d

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ClaimTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import judge
from grosmc_mj.experiments.runs import RunResult, run_on
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
from grosmc_mj.studies.studied import (
    UNDER_LOAD,
    Condition,
    Named,
    StudiedLaw,
    Unlimited,
    case_for,
    chosen_laws,
    conditions_of,
    judgeable_in,
    laws_of,
    limits_in,
)

# The case of a system whose loop and machine are those that one can buy.
MACHINE = "machine"
# What breaks first of a run that ended early.
ENDED = "the run ended"
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
# The part of a run that is its end, and the time over which an input's mean is taken [s].
_END, _MEAN = 0.2, 0.02
# Fewer swings than these are no cycle.
_SWINGS = 3

# The result


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
        chatter: Of the command in the end, in the input's unit.
        variation: Total variation of the input a second.
        deviation: Largest distance from the nominal optimum of a law that follows it.
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
    chatter: float | None = None
    variation: float | None = None
    deviation: float | None = None
    impossible: str | None = None
    claims: dict[str, Unlimited] = {}

    @computed_field
    @property
    def kept(self) -> bool:
        """Whether everything is kept."""
        return self.share_of_the_tightest_limit <= 1 and not self.impossible


class Level(BaseModel):
    """A rung of a result; with the loop and the parts of a machine that it has."""

    name: str
    plant: str
    sampled: bool = True
    loop: Any = None
    parts: list[Any] = []
    assumed: list[str] = []

    @property
    def title(self) -> str:
        """The name, with a mark where it rests on numbers that nobody has published."""
        return f"{self.name}*" if self.assumed else self.name


class Climber(BaseModel):
    """A law that climbs."""

    name: str
    predicts: bool = False
    sampled: str = ""
    follows_optimum: bool = True


class Statement(BaseModel):
    """A claim of the chapter."""

    claim: str
    statement: str
    under: str = "nominal"
    of: list[str] = []


class Climbs(BaseModel):
    """A ladder with its rows: what the study writes and its tables are made from.

    Attributes:
        target: SYSTEM/CASE.
        title: Of the case.
        output_unit: Of errors.
        input_unit: Of inputs.
        conditions: Under which laws climb; the first rows are of the first.
        laws: Those that climb.
        climbing: Rungs, each on top of the others.
        alone: Rungs, each alone on the sampled plant.
        claims: Claims of the case file.
        climbs: A row for each law, rung and condition.
    """

    target: str
    title: str
    output_unit: str
    input_unit: str
    conditions: list[Named]
    laws: list[Climber]
    climbing: list[Level]
    alone: list[Level]
    claims: list[Statement] = []
    climbs: list[Climb]

    def way(self, law: str, condition: str) -> list[Climb]:
        """A law's way up, rung by rung, from equations that are true."""
        return [
            row
            for row in self.climbs
            if row.together
            and row.rung != "printed"
            and (row.law, row.condition) == (law, condition)
        ]

    def ways(self, condition: str) -> dict[str, list[Climb]]:
        """The way of each law that has begun to climb."""
        ways = {law.name: self.way(law.name, condition) for law in self.laws}
        return {law: way for law, way in ways.items() if way}

    def complete(self, way: Sequence[Climb]) -> bool:
        """Whether a way ends at the complete machine, and all is kept there."""
        return way[-1].rung == self.climbing[-1].name and way[-1].kept


def first_failed(way: Sequence[Climb]) -> Climb | None:
    """The first rung on which something is not kept; None if all is kept on all."""
    return next((row for row in way if not row.kept), None)


def fallen(way: Sequence[Climb], claim: str) -> Climb | None:
    """The first rung on which a claim is not kept; None if it is kept wherever it is judged."""
    return next((row for row in way if row.claims.get(claim, 0.0) > 1), None)


# The rungs


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
    def level(self) -> Level:
        """It in a result."""
        return Level(
            name=self.name,
            plant=self.plant,
            sampled=self.sampled,
            loop=asdict(self.loop) if self.looped else None,
            parts=[{"kind": part.kind, **asdict(part)} for part in self.parts],
            assumed=list(self.assumed),
        )


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
        for table in tables if isinstance(tables, list) else [tables]:
            own = [name for name in table.assumed if numbers is None or name in numbers]
            if own:
                of = next((getattr(table, key) for key in _OWNERS if hasattr(table, key)), kind)
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


# The runs


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

    def of_rows(self, rows: Sequence[Climb]) -> Climbs:
        """The result."""
        case, error = self.machine.case, self.laws[0].controller.designed.error
        return Climbs(
            target=f"{case.system}/{case.name}",
            title=case.title,
            output_unit=error.units[error.output_rows[0]],
            input_unit=self.experiment.nominal.system.input.unit,
            conditions=[c.named for c in self.conditions],
            laws=[
                Climber(name=law.name, predicts=law.predict, sampled=law.settings,
                        follows_optimum=law.follows_optimum)
                for law in self.laws
            ],
            climbing=[rung.level for rung in self.climbing],
            alone=[rung.level for rung in self.alone],
            claims=[
                Statement(claim=table.id, statement=self.statements.get(table.id, ""),
                          under=table.under, of=list(table.of or self.machine.controllers))
                for table in self.machine.file.claim
            ],
            climbs=list(rows),
        )  # fmt: skip


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
        laws=chosen_laws(laws_of(bare), chosen, rivals=rivals),
        climbing=climbing,
        alone=alone,
        conditions=conditions if loaded else conditions[:1],
    )


def climb(
    studied: Ladder, law: StudiedLaw, rung: Rung, condition: Condition, *, together: bool
) -> Climb:
    """How a law stands on a rung."""
    row = Climb(law=law.name, rung=rung.name, together=together, condition=condition.name)
    try:
        result = run_of(studied, law, rung, condition)
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})
    limits = limits_in(studied.experiment.file.requirement, law, condition, [rung.plant])
    limits = judgeable_in(limits, rung.loop, studied.machine.case.loop)
    shares = {limit.key: judge(limit, result).share for limit in limits if limit.value}
    claims = _shares_of_claims(studied.machine, law, condition, result)
    row = row.model_copy(update={"shares": shares, "claims": claims, "tightest": ENDED})
    if result.ended:
        return row
    worst, run = max(shares, key=lambda key: shares[key], default=""), result.trajectory
    swing = oscillation(run.time, result.comparison.error)
    return row.model_copy(
        update={
            "share_of_the_tightest_limit": shares.get(worst, 0.0),
            "tightest": worst,
            "amplitude": swing.amplitude,
            "frequency": swing.frequency,
            "chatter": chatter(run.time[:-1], run.command),
            "variation": result.metrics["total_variation"].value,
            "deviation": result.metrics["deviation"].value if law.follows_optimum else None,
        }
    )


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
    for table in machine.file.claim:
        if table.under == condition.name and _is_about(machine, table, law):
            for limit in limits_in([table], law, condition, [result.plant]):
                share = judge(limit, result).share
                shares[table.id] = max(share, shares.get(table.id, share))
    return shares


def _is_about(machine: Experiment, table: ClaimTable, law: StudiedLaw) -> bool:
    """Whether a claim is about a law, however that law switches."""
    written = {controller.called: controller.law for controller in machine.file.controller}
    named = table.of or machine.controllers
    return law.base in {*named, *(written.get(name, name) for name in named)}


class Oscillation(NamedTuple):
    """Of a signal that swings about its mean.

    Attributes:
        amplitude: Half of its range, in the signal's unit.
        frequency: Swings a second [Hz]; None for no cycle.
    """

    amplitude: float
    frequency: float | None


def oscillation(time: Array, signal: Array) -> Oscillation:
    """How a signal swings in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: (N,).
    """
    tail = signal[-max(2, round(_END * len(signal))) :]
    about = tail - tail.mean()
    amplitude = float(np.ptp(tail) / 2)
    # A crossing of the mean counts once it is left by a tenth of the amplitude.
    side = np.sign(about)[np.abs(about) > 0.1 * amplitude]
    crossings = int(np.count_nonzero(np.diff(side)))
    if amplitude == 0 or crossings < 2 * _SWINGS:
        return Oscillation(amplitude, None)
    return Oscillation(amplitude, crossings / 2 / (len(tail) * float(time[1] - time[0])))


def chatter(time: Array, command: Array) -> float:
    """Root mean square of a command about its mean over 20 ms, in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        command: (N,) or (N, m), of which the largest input counts.
    """
    inputs = command.reshape(len(command), -1)
    inputs = inputs[-max(2, round(_END * len(inputs))) :]
    window = max(2, round(_MEAN / float(time[1] - time[0])))
    fast = inputs - uniform_filter1d(inputs, window, axis=0, mode="nearest")
    return float(np.sqrt(np.mean(fast**2, axis=0)).max())
