"""grosmc-mj study disturbance."""

from __future__ import annotations

from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import (
    OUTPUT,
    Command,
    Flag,
    Laws,
    Out,
    Target,
    WholeNumber,
    command,
)
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.cells import Cells
    from grosmc_mj.studies.disturbance import Advance, DisturbanceStudy, WorstDisturbance

_Text = Annotated[str, Parameter(metavar="TEXT", show_default="none")]


@command
class DisturbanceCommand(Command):
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
            the input's.
        pieces: Number of pieces to begin with.
        largest: Search the largest bound, too, up to which all is kept, from --bound up and down.
        film: A law to film under its worst disturbance, beside the compared one.
        gif: Write the film as a GIF, too.
        resume: Search only what is missing in disturbance_NAME, the folder in --out to which every
            finished law is written, of the same file and versions.
        out: Folder for disturbance_NAME.json, the figure and the case files.
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
    film: Annotated[str, Parameter(metavar="NAME", show_default="none", group=OUTPUT)] = ""
    gif: Annotated[Flag, Parameter(group=OUTPUT)] = False
    resume: Flag = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Search for each law, write, draw and print what was found."""
        from grosmc_mj.studies.disturbance import disturbance_study
        from grosmc_mj.studies.disturbance_answer import (
            disturbance_result,
            require_filmable,
            require_replayable,
        )

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
        )
        require_replayable(study, self.out)
        if self.film:
            require_filmable(study, self.film)

        rows: list[WorstDisturbance] = []
        with screen.answered(
            self._path(study),
            lambda complete: disturbance_result(study, rows, complete=complete),
            rows,
            lambda: self._draw(study, rows),
            full=self.verbose,
            advice=screen.RESUME,
        ):
            self._search(study, rows)
        if self.film:
            screen.say_files(screen.console(), self._film(study, rows))
        return DONE if all(worst.kept for worst in rows) else DIFFERS

    def _search(self, study: DisturbanceStudy, rows: list[WorstDisturbance]) -> None:
        """Search for each law, or read what was found if --resume is given.

        Args:
            study: The study.
            rows: Filled law by law: an interrupt leaves the first ones.
        """
        from grosmc_mj.studies.disturbance import cells_of

        cells = cells_of(study, self._path(study).with_suffix(""))
        laws = study.experiment.controllers
        with screen.progress(len(laws), "laws") as advance:
            for law in laws:
                worst = self._worst(study, cells, law, lambda text: advance(text, 0))
                rows.append(worst)
                advance(law, 1)

    def _worst(
        self,
        study: DisturbanceStudy,
        cells: Cells[WorstDisturbance],
        law: str,
        advance: Advance,
    ) -> WorstDisturbance:
        """Search for a law; with --resume only what is missing."""
        worst = None
        if self.resume:
            worst = cells.read(law, self.largest) or cells.read(law, False)
        if worst is None:
            worst = study.find(law, advance)
            cells.write(worst)

        if self.largest and worst.largest is None:
            bounds = study.largest(law, advance)
            worst = worst.model_copy(update={"largest": bounds})
            cells.write(worst)
        return worst

    def _path(self, study: DisturbanceStudy) -> Path:
        """Return the path of the result."""
        return self.out / f"disturbance_{result_name(study.experiment.path)}.json"

    def _draw(self, study: DisturbanceStudy, rows: list[WorstDisturbance]) -> tuple[Path, ...]:
        """Draw the figure and write the case files; returns their paths."""
        from grosmc_mj.files import atomic_write, name_in_files
        from grosmc_mj.results.charts import write_panels
        from grosmc_mj.studies import disturbance_answer as answer

        path = self._path(study)
        title = f"{study.experiment.target}: worst disturbance on {self.on}"
        figure = path.with_suffix(".png")
        write_panels(figure, title, [answer.charts(study, worst) for worst in rows])

        files = [figure]
        for worst in rows:
            file = path.with_name(f"{path.stem}_{name_in_files(worst.law)}.toml")
            with atomic_write(file) as part:
                part.write_text(answer.case_text(study, worst), encoding="utf-8")
            files.append(file)
        return tuple(files)

    def _film(self, study: DisturbanceStudy, rows: list[WorstDisturbance]) -> Path:
        """Write the film; returns its path."""
        from grosmc_mj.experiments.films import SMALL, write_case_film
        from grosmc_mj.studies.disturbance_answer import disturbance_film

        (worst,) = [row for row in rows if row.law == self.film]
        path = self._path(study)
        path = path.with_name(f"{path.stem}_film.mp4")
        film = disturbance_film(study, worst, SMALL)
        settings = study.experiment.settings
        with screen.progress(len(film.times), "frames") as advance:
            written = write_case_film(
                study.experiment,
                film,
                path,
                settings=settings,
                gif=self.gif,
                advance=lambda: advance(path.name),
            )
        return written.film
