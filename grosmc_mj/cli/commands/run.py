"""grosmc-mj run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import (
    OUTPUT,
    Figures,
    Flag,
    Laws,
    Out,
    Target,
    WholeNumber,
    command,
)
from grosmc_mj.cli.films import FOLDER, film_runs
from grosmc_mj.cli.targets import result_name
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import name_in_files
from grosmc_mj.ground.wording import counted

if TYPE_CHECKING:
    from grosmc_mj.experiments.assumptions.audit import Audit
    from grosmc_mj.experiments.experiment import Experiment, RunResult
    from grosmc_mj.output.results.result import Result

# Timesteps from which on the memory of a run's record is counted before the run.
_LONG = 1_000_000


@command
class RunCommand(AnsweringCommand):
    """Run an experiment, and say whether it keeps what it requires.

    A case file names a plant (a system of the package, an MJCF robot, or Python of your own),
    edits, disturbances, laws with their numbers, and requirements; grosmc-mj new writes one to
    begin with. The package's own cases are such files, see grosmc-mj list; of a SYSTEM all run.
    Logs of the real machine, of --log or of [[measured]] in the file, are judged like runs.
    NAME.json, NAME.png and NAME.svg go to --out, and the figure's curves to
    DIR/curves/NAME.json, for grosmc-mj report.

    Exit code: 0 if every requirement that a run can be judged by is kept, 1 if one is not, 2 if
    file or set-up is wrong, or no requirement of a file that has some can be judged.

    Attributes:
        target: A system, a case (SYSTEM/CASE) or a case file (FILE.toml).
        laws: Laws to run, of the file's controllers or of its [laws].
        out: Folder for the results.
        figures: Draw the figure.
        draws: Runs in a loop with an encoder, noise, jitter or missed samples: each has random
            numbers of its own and other phases of the encoders, and all must keep what is required.
        log: Logs of the real machine that are judged in place of simulations, one by one, by
            the case's requirements. CSV, Parquet, MCAP or MATLAB, its columns as [log] of the
            file says; it begins where the run begins. With several laws, --laws names the one
            that made it.
        save: Write each trajectory too, a column a signal with its unit: --save for Parquet,
            --save csv for CSV. They go to DIR/trajectories/NAME.PLANT.LAW.parquet.
        film: Film its laws side by side in MuJoCo: DIR/films/NAME.mp4.
    """

    target: Target
    _: KW_ONLY
    laws: Laws = ()
    log: Annotated[tuple[Path, ...], Parameter(metavar="LOG...", show_default="none")] = ()
    out: Out = Path("renders")
    figures: Figures = True
    draws: WholeNumber = 10
    save: Annotated[
        Literal["parquet", "csv"] | None,
        Parameter(metavar="[FORMAT]", group=OUTPUT, show_default="none"),
    ] = None
    film: Annotated[Flag, Parameter(group=OUTPUT)] = False

    in_brief = True

    def questions(self) -> Sequence[Question]:
        """Return the question of each experiment."""
        from grosmc_mj.experiments.catalogue import find_experiments
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.draws)
        experiments = find_experiments(self.target)
        if self.laws:
            experiments = [experiment.changed(laws=self.laws) for experiment in experiments]
        if self.log and len(experiments) > 1:
            raise ArgumentError(f"--log: {self.target} is {len(experiments)} cases: name one")
        for experiment in experiments:
            _check(experiment)
            if not self.log:
                _require_memory(experiment)
        return [_RunQuestion(self, experiment) for experiment in experiments]

    def measured(self, experiment: Experiment) -> Sequence[RunResult]:
        """Return the logs of the command, or else those of the file, as runs.

        Raises:
            ArgumentError: If a log cannot be read, or no requirement can be judged by one.
        """
        from grosmc_mj.experiments.file.schema import MeasuredTable
        from grosmc_mj.experiments.measured import measured_results, results_of_logs

        if not self.log:
            return measured_results(experiment)

        tables = [MeasuredTable(log=str(path.absolute())) for path in self.log]
        measured = results_of_logs(experiment, tables)
        for result in measured:
            if experiment.limits and not result.requirements:
                reasons = "; ".join(result.not_judged) or "none is asked of the truest plant"
                raise ArgumentError(f"{result.log}: no requirement can be judged: {reasons}")
        return measured


class _RunQuestion(Question):
    """Does an experiment keep what it requires?"""

    def __init__(self, command: RunCommand, experiment: Experiment) -> None:
        from grosmc_mj.experiments.logs.log import name_of_log

        logs = [name_of_log(path) for path in command.log]
        self._name = "_".join([result_name(experiment.path), *logs])
        self.path = command.out / f"{self._name}.json"
        self._command = command
        self._experiment = experiment
        self._measured = command.measured(experiment)
        self._results: list[RunResult] = []
        self._premises: Sequence[Audit] = ()
        self._complete = False
        self._kept = False

    def measure(self) -> None:
        """Run the experiment, and audit its laws; of --log nothing runs."""
        from grosmc_mj.studies.sweep.draws import judged_over_draws

        experiment = self._experiment
        if not self._command.log:
            steps = len(experiment.plant_names) * len(experiment.controllers)
            with screen.progress(steps) as advance:
                for result in experiment.runs():
                    self._results.append(judged_over_draws(result, self._command.draws))
                    advance(result.key)
            self._premises = _audits_of_robots(experiment, self._results)
        self._results += self._measured

    def result(self, *, complete: bool) -> Result | None:
        """Return the judged runs."""
        from grosmc_mj.cli.commands.run_answer import answer_of_run

        if not self._results:
            return None
        result = answer_of_run(
            self._experiment,
            self._results,
            self._premises,
            draws=self._command.draws,
            complete=complete,
        )
        self._complete = complete
        self._kept = result.kept
        return result

    @property
    def missing(self) -> Sequence[str]:
        """Runs that are not made."""
        made = [(run.plant, run.controller.name) for run in self._results]
        runs = product(self._experiment.plant_names, self._experiment.controllers)
        return [f"{law} on {plant}" for plant, law in runs if (plant, law) not in made]

    def show(self, result: Result, *, full: bool, among: bool) -> None:
        """Write and print the result; that of another file of this name is renamed before."""
        from grosmc_mj.output.results.document import set_aside_other

        aside = None
        try:
            aside = set_aside_other(self.path, "configuration", result.configuration)
        finally:
            # It is printed also if it cannot be written.
            super().show(result, full=full, among=among)
        if aside is not None:
            screen.console().print(
                f"{self.path.name} had results of another file or other settings: now in "
                f"{aside.name}; figures and trajectories of that name are replaced",
                style="dim",
            )

    def draw(self) -> Sequence[Path]:
        """Write the curves and, of a complete answer, draw the figure."""
        from grosmc_mj.experiments.answer.curves import experiment_chart, write_curves

        write_curves(self._results, self.path.stem, self.path.parent)
        if not (self._command.figures and self._complete):
            return ()

        # Imported here: matplotlib takes longer than a run.
        from grosmc_mj.output.charts.figure import write_chart

        figure_path = self.path.with_suffix(".png")
        write_chart(experiment_chart(self._results), figure_path)
        return (figure_path,)

    def close(self) -> None:
        """Save the trajectories and film them, if that is asked for."""
        console = screen.console()
        if self._command.save:
            folder = self._command.out / "trajectories"
            for result in self._results:
                law = name_in_files(result.controller.name)
                plant = name_in_files(result.plant)
                result.save(folder / f"{self._name}.{plant}.{law}.{self._command.save}")
            trajectories = counted(len(self._results), "trajectory", "trajectories")
            console.print(f"{trajectories} in {folder}", soft_wrap=True)
        if self._command.film:
            film_runs(console, self._results, self._command.out / FOLDER / f"{self._name}.mp4")

    @property
    def kept(self) -> bool:
        """Whether everything that is required is kept."""
        return self._kept


def _require_memory(experiment: Experiment) -> None:
    """Refuse runs whose records do not fit into memory; say what long ones take.

    Raises:
        ArgumentError: If the machine has less memory.
    """
    from grosmc_mj.simulation.problem import is_much_memory, memory_words, require_memory

    # Shorter runs take some MB, and this prepares each of them.
    if experiment.steps < _LONG:
        return
    runs = len(experiment.plant_names) * len(experiment.controllers)
    size = experiment.record_size
    require_memory(size, runs, experiment.steps)
    if is_much_memory(size):
        screen.notice(f"{experiment.path.name}: {memory_words(size, runs, experiment.steps)}.")


def _audits_of_robots(experiment: Experiment, results: Sequence[RunResult]) -> Sequence[Audit]:
    """Return the premises of each sliding mode law on a robot; none of a plant with equations."""
    if experiment.nominal.system.symbolic:
        return ()
    from grosmc_mj.experiments.assumptions.robot import audits

    return audits(results)


def _check(experiment: Experiment) -> None:
    """Refuse, before anything runs, mistakes of a file that a single run would not notice.

    They are unknown claims, wrong [[uncertain]] tables, as a campaign would refuse them, and
    requirements none of which can be judged: nothing would be kept or failed.
    """
    if experiment.file.claim:
        from grosmc_mj.chapter.claims.ledger import cited_claims

        cited_claims(experiment)
    from grosmc_mj.studies.judging import refuse_unjudgeable

    refuse_unjudgeable(experiment)
