"""grosmc-mj run."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
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
    from grosmc_mj.assumptions.audit import Audit
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import Judgement
    from grosmc_mj.experiments.runs import RunResult
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
        """Run, judge, write, print, draw, one experiment after the other."""
        from grosmc_mj.experiments.catalogue import find_experiments

        experiments = find_experiments(self.target)
        if self.laws:
            experiments = [one.with_laws(self.laws) for one in experiments]
        for experiment in experiments:
            _check(experiment)
        self.out.mkdir(parents=True, exist_ok=True)
        kept = [self._run(one, alone=len(experiments) == 1) for one in experiments]
        return DONE if all(kept) else DIFFERS

    def _run(self, experiment: Experiment, *, alone: bool) -> bool:
        """Whether an experiment keeps what it requires."""
        from grosmc_mj.assumptions.robot import audits
        from grosmc_mj.results.result import KEPT

        results: list[RunResult] = []
        premises: Sequence[Audit] = ()
        name, answer, complete = result_name(experiment.path), {"verdict": ""}, False
        path = self.out / f"{name}.json"
        try:
            steps = len(experiment.plant_names) * len(experiment.controllers)
            with screen.progress(steps) as advance:
                for result in experiment.runs():
                    results.append(result)
                    advance(result.key)
            complete, premises = True, audits(results)
        finally:
            # Results are kept and shown, whatever happened since.
            if results:
                answer = self._answer(experiment, results, premises, path, complete, alone)
        console, files = screen.console(), [path]
        if self.figures:
            files.append(_draw(results, path.with_suffix(".png")))
        if self.save:
            folder = self.out / "trajectories"
            for result in results:
                law = re.sub(r"[^\w.+-]+", "_", result.controller.name)
                result.save(folder / f"{name}.{result.plant}.{law}.{self.save}")
            console.print(f"{len(results)} trajectories in {folder}", soft_wrap=True)
        screen.say_files(console, *files)
        if self.film:
            film_runs(console, results, experiment.settings, self.out / FOLDER / f"{name}.mp4")
        return answer["verdict"] == KEPT

    def _answer(
        self,
        experiment: Experiment,
        results: Sequence[RunResult],
        premises: Sequence[Audit],
        path: Path,
        complete: bool,
        alone: bool,
    ) -> dict[str, Any]:
        """Judge, write and print the results of an experiment; returns the answer."""
        from grosmc_mj.chapter.premises import audit_document, audit_table, worst_points
        from grosmc_mj.experiments.curves import write_curves
        from grosmc_mj.experiments.document import experiment_document
        from grosmc_mj.experiments.requirements import judge_all
        from grosmc_mj.results.document import keep_other, write_json
        from grosmc_mj.results.result import KEPT

        judged, console = judge_all(experiment.limits, results), screen.console()
        content = experiment_document(
            experiment, results, judged, complete=complete,
            premises=[audit_document(audit) for audit in premises],
        )  # fmt: skip
        answer, aside = content["answers"][0], None
        try:
            aside = keep_other(path, content, "configuration")
            write_json(path, content)
            write_curves(results, path.stem, path.parent)
        finally:
            # Results that cannot be written are printed.
            words = f"{answer['words']}." if alone else f"{path.stem}: {answer['words']}."
            screen.say_verdict(console, words, good=answer["verdict"] == KEPT)
            screen.say_lines(
                console, list(_wrong(experiment, results, premises)), full=self.verbose
            )
            for audit in premises:
                held = f"{len(audit.premises) - len(audit.failed())} of {len(audit.premises)} hold"
                console.print(f"premises of {audit.controller}: {held}", style="dim")
            if judged and (alone or answer["verdict"] != KEPT):
                console.print(_requirements(judged if alone else [x for x in judged if not x.kept]))
            if alone:
                console.print(runs_table(results))
                for lines in _described(experiment):
                    screen.say_lines(console, lines, "dim", full=self.verbose)
            if self.verbose:
                screen.say_tables(content)
                for audit in premises:
                    screen.wide_console().print(audit_table(audit), *worst_points(audit), sep="\n")
        if aside is not None:
            console.print(
                f"{path.name} had results of another file or other settings: now in {aside.name}; "
                "figures and trajectories of that name are replaced", style="dim",
            )  # fmt: skip
        return answer


def _check(experiment: Experiment) -> None:
    """Refuse, before anything runs, what a file says wrongly and a single run does not need.

    That are unknown claims, wrong [[uncertain]] tables, as a campaign would refuse them, and
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


