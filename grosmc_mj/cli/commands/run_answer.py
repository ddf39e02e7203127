"""Result of run: judged requirements, failing premises, and lines on loop and machine."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence

from grosmc_mj.chapter.premises import audit_document, audit_table
from grosmc_mj.experiments.answer.document import experiment_result
from grosmc_mj.experiments.answer.tables import endings
from grosmc_mj.experiments.assumptions.audit import Audit
from grosmc_mj.experiments.assumptions.notes import notes_on
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, unit_of
from grosmc_mj.experiments.measured import MeasuredResult, disagreements
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine import MachinePart
from grosmc_mj.output.results import tables
from grosmc_mj.output.results.result import Result
from grosmc_mj.studies.ladder.assumed import assumed_numbers, in_words
from grosmc_mj.theory.plants.system import Signal, System


def answer_of_run(
    experiment: Experiment,
    results: Sequence[RunResult],
    premises: Sequence[Audit],
    *,
    draws: int,
    complete: bool,
) -> Result:
    """Return the judged runs of an experiment.

    Args:
        experiment: The experiment.
        results: Its runs.
        premises: Audits of the theorems' premises, one for each law.
        draws: Draws of a loop that the runs are judged over.
        complete: Whether nothing was interrupted.
    """
    simulated = [result for result in results if result.simulated]
    measured = [result for result in results if isinstance(result, MeasuredResult)]

    judgements = _by_requirement(experiment.limits, simulated)
    notes = notes_on(experiment, simulated) if simulated else list(experiment.not_judged)
    if not simulated or experiment.loop is None or not experiment.loop.drawn:
        draws = 1
    if draws > 1:
        notes.append(f"judged by the worst of {draws} draws of noise, timing and encoders' phases")
    for result in measured:
        judgements += result.requirements
        notes += [*result.notes, *result.not_judged]
    notes += disagreements(experiment, judgements)

    remarks = [*_premise_lines(premises), *_log_lines(measured)]
    if simulated:
        remarks += [
            *_loop_lines(experiment),
            *_machine_lines(experiment),
            *_rest_lines(experiment),
        ]
    return experiment_result(
        experiment,
        results,
        judgements,
        complete=complete,
        draws=draws,
        faults=[*endings(results), *_failing_premises(premises)],
        notes=notes,
        remarks=remarks,
        tables=[*_steps_tables(experiment, simulated), *map(audit_table, premises)],
        premises=[audit_document(audit) for audit in premises],
    )


def _by_requirement(
    requirements: Iterable[Requirement], results: Sequence[RunResult]
) -> list[Judgement]:
    """Return the judgements of all runs, requirement by requirement."""
    judgements = [judgement for result in results for judgement in result.requirements]
    ordered: list[Judgement] = []
    for requirement in requirements:
        ordered += [item for item in judgements if item.requirement is requirement]
    return ordered


def _premise_lines(premises: Sequence[Audit]) -> Iterator[str]:
    """Yield how many premises of each law hold."""
    for audit in premises:
        count = len(audit.premises)
        yield f"premises of {audit.controller}: {count - len(audit.failed())} of {count} hold"


def _failing_premises(premises: Sequence[Audit]) -> Iterator[str]:
    """Yield a line for each premise that fails."""
    for audit in premises:
        for premise in audit.failed():
            yield f"premise fails: {premise.name} of {audit.controller} ({premise.source})"


def _log_lines(results: Sequence[MeasuredResult]) -> list[str]:
    """Return a line on each log: its part that is judged, and where it starts."""
    lines = []
    for result in results:
        end = result.begin + result.trajectory.time[-1]
        starts = []
        pairs = zip(
            result.trajectory.system.states,
            result.trajectory.state[0].tolist(),
            result.case.x0,
            strict=True,
        )
        for state, value, declared in pairs:
            if math.isfinite(value):
                starts.append(
                    f"{state.name} {value:.4g} (case {declared:.4g}){unit_after(state.unit)}"
                )
        lines.append(
            f"{result.plant}: {result.log.name} from {result.begin:.4g} to {end:.4g} s; starts at "
            f"{', '.join(starts)}"
        )
    return lines


def _steps_tables(experiment: Experiment, simulated: Sequence[RunResult]) -> Iterator[tables.Table]:
    """Yield the table of the steps of simulations and laws; nothing where logs alone are judged."""
    if not simulated:
        return
    settings = experiment.settings
    row = (
        f"{settings.timestep:g} s",
        settings.integrator,
        f"{settings.control_period:g} s",
    )
    columns = tables.words("timestep", "integrator", "control period")
    yield tables.table("", columns, [row])


def _loop_lines(experiment: Experiment) -> list[str]:
    """Return lines on the control loop, if there is one, with its assumed numbers."""
    loop = experiment.loop
    if loop is None:
        return []

    lines = [
        "control loop: y is the true state, u the input that is applied; s is computed from the "
        "measured state, J from the input that the law demands"
    ]
    numbers = [number for number in assumed_numbers(experiment) if number.kind in LOOP_PARTS]
    assumed = []
    for kind, words in in_words(numbers):
        # The computer is its own owner.
        assumed.append(words if kind == "computing" else f"{kind} {words}")
    if assumed:
        lines.append(f"assumed numbers of the loop ({'; '.join(assumed)})")
    lines.extend(loop.words(experiment.nominal.system))
    return lines


# Tables of motors: those that laws know stand in place of the true ones.
_OF_MOTORS = ("motor", "known_motor")


def _machine_lines(experiment: Experiment) -> list[str]:
    """Return lines on the parts of the machine, if it has any; * marks assumed numbers."""
    parts = experiment.parts
    if not parts:
        return []

    file = experiment.file
    system = experiment.nominal.system
    voltages = experiment.nominal.voltages
    unknown = "no law knows these parts"
    if voltages:
        unknown += ", but for its motor"
    lines = [f"machine, in MuJoCo alone; {unknown} (*: an assumed number):"]
    of_file = [(kind, table) for kind in MACHINE_PARTS for table in getattr(file, kind)]
    for (kind, table), part in zip(of_file, parts, strict=True):
        known = [name for voltage in voltages for name in voltage.known_numbers(part)]
        names = [name for name in table.numbers if name not in known]
        numbers = _numbers_in_words(kind, part, names, table.assumed, system)
        lines.append(f"{part.kind} of {part.of}: {numbers or 'all of its numbers are known'}")

    of_motors = {
        table.values["input"]: table for kind in _OF_MOTORS for table in getattr(file, kind)
    }
    for voltage in voltages:
        motor = voltage.motor
        assumed = of_motors[motor.of].assumed
        numbers = _numbers_in_words("motor", motor, voltage.numbers, assumed, system)
        lines.append(f"laws give volts, and know of {motor.of}: {numbers}")
    return lines


def _numbers_in_words(
    kind: str, part: MachinePart, names: Iterable[str], assumed: Collection[str], system: System
) -> str:
    """Return numbers of a part of the machine with their units; * marks assumed ones."""
    numbers = []
    for name in names:
        unit = unit_of(kind, part.of, name, system)
        text = f"{name} {getattr(part, name):.4g}{unit_after(unit)}"
        if name in assumed:
            text += "*"
        numbers.append(text)
    return ", ".join(numbers)


def _rest_lines(experiment: Experiment) -> list[str]:
    """Return the line on the operating point, if there is one."""
    nominal = experiment.nominal
    if nominal.at is None:
        return []
    state = _values(nominal.system.states, nominal.at.x)
    inputs = _values(nominal.system.inputs, nominal.at.u)
    return [f"at rest at {state} under {inputs}"]


def _values(signals: Iterable[Signal], values: Iterable[float]) -> str:
    """Return signals with their values and units."""
    pairs = zip(signals, values, strict=True)
    return ", ".join(
        f"{signal.name} = {value:.4g}{unit_after(signal.unit)}" for signal, value in pairs
    )
