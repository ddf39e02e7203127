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
from grosmc_mj.errors import ArgumentError

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
        log: CSV, Parquet, MCAP or MATLAB: time, commands and measured states.
        case: SYSTEM, SYSTEM/CASE or FILE.toml of the fitted machine, with the law and requirements.
        law: The law that the machine ran.
        seeds: Number of runs, each with its own noise.
        noise_from: Another log of the machine to take noise and resolution of the sensors from.
        film: Film the nearest run, with the measured machine as a ghost.
        out: Folder for results.
    """

    log: Path
    case: str
    _: KW_ONLY
    law: Annotated[str, Parameter(metavar="NAME")]
    seeds: WholeNumber = 16
    noise_from: Annotated[Path | None, Parameter(metavar="LOG", show_default="LOG")] = None
    film: Annotated[Flag, Parameter(group=OUTPUT)] = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Ask the law, simulate, leave out, write and print the result."""
        from grosmc_mj.identify.film import film_beside_log, require_filmable
        from grosmc_mj.identify.predict_report import draw_prediction, prediction_result
        from grosmc_mj.results.result import KEPT

        if not 1 <= self.seeds <= _MOST_SEEDS:
            raise ArgumentError(f"--seeds {self.seeds} must be from 1 to {_MOST_SEEDS}")
        question = self._question()
        experiment = question.experiment
        plant = experiment.plant(experiment.nominal.truest)
        if self.film:
            require_filmable(plant, question.log)

        complete, lesser = self._predictions(question)
        document = prediction_result(question, complete, lesser, self._configuration(experiment))
        name = f"predict_{result_name(experiment.path)}_{self.log.stem}"
        path = self.out / f"{name}.json"
        self._print(question, document, path)

        figure = path.with_suffix(".png")
        draw_prediction(question, complete, figure)
        screen.say_files(screen.console(), figure)
        if self.film:
            run = complete.runs[complete.nearest]
            film = film_beside_log(plant, run, question.log, 0.0, "predicted")
            write_film_of_log(film, self.out / FOLDER / f"{name}.mp4")
        return DONE if document["answers"][0]["verdict"] == KEPT else DIFFERS

    def _question(self) -> Question:
        """Read case and logs.

        Raises:
            ArgumentError: If one of them is wrong.
        """
        from grosmc_mj.experiments.catalogue import find_experiments
        from grosmc_mj.identify.model import gears_of
        from grosmc_mj.identify.predict import question_of
        from grosmc_mj.logs.read import read_log

        experiment = find_experiments(self.case)[0].with_laws([self.law])
        system = experiment.nominal.system
        gears = gears_of(experiment)
        log = read_log(self.log, system, experiment.file.log, gears)
        noise_log = log
        if self.noise_from is not None:
            noise_log = read_log(self.noise_from, system, experiment.file.log, gears)
        return question_of(experiment, self.law, log, noise_log)

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

    def _configuration(self, experiment: Experiment) -> Mapping[str, Any]:
        """Return the arguments, for the result."""
        return {
            "case": str(experiment.path),
            "log": self.log.name,
            "noise_from": (self.noise_from or self.log).name,
            "law": self.law,
            "seeds": self.seeds,
        }

    def _print(self, question: Question, document: Mapping[str, Any], path: Path) -> None:
        """Print law, prediction, tables and which properties decide; write the document."""
        from grosmc_mj.identify.predict_report import law_words

        finding = question.law_on_log
        reproduces = finding is not None and finding.first is None
        screen.say_verdict(screen.console(), law_words(question), good=reproduces)
        screen.say_result(document, path, question.notes, full=self.verbose, brief=2)
        screen.console().print(document["answers"][0]["more"], markup=False)
