"""grosmc-mj run."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Laws
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.cli.targets import TARGET, result_name
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.results.palette import FAILED

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.assumptions.audit import Audit
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.requirements import Judgement
    from grosmc_mj.experiments.runs import RunResult
    from grosmc_mj.results.tables import Table


# Files of trajectories that are listed one by one.
_LISTED = 4


@dataclass(frozen=True)
class RunCommand(Command):
    """Run an experiment, and say whether it keeps what it requires.

    A case file names a plant (a system of the package, an MJCF robot, or Python of your own),
    edits, disturbances, laws with their numbers, and requirements; grosmc-mj new writes one to
    begin with. The package's own cases are such files, see grosmc-mj list; of a SYSTEM all run.
    NAME.json, NAME.png and NAME.svg go to --out, and the figure's curves to
    DIR/curves/NAME.json, for grosmc-mj report.

    Exit code: 0 if every requirement that a run tells about is kept, 1 if one is not, 2 if file or
    set-up is wrong, or runs tell about no requirement of a file that has some.

    Attributes:
        target: A system, a case of the package or a case file.
        laws: Laws to run, of the file's controllers or of its [laws].
        out: Folder for the results.
        figures: Whether to draw the figure.
        save: Write each trajectory too, a column a signal with its unit: --save for Parquet, or
            csv or npz. They go to DIR/trajectories/NAME.PLANT.LAW.parquet.
        film: Whether to film its laws side by side in MuJoCo: DIR/films/NAME.mp4.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    laws: Laws = ()
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")
    figures: bool = True
    save: Literal["parquet", "csv", "npz"] | None = None
    film: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False

    def execute(self) -> int:
        """Run, write, judge, print, draw."""
        from grosmc_mj.chapter.claims.cited import cited_claims
        from grosmc_mj.experiments.catalogue import find_experiments

        experiments = find_experiments(self.target)
        if self.laws:
            experiments = [one.with_laws(self.laws) for one in experiments]
        for experiment in experiments:
            _check_uncertain(experiment)
            _refuse_unjudgeable(experiment)
            cited_claims(experiment)
        self.out.mkdir(parents=True, exist_ok=True)
        done: list[_JudgedExperiment] = []
        try:
            for experiment in experiments:
                name = result_name(experiment.path)
                done.append(_JudgedExperiment(name, experiment, self.out / f"{name}.json"))
                done[-1].run()
        finally:
            # What was computed is shown and kept, whatever happened since.
            if any(each.results for each in done):
                self._say(done)
        files = [each.file for each in done]
        if self.figures:
            files += [_draw(each.results, each.file.with_suffix(".png")) for each in done]
        saved = [file for each in done for file in self._saved(each)]
        console = screen.console()
        screen.say_files(console, *files, *(saved if len(saved) <= _LISTED else ()))
        for each in done:
            if each.aside is not None:
                console.print(
                    f"{each.file.name} had results of another file or other settings: now in "
                    f"{each.aside.name}; figures and trajectories of that name are replaced",
                    style="dim",
                )
        if len(saved) > _LISTED:
            console.print(f"{len(saved)} trajectories in {saved[0].parent}", style="dim")
        for each in done if self.film else ():
            path = self.out / FOLDER / f"{each.name}.mp4"
            film_runs(console, each.results, each.experiment.settings, path)
        return screen.DONE if all(each.kept for each in done) else screen.DIFFERS

    def _saved(self, done: _JudgedExperiment) -> list[Path]:
        """The trajectories, if they are wanted."""
        folder = self.out / "trajectories"
        return [
            each.save(folder / f"{done.name}.{each.plant}.{_plain(each)}.{self.save}")
            for each in (done.results if self.save else ())
        ]

    def _say(self, done: Sequence[_JudgedExperiment]) -> None:
        """The answer, and the tables."""
        console = screen.console()
        if len(done) == 1:
            _answer(console, done[0], full=self.verbose)
        else:
            _answers(console, done)
        if self.verbose:
            for each in done:
                _tables(screen.wide_console(), each)


