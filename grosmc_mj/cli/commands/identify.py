"""grosmc-mj identify and compare: logs of a machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, Flag, Out, command
from grosmc_mj.cli.films import write_film_of_log
from grosmc_mj.cli.targets import result_name
from grosmc_mj.ground.errors import ArgumentError, SetupError

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.logs.log import Log
    from grosmc_mj.identify.fit import Fit
    from grosmc_mj.identify.model import LogModel
    from grosmc_mj.identify.parameters import Parameters
    from grosmc_mj.identify.replay import Predictor
    from grosmc_mj.output.films.film import Film
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.theory.plants import Plant


@dataclass(frozen=True)
class _OfLog(AnsweringCommand):
    """Arguments and options of both commands.

    Attributes:
        log: CSV, Parquet, MCAP or MATLAB: time, inputs and measured states.
        case: SYSTEM, SYSTEM/CASE or FILE.toml that the log is of.
        also: More logs of the same machine.
        horizon: Length of a prediction, which then begins anew [s].
        out: Folder for results.
    """

    log: Path
    case: str
    _: KW_ONLY
    also: Annotated[tuple[Path, ...], Parameter(metavar="LOG...", show_default="none")] = ()
    horizon: Annotated[float, Parameter(metavar="S")] = 1.0
    out: Out = Path("renders")

    def _read(self) -> tuple[Experiment, Log]:
        """Return the experiment of the case, and all logs as one."""
        from grosmc_mj.experiments.catalogue import find_experiments
        from grosmc_mj.experiments.logs.log import join_logs
        from grosmc_mj.experiments.logs.read import read_log

        if not 0 < self.horizon < float("inf"):
            raise ArgumentError(f"--horizon {self.horizon:g} must be above 0 s")
        experiment = find_experiments(self.case)[0]
        system = experiment.nominal.system
        table = experiment.file.log
        gears = experiment.nominal.gears
        logs = [read_log(path, system, table, gears) for path in (self.log, *self.also)]
        return experiment, join_logs(logs)

    def _path(self, kind: str, experiment: Experiment) -> Path:
        """Return the path of a result."""
        from grosmc_mj.experiments.logs.log import name_of_log

        return self.out / f"{kind}_{result_name(experiment.path)}_{name_of_log(self.log)}.json"


@command
class IdentifyCommand(_OfLog):
    """Fit a case's parameters to a log of the machine, and write the case of that machine.

    Fitted are the numbers of the case's [[uncertain]] tables within their ranges, or those of
    --fit: masses, lengths, damping, friction, machine parts, delay, a sensor's bias. What the log
    does not show is named and held at its value. The result is the values with their 95 %
    intervals, how well the part that was held out is predicted, a figure, and a case file with the
    fitted values and their joint distribution, for run, campaign, study and film.

    Attributes:
        fit: Names of [[uncertain]] numbers, or paths such as edit.shaft.damping.
        hold_out: Share of the log, its end, that is not fitted but predicted.
        loop: Case whose run, task, laws and requirements the case file has.
    """

    _: KW_ONLY
    fit: Annotated[tuple[str, ...], Parameter(metavar="NAME...", show_default="all")] = ()
    hold_out: Annotated[float, Parameter(metavar="SHARE")] = 0.3
    loop: Annotated[str, Parameter("--case", metavar="CASE", show_default="those of CASE")] = ""

    def questions(self) -> Sequence[Question]:
        """Return the one question of the logs."""
        from grosmc_mj.experiments.file.shipped import written_beside
        from grosmc_mj.identify.closed_loop import closed_loop
        from grosmc_mj.identify.parameters import parameters_of

        if not 0 < self.hold_out < 0.9:
            raise ArgumentError(f"--hold-out {self.hold_out:g} must be above 0 and below 0.9")
        experiment, log = self._read()
        # It has a name of its own: a run of it writes results of that name.
        name = self._path("identify", experiment).with_suffix(".toml").name
        case_file = written_beside(experiment.path, self.out, name)
        loop = None
        if self.loop:
            loop = closed_loop(self.loop, experiment, case_file)
        question = _IdentifyQuestion(
            path=self._path("identification", experiment),
            case_file=case_file,
            loop=loop,
            command=self,
            parameters=parameters_of(experiment, self.fit),
            log=log,
            parts=self._parts(log, experiment.settings.timestep),
        )
        return [question]

    def _parts(self, log: Log, timestep: float) -> tuple[Predictor, Predictor]:
        """Return the part of a log that is fitted, and the one that is held out, in windows.

        Raises:
            ArgumentError: If the plant has other inputs or states, or a part is too short.
        """
        from grosmc_mj.identify.replay import Predictor

        fitted = log.between(0, 1 - self.hold_out)
        held_out = log.between(1 - self.hold_out, 1)
        # Making a predictor refuses a part that is too short, before the work.
        for part in (fitted, held_out):
            Predictor.leading(part, self.horizon, timestep)
        return (
            Predictor.of(fitted, self.horizon, timestep),
            Predictor.of(held_out, self.horizon, timestep),
        )


@dataclass
class _IdentifyQuestion(Question):
    """Which parameters does the log show?

    Attributes:
        path: JSON file of the result.
        case_file: Case file of the fit.
        command: The options.
        parameters: Parameters to be fitted.
        log: The whole log.
        parts: The part of the log that is fitted, and the one that is held out.
        loop: Case whose closed loop the case file has; that of the command without.
        best: The fit; None before it.
        errors: Residuals of the part that is held out.
        unwritten: Text of the case file, if it could not be written.
    """

    path: Path
    case_file: Path
    command: IdentifyCommand
    parameters: Parameters
    log: Log
    parts: tuple[Predictor, Predictor]
    loop: Experiment | None = None
    best: Fit | None = None
    errors: Any = None
    unwritten: str = ""

    @property
    def files(self) -> Sequence[Path]:
        """The figure and the case file."""
        return (self.path.with_suffix(".png"), self.case_file)

    def measure(self) -> None:
        """Fit the parameters, and write their case file.

        Raises:
            KeyboardInterrupt: After an interrupt, with the best values so far in place of the fit.
        """
        from grosmc_mj.identify.fit import fit

        fitted, _ = self.parts
        with screen.progress(1) as advance:
            best = fit(self.parameters, fitted, self._plant, progress=lambda text: advance(text, 0))
            advance("fitted")
        self.best = best
        # A fit is hours of a bench: no failure of what follows may lose it.
        self._write_case(best)
        if not best.finished:
            raise KeyboardInterrupt

    @property
    def missing(self) -> Sequence[str]:
        """The search, if it was interrupted."""
        return () if self.best is None or self.best.finished else ("the search",)

    @property
    def _plant(self) -> Plant:
        """The plant that is fitted."""
        experiment = self.parameters.experiment
        return experiment.plant(experiment.nominal.truest)

    def _write_case(self, best: Fit) -> None:
        """Write the case file of the fit; where it cannot be written it is shown at the end.

        Raises:
            SetupError: If it cannot be written.
        """
        from grosmc_mj.identify.case_file import case_text, write_case

        try:
            write_case(best, self.log.name, self.case_file, self.loop)
        except SetupError:
            self.unwritten = case_text(best, self.log.name, self.case_file, self.loop)
            raise

    def result(self, *, complete: bool) -> Result | None:
        """Predict the part of the log that is held out, and return the result."""
        from grosmc_mj.identify.compare import prediction_errors
        from grosmc_mj.identify.fit import slip
        from grosmc_mj.identify.pushes import unexplained_moments
        from grosmc_mj.identify.quality import quality, residuals
        from grosmc_mj.identify.replay import Predictor
        from grosmc_mj.identify.report import identification

        best = self.best
        if best is None:
            return None
        plant = self._plant
        horizon = self.command.horizon
        timestep = self.parameters.experiment.settings.timestep
        fitted, held_out = self.parts
        self.errors = residuals(best, held_out, plant)
        rows = quality(self.errors, held_out.log, plant.system)
        found = best.model(plant)
        predicted, _ = prediction_errors({"fitted": found}, held_out.log, horizon, timestep)

        short = Predictor.leading(self.log, horizon, timestep).short_words(horizon)
        doubts = [*self.log.notes, *filter(None, [short, slip(best, fitted, plant)])]
        doubts += unexplained_moments([found], self.log, horizon, timestep)
        return identification(
            best, rows, predicted, self.log.name, horizon, self.command.hold_out, doubts
        )

    def draw(self) -> Sequence[Path]:
        """Draw the residuals of the part that is held out."""
        from grosmc_mj.identify.report import draw_residuals

        _, held_out = self.parts
        figure = self.path.with_suffix(".png")
        draw_residuals(self.errors, held_out.log, self._plant.system, figure)
        return (figure,)

    def show(self, result: Result, *, full: bool, among: bool) -> None:
        """Write and print the result, and the path of the case file."""
        try:
            super().show(result, full=full, among=among)
        finally:
            # A full disk takes the result, too.
            if self.unwritten:
                screen.console().print(self.unwritten, markup=False, soft_wrap=True, end="")
        if not self.unwritten:
            screen.say_files(screen.console(), self.case_file)


@command
class CompareCommand(_OfLog):
    """Put the inputs of a log on every rung, and tell which one explains the machine.

    Printed and corrected equations, physics, physics behind the delays of the case's loop and the
    machine as built predict the measured states from many starts along the log; the error is told
    by the time since the start.

    Attributes:
        film: Film the first prediction, with the measured machine as a ghost.
    """

    _: KW_ONLY
    film: Annotated[Flag, Parameter(group=OUTPUT)] = False

    def questions(self) -> Sequence[Question]:
        """Return the one question of the logs."""
        from grosmc_mj.identify.film import film_of_log
        from grosmc_mj.identify.model import models_of

        experiment, log = self._read()
        question = _CompareQuestion(
            path=self._path("compare", experiment),
            horizon=self.horizon,
            experiment=experiment,
            log=log,
            rungs=models_of(experiment),
        )
        if self.film:
            truest = question.rungs.get("loop", question.rungs[experiment.nominal.truest])
            question.film = film_of_log(truest, log, self.horizon)
        return [question]


@dataclass
class _CompareQuestion(Question):
    """Which model explains the log?

    Attributes:
        path: JSON file of the result.
        horizon: Length of a prediction [s].
        experiment: The experiment of the case.
        log: The log.
        rungs: Models by name.
        film: Film that is asked for.
        answer: The result; None before it.
    """

    path: Path
    horizon: float
    experiment: Experiment
    log: Log
    rungs: Mapping[str, LogModel]
    film: Film | None = None
    answer: Result | None = None

    def measure(self) -> None:
        """Predict the log on every rung."""
        from grosmc_mj.identify.compare import comparison_result, prediction_errors
        from grosmc_mj.identify.pushes import unexplained_moments
        from grosmc_mj.identify.replay import Predictor

        timestep = self.experiment.settings.timestep
        rows, notes = prediction_errors(self.rungs, self.log, self.horizon, timestep)
        followed = [self.rungs[name] for name in dict.fromkeys(row.rung for row in rows)]
        pushes = unexplained_moments(followed, self.log, self.horizon, timestep)
        short = Predictor.leading(self.log, self.horizon, timestep).short_words(self.horizon)
        notes = [*self.log.notes, *filter(None, [short]), *notes, *pushes]
        self.answer = comparison_result(rows, notes, self.log, self.experiment, self.horizon)

    def result(self, *, complete: bool) -> Result | None:
        """Return the errors of the predictions."""
        return self.answer

    def close(self) -> None:
        """Write the film that is asked for, if any."""
        if self.film is not None:
            write_film_of_log(self.film, self.path.with_suffix(".mp4"))
