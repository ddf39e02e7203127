"""grosmc-mj study ladder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import (
    OUTPUT,
    Command,
    Flag,
    Out,
    StudiedLaws,
    Target,
    WholeNumber,
    command,
)
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.cells import Cells
    from grosmc_mj.studies.ladder import Ladder, RungResult
    from grosmc_mj.studies.studied import StudiedLaw


@command
class LadderCommand(Command):
    """Find where each law breaks on the way from its equations to the machine as built.

    Each law climbs: printed, corrected and MuJoCo's plant; sampled; encoders and estimated rates;
    delay; jitter; missed samples; actuator; motor; friction; backlash; flexibility; loads; stops.
    One is added on top of the others, and then each alone to the sampled plant. The logs of the
    file's [[measured]] tables are the rung beside. On every rung all
    that the target requires is judged, the same for every law, and what the chapter claims of the
    law, as far as the target's file has it as a [[claim]]. Shown and not judged: how far a law that
    follows the nominal optimum is from it, how the error swings in the end, how much the input
    varies.

    Writes ladder_NAME.json, .png and .svg to --out, after Ctrl-C or SIGTERM what there is of them,
    and each finished run to the folder ladder_NAME.

    Exit code: 0 if done, 1 if a law keeps everything on no rung, 2 if the command or the set-up is
    wrong.

    Attributes:
        target: A system, which means its machine, a case, or a case file, whose own edits and
            disturbances act.
        laws: Laws to study, such as lqr, implicit, "implicit, predicted" or any law of the file.
        rivals: Study lqi, fl-pid, adrc and adaptive, too.
        loaded: Climb under every condition: nominal, the file's own or the system's other cases.
        draws: Runs of a rung with an encoder, noise, jitter or missed samples: each has random
            numbers of its own and other phases of the encoders, and all must keep it.
        resume: Run only what is missing in ladder_NAME, the folder in --out to which every finished
            run is written, of the same file and versions.
        film: A law to film around where it breaks.
        gif: Write the film as a GIF, too.
        out: Folder for ladder_NAME.json and the figure.
    """

    target: Target
    _: KW_ONLY
    laws: StudiedLaws = ()
    rivals: Flag = False
    loaded: Flag = False
    draws: WholeNumber = 10
    resume: Flag = False
    film: Annotated[str, Parameter(metavar="NAME", show_default="none", group=OUTPUT)] = ""
    gif: Annotated[Flag, Parameter(group=OUTPUT)] = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Climb with each law, write, draw and print where it breaks."""
        from grosmc_mj.arguments import require_known
        from grosmc_mj.studies.ladder import cells_of
        from grosmc_mj.studies.ladder_answer import ladder_result
        from grosmc_mj.sweep.draws import require_draws

        require_draws(self.draws)
        studied = self._studied()
        laws = {law.name: law for law in studied.laws}
        if self.film:
            require_known("law", self.film, laws)
        folder = self._path(studied).with_suffix("")
        cells = {load.name: cells_of(studied, load, folder) for load in studied.conditions}

        rows: list[RungResult] = []
        with screen.answered(
            self._path(studied),
            lambda complete: ladder_result(studied, rows, complete=complete),
            rows,
            lambda: self._draw(studied, rows),
            full=self.verbose,
            advice=screen.RESUME,
        ):
            self._climb(studied, cells, rows)
        if self.film:
            screen.say_files(screen.console(), self._film(studied, laws[self.film], rows))
        keeping = {row.law for row in rows if row.kept}
        return DONE if keeping.issuperset(laws) else DIFFERS

    def _studied(self) -> Ladder:
        """Return the ladder of the target, with the sentences of the claims that its file cites."""
        from grosmc_mj.chapter.claims.cited import cited_claims
        from grosmc_mj.studies.ladder import ladder

        studied = ladder(
            self.target,
            self.laws,
            loaded=self.loaded,
            rivals=self.rivals,
            draws=self.draws,
        )
        claims = cited_claims(studied.machine)
        statements = {name: claim.statement for name, claim in claims.items()}
        return replace(studied, statements=statements)

    def _climb(
        self,
        studied: Ladder,
        cells: Mapping[str, Cells[RungResult]],
        rows: list[RungResult],
    ) -> None:
        """Run every rung, or read it if it is finished and --resume is given.

        Args:
            studied: The ladder.
            cells: Files of the finished rungs, by condition.
            rows: Filled rung by rung: an interrupt leaves the first ones.
        """
        from grosmc_mj.studies.ladder import measured_rows, run_rung

        measured = measured_rows(studied)
        steps = list(studied.steps())
        with screen.progress(len(steps), "rungs") as advance:
            for law, rung, condition, together in steps:
                advance(law.name, 0)
                row = None
                if self.resume:
                    row = cells[condition.name].read(law.name, rung.name, condition.name, together)
                if row is None:
                    row = run_rung(studied, law, rung, condition, together=together)
                    cells[condition.name].write(row)
                rows.append(row)
                advance(law.name, 1)
        rows.extend(measured)

    def _path(self, studied: Ladder) -> Path:
        """Return the path of the result."""
        return self.out / f"ladder_{result_name(studied.machine.path)}.json"

    def _draw(self, studied: Ladder, rows: list[RungResult]) -> tuple[Path, ...]:
        """Draw the figures; returns their paths."""
        from grosmc_mj.studies.ladder_answer import charts
        from grosmc_mj.studies.matrix import NOTE, write_charts

        title = f"{studied.target}: where each law fails"
        return write_charts(self._path(studied), title, charts(studied, rows), NOTE)

    def _film(
        self,
        studied: Ladder,
        law: StudiedLaw,
        rows: list[RungResult],
    ) -> Path:
        """Write the film; returns its path."""
        from grosmc_mj.experiments.films import SMALL, write_case_film
        from grosmc_mj.studies.ladder_answer import ladder_film

        path = self.out / f"ladder_{result_name(studied.machine.path)}_film.mp4"
        film = ladder_film(studied, law, rows, replace(SMALL, fps=8))
        settings = studied.experiment.settings
        written = write_case_film(studied.machine, film, path, settings=settings, gif=self.gif)
        return written.film