@dataclass
class _JudgedExperiment:
    """One experiment and what came out.

    Attributes:
        name: Of its files.
        experiment: What runs.
        file: Its JSON.
        results: The runs that are done.
        premises: Those of a robot's laws.
        judgements: Of the requirements.
        aside: Where results of the same name are now that another file or other settings gave.
    """

    name: str
    experiment: Experiment
    file: Path
    results: list[RunResult] = field(default_factory=list)
    premises: Sequence[Audit] = ()
    judgements: Sequence[Judgement] = ()
    aside: Path | None = None

    @property
    def failed(self) -> list[Judgement]:
        """The requirements that are not kept."""
        return [each for each in self.judgements if not each.kept]

    @property
    def kept(self) -> bool:
        """Whether it keeps all that it requires or, if that is nothing, runs to its end."""
        ended = not self.experiment.limits and any(result.ended for result in self.results)
        return not self.failed and not ended

    def run(self) -> None:
        """Run it, judge it, write its JSON."""
        from grosmc_mj.assumptions.robot import audits
        from grosmc_mj.chapter.premises import audit_document
        from grosmc_mj.experiments.curves import write_curves
        from grosmc_mj.experiments.document import experiment_document
        from grosmc_mj.experiments.requirements import judge_all
        from grosmc_mj.results.document import keep_other, write_json

        complete = False
        try:
            with screen.progress(
                len(self.experiment.plant_names) * len(self.experiment.controllers)
            ) as advance:
                for result in self.experiment.runs():
                    self.results.append(result)
                    advance(result.key)
            complete = True
            self.premises = audits(self.results)
        finally:
            self.judgements = judge_all(self.experiment.limits, self.results)
            if self.results:
                content = experiment_document(
                    self.experiment,
                    self.results,
                    self.judgements,
                    complete=complete,
                    premises=[audit_document(audit) for audit in self.premises],
                )
                self.aside = keep_other(self.file, content, "configuration")
                write_json(self.file, content)
                write_curves(self.results, self.name, self.file.parent)


def _plain(result: RunResult) -> str:
    """The name of a run's law as part of a file's."""
    return re.sub(r"[^\w.+-]+", "_", result.controller.name)


def _check_uncertain(experiment: Experiment) -> None:
    """Refuse wrong [[uncertain]] tables, as a campaign would; a single run does not need them."""
    if not experiment.file.uncertain:
        return
    from grosmc_mj.sweep.family import family_of

    try:
        family_of(experiment.file, experiment.case, experiment.nominal.plant)
    except GrosmcError as error:
        raise ArgumentError(f"{experiment.path}: {error}") from error


def _refuse_unjudgeable(experiment: Experiment) -> None:
    """Refuse requirements of which runs tell about none: nothing would be kept or failed."""
    if experiment.not_judged and not experiment.limits:
        notes = [each.removeprefix("not judged: ") for each in experiment.not_judged]
        raise ArgumentError(f"{experiment.path}: no requirement can be judged: {'; '.join(notes)}")


def _answer(console: Console, done: _JudgedExperiment, *, full: bool) -> None:
    """Whether one experiment keeps its requirements, and its main numbers."""
    from grosmc_mj.experiments import tables

    wrong, all_of_them = done.failed, done.judgements
    words = _kept(len(wrong), len(all_of_them), len(done.experiment.not_judged))
    if not done.experiment.limits:
        words = "The file requires nothing: give it a [[requirement]]."
    screen.say_verdict(console, words, good=done.kept)
    screen.say_lines(console, list(done.experiment.not_judged), FAILED, all=full)
    screen.say_lines(console, tables.endings(done.results), all=full)
    fails = [
        f"premise fails: {premise.name} of {audit.controller} ({premise.source})"
        for audit in done.premises
        for premise in audit.failed()
    ]
    screen.say_lines(console, fails, FAILED, all=full)
    for audit in done.premises:
        held = len(audit.premises) - len(audit.failed())
        console.print(
            f"premises of {audit.controller}: {held} of {len(audit.premises)} hold", style="dim"
        )
    if all_of_them:
        console.print(_requirements(all_of_them))
    console.print(runs_table(done.results))
    screen.say_lines(console, _in_loop(done.experiment), "dim", all=full)
    screen.say_lines(console, _on_its_machine(done.experiment), "dim", all=full)
    robot = done.experiment.nominal.robot
    changed = [*_at_rest(done.experiment), *(robot.notes if robot is not None else ())]
    screen.say_lines(console, list(changed), "dim", all=full)


def _at_rest(experiment: Experiment) -> list[str]:
    """Where a plant rests that a file says so of, and under which input."""
    point, system = experiment.nominal.at, experiment.nominal.system
    if point is None:
        return []
    named = [*zip(system.states, point.x, strict=True)], [*zip(system.inputs, point.u, strict=True)]
    state, inputs = (
        ", ".join(f"{each.name} = {value:.4g} {each.unit}" for each, value in pairs)
        for pairs in named
    )
    return [f"at rest at {state} under {inputs}"]


def _in_loop(experiment: Experiment) -> list[str]:
    """What lies between the laws and the plant, and of what the numbers are then."""
    from grosmc_mj.experiments.file.parts import LOOP_PARTS

    if (loop := experiment.case.loop) is None:
        return []
    assumed = [
        f"{' '.join(filter(None, [kind, getattr(table, 'of', '')]))}: {', '.join(table.assumed)}"
        for kind in LOOP_PARTS
        for table in _tables_of(experiment, kind)
        if table.assumed
    ]
    return [
        "in its loop: y is true, u is given; s is what the law sees, J of what it asks for",
        *([f"assumed of it: {'; '.join(assumed)}"] if assumed else []),
        *loop.words(experiment.nominal.system),
    ]


