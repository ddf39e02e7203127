"""grosmc-mj identify and compare: logs of a machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import OUTPUT, Command, Flag, Out, command
from grosmc_mj.cli.exit_codes import DONE, INTERRUPTED
from grosmc_mj.cli.films import write_film_of_log
from grosmc_mj.cli.targets import result_name
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.logs.log import Log
    from grosmc_mj.identify.fit import Fit
    from grosmc_mj.identify.replay import Predictor


@dataclass(frozen=True)
class _OfLog(Command):
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
    also: Annotated[tuple[Path, ...], Parameter(metavar="LOG...", show_default=False)] = ()
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
    """

    _: KW_ONLY
    fit: Annotated[tuple[str, ...], Parameter(metavar="NAME...", show_default="all")] = ()
    hold_out: Annotated[float, Parameter(metavar="SHARE")] = 0.3

    def execute(self) -> int:
        """Read the logs, fit the parameters, write and print the result."""
        from grosmc_mj.identify.fit import fit
        from grosmc_mj.identify.parameters import parameters_of

        if not 0 < self.hold_out < 0.9:
            raise ArgumentError(f"--hold-out {self.hold_out:g} must be above 0 and below 0.9")
        experiment, log = self._read()
        path = self._path("identification", experiment)
        # The case file has a name of its own: a run of it writes results of that name.
        case_file = self._path("identify", experiment).with_suffix(".toml")
        require_writable(path, path.with_suffix(".png"), case_file)
        parameters = parameters_of(experiment, self.fit)
        plant = experiment.plant(experiment.nominal.truest)
        timestep = experiment.settings.timestep
        fitted, held_out = self._parts(log, timestep)

        with screen.progress(1) as advance:
            best = fit(parameters, fitted, plant, progress=lambda text: advance(text, 0))
            advance("fitted")
        try:
            self._answer(best, held_out, log, path, fitted)
        finally:
            # A fit is hours of a bench: no other failure may lose it.
            self._write_case(best, log.name, case_file)
        return DONE if best.finished else INTERRUPTED

    def _answer(
        self, best: Fit, held_out: Predictor, log: Log, path: Path, fitted: Predictor
    ) -> None:
        """Predict the part of the log that was held out, write and print the result.

        Args:
            best: The fit.
            held_out: The part of the log that was held out.
            log: The whole log.
            path: JSON file of the result.
            fitted: The part of the log that was fitted.
        """
        from grosmc_mj.identify.compare import prediction_errors
        from grosmc_mj.identify.fit import slip
        from grosmc_mj.identify.pushes import unexplained_moments
        from grosmc_mj.identify.quality import quality, residuals
        from grosmc_mj.identify.replay import Predictor
        from grosmc_mj.identify.report import draw_residuals, identification

        experiment = best.parameters.experiment
        plant = experiment.plant(experiment.nominal.truest)
        timestep = experiment.settings.timestep
        errors = residuals(best, held_out, plant)
        rows = quality(errors, held_out.log, plant.system)
        found = best.model(plant)
        predicted, _ = prediction_errors({"fitted": found}, held_out.log, self.horizon, timestep)

        short = Predictor.leading(log, self.horizon, timestep).short_words(self.horizon)
        doubts = [*log.notes, *filter(None, [short, slip(best, fitted, plant)])]
        doubts += unexplained_moments([found], log, self.horizon, timestep)
        result = identification(
            best, rows, predicted, log.name, self.horizon, self.hold_out, doubts
        )

        def drawn() -> Sequence[Path]:
            figure = path.with_suffix(".png")
            draw_residuals(errors, held_out.log, plant.system, figure)
            return (figure,)

        screen.say_result(result, path, drawn, full=self.verbose)

    def _write_case(self, best: Fit, log: str, path: Path) -> None:
        """Write the case file of the fit; print it where it cannot be written.

        Raises:
            SetupError: If it cannot be written.
        """
        from grosmc_mj.identify.case_file import case_text, write_case

        try:
            write_case(best, log, path)
        except SetupError:
            screen.console().print(case_text(best, log, path), markup=False, soft_wrap=True, end="")
            raise
        screen.say_files(screen.console(), path)

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

    def execute(self) -> int:
        """Read the logs, predict them on every rung, write and print the errors."""
        from grosmc_mj.identify.compare import comparison_result, prediction_errors
        from grosmc_mj.identify.film import film_of_log
        from grosmc_mj.identify.model import models_of
        from grosmc_mj.identify.pushes import unexplained_moments
        from grosmc_mj.identify.replay import Predictor

        experiment, log = self._read()
        path = self._path("compare", experiment)
        require_writable(path)
        rungs = models_of(experiment)
        film = None
        if self.film:
            truest = rungs.get("loop", rungs[experiment.nominal.truest])
            film = film_of_log(truest, log, self.horizon)

        timestep = experiment.settings.timestep
        rows, notes = prediction_errors(rungs, log, self.horizon, timestep)
        followed = [rungs[name] for name in dict.fromkeys(row.rung for row in rows)]
        pushes = unexplained_moments(followed, log, self.horizon, timestep)
        short = Predictor.leading(log, self.horizon, timestep).short_words(self.horizon)
        notes = [*log.notes, *filter(None, [short]), *notes, *pushes]
        result = comparison_result(rows, notes, log, experiment, self.horizon)
        screen.say_result(result, path, full=self.verbose)
        if film is not None:
            write_film_of_log(film, path.with_suffix(".mp4"))
        return DONE
