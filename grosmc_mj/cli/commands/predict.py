"""grosmc-mj predict: a closed loop on a fitted machine, beside its log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import OUTPUT, Command, Flag, Out, WholeNumber, command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.films import FOLDER, write_film_of_log
from grosmc_mj.cli.targets import result_name
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.identify.predict import Prediction, Question

# More runs tell nothing new, and each is kept in memory.
_MOST_SEEDS = 1000


@command
class PredictCommand(Command):
    """Predict a closed loop on a fitted machine, and compare it with the log of the real one.

    The law is asked for every logged command on the logged states: is it the law of the log? Then
    it runs on the case's machine from the start of the log, with the sensor noise and resolution
    that the log shows, once for each seed; and again without each property of the machine in turn:
    a number of the loop, friction and damping set to zero, masses to those of the model. Nothing is
    fitted. The result is measured beside predicted numbers, which properties decide, a figure.

    Exit code: 0 if each number that a requirement asks for lies, as measured, within the spread of
    the predicted ones; 1 if one does not; 2 if log, case or law are wrong.

    Attributes:
        logs_and_case: Logs (CSV, Parquet, MCAP or MATLAB) with time, commands and measured states,
            which are judged one by one; by default those of [[measured]]. Then SYSTEM, SYSTEM/CASE
            or FILE.toml of the fitted machine, with law and requirements.
        law: The law that the machine ran.
        seeds: Number of runs, each with its own noise.
        noise_from: Another log of the machine to take noise and resolution of the sensors from.
        film: Film the nearest run, with the measured machine as a ghost.
        out: Folder for results.
    """

    logs_and_case: Annotated[tuple[str, ...], Parameter(metavar="[LOG...] CASE")]
    _: KW_ONLY
    law: Annotated[str, Parameter(metavar="NAME")]
    seeds: WholeNumber = 16
    noise_from: Annotated[Path | None, Parameter(metavar="LOG", show_default="LOG")] = None
    film: Annotated[Flag, Parameter(group=OUTPUT)] = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Predict and judge one log after the other."""
        from grosmc_mj.experiments.catalogue import find_experiments

        if not 1 <= self.seeds <= _MOST_SEEDS:
            raise ArgumentError(f"--seeds {self.seeds} must be from 1 to {_MOST_SEEDS}")
        *paths, case = self.logs_and_case
        experiment = find_experiments(case)[0].with_laws([self.law])
        logs = {Path(path): 0.0 for path in paths} or self._measured(experiment)
        # Every log is checked before the first prediction runs.
        questions = {path: self._question(experiment, path, logs[path]) for path in logs}
        for path in logs:
            answer = self._path(experiment, path)
            require_writable(answer, answer.with_suffix(".png"))

        inside = [self._judge(path, question) for path, question in questions.items()]
        return DONE if all(inside) else DIFFERS

    def _measured(self, experiment: Experiment) -> Mapping[Path, float]:
        """Return the logs of the case that were made under the law, and where their runs begin [s].

        Raises:
            ArgumentError: If there is none.
        """
        logs = {}
        for table in experiment.file.measured:
            if table.law in (None, self.law):
                logs[experiment.path.parent / table.log] = table.start
        if not logs:
            raise ArgumentError(
                f"no log to predict: name one before {experiment.path}, or give the case a "
                "[[measured]]"
            )
        return logs

    def _question(self, experiment: Experiment, path: Path, start: float) -> Question:
        """Read a log, and the one of the noise.

        Raises:
            ArgumentError: If one of them is wrong.
        """
        from grosmc_mj.experiments.logs.read import read_log
        from grosmc_mj.identify.predict import question_of

        system = experiment.nominal.system
        gears = experiment.nominal.gears
        table = experiment.file.log
        log = read_log(path, system, table, gears, to_learn=False)
        noise_log = log
        if self.noise_from is not None:
            noise_log = read_log(self.noise_from, system, table, gears, to_learn=False)
        return question_of(experiment, self.law, log, noise_log, start)

    def _path(self, experiment: Experiment, log: Path) -> Path:
        """Return the JSON file of the result of a log."""
        from grosmc_mj.experiments.logs.log import name_of_log

        return self.out / f"predict_{result_name(experiment.path)}_{name_of_log(log)}.json"

    def _judge(self, log: Path, question: Question) -> bool:
        """Predict a log, write and print the result; return whether it lies within the spread."""
        from grosmc_mj.identify.film import film_beside_log, filmable
        from grosmc_mj.identify.predict_report import draw_prediction, prediction_result
        from grosmc_mj.output.results.result import KEPT

        experiment = question.experiment
        film_of = None
        if self.film:
            film_of = filmable(experiment.plant(experiment.nominal.truest), question.log)

        path = self._path(experiment, log)
        figure = path.with_suffix(".png")
        complete, lesser = self._predictions(question)
        result = prediction_result(question, complete, lesser, self._configuration(question))
        screen.say_result(
            result,
            path,
            lambda: (draw_prediction(question, complete, figure),),
            full=self.verbose,
        )
        if film_of is not None:
            run = complete.runs[complete.nearest]
            film = film_beside_log(film_of, run, question.log, 0.0, "predicted")
            write_film_of_log(film, self.out / FOLDER / f"{path.stem}.mp4")
        return result.answers[-1].verdict == KEPT

    def _predictions(self, question: Question) -> tuple[Prediction, Mapping[str, Prediction]]:
        """Return the prediction of the machine, and those without each of its properties."""
        from grosmc_mj.identify.leave_out import without_each
        from grosmc_mj.identify.predict import predict

        machines = without_each(question.experiment)
        lesser = {}
        with screen.progress(1 + len(machines), "machines") as advance:
            complete = predict(question, self.seeds)
            advance("the machine")
            for name, experiment in machines.items():
                lesser[name] = predict(question, self.seeds, experiment)
                advance(f"without {name}")
        return complete, lesser

    def _configuration(self, question: Question) -> Mapping[str, Any]:
        """Return the arguments, for the result."""
        noise_log = question.log.name
        if self.noise_from is not None:
            noise_log = self.noise_from.name
        return {
            "case": str(question.experiment.path),
            "log": question.log.name,
            "noise_from": noise_log,
            "law": self.law,
            "seeds": self.seeds,
        }
