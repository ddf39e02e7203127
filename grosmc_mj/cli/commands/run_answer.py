"""Answer of run on the terminal: verdict, mistakes, requirements, runs, loop and machine."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from grosmc_mj.assumptions.audit import Audit
from grosmc_mj.assumptions.notes import notes_on
from grosmc_mj.chapter.premises import audit_document, audit_table, worst_points
from grosmc_mj.cli import screen
from grosmc_mj.experiments.document import experiment_document
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, MACHINE_UNITS, unit_of
from grosmc_mj.experiments.measured import MeasuredResult, disagreements
from grosmc_mj.experiments.tables import endings, requirements_table, results_table
from grosmc_mj.plants.system import Signal
from grosmc_mj.requirements.judging import Judgement
from grosmc_mj.requirements.requirement import Requirement
from grosmc_mj.results.result import KEPT
from grosmc_mj.results.tables import Table

# Rows of a table in an answer, which fits on a screen.
_MOST_ROWS = 9


@dataclass(frozen=True)
class RunAnswer:
    """Judged results of an experiment.

    Attributes:
        experiment: The experiment.
        results: Its runs.
        premises: Audits of the theorems' premises, one for each law.
        judgements: Requirements as each run keeps them.
        content: The document that is written.
    """

    experiment: Experiment
    results: Sequence[RunResult]
    premises: Sequence[Audit]
    judgements: Sequence[Judgement]
    content: Mapping[str, Any]

    @property
    def kept(self) -> bool:
        """True if everything that is required is kept."""
        return self.content["answers"][0]["verdict"] == KEPT

    @property
    def notes(self) -> Sequence[str]:
        """Notes beside the verdict, a line each."""
        return self.content["answers"][0]["notes"]

    @property
    def words(self) -> str:
        """Verdict as a sentence, without its full stop."""
        return self.content["answers"][0]["words"]


def judge(
    experiment: Experiment,
    results: Sequence[RunResult],
    premises: Sequence[Audit],
    *,
    draws: int,
    complete: bool,
) -> RunAnswer:
    """Return the judged runs of an experiment with their document.

    Args:
        experiment: The experiment.
        results: Its runs.
        premises: Audits of the theorems' premises.
        draws: Draws of a loop that the runs are judged over.
        complete: Whether nothing was interrupted.
    """
    simulated = [result for result in results if result.simulated]
    measured = [result for result in results if isinstance(result, MeasuredResult)]

    judgements = by_requirement(experiment.limits, simulated)
    notes = notes_on(experiment, simulated) if simulated else list(experiment.not_judged)
    if simulated and experiment.loop is not None and experiment.loop.drawn and draws > 1:
        notes.append(f"judged by the worst of {draws} draws of noise, timing and encoders' phases")
    for result in measured:
        judgements += result.requirements
        notes += result.not_judged
    notes += disagreements(experiment, judgements)
    content = experiment_document(
        experiment,
        results,
        judgements,
        complete=complete,
        notes=notes,
        premises=[audit_document(audit) for audit in premises],
    )
    return RunAnswer(experiment, results, premises, judgements, content)


def by_requirement(
    requirements: Iterable[Requirement], results: Sequence[RunResult]
) -> list[Judgement]:
    """Return the judgements of all runs, requirement by requirement."""
    judgements = [judgement for result in results for judgement in result.requirements]
    ordered: list[Judgement] = []
    for requirement in requirements:
        ordered += [item for item in judgements if item.requirement is requirement]
    return ordered


def print_alone(answer: RunAnswer, *, verbose: bool) -> None:
    """Print the answer of the only experiment, with its requirements, runs, loop and machine."""
    console = screen.console()
    _print_verdict(console, answer, f"{answer.words}.", verbose=verbose)
    if answer.judgements:
        console.print(_brief(requirements_table(answer.judgements)))
    console.print(_brief(results_table(answer.results)))

    screen.say_lines(console, _log_lines(answer.results), "dim", full=verbose)
    if not any(result.simulated for result in answer.results):
        return
    experiment = answer.experiment
    screen.say_lines(console, _loop_lines(experiment), "dim", full=verbose)
    screen.say_lines(console, _machine_lines(experiment), "dim", full=verbose)
    screen.say_lines(console, _rest_lines(experiment), "dim", full=verbose)


def _brief(table: Table) -> Table:
    """Return a table as the answer has it: its first rows, below the verdict, without a title."""
    return table.brief(_MOST_ROWS).model_copy(update={"title": ""})


def print_among(answer: RunAnswer, name: str, *, verbose: bool) -> None:
    """Print the answer of one of several experiments, with the requirements that fail."""
    console = screen.console()
    _print_verdict(console, answer, f"{name}: {answer.words}.", verbose=verbose)
    if answer.judgements and not answer.kept:
        failed = [judgement for judgement in answer.judgements if not judgement.kept]
        console.print(_brief(requirements_table(failed)))


def _print_verdict(
    console: Console,
    answer: RunAnswer,
    words: str,
    *,
    verbose: bool,
) -> None:
    """Print the verdict, notes, what is wrong, and how many premises of each law hold."""
    screen.say_verdict(console, words, good=answer.kept)
    screen.say_lines(console, list(_mistakes(answer)), full=verbose)
    screen.say_lines(console, answer.notes, "yellow", full=verbose)
    for audit in answer.premises:
        count = len(audit.premises)
        held = count - len(audit.failed())
        console.print(f"premises of {audit.controller}: {held} of {count} hold", style="dim")


def print_tables(answer: RunAnswer) -> None:
    """Print all tables of an answer, and where the premises are worst."""
    screen.say_tables(answer.content)
    for audit in answer.premises:
        screen.wide_console().print(audit_table(audit), *worst_points(audit), sep="\n")


def _mistakes(answer: RunAnswer) -> Iterator[str]:
    """Yield a line for each run that ended early and each premise that fails."""
    yield from endings(answer.results)
    for audit in answer.premises:
        for premise in audit.failed():
            yield f"premise fails: {premise.name} of {audit.controller} ({premise.source})"


def _log_lines(results: Sequence[RunResult]) -> list[str]:
    """Return a line on each log: its part that is judged, and where it starts."""
    lines = []
    for result in results:
        if not isinstance(result, MeasuredResult):
            continue
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
                starts.append(f"{state.name} {value:.4g} (case {declared:.4g}) {state.unit}")
        lines.append(
            f"{result.plant}: {result.log.name} from {result.begin:.4g} to {end:.4g} s; starts at "
            f"{', '.join(starts)}"
        )
    return lines


def _loop_lines(experiment: Experiment) -> list[str]:
    """Return lines on the control loop, if there is one, with its assumed numbers."""
    loop = experiment.loop
    if loop is None:
        return []

    lines = [
        "in its loop: y is the true state, u the input that is applied; s is computed from the "
        "measured state, J from the input that the law demands"
    ]
    assumed = []
    for kind, table in _tables_of(experiment, LOOP_PARTS):
        if table.assumed:
            part = f"{kind} {getattr(table, 'of', '')}".strip()
            assumed.append(f"{part}: {', '.join(table.assumed)}")
    if assumed:
        lines.append(f"assumed of it: {'; '.join(assumed)}")
    lines.extend(loop.words(experiment.nominal.system))
    return lines


def _machine_lines(experiment: Experiment) -> list[str]:
    """Return lines on the parts of the machine, if it has any; * marks assumed numbers."""
    parts = experiment.parts
    if not parts:
        return []

    lines = ["on its machine, in physics alone; no law knows of (* is assumed):"]
    tables = _tables_of(experiment, MACHINE_PARTS)
    for (kind, table), part in zip(tables, parts, strict=True):
        numbers = []
        for name in MACHINE_UNITS[kind]:
            if name not in table.model_fields_set:
                continue
            unit = unit_of(kind, part.of, name, experiment.nominal.system)
            text = f"{name} {getattr(part, name):.4g} {unit}".rstrip()
            if name in table.assumed:
                text += "*"
            numbers.append(text)
        lines.append(f"{part.kind} of {part.of}: {', '.join(numbers)}")
    return lines


def _tables_of(experiment: Experiment, kinds: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """Yield the tables of some kinds of parts in the file, each with its kind."""
    for kind in kinds:
        content = getattr(experiment.file, kind)
        if isinstance(content, list):
            for table in content:
                yield kind, table
        elif content:
            yield kind, content


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
    return ", ".join(f"{signal.name} = {value:.4g} {signal.unit}" for signal, value in pairs)