def _on_its_machine(experiment: Experiment) -> list[str]:
    """The parts of the machine that neither laws nor equations know; * marks assumed numbers."""
    from grosmc_mj.experiments.file.parts import MACHINE_PARTS, MACHINE_UNITS, unit_of

    tables = [(kind, t) for kind in MACHINE_PARTS for t in _tables_of(experiment, kind)]
    lines = []
    for (kind, table), part in zip(tables, experiment.case.parts, strict=True):
        numbers = [
            f"{name} {getattr(part, name):.4g} "
            f"{unit_of(kind, part.of, name, experiment.nominal.system)}".rstrip()
            + "*" * (name in table.assumed)
            for name in MACHINE_UNITS[kind]
            if name in table.model_fields_set
        ]
        lines.append(f"{part.kind} of {part.of}: {', '.join(numbers)}")
    head = "on its machine, in physics alone; no law knows of (* is assumed):"
    return [head, *lines] if lines else []


def _tables_of(experiment: Experiment, kind: str) -> list[Any]:
    """The tables of a kind of part in the file."""
    tables = getattr(experiment.file, kind)
    return tables if isinstance(tables, list) else [tables] if tables else []


def _kept(failed: int, judged: int, not_judged: int) -> str:
    """How many requirements are kept, in words."""
    if failed:
        words = f"{failed} of {judged} requirements are not kept."
    elif judged == 1:
        words = "The requirement is kept."
    else:
        words = f"All {judged} requirements are kept."
    return f"{words} {not_judged} cannot be judged." if not_judged else words


def _answers(console: Console, done: Sequence[_JudgedExperiment]) -> None:
    """The same of several experiments, a row each."""
    failed = sum(len(each.failed) for each in done)
    judged = sum(len(each.judgements) for each in done)
    untold = [f"{each.name}: {line}" for each in done for line in each.experiment.not_judged]
    words = _kept(failed, judged, len(untold))
    screen.say_verdict(console, words, good=all(each.kept for each in done))
    screen.say_lines(console, untold, FAILED, all=False)
    rows = [
        (
            each.name,
            ", ".join(f"{wrong.controller}: {wrong.limit.words}" for wrong in each.failed) or "-",
            f"{len(each.judgements) - len(each.failed)} of {len(each.judgements)}",
            str(sum(bool(result.ended) for result in each.results)),
        )
        for each in sorted(done, key=lambda each: -len(each.failed))
    ]
    columns = ("experiment", "not kept", "kept", "ended early")
    console.print(screen.brief_table("", columns, rows, words=2))


def _requirements(judgements: Sequence[Judgement]) -> Table:
    """What was required, what fails first."""
    from grosmc_mj.results.tables import number

    rows, styles = [], []
    for each in sorted(judgements, key=lambda each: each.kept):
        unit = each.limit.unit if each.limit.unit != "1" else ""
        said = "kept" if each.kept else "FAILED" + (f": {each.note}" if each.note else "")
        found = (each.measured, each.margin)
        cells = ("-" if x is None else f"{number(x)} {unit}".strip() for x in found)
        rows.append((said, each.limit.words, each.controller, each.plant, *cells))
        styles.append("" if each.kept else "red")
    columns = ("", "requirement", "law", "plant", "measured", "margin")
    return screen.brief_table("", columns, rows, words=4, most=9, styles=styles)


def runs_table(results: Sequence[RunResult]) -> Table:
    """The main numbers of runs of one case, physics first."""
    from grosmc_mj.experiments.tables import metric_cell

    system, error = results[0].trajectory.system, results[0].controller.designed.error
    output = error.units[error.output_rows[0]]
    rows, styles = [], []
    for result in sorted(results, key=lambda each: each.plant != "physics"):
        metrics = result.metrics
        law = result.controller.name + (" (!)" if result.ended else "")
        shares = result.cost_shares
        found = (metrics["deviation"], metrics["settling_time"], *shares, metrics["max_input"])
        rows.append((result.plant, law, *map(metric_cell, found)))
        styles.append("red" if result.ended else "")
    columns = (
        "plant", "law", f"max|y-y*| [{output}]", "settled [s]", "J(u_c)/J*", "J(u_d)/J* [1/s]",
        f"max|u| [{system.input.unit}]",
    )  # fmt: skip
    return screen.brief_table("", columns, rows, words=2, most=9, styles=styles)


def _tables(console: Console, done: _JudgedExperiment) -> None:
    """All that was measured."""
    from grosmc_mj.chapter.premises import audit_table, worst_points
    from grosmc_mj.experiments import tables

    console.print()
    console.print(tables.results_table(done.results))
    console.print()
    console.print(tables.LEGEND, style="dim")
    console.print(tables.gains_table(done.results))
    console.print()
    if done.judgements:
        console.print(tables.requirements_table(done.judgements))
        console.print()
    for audit in done.premises:
        console.print(audit_table(audit))
        for line in worst_points(audit):
            console.print(line, soft_wrap=True)


def _draw(results: Sequence[RunResult], path: Path) -> Path:
    """The figure."""
    from grosmc_mj.experiments.curves import draw_experiment, figure_size
    from grosmc_mj.results.figure import figure_written

    with figure_written(path, figure_size(results)) as figure:
        draw_experiment(figure, results)
    return path
