"""grosmc-mj study ladder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.targets import TARGET, result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.ladder import Climb, Ladder
    from grosmc_mj.studies.studied import StudiedLaw


@dataclass(frozen=True)
class LadderCommand(Command):
    """Find where each law breaks on the way from its equations to the machine as built.

    Each law climbs: printed, corrected and MuJoCo's plant; sampled; encoders and estimated rates;
    delay; jitter; missed samples; actuator; motor; friction; backlash; flexibility; loads; stops.
    One is added on top of the others, and then each alone to the sampled plant. On every rung all
    that the target requires is judged, the same for every law, and what the chapter claims of the
    law, as far as the target's file has it as a [[claim]]. Shown and not judged: how far a law that
    follows the nominal optimum is from it, how the error swings in the end, how much the input
    varies.

    Writes ladder_NAME.json, .png and .svg to --out, after Ctrl-C or SIGTERM what there is of them,
    and each finished run to the folder ladder_NAME.

    Attributes:
        target: A system, which means its machine, a case, or a case file, whose own edits and
            disturbances act.
        laws: Laws to study, such as lqr, implicit, "implicit, predicted" or any law of the
            file; all by default, but for the rivals.
        rivals: Study lqi, pid, adrc and adaptive, too.
        loaded: Climb under every condition: nominal, the file's own or the system's other cases.
        resume: Run only what is missing in ladder_NAME, the folder in --out to which every finished
            run is written, of the same file and versions.
        film: A law to film around where it breaks; none by default.
        gif: Write the film as an animated GIF as well.
        out: Folder for ladder_NAME.json and the figure.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    laws: Annotated[tuple[str, ...], arg(metavar="NAME [NAME ...]", help_behavior_hint="")] = ()
    rivals: Annotated[bool, FlagCreatePairsOff] = False
    loaded: Annotated[bool, FlagCreatePairsOff] = False
    resume: Annotated[bool, FlagCreatePairsOff] = False
    film: Annotated[str, arg(metavar="NAME", help_behavior_hint="(default: none)")] = ""
    gif: Annotated[bool, FlagCreatePairsOff] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Climb, write, print, draw."""
        from grosmc_mj.arguments import require_known
        from grosmc_mj.chapter.claims.cited import cited_claims
        from grosmc_mj.studies import ladder

        studied = ladder.ladder(self.target, self.laws, loaded=self.loaded, rivals=self.rivals)
        cited = {name: claim.statement for name, claim in cited_claims(studied.machine).items()}
        studied = replace(studied, statements=cited)
        laws = {law.name: law for law in studied.laws}
        if self.film:
            require_known("law", self.film, laws)
        cells = ladder.Cells.of(studied, self._path(studied).with_suffix(""))
        steps = list(studied.steps())
        rows: list[Climb] = []
        with (
            screen.partial_results_kept(
                lambda: self._write(studied, rows, complete=False),
                "interrupted; the same command with --resume runs what is missing",
            ),
            screen.progress(len(steps), "rungs") as advance,
        ):
            for law, rung, condition, together in steps:
                advance(law.name, 0)
                key = (law.name, rung.name, condition.name, together)
                row = cells.read(*key) if self.resume else None
                if row is None:
                    row = ladder.climb(studied, law, rung, condition, together=together)
                    cells.write(row)
                rows.append(row)
                advance(law.name, 1)
        try:
            files = self._write(studied, rows, complete=True)
        finally:
            self._answer(studied, rows)
        if self.film:
            files = (*files, self._film(studied, laws[self.film], rows))
        screen.say_files(screen.console(), *files)
        return DONE

    def _path(self, studied: Ladder) -> Path:
        """Where the result is written."""
        return self.out / f"ladder_{result_name(studied.machine.path)}.json"

    def _write(self, studied: Ladder, rows: list[Climb], *, complete: bool) -> tuple[Path, ...]:
        """Write document and figure; returns where they are, nowhere without a row."""
        from grosmc_mj.results.charts import write_cells
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies import ladder

        if not rows:
            return ()
        target = self._path(studied)
        write_json(target, ladder.ladder_document(studied, rows, complete=complete))
        title, maps = f"{studied.target}: where each law breaks", ladder.charts(studied, rows)
        figure = target.with_suffix(".png")
        return target, write_cells(figure, title, list(maps.values()), ladder.NOTE)

    def _film(self, studied: Ladder, law: StudiedLaw, rows: list[Climb]) -> Path:
        """Write the film; returns where it is."""
        from grosmc_mj.experiments.films import SMALL, write_case_film
        from grosmc_mj.studies.ladder import ladder_film

        path = self.out / f"ladder_{result_name(studied.machine.path)}_film.mp4"
        film = ladder_film(studied, law, rows, replace(SMALL, fps=8))
        case, settings = studied.machine.case, studied.experiment.settings
        return write_case_film(case, film, path, settings=settings, gif=self.gif).film

    def _answer(self, studied: Ladder, rows: list[Climb]) -> None:
        """Print which laws pass, where each breaks, and on request every table."""
        from grosmc_mj.studies import ladder

        console, wide = screen.console(), screen.wide_console()
        for condition in studied.conditions:
            console.print(ladder.verdict(studied, rows, condition.name), style="bold", markup=False)
            console.print(ladder.answer_table(studied, rows, condition))
            if claims := ladder.claims_table(studied, rows, condition.name):
                console.print(claims.model_copy(update={"legend": ""}))
        if self.verbose:
            for sheet in ladder.sheets(studied, rows):
                if not sheet.table.legend:
                    wide.print(sheet.table)
        if assumed := ladder.assumed_text(studied):
            console.print(assumed, style="dim", markup=False)
        if self.verbose:
            console.print(ladder.LEGEND, style="dim", markup=False)
