"""Which disturbance within a bound is the worst for each law?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli.command import Flag, Laws, Target, WholeNumber, command
from grosmc_mj.cli.study_command import FilmedStudyCommand

if TYPE_CHECKING:
    from grosmc_mj.output.films.film import Film
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.disturbance.disturbance import DisturbanceStudy
    from grosmc_mj.studies.disturbance.row import WorstDisturbance

_Text = Annotated[str, Parameter(metavar="TEXT", show_default="none")]


@command
class DisturbanceCommand(FilmedStudyCommand["DisturbanceStudy", "WorstDisturbance"]):
    """Find the worst disturbance within a bound, under which a law misses most what is required.

    The disturbance acts on a body, on an input or on the measurement of a state, in place of the
    case's own one there, which it is compared with. It has the bound's size and switches its sign,
    or rises and falls at --slew. The signs begin with those of the responses to each piece of it
    alone, which are exact for a linear loop; pieces are then flipped while it gets worse. Half the
    pieces must agree within 5 %, else their number doubles. Random telegraph signals of as many
    runs are the control. The search is on the equations if they are all of the plant; MuJoCo
    confirms.

    Writes disturbance_NAME.json, .png and .svg to --out, and for each law a case file that replays
    its worst disturbance; after Ctrl-C what there is of them.

    Exit code: 0 if each law keeps all, 1 if one does not, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, which means its bench, a case, or a case file.
        on: A body, an input, or a state whose measurement is disturbed.
        bound: Its largest magnitude with its unit: "1 N m" or "2 N" on a body.
        axis: x, y or z of a force or torque on a body; by default as in the case's own disturbance
            there, else x of a force and y of a torque.
        slew: Its largest rate with its unit, such as "2 N m/s".
        start: States by whose bounds the start may deviate, such as "rotor angle=0.1 rad".
        laws: Laws to study, controllers or [laws] of the file.
        requirement: Key of the requirement to be missed, such as stays_within; by default any but
            settling, recovery and the input's. With recovers_within the disturbance ends in time.
        pieces: Number of pieces to begin with, from 2 to 640.
        largest: Search the largest bound, too, up to which all is kept, from --bound up and down;
            both ends of its range are told, 5 % from each other.
        film: A law to film under its worst disturbance, beside the compared one.
    """

    target: Target
    _: KW_ONLY
    on: Annotated[str, Parameter(metavar="NAME")]
    bound: Annotated[str, Parameter(metavar="TEXT")]
    axis: _Text = ""
    slew: _Text = ""
    start: Annotated[tuple[str, ...], Parameter(metavar="STATE=BOUND...", show_default="none")] = ()
    laws: Laws = ()
    requirement: Annotated[str, Parameter(metavar="KEY", show_default="any")] = ""
    pieces: WholeNumber = 40
    largest: Flag = False

    def study(self) -> DisturbanceStudy:
        """Return the search that the options describe."""
        from grosmc_mj.studies.disturbance.answer import require_filmable, require_replayable
        from grosmc_mj.studies.disturbance.disturbance import disturbance_study

        study = disturbance_study(
            self.target,
            self.on,
            self.bound,
            self.laws,
            axis=self.axis,
            slew=self.slew,
            starts=self.start,
            requirement=self.requirement,
            pieces=self.pieces,
            bounded=self.largest,
        )
        require_replayable(study)
        if self.film:
            require_filmable(study, self.film)
        return study

    def result(
        self, study: DisturbanceStudy, rows: Sequence[WorstDisturbance], *, complete: bool
    ) -> Result:
        """Return the result of a search."""
        from grosmc_mj.studies.disturbance.answer import disturbance_result

        return disturbance_result(study, rows, complete=complete)

    def draw(
        self, study: DisturbanceStudy, rows: Sequence[WorstDisturbance], path: Path
    ) -> Sequence[Path]:
        """Draw the figure."""
        from grosmc_mj.output.charts.figure import write_chart
        from grosmc_mj.output.charts.of_results import panels_chart
        from grosmc_mj.studies.disturbance.answer import charts

        title = f"{study.experiment.target}: worst disturbance on {self.on}"
        figure = path.with_suffix(".png")
        write_chart(panels_chart(title, [charts(study, worst) for worst in rows]), figure)
        return [figure]

    def write_cases(
        self, study: DisturbanceStudy, rows: Sequence[WorstDisturbance], path: Path
    ) -> Sequence[Path]:
        """Write a case file for each law that replays its worst disturbance."""
        from grosmc_mj.experiments.file.shipped import written_beside
        from grosmc_mj.ground.files import atomic_write, name_in_files
        from grosmc_mj.studies.disturbance.answer import case_text

        files = []
        for worst in rows:
            name = f"{path.stem}_{name_in_files(worst.law)}.toml"
            file = written_beside(study.experiment.path, path.parent, name)
            with atomic_write(file) as part:
                part.write_text(case_text(study, worst), encoding="utf-8")
            files.append(file)
        return files

    def keeps(self, study: DisturbanceStudy, rows: Sequence[WorstDisturbance]) -> bool:
        """Whether each law keeps everything."""
        return all(worst.kept for worst in rows)

    def film_of(self, study: DisturbanceStudy, rows: Sequence[WorstDisturbance]) -> Film:
        """Return the film of the law under its worst disturbance."""
        from grosmc_mj.experiments.films import SMALL
        from grosmc_mj.studies.disturbance.answer import disturbance_film

        (worst,) = [row for row in rows if row.law == self.film]
        return disturbance_film(study, worst, SMALL)