def _wrong(
    experiment: Experiment, results: Sequence[RunResult], premises: Sequence[Audit]
) -> Iterator[str]:
    """A line for each requirement without a judgement, run that ended early and failed premise."""
    from grosmc_mj.experiments.tables import endings

    yield from experiment.not_judged
    yield from endings(results)
    for audit in premises:
        for premise in audit.failed():
            yield f"premise fails: {premise.name} of {audit.controller} ({premise.source})"


def _described(experiment: Experiment) -> Iterator[list[str]]:
    """The loop, the parts of the machine, and where a robot rests; * marks assumed numbers."""
    from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, MACHINE_UNITS, unit_of

    case, nominal = experiment.case, experiment.nominal
    if case.loop is not None:
        assumed = [
            f"{kind} {getattr(table, 'of', '')}".strip() + f": {', '.join(table.assumed)}"
            for kind, table in _tables_of(experiment, LOOP_PARTS)
            if table.assumed
        ]
        yield [
            "in its loop: y is the true state, u the input that is applied; s is computed from the "
            "measured state, J from the input that the law demands",
            *([f"assumed of it: {'; '.join(assumed)}"] if assumed else []),
            *case.loop.words(nominal.system),
        ]
    parts = []
    for (kind, table), part in zip(
        _tables_of(experiment, MACHINE_PARTS), case.parts, strict=True
    ):  # fmt: skip
        numbers = [
            f"{name} {getattr(part, name):.4g} {unit_of(kind, part.of, name, nominal.system)}"
            .rstrip() + "*" * (name in table.assumed)
            for name in MACHINE_UNITS[kind]
            if name in table.model_fields_set
        ]  # fmt: skip
        parts.append(f"{part.kind} of {part.of}: {', '.join(numbers)}")
    if parts:
        yield ["on its machine, in physics alone; no law knows of (* is assumed):", *parts]
    if nominal.at is not None:
        state, inputs = (
            ", ".join(f"{one.name} = {x:.4g} {one.unit}" for one, x in zip(names, at, strict=True))
            for names, at in (
                (nominal.system.states, nominal.at.x), (nominal.system.inputs, nominal.at.u)
            )
        )  # fmt: skip
        yield [f"at rest at {state} under {inputs}"]
    if nominal.robot is not None:
        yield list(nominal.robot.notes)


def _tables_of(experiment: Experiment, kinds: Iterable[str]) -> Iterator[tuple[str, Any]]:
    """The tables of some kinds of parts in the file, each with its kind."""
    for kind in kinds:
        tables = getattr(experiment.file, kind)
        for table in tables if isinstance(tables, list) else filter(None, [tables]):
            yield kind, table


def _requirements(judgements: Sequence[Judgement]) -> Table:
    """What was required, what fails first."""
    from grosmc_mj.results.tables import number

    rows, styles = [], []
    for item in sorted(judgements, key=lambda item: item.kept):
        unit = item.limit.unit if item.limit.unit != "1" else ""
        verdict = "kept" if item.kept else "FAILED" + (f": {item.note}" if item.note else "")
        values = (item.measured, item.margin)
        cells = ("-" if x is None else f"{number(x)} {unit}".strip() for x in values)
        rows.append((verdict, item.limit.words, item.controller, item.plant, *cells))
        styles.append("" if item.kept else "red")
    columns = ("", "requirement", "law", "plant", "measured", "margin")
    return screen.brief_table("", columns, rows, words=4, most=9, styles=styles)


def runs_table(results: Sequence[RunResult]) -> Table:
    """The main numbers of runs of one case, physics first."""
    from grosmc_mj.experiments.tables import metric_cell

    system, error = results[0].trajectory.system, results[0].controller.designed.error
    output = error.units[error.output_rows[0]]
    rows, styles = [], []
    for result in sorted(results, key=lambda result: result.plant != "physics"):
        metrics = result.metrics
        law = result.controller.name + (" (!)" if result.ended else "")
        shown = (
            metrics["deviation"], metrics["settling_time"], *result.cost_shares,
            metrics["max_input"],
        )  # fmt: skip
        rows.append((result.plant, law, *map(metric_cell, shown)))
        styles.append("red" if result.ended else "")
    columns = (
        "plant", "law", f"max|y-y*| [{output}]", "settled [s]", "J(u_c)/J*", "J(u_d)/J* [1/s]",
        f"max|u| [{system.input.unit}]",
    )  # fmt: skip
    return screen.brief_table("", columns, rows, words=2, most=9, styles=styles)


def _draw(results: Sequence[RunResult], path: Path) -> Path:
    """The figure."""
    from grosmc_mj.experiments.curves import draw_experiment, figure_size
    from grosmc_mj.results.figure import figure_written

    with figure_written(path, figure_size(results)) as figure:
        draw_experiment(figure, results)
    return path
