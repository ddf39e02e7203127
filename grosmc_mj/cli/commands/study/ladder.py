"""grosmc-mj study ladder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.ladder import Climb, Climbs, Ladder
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

    Writes ladder_NAME.json, .png and .svg to --out; after Ctrl-C or SIGTERM what there is of them.

    Attributes:
        target: A system, which means its machine, a case, or a case file, whose own edits and
            disturbances act.
        laws: Laws to study, such as lqr, implicit or "implicit, predicted"; all by default, but for
            the rivals.
        rivals: Study lqi, pid, adrc and adaptive, too.
        loaded: Climb under every condition: nominal, the file's own or the system's other cases.
        film: A law to film around where it breaks; none by default.
        gif: Write the film as an animated GIF as well.
        out: Folder for ladder_NAME.json and the figure.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    laws: Annotated[tuple[str, ...], arg(metavar="NAME [NAME ...]", help_behavior_hint="")] = ()
    rivals: Annotated[bool, FlagCreatePairsOff] = False
    loaded: Annotated[bool, FlagCreatePairsOff] = False
    film: Annotated[str, arg(metavar="NAME", help_behavior_hint="(default: none)")] = ""
    gif: Annotated[bool, FlagCreatePairsOff] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Climb, write, print, draw."""
        from grosmc_mj.chapter.claims.cited import cited_claims
        from grosmc_mj.studies import ladder
        from grosmc_mj.studies.studied import chosen_laws

        studied = ladder.ladder(self.target, self.laws, loaded=self.loaded, rivals=self.rivals)
        cited = {name: claim.statement for name, claim in cited_claims(studied.machine).items()}
        studied = replace(studied, statements=cited)
        filmed = chosen_laws(studied.laws, [self.film])[0] if self.film else None
        steps = list(studied.steps())
        rows: list[Climb] = []
        with (
            screen.kept_on_interrupt(lambda: self._write(studied, rows, complete=False)),
            screen.progress(len(steps), "rungs") as advance,
        ):
            for law, rung, condition, together in steps:
                advance(law.name, 0)
                rows.append(ladder.climb(studied, law, rung, condition, together=together))
                advance(law.name, 1)
        files = self._write(studied, rows, complete=True)
        study = studied.of_rows(rows)
        if filmed is not None:
            files = (*files, self._film(studied, filmed, study))
        self._answer(study)
        screen.say_files(screen.console(), *files)
        return screen.DONE

    def _write(self, studied: Ladder, rows: list[Climb], *, complete: bool) -> tuple[Path, ...]:
        """Write document and figure; returns where they are, nowhere without a row."""
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies.ladder_tables import ladder_document, write_ladder_figure

        if not rows:
            return ()
        study = studied.of_rows(rows)
        target = self.out / f"ladder_{result_name(studied.machine.path)}.json"
        write_json(target, ladder_document(studied, study, complete=complete))
        return target, write_ladder_figure(study, target.with_suffix(".png"))

    def _film(self, studied: Ladder, law: StudiedLaw, study: Climbs) -> Path:
        """Write the film; returns where it is."""
        from grosmc_mj.experiments.films import SMALL, write_case_film
        from grosmc_mj.studies.ladder_tables import ladder_film

        path = self.out / f"ladder_{result_name(studied.machine.path)}_film.mp4"
        film = ladder_film(studied, law, study, replace(SMALL, fps=8))
        case, settings = studied.machine.case, studied.experiment.settings
        return write_case_film(case, film, path, settings=settings, gif=self.gif).film

    def _answer(self, study: Climbs) -> None:
        """Print which laws pass, where each breaks, and on request every share."""
        from grosmc_mj.studies import ladder_tables as tables

        console, wide = screen.console(), screen.wide_console()
        for condition in study.conditions:
            console.print(tables.verdict(study, condition.name), style="bold", markup=False)
            console.print(tables.answer_table(study, condition.name))
            if claims := tables.claims_table(study, condition.name):
                console.print(claims.model_copy(update={"legend": ""}))
            if not self.verbose:
                continue
            wide.print(tables.share_table(study, condition.name, together=True))
            if condition is study.conditions[0]:
                wide.print(tables.share_table(study, condition.name, together=False))
            wide.print(tables.deviation_table(study, condition.name))
        if assumed := tables.assumed_text(study):
            console.print(assumed, style="dim", markup=False)
        if self.verbose:
            console.print(tables.LEGEND, style="dim", markup=False)
