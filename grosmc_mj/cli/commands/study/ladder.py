"""grosmc-mj study ladder."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.targets import TARGET, result_name

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.studies.ladder.measure import Ladder, Standing
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

    Writes ladder_NAME.json, .png and .svg to --out; after Ctrl-C what there is of them.

    Attributes:
        target: A system, which means its machine, a case, or a case file.
        laws: Laws to study, such as lqr, implicit or "implicit, predicted"; all by default.
        loaded: Climb under the system's other cases, too.
        film: A law to film around where it breaks; none by default.
        gif: Write the film as an animated GIF as well.
        out: Folder for ladder_NAME.json and the figure.
    """

    target: Annotated[Positional[str], arg(metavar=TARGET, name="target")]
    laws: Annotated[
        tuple[str, ...], arg(metavar="NAME [NAME ...]", help_behavior_hint="(default: all)")
    ] = ()
    loaded: Annotated[bool, FlagCreatePairsOff] = False
    film: Annotated[str, arg(metavar="NAME", help_behavior_hint="(default: none)")] = ""
    gif: Annotated[bool, FlagCreatePairsOff] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")

    def execute(self) -> int:
        """Climb, write, print, draw."""
        from grosmc_mj.chapter.claims.cited import cited_claims
        from grosmc_mj.studies.ladder.measure import ladder, standing
        from grosmc_mj.studies.studied import chosen_laws

        began = time.perf_counter()
        studied = ladder(self.target, self.laws, loaded=self.loaded)
        cited = cited_claims(studied.machine)
        studied = replace(
            studied, statements={name: claim.statement for name, claim in cited.items()}
        )
        filmed = chosen_laws(studied.laws, [self.film])[0] if self.film else None
        first, *loaded = studied.conditions
        ways = [(rung, True, first) for rung in studied.climbing]
        ways += [(rung, False, first) for rung in studied.alone]
        ways += [(rung, True, condition) for condition in loaded for rung in studied.climbing]
        rows: list[Standing] = []
        with (
            screen.kept_on_interrupt(lambda: self._write(studied, rows, complete=False)),
            screen.progress(len(studied.laws) * len(ways), "rungs") as advance,
        ):
            for law in studied.laws:
                for rung, together, condition in ways:
                    advance(law.name, 0)
                    rows.append(standing(studied, law, rung, condition, together=together))
                    advance(law.name, 1)
        files = self._write(studied, rows, complete=True)
        if filmed is not None:
            files = (*files, self._film(studied, filmed, rows))
        console = screen.console()
        _answer(console, studied, rows, full=self.verbose)
        console.print(f"In {time.perf_counter() - began:.1f} s", style="dim")
        screen.say_files(console, *files)
        return screen.DONE

    def _write(
        self, studied: Ladder, rows: Sequence[Standing], *, complete: bool
    ) -> tuple[Path, ...]:
        """Write document and figure; returns where they are, nowhere without a row."""
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies.ladder.figure import write_ladder_figure
        from grosmc_mj.studies.ladder.report import ladder_document

        if not rows:
            return ()
        base = self.out / f"ladder_{result_name(studied.machine.path)}"
        target = base.with_suffix(".json")
        write_json(target, ladder_document(studied, rows, complete=complete))
        return target, write_ladder_figure(studied, rows, base.with_suffix(".png"))

    def _film(self, studied: Ladder, law: StudiedLaw, rows: Sequence[Standing]) -> Path:
        """Write the film; returns where it is."""
        from grosmc_mj.experiments.films import SMALL, write_case_film
        from grosmc_mj.studies.ladder.film import ladder_film

        path = self.out / f"ladder_{result_name(studied.machine.path)}_film.mp4"
        film = ladder_film(studied, law, rows, replace(SMALL, fps=8))
        settings = studied.experiment.settings
        return write_case_film(
            studied.machine.case, film, path, settings=settings, gif=self.gif
        ).film


def _answer(console: Console, studied: Ladder, rows: Sequence[Standing], *, full: bool) -> None:
    """Up to where laws climb, where each breaks, and on request every share."""
    from grosmc_mj.studies.ladder.answers import verdict
    from grosmc_mj.studies.ladder.report import (
        LEGEND,
        assumed_text,
        breaks_table,
        claims_table,
        deviation_table,
        ladder_table,
    )

    for condition in studied.conditions:
        own = [row for row in rows if row.condition is condition]
        console.print(verdict(own, condition.name), style="bold", markup=False)
        console.print(breaks_table(condition.title, own, condition.name))
        if claims := claims_table("On which rung claims fall", own, condition.name):
            console.print(claims)
        if not full:
            continue
        wide = screen.wide_console()
        for title, together, rungs in (
            ("Each rung on top of the others", True, studied.climbing),
            ("Each alone on the sampled plant", False, studied.alone),
        ):
            if some := [row for row in own if row.together is together]:
                wide.print(ladder_table(title, some, rungs))
        wide.print(deviation_table([r for r in own if r.together], studied.climbing))
    if assumed := assumed_text({rung.name: rung.assumed for rung in studied.climbing}):
        console.print(assumed, style="dim", markup=False)
    if full:
        console.print(LEGEND, style="dim", markup=False)
