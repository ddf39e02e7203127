"""Margins of laws in loops and on machines: searched on the task, measured by small signals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.user_code import is_named, sources
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.ground.units import number_in, typed_number
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.output.results.tables import number
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.simulation.disturbances import Table as Injected
from grosmc_mj.simulation.loop import Loop
from grosmc_mj.studies.margins.chatter import chatter
from grosmc_mj.studies.margins.multisine import multisine
from grosmc_mj.studies.margins.row import LEVELS, SEED, LawMargins, Level
from grosmc_mj.studies.margins.sensitivity import (
    LEAVES,
    REALIZATIONS,
    LoopPlace,
    RunningLoop,
    measure_with_tests,
)
from grosmc_mj.studies.margins.task import task_margins
from grosmc_mj.studies.study import Advance, Study, StudyCell, dependencies
from grosmc_mj.studies.target import (
    BENCH,
    MACHINE,
    Condition,
    StudiedLaw,
    case_for,
    case_laws,
    chosen_laws,
    conditions_of,
    judgeable_in,
    limits_in,
    of_system,
)
from grosmc_mj.studies.trials import Trials

IDEAL = "ideal loop"
# The largest injection, over the limit of the input or over the range of a state in its task.
SHARE = 0.25


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

    def limits(self, law: StudiedLaw, condition: Condition) -> tuple[Requirement, ...]:
        """Return the limits that a law must keep in the loop."""
        limits = limits_in(self.case.file.requirement, law, condition, [self.plant_name])
        return judgeable_in(limits, self.loop, self.case.loop)

    def running(self, law: StudiedLaw, loop: Loop) -> RunningLoop:
        """Return a law on the nominal plant, where its reference is kept.

        Raises:
            GrosmcError: If the law does not fit into the loop, or has no design.
        """
        experiment = self.nominal
        controller = law.controller
        error = controller.designed.error
        loops = [
            experiment.loop_around(controller, loop.draw(run), predict=law.predict, run=run)
            for run in range(REALIZATIONS if loop.drawn else 1)
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
class MarginStudy(Study[LawMargins]):
    """A target, ready to be studied.

    Attributes:
        target: The target on the command line.
        setups: Its loops and machines.
        injection: Largest injection at an input [unit of the input]; 0 for a quarter of its limit.
        period: Period of the injections [s]; 0 for the length of the task.
        draws: Draws of a loop that the task is judged over.
        chosen: Names of laws that were asked for.
    """

    kind = "margins"
    row = LawMargins

    target: str
    setups: Sequence[Setup]
    injection: float = 0.0
    period: float = 0.0
    draws: int = 1
    chosen: Sequence[str] = ()

    @property
    def case(self) -> Experiment:
        """The case of the first setup."""
        return self.setups[0].case

    def cells(self) -> list[StudyCell[LawMargins]]:
        """Return a cell for each law in each setup."""
        conditions = [condition for setup in self.setups for condition in setup.conditions]
        depends_on = dependencies(self.configuration(), conditions)
        cells = []
        for setup in self.setups:
            for law in setup.laws:
                cell = StudyCell(
                    name=f"{setup.name}: {law.name}",
                    key=(setup.name, law.name),
                    depends_on=depends_on,
                    measure=partial(law_margins, self, setup, law),
                )
                cells.append(cell)
        return cells

    def places(self, setup: Setup) -> dict[LoopPlace, float]:
        """Return the largest injection at each place: inputs, then measured states.

        A measured state gets a share of its range in the nominal task under the first law.

        Raises:
            ArgumentError: If an input has no limit, or the injection is beyond it.
        """
        case = setup.case
        plant = case.plant(setup.plant_name)
        allowed = [limit.number for limit in case.limits if limit.of_actuators]
        largest: dict[LoopPlace, float] = {}
        for signal, limit in zip(plant.system.inputs, case.input_limits(plant)[1], strict=True):
            bound = float(min([limit, *allowed]))
            if self.injection > bound:
                unit = unit_after(signal.unit)
                raise ArgumentError(
                    f"--injection {self.injection:g}{unit} is beyond the limit of {signal.name}, "
                    f"{bound:g}{unit}"
                )
            largest[LoopPlace(signal.name)] = self.injection or SHARE * bound
            if math.isinf(largest[LoopPlace(signal.name)]):
                raise ArgumentError(
                    f"{case.path}: {signal.name} has no limit to size an injection by: give it "
                    "an [[actuator]] with a limit, or the command an --injection"
                )

        measured = [sensor.of for sensor in case.loop.sensors] if case.loop else []
        for state, size in zip(plant.system.states, _ranges(setup), strict=True):
            if size > 0 and (state.name in measured or not measured):
                largest[LoopPlace(state.name, output=True)] = SHARE * size
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
            "draws": self.draws,
            "setups": setups,
        }


def _ranges(setup: Setup) -> Array:
    """Range of each state in the nominal task, (n,), under the first law with which it can run.

    Those that the case runs come first; zeros if there is none.
    """
    laws = sorted(setup.laws, key=lambda law: law.base not in setup.case.controllers)
    for law in laws:
        try:
            loop = setup.running(law, setup.loop)
            nothing = [Injected((0.0,), loop.control_period)]
            place = LoopPlace(loop.plant.system.inputs[0].name)
            started = replace(loop, x0=np.array(setup.nominal.x0))
            run = started.run(place, nothing, 0, setup.nominal.duration)
        except SetupError:
            raise
        except GrosmcError:
            continue
        return np.ptp(run.state[0], axis=0)
    return np.zeros(len(setup.case.nominal.system.states))


def law_margins(
    studied: MarginStudy,
    setup: Setup,
    law: StudiedLaw,
    advance: Advance = lambda _: None,
) -> LawMargins:
    """Search the margins of a law's task, and measure S at all places.

    Args:
        studied: The study.
        setup: One of its setups.
        law: One of its laws.
        advance: Told what is measured now.

    Raises:
        SetupError: If the computer, not the law, is at fault.
        ArgumentError: If an injection cannot be sized, its period is too short, or the loop of a
            law that the case runs or that was chosen leaves its region under the one asked for.
    """
    name = f"{setup.name}: {law.name}"
    row = LawMargins(setup=setup.name, law=law.name)
    places = studied.places(setup)
    multisine(studied.period or setup.nominal.duration, setup.nominal.settings.control_period)
    try:
        task = _task_margins(studied, setup, law, lambda at: advance(f"{name}: {at}"))
        measured = _signals(studied, setup, law, places, lambda at: advance(f"{name}: {at}"))
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    row = row.model_copy(update={"task": task, **measured})
    asked_for = law.base in setup.case.controllers or law.name in studied.chosen
    if studied.injection and asked_for:
        _require_in_region(row)
    return row


def _task_margins(
    studied: MarginStudy, setup: Setup, law: StudiedLaw, advance: Advance
) -> list[Verdict]:
    """Return the verdicts on the task of a law under each condition."""
    trials = Trials(setup.plant_name, setup.limits, studied.draws)
    task: list[Verdict] = []
    for condition in setup.conditions:
        advance(f"{condition.name}: task")
        task += task_margins(trials, law, condition)
    return task


def _signals(
    studied: MarginStudy,
    setup: Setup,
    law: StudiedLaw,
    places: Mapping[LoopPlace, float],
    advance: Advance,
) -> dict[str, Any]:
    """Return where a law begins to chatter, and S at all places and amplitudes."""
    running = setup.running(law, setup.loop)
    period = studied.period or setup.nominal.duration
    begins = None
    if law.controller.designed.switching:
        advance("chatter")
        place, largest = next(iter(places.items()))
        size = largest / SHARE
        begins = chatter(lambda loop: setup.running(law, loop), setup.loop, place, size, period)

    levels: list[Level] = []
    for place, largest in places.items():
        for rms in largest * LEVELS:
            advance(f"S at {place.name}, {number(rms)} rms")
            levels.append(_level(running, place, period, rms))
    return {"chatter": begins, "levels": levels}


def _require_in_region(row: LawMargins) -> None:
    """Refuse an injection at an input under which the loop leaves its region.

    Raises:
        ArgumentError: With the size to make smaller.
    """
    for level in row.of_inputs[len(LEVELS) - 1 :: len(LEVELS)]:
        if LEAVES in level.doubt:
            raise ArgumentError(
                f"{row.setup}: the loop with {row.law} leaves its region under an injection of "
                f"{number(level.rms)}{unit_after(level.unit)} rms: give a smaller --injection"
            )


def _level(running: RunningLoop, place: LoopPlace, period: float, rms: float) -> Level:
    """S at a place at one amplitude."""
    measured, doubt = measure_with_tests(running, place, period, rms, SEED)
    system = running.plant.system
    signals = system.states if place.output else system.inputs
    counting = np.zeros(len(measured.multisine.lines), bool)
    column = np.zeros((len(counting), len(signals)), np.complex128)
    if measured.usable:
        counting = measured.counting
        column = measured.column
    return Level(
        place=place.name,
        output=place.output,
        rms=rms,
        unit=signals[measured.index].unit,
        margins=measured.margins,
        errors=measured.errors,
        doubt=doubt,
        frequency=measured.multisine.frequencies[counting].tolist(),
        real=column[counting].real.tolist(),
        imaginary=column[counting].imag.tolist(),
        index=measured.index,
    )


def margin_study(
    target: str,
    chosen: Sequence[str] = (),
    *,
    further: bool = False,
    rivals: bool = False,
    injection: str = "",
    period: str = "",
    draws: int = 1,
) -> MarginStudy:
    """Return the loops and machines of a target: ideal loop, its loop, its machine.

    Args:
        target: A system, which means its bench and its machine, ``SYSTEM/CASE``, or the path of a
            case file.
        chosen: Names of laws; the controllers of the file by default.
        further: Whether the default includes the case's other laws and all switching laws.
        rivals: Whether the default includes the rivals.
        injection: Largest injection at an input with its unit; a quarter of the limit by default.
        period: Period of the injections with its unit; the length of the task by default.
        draws: Draws of a loop that the task is judged over.

    Raises:
        ArgumentError: If there is no such target or law, nothing is required, a number has not
            the unit of the input, or chosen laws are asked for together with more of the default.
    """
    if chosen and (further or rivals):
        raise ArgumentError("--laws names all laws that are studied: leave out --all and --rivals")
    case = case_for(target, BENCH)
    cases = [case]
    machine = of_system(case, MACHINE)
    if target == case.system and machine is not None:
        cases.append(machine)

    setups = []
    for built in cases:
        edits = tuple(edit for edit in built.edits if edit not in built.parts)
        bare = built.changed(loop=None, edits=edits)
        if chosen:
            laws = chosen_laws(bare, chosen)
        else:
            laws = case_laws(bare, further=further, rivals=rivals)
        if built is case:
            conditions = _in_loop(bare, Loop(), None, ())
            setups.append(Setup(built.target, IDEAL, built, conditions, laws))
        if built.loop is not None or built.parts:
            conditions = _in_loop(bare, built.loop or Loop(), built.known_loop, built.parts)
            setups.append(Setup(built.target, "", built, conditions, laws))

    largest = typed_number(injection, case.nominal.system.inputs[0].unit) if injection else 0.0
    seconds = number_in(period, "s") if period else 0.0
    if (injection and largest <= 0) or (period and seconds <= 0):
        raise ArgumentError("--injection and --period must be positive")
    return MarginStudy(target, setups, largest, seconds, draws, chosen)


def _in_loop(
    bare: Experiment, loop: Loop, known: Loop | None, parts: Sequence[MachinePart]
) -> list[Condition]:
    """Conditions of an experiment with a loop and the parts of a machine."""
    conditions = []
    for condition in conditions_of(bare):
        edits = (*condition.experiment.edits, *parts)
        changed = condition.experiment.changed(loop=loop, known_loop=known, edits=edits)
        conditions.append(replace(condition, experiment=changed))
    return conditions
