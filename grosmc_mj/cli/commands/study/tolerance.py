"""How much of each imperfection of the loop does each law stand?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli.command import Flag, StudiedLaws, Target, WholeNumber, command
from grosmc_mj.cli.study_command import StudyCommand

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.output.results.verdicts import Verdicts
    from grosmc_mj.studies.tolerance.tolerance import ToleranceStudy


@command
class ToleranceCommand(StudyCommand["ToleranceStudy", "Verdicts"]):
    """Find how much of each imperfection of the loop each law stands.

    For each law and each number of the bench's loop alone (delay, resolution, lag and so on), and
    for all of them together: the largest amount up to which all that the target requires is kept,
    nominal and under its edits and disturbances, or else those of the system's case1 and case2.
    Amounts are searched on the equations, from 1/16 to 1024 times the bench's. Of the least answers
    over the conditions MuJoCo confirms, at both ends, each law's least, those next to a limit and
    some at random; all of a law's once one differs.

    Writes tolerance_NAME.json, .png and .svg to --out, after Ctrl-C what there is of them, and each
    finished law to the folder tolerance_NAME.

    Exit code: 0 if done, 1 if a law keeps everything under no condition, even without any
    imperfection, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, which means its bench, a case, or a case file; without a loop of its own
            it is studied on its system's bench.
        laws: Laws to study, such as lqr, implicit, "implicit, predicted" or any law of the file.
        rivals: Study lqi, fl-pid, adrc and adaptive, too.
        control_period: Search the longest control period too, in an otherwise ideal loop.
        draws: Runs of a loop with an encoder, noise, jitter or missed samples: each has random
            numbers of its own and other phases of the encoders, and all must keep it.
    """

    target: Target
    _: KW_ONLY
    laws: StudiedLaws = ()
    rivals: Flag = False
    control_period: Flag = False
    draws: WholeNumber = 10

    def study(self) -> ToleranceStudy:
        """Return the target with its bench, conditions and laws."""
        from grosmc_mj.studies.sweep.draws import require_draws
        from grosmc_mj.studies.tolerance.tolerance import tolerance_study

        require_draws(self.draws)
        return tolerance_study(
            self.target,
            self.laws,
            rivals=self.rivals,
            longer_period=self.control_period,
            draws=self.draws,
        )

    def result(self, study: ToleranceStudy, rows: Sequence[Verdicts], *, complete: bool) -> Result:
        """Return the result of a study of tolerances."""
        from grosmc_mj.studies.tolerance.answer import tolerance_result

        return tolerance_result(study, study.tolerances(rows), complete=complete)

    def draw(self, study: ToleranceStudy, rows: Sequence[Verdicts], path: Path) -> Sequence[Path]:
        """Draw a figure for each condition."""
        from grosmc_mj.studies.matrix import write_charts
        from grosmc_mj.studies.tolerance.answer import NOTE, charts

        title = f"{study.target}: what of its bench each law stands"
        return write_charts(path, title, charts(study, study.tolerances(rows)), NOTE)

    def keeps(self, study: ToleranceStudy, rows: Sequence[Verdicts]) -> bool:
        """Whether each law keeps everything under some condition without any imperfection."""
        answers = study.tolerances(rows)
        keeping = {answer.law for answer in answers if answer.largest_kept is not None}
        return all(answer.law in keeping for answer in answers)
