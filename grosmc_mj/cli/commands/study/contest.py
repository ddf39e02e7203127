"""Which laws keep all, each tuned by the same budget?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli.command import Target, WholeNumber, command
from grosmc_mj.cli.study_command import SearchStudyCommand

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.contest.contest import ContestStudy
    from grosmc_mj.studies.contest.row import ContestLaw


@command
class ContestCommand(SearchStudyCommand["ContestStudy", "ContestLaw"]):
    """Tune all laws of a case by one budget, and find the simplest that keeps all.

    Each law of the case and each rival is tuned as by grosmc-mj tune, by the same budget of runs
    and to the same conditions. Then each is judged alike, with the numbers of the file and with
    the tuned ones: draws of no search, random plants, gain and delay of the nominal task, largest
    input and its variation. The simplest law has the fewest tuned numbers, then the smallest
    share of its tightest limit.

    Writes contest_NAME.json, .png and .svg to --out, and each finished batch of runs and each law
    to the folder contest_NAME.

    Exit code: 0 if a tuned law keeps all, 1 if none does, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, which means its machine, a case, or a case file.
        laws: Laws that contend.
        margin_draws: Draws that margins of gain and delay are searched on.
    """

    target: Target
    _: KW_ONLY
    laws: Annotated[
        tuple[str, ...], Parameter(metavar="NAME...", show_default="all and the rivals")
    ] = ()
    margin_draws: WholeNumber = 2

    def study(self) -> ContestStudy:
        """Return the target with the laws that contend."""
        from grosmc_mj.studies.contest.contest import contest_study
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.margin_draws, "--margin-draws")
        return contest_study(
            self.target, self.laws, margin_draws=self.margin_draws, **self.search_options()
        )

    def result(self, study: ContestStudy, rows: Sequence[ContestLaw], *, complete: bool) -> Result:
        """Return the result of a contest."""
        from grosmc_mj.studies.contest.answer import contest_result

        return contest_result(study, rows, complete=complete)

    def draw(self, study: ContestStudy, rows: Sequence[ContestLaw], path: Path) -> Sequence[Path]:
        """Draw the figure."""
        from grosmc_mj.output.charts.figure import write_chart
        from grosmc_mj.output.charts.of_results import cells_chart
        from grosmc_mj.studies.contest.answer import NOTE, contest_chart

        title = f"{study.target}: the file's numbers and tuned ones"
        chart = cells_chart(title, [contest_chart(study, rows)], NOTE)
        return (write_chart(chart, path.with_suffix(".png")),)

    def keeps(self, study: ContestStudy, rows: Sequence[ContestLaw]) -> bool:
        """Whether a tuned law keeps all on draws of no search."""
        return any(row.kept for row in rows)
