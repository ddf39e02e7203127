"""grosmc-mj predict: a closed loop on a fitted machine, beside its log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, Flag, Out, WholeNumber, command
from grosmc_mj.cli.films import FOLDER, write_film_of_log
from grosmc_mj.cli.targets import result_name
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.files import name_in_files

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.identify.predict import Prediction, PredictionQuestion
    from grosmc_mj.output.results.result import Result

# More runs tell nothing new, and each is kept in memory.
_MOST_SEEDS = 1000


@command
class PredictCommand(AnsweringCommand):
    """Predict a closed loop on a fitted machine, and compare it with the log of the real one.

    The law is asked for every logged command on the logged states: is it the law of the log? Then
    it runs on the case's machine from the start of the log, with the sensor noise and resolution
    that the log shows, once for each seed. Nothing is fitted. The result is measured beside
    predicted numbers, and a figure.

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

    def questions(self) -> Sequence[Question]:
        """Return the question of each log; every log is checked before the first prediction."""
        from grosmc_mj.experiments.catalogue import find_experiments

        if not 1 <= self.seeds <= _MOST_SEEDS:
            raise ArgumentError(f"--seeds {self.seeds} must be from 1 to {_MOST_SEEDS}")
        *paths, case = self.logs_and_case
        experiment = find_experiments(case)[0].changed(laws=[self.law])
        logs = {Path(path): 0.0 for path in paths} or self._measured(experiment)
        questions = []
        for path, start in logs.items():
            asked = self._question(experiment, path, start)
            questions.append(_PredictQuestion(self, self._path(experiment, path), asked))
        return questions

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

    def _question(self, experiment: Experiment, path: Path, start: float) -> PredictionQuestion:
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

        names = (result_name(experiment.path), name_of_log(log), name_in_files(self.law))
        return self.out / f"predict_{'_'.join(names)}.json"


class _PredictQuestion(Question):
    """Does a log lie within the spread of the predicted runs?"""

    def __init__(self, command: PredictCommand, path: Path, asked: PredictionQuestion) -> None:
        self.path = path
        self._command = command
        self._asked = asked
        self._complete: Prediction | None = None
        self._film_of: Any = None
        self._kept = False

    @property
    def files(self) -> Sequence[Path]:
        """The figure."""
        return (self.path.with_suffix(".png"),)

    def measure(self) -> None:
        """Predict the machine."""
        from grosmc_mj.identify.film import filmable
        from grosmc_mj.identify.predict import predict

        experiment = self._asked.experiment
        if self._command.film:
            plant = experiment.plant(experiment.nominal.truest)
            self._film_of = filmable(plant, self._asked.log)

        self._complete = predict(self._asked, self._command.seeds)

    def result(self, *, complete: bool) -> Result | None:
        """Return the measured numbers beside the predicted ones."""
        from grosmc_mj.identify.predict_report import prediction_result
        from grosmc_mj.output.results.result import KEPT

        if self._complete is None:
            return None
        configuration = self._configuration()
        result = prediction_result(self._asked, self._complete, configuration)
        self._kept = result.answers[-1].verdict == KEPT
        return result

    def draw(self) -> Sequence[Path]:
        """Draw the log beside the predicted runs."""
        from grosmc_mj.identify.predict_report import draw_prediction

        if self._complete is None:
            return ()
        (figure,) = self.files
        return (draw_prediction(self._asked, self._complete, figure),)

    def close(self) -> None:
        """Film the nearest run, if that is asked for."""
        from grosmc_mj.identify.film import film_beside_log

        if self._film_of is not None and self._complete is not None:
            run = self._complete.runs[self._complete.nearest]
            film = film_beside_log(self._film_of, run, self._asked.log, 0.0, "predicted")
            write_film_of_log(film, self._command.out / FOLDER / f"{self.path.stem}.mp4")

    @property
    def kept(self) -> bool:
        """Whether the measured numbers lie within the spread."""
        return self._kept

    def _configuration(self) -> Mapping[str, Any]:
        """Return the arguments, for the result."""
        noise_log = self._asked.log.name
        if self._command.noise_from is not None:
            noise_log = self._command.noise_from.name
        return {
            "case": str(self._asked.experiment.path),
            "log": self._asked.log.name,
            "noise_from": noise_log,
            "law": self._command.law,
            "seeds": self._command.seeds,
        }
