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

_Text = Annotated[str, Parameter(metavar="TEXT", show_default="none")]


@command
class ContestCommand(SearchStudyCommand["ContestStudy", "ContestLaw"]):
    """Tune all laws of a case by one budget, and find the simplest that keeps all.

    Each law of the case and each rival is tuned as by grosmc-mj tune, by the same budget of runs
    and to the same conditions. Then each is judged alike, with the numbers of the file and with
    the tuned ones: draws of no search, random plants, the worst disturbance within --bound, gain
    and delay of the nominal task, largest input and its variation. The simplest law has the fewest
    tuned numbers, then the smallest share of its tightest limit.

    Writes contest_NAME.json, .png and .svg to --out, each finished batch of runs and each law to
    the folder contest_NAME, and contest_NAME.toml, a case with the tuned laws, beside a case file
    of your own, of a case of the package to --out.

    Exit code: 0 if a tuned law keeps all, 1 if none does, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, which means its machine, a case, or a case file.
        laws: Laws that contend.
        margin_draws: Draws that margins of gain and delay are searched on.
        on: A body, an input or a state on which the worst disturbance is searched for each law.
        bound: Its largest magnitude with its unit, "0.1 N m".
    """

    target: Target
    _: KW_ONLY
    laws: Annotated[
        tuple[str, ...], Parameter(metavar="NAME...", show_default="all and the rivals")
    ] = ()
    margin_draws: WholeNumber = 2
    on: _Text = ""
    bound: _Text = ""

    def study(self) -> ContestStudy:
        """Return the target with the laws that contend."""
        from grosmc_mj.studies.contest.contest import contest_study
        from grosmc_mj.studies.sweep.draws import require_draws

        require_draws(self.margin_draws, "--margin-draws")
        return contest_study(
            self.target,
            self.laws,
            margin_draws=self.margin_draws,
            on=self.on,
            bound=self.bound,
            **self.search_options(),
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

        if not any(row.tuned for row in rows):
            return ()
        title = f"{study.target}: the file's numbers and tuned ones"
        chart = cells_chart(title, [contest_chart(study, rows)], NOTE)
        return [write_chart(chart, path.with_suffix(".png"))]

    def write_cases(
        self, study: ContestStudy, rows: Sequence[ContestLaw], path: Path
    ) -> Sequence[Path]:
        """Write the case with the tuned laws."""
        from grosmc_mj.experiments.file.shipped import written_beside
        from grosmc_mj.ground.files import write_whole
        from grosmc_mj.studies.contest.answer import contest_words
        from grosmc_mj.studies.tune.case_text import case_text
        from grosmc_mj.studies.tune.row import found_values

        if not any(row.tuned for row in rows):
            return ()
        case = written_beside(study.case.path, self.out, f"{path.stem}.toml")
        values = {row.law: found_values(row.numbers) for row in rows if row.tuned}
        laws = [law for law in study.tuning.laws if law.name in values]
        write_whole(case, case_text(study.case, laws, values, contest_words(rows)))
        return [case]

    def keeps(self, study: ContestStudy, rows: Sequence[ContestLaw]) -> bool:
        """Whether a tuned law keeps all on draws of no search."""
        return any(row.kept for row in rows)
