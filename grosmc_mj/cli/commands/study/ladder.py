"""Where does each law break between equations and machine?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, replace
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli.command import Flag, StudiedLaws, Target, WholeNumber, command
from grosmc_mj.cli.study_command import FilmedStudyCommand

if TYPE_CHECKING:
    from grosmc_mj.output.films.film import Film
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.output.results.verdicts import Verdict
    from grosmc_mj.studies.ladder.ladder import Ladder


@command
class LadderCommand(FilmedStudyCommand["Ladder", "Verdict"]):
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
        film: A law to film around where it breaks.
    """

    target: Target
    _: KW_ONLY
    laws: StudiedLaws = ()
    rivals: Flag = False
    loaded: Flag = False
    draws: WholeNumber = 10

    def study(self) -> Ladder:
        """Return the ladder of the target, with the sentences of the claims that its file cites."""
        from grosmc_mj.chapter.claims.ledger import cited_claims
        from grosmc_mj.ground.arguments import require_known
        from grosmc_mj.studies.ladder.ladder import ladder
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.draws)
        study = ladder(
            self.target,
            self.laws,
            loaded=self.loaded,
            rivals=self.rivals,
            draws=self.draws,
        )
        if self.film:
            require_known("law", self.film, [law.name for law in study.laws])
        claims = cited_claims(study.machine)
        statements = {name: claim.statement for name, claim in claims.items()}
        return replace(study, statements=statements)

    def measure(self, study: Ladder, rows: list[Verdict], folder: Path) -> None:
        """Climb with each law; the logs of the real machine come last, if all can be read."""
        from grosmc_mj.studies.ladder.ladder import measured_rows

        measured = measured_rows(study)
        super().measure(study, rows, folder)
        rows.extend(measured)

    def result(self, study: Ladder, rows: Sequence[Verdict], *, complete: bool) -> Result:
        """Return the result of a ladder."""
        from grosmc_mj.studies.ladder.answer import ladder_result

        return ladder_result(study, rows, complete=complete)

    def draw(self, study: Ladder, rows: Sequence[Verdict], path: Path) -> Sequence[Path]:
        """Draw a figure for each condition."""
        from grosmc_mj.studies.ladder.answer import charts
        from grosmc_mj.studies.matrix import NOTE, write_charts

        title = f"{study.target}: where each law fails"
        return write_charts(path, title, charts(study, rows), NOTE)

    def keeps(self, study: Ladder, rows: Sequence[Verdict]) -> bool:
        """Whether each law keeps everything on some rung."""
        keeping = {row.law for row in rows if row.kept}
        return all(law.name in keeping for law in study.laws)

    def film_of(self, study: Ladder, rows: Sequence[Verdict]) -> Film:
        """Return the film of the law around where it breaks."""
        from grosmc_mj.experiments.films import SMALL
        from grosmc_mj.studies.ladder.film import ladder_film

        (law,) = [law for law in study.laws if law.name == self.film]
        return ladder_film(study, law, rows, replace(SMALL, fps=8))
