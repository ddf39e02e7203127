"""grosmc-mj run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, Laws, Out, Target
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.cli.targets import result_name
from grosmc_mj.errors import ArgumentError, GrosmcError

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.assumptions.audit import Audit
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import Judgement
    from grosmc_mj.experiments.runs import RunResult
    from grosmc_mj.plants.system import Signal
    from grosmc_mj.results.tables import Table


@dataclass(frozen=True)
class RunCommand(Command):
    """Run an experiment, and say whether it keeps what it requires.

    A case file names a plant (a system of the package, an MJCF robot, or Python of your own),
    edits, disturbances, laws with their numbers, and requirements; grosmc-mj new writes one to
    begin with. The package's own cases are such files, see grosmc-mj list; of a SYSTEM all run.
    NAME.json, NAME.png and NAME.svg go to --out, and the figure's curves to
    DIR/curves/NAME.json, for grosmc-mj report.

    Exit code: 0 if every requirement that a run can be judged by is kept, 1 if one is not, 2 if
    file or set-up is wrong, or no requirement of a file that has some can be judged.

    Attributes:
        target: A system, a case of the package or a case file.
        laws: Laws to run, of the file's controllers or of its [laws].
        out: Folder for the results.
        figures: Whether to draw the figure.
        save: Write each trajectory too, a column a signal with its unit: --save for Parquet,
            --save csv for CSV. They go to DIR/trajectories/NAME.PLANT.LAW.parquet.
        film: Whether to film its laws side by side in MuJoCo: DIR/films/NAME.mp4.
    """

    target: Target
    laws: Laws = ()
    out: Out = Path("renders")
    figures: bool = True
    save: Annotated[Literal["parquet", "csv"] | None, arg(help_behavior_hint="(default: none)")] = (
        None
    )
    film: Flag = False

    def execute(self) -> int:
        """Run, judge, write, print and draw one experiment after the other."""
        from grosmc_mj.experiments.catalogue import find_experiments

        experiments = find_experiments(self.target)
        if self.laws:
            experiments = [experiment.with_laws(self.laws) for experiment in experiments]
        for experiment in experiments:
            _check(experiment)

        self.out.mkdir(parents=True, exist_ok=True)
        alone = len(experiments) == 1
        kept = [self._run(experiment, alone=alone) for experiment in experiments]
        return DONE if all(kept) else DIFFERS

    def _run(self, experiment: Experiment, *, alone: bool) -> bool:
        """Run one experiment; returns True if it keeps what it requires.

        Args:
            experiment: The experiment.
            alone: True if it is the only one of the command: its answer is longer.
        """
        from grosmc_mj.assumptions.robot import audits
        from grosmc_mj.results.result import KEPT

        name = result_name(experiment.path)
        path = self.out / f"{name}.json"
        results: list[RunResult] = []
        premises: Sequence[Audit] = ()
        complete = False
        verdict = ""
        try:
            steps = len(experiment.plant_names) * len(experiment.controllers)
            with screen.progress(steps) as advance:
                for result in experiment.runs():
                    results.append(result)
                    advance(result.key)
            premises = audits(results)
            complete = True
        finally:
            # Results are kept and shown, whatever happened since.
            if results:
                answer = _judge(experiment, results, premises, complete=complete)
                verdict = answer.verdict
                self._write(answer, path, alone=alone)

        files = [path]
        if self.figures:
            files.append(_draw(results, path.with_suffix(".png")))
        console = screen.console()
        if self.save:
            folder = self.out / "trajectories"
            for result in results:
                law = re.sub(r"[^\w.+-]+", "_", result.controller.name)
                result.save(folder / f"{name}.{result.plant}.{law}.{self.save}")
            console.print(f"{len(results)} trajectories in {folder}", soft_wrap=True)
        screen.say_files(console, *files)
        if self.film:
            film_runs(console, results, experiment.settings, self.out / FOLDER / f"{name}.mp4")
        return verdict == KEPT

    def _write(self, answer: _Answer, path: Path, *, alone: bool) -> None:
        """Write the results of an experiment, and print them, also if they cannot be written."""
        from grosmc_mj.experiments.curves import write_curves
        from grosmc_mj.results.document import keep_other, write_json

        try:
            aside = keep_other(path, answer.content, "configuration")
            write_json(path, answer.content)
            write_curves(answer.results, path.stem, path.parent)
        finally:
            if alone:
                _print_alone(answer, verbose=self.verbose)
            else:
                _print_among(answer, path.stem, verbose=self.verbose)
            if self.verbose:
                _print_tables(answer)

        if aside is not None:
            screen.console().print(
                f"{path.name} had results of another file or other settings: now in {aside.name}; "
                "figures and trajectories of that name are replaced",
                style="dim",
            )


@dataclass(frozen=True)
class _Answer:
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
    def verdict(self) -> str:
        """Verdict of the document."""
        return self.content["answers"][0]["verdict"]

    @property
    def words(self) -> str:
        """Verdict as a sentence, without its full stop."""
        return self.content["answers"][0]["words"]


def _judge(
    experiment: Experiment,
    results: Sequence[RunResult],
    premises: Sequence[Audit],
    *,
    complete: bool,
) -> _Answer:
    """Judge the runs of an experiment, and make their document."""
    from grosmc_mj.chapter.premises import audit_document
    from grosmc_mj.experiments.document import experiment_document
    from grosmc_mj.experiments.requirements import judge_all

    judgements = judge_all(experiment.limits, results)
    content = experiment_document(
        experiment,
        results,
        judgements,
        complete=complete,
        premises=[audit_document(audit) for audit in premises],
    )
    return _Answer(experiment, results, premises, judgements, content)


def _check(experiment: Experiment) -> None:
    """Refuse, before anything runs, mistakes of a file that a single run would not notice.

    They are unknown claims, wrong [[uncertain]] tables, as a campaign would refuse them, and
    requirements none of which can be judged: nothing would be kept or failed.
    """
    from grosmc_mj.chapter.claims.cited import cited_claims

    cited_claims(experiment)
    if experiment.file.uncertain:
        from grosmc_mj.sweep.family import family_of

        try:
            family_of(experiment.file, experiment.case, experiment.nominal.plant)
        except GrosmcError as error:
            raise ArgumentError(f"{experiment.path}: {error}") from error

    if experiment.not_judged and not experiment.limits:
        notes = "; ".join(line.removeprefix("not judged: ") for line in experiment.not_judged)
        raise ArgumentError(f"{experiment.path}: no requirement can be judged: {notes}")


def _print_alone(answer: _Answer, *, verbose: bool) -> None:
    """Print the answer of the only experiment, with its requirements, runs, loop and machine."""
    console = screen.console()
    _print_verdict(console, answer, f"{answer.words}.", verbose=verbose)
    if answer.judgements:
        console.print(_requirements_table(answer.judgements))
    console.print(_runs_table(answer.results))

    experiment = answer.experiment
    screen.say_lines(console, _loop_lines(experiment), "dim", full=verbose)
    screen.say_lines(console, _machine_lines(experiment), "dim", full=verbose)
    screen.say_lines(console, _rest_lines(experiment), "dim", full=verbose)
    if experiment.nominal.robot is not None:
        screen.say_lines(console, experiment.nominal.robot.notes, "dim", full=verbose)


def _print_among(answer: _Answer, name: str, *, verbose: bool) -> None:
    """Print the answer of one of several experiments, with the requirements that fail."""
    from grosmc_mj.results.result import KEPT

    console = screen.console()
    _print_verdict(console, answer, f"{name}: {answer.words}.", verbose=verbose)
    if answer.judgements and answer.verdict != KEPT:
        failed = [judgement for judgement in answer.judgements if not judgement.kept]
        console.print(_requirements_table(failed))


def _print_verdict(console: Console, answer: _Answer, words: str, *, verbose: bool) -> None:
    """Print the verdict, what is wrong, and how many premises of each law hold."""
    from grosmc_mj.results.result import KEPT

    screen.say_verdict(console, words, good=answer.verdict == KEPT)
    screen.say_lines(console, list(_mistakes(answer)), full=verbose)
    for audit in answer.premises:
        count = len(audit.premises)
        held = count - len(audit.failed())
        console.print(f"premises of {audit.controller}: {held} of {count} hold", style="dim")


def _print_tables(answer: _Answer) -> None:
    """Print all tables of an answer, and where the premises are worst."""
    from grosmc_mj.chapter.premises import audit_table, worst_points

    screen.say_tables(answer.content)
    for audit in answer.premises:
        screen.wide_console().print(audit_table(audit), *worst_points(audit), sep="\n")


def _mistakes(answer: _Answer) -> Iterator[str]:
    """Yield a line for each requirement not judged, run that ended early and failed premise."""
    from grosmc_mj.experiments.tables import endings

    yield from answer.experiment.not_judged
    yield from endings(answer.results)
    for audit in answer.premises:
        for premise in audit.failed():
            yield f"premise fails: {premise.name} of {audit.controller} ({premise.source})"


def _loop_lines(experiment: Experiment) -> list[str]:
    """Return lines on the control loop, if there is one, with its assumed numbers."""
    from grosmc_mj.experiments.file.parts import LOOP_PARTS

    loop = experiment.case.loop
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
    from grosmc_mj.experiments.file.parts import MACHINE_PARTS, MACHINE_UNITS, unit_of

    parts = experiment.case.parts
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
            number = f"{name} {getattr(part, name):.4g} {unit}".rstrip()
            if name in table.assumed:
                number += "*"
            numbers.append(number)
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


def _requirements_table(judgements: Sequence[Judgement]) -> Table:
    """Return the table of requirements, those that fail first."""
    rows = []
    styles = []
    for judgement in sorted(judgements, key=lambda judgement: judgement.kept):
        limit = judgement.limit
        verdict = "kept" if judgement.kept else "FAILED"
        if judgement.note and not judgement.kept:
            verdict += f": {judgement.note}"
        rows.append(
            (
                verdict,
                limit.words,
                judgement.controller,
                judgement.plant,
                _quantity(judgement.measured, limit.unit),
                _quantity(judgement.margin, limit.unit),
            )
        )
        styles.append("" if judgement.kept else "red")

    columns = ("", "requirement", "law", "plant", "measured", "margin")
    return screen.brief_table("", columns, rows, words=4, most=9, styles=styles)


def _quantity(value: float | None, unit: str) -> str:
    """Return a value with its unit, or a dash."""
    from grosmc_mj.results.tables import number

    if value is None:
        return "-"
    if unit == "1":
        return number(value)
    return f"{number(value)} {unit}".strip()


def _runs_table(results: Sequence[RunResult]) -> Table:
    """Return the main numbers of runs of one case, physics first."""
    from grosmc_mj.experiments.tables import metric_cell

    rows = []
    styles = []
    for result in sorted(results, key=lambda result: result.plant != "physics"):
        law = f"{result.controller.name} (!)" if result.ended else result.controller.name
        metrics = (
            result.metrics["deviation"],
            result.metrics["settling_time"],
            *result.cost_shares,
            result.metrics["max_input"],
        )
        rows.append((result.plant, law, *map(metric_cell, metrics)))
        styles.append("red" if result.ended else "")

    error = results[0].controller.designed.error
    output_unit = error.units[error.output_rows[0]]
    input_unit = results[0].trajectory.system.input.unit
    columns = (
        "plant",
        "law",
        f"max|y-y*| [{output_unit}]",
        "settled [s]",
        "J(u_c)/J*",
        "J(u_d)/J* [1/s]",
        f"max|u| [{input_unit}]",
    )
    return screen.brief_table("", columns, rows, words=2, most=9, styles=styles)


def _draw(results: Sequence[RunResult], path: Path) -> Path:
    """Draw the figure; returns its path."""
    from grosmc_mj.experiments.curves import draw_experiment, figure_size
    from grosmc_mj.results.figure import figure_written

    with figure_written(path, figure_size(results)) as figure:
        draw_experiment(figure, results)
    return path
