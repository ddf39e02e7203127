"""grosmc-mj tune."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from grosmc_mj.cli.command import Target, command
from grosmc_mj.cli.study_command import SearchStudyCommand
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.output.results.result import Result
    from grosmc_mj.studies.tune.row import TunedLaw
    from grosmc_mj.studies.tune.tune import TuneStudy


@command
class TuneCommand(SearchStudyCommand["TuneStudy", "TunedLaw"]):
    """Find numbers with which a law keeps all that a case requires.

    Each law's numbers are searched in its loop and on its machine as built: designs by the hundred,
    each run under all conditions (nominal and its edits and disturbances, or else those of the
    system's case1 and case2) and in several draws of what is random. Designs are
    ordered by what they exceed under all conditions together, and where all is kept by the share of
    the tightest limit; the search ends at half of each limit, or when its runs are spent. The
    numbers found are judged on other draws.

    Writes tune_NAME.json, .png and .svg to --out, each finished batch of runs to the folder
    tune_NAME, and NAME_tuned.toml, a case with the tuned laws, beside a case file of your own, of a
    case of the package to --out; after Ctrl-C the best so far.

    Exit code: 0 if each law keeps all on the other draws, 1 if none was found for a law, or it does
    not, 2 if the command or the set-up is wrong.

    Attributes:
        target: A system, which means its machine, a case, or a case file.
        law: Laws to tune, such as lqr, implicit or any law of the file.
        number: Numbers and ranges instead of the law's usual ones, such as "laws.mine.k=0.1..100",
            "laws.adrc.bandwidth=1 Hz..80 Hz" or laws.lqr.Q[1], and with one law those of an
            estimator, "estimator.rotor speed.bandwidth=20..300"; a range above 0 is searched by the
            logarithm.
    """

    target: Target
    _: KW_ONLY
    law: Annotated[tuple[str, ...], Parameter(metavar="NAME...")]
    number: Annotated[
        tuple[str, ...], Parameter(metavar="PATH=LOW..HIGH...", show_default="the law's own")
    ] = ()

    def study(self) -> TuneStudy:
        """Return the target with the laws and numbers that are tuned."""
        from grosmc_mj.studies.tune.tune import tune_study

        return tune_study(self.target, self.law, self.number, **self.search_options())

    def result(self, study: TuneStudy, rows: Sequence[TunedLaw], *, complete: bool) -> Result:
        """Return the result of a tuning."""
        from grosmc_mj.studies.tune.answer import tune_result

        return tune_result(study, rows, complete=complete)

    def draw(self, study: TuneStudy, rows: Sequence[TunedLaw], path: Path) -> Sequence[Path]:
        """Draw the figure."""
        from grosmc_mj.output.charts.figure import write_chart
        from grosmc_mj.output.charts.of_results import panels_chart
        from grosmc_mj.studies.tune.answer import charts

        figure = path.with_suffix(".png")
        title = f"{study.target}: tuned laws"
        write_chart(panels_chart(title, [charts(row) for row in rows]), figure)
        return [figure]

    def write_cases(self, study: TuneStudy, rows: Sequence[TunedLaw], path: Path) -> Sequence[Path]:
        """Write the case with the tuned laws."""
        from grosmc_mj.experiments.file.shipped import written_beside
        from grosmc_mj.ground.files import write_whole
        from grosmc_mj.studies.tune.answer import law_answer
        from grosmc_mj.studies.tune.case_text import case_text

        name = f"{result_name(study.case.path)}_tuned.toml"
        case = written_beside(study.case.path, self.out, name)
        values = {row.law: row.values for row in rows}
        laws = [law for law in study.laws if law.name in values]
        comments = [law_answer(study, row).words for row in rows]
        write_whole(case, case_text(study.case, laws, values, comments))
        return [case]

    def keeps(self, study: TuneStudy, rows: Sequence[TunedLaw]) -> bool:
        """Whether each law keeps all on draws of no search."""
        return all(row.kept for row in rows)
