"""grosmc-mj study tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, Out, StudiedLaws, Target, WholeNumber, command
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.targets import result_name

if TYPE_CHECKING:
    from grosmc_mj.studies.tolerance import Tolerance, ToleranceStudy


@command
class ToleranceCommand(Command):
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
        resume: Search only the laws that are missing in tolerance_NAME, the folder in --out to
            which every finished law is written, of the same file and versions.
        out: Folder for tolerance_NAME.json and the figure.
    """

    target: Target
    _: KW_ONLY
    laws: StudiedLaws = ()
    rivals: Flag = False
    control_period: Flag = False
    draws: WholeNumber = 10
    resume: Flag = False
    out: Out = Path("renders")

    def execute(self) -> int:
        """Search the tolerances, write, draw and print them."""
        from grosmc_mj.studies.tolerance import tolerance_study
        from grosmc_mj.studies.tolerance_answer import tolerance_result
        from grosmc_mj.sweep.draws import require_draws

        require_draws(self.draws)
        studied = tolerance_study(
            self.target, self.laws, rivals=self.rivals, longer_period=self.control_period
        )
        # Laws finish in any order.
        by_law: dict[int, list[Tolerance]] = {}
        with screen.answered(
            self._path(studied),
            lambda complete: tolerance_result(
                studied, _in_order(by_law), self.draws, complete=complete
            ),
            by_law,
            lambda: self._draw(studied, _in_order(by_law)),
            full=self.verbose,
            advice=screen.RESUME,
        ):
            self._search(studied, by_law)

        rows = _in_order(by_law)
        keeping = {row.law for row in rows if row.kept_ideally}
        return DONE if all(row.law in keeping for row in rows) else DIFFERS

    def _search(self, studied: ToleranceStudy, by_law: dict[int, list[Tolerance]]) -> None:
        """Search the tolerances of each law; with --resume read those that are finished.

        Args:
            studied: The study.
            by_law: Filled law by law: an interrupt leaves the finished ones.
        """
        from grosmc_mj.executors import executor_for
        from grosmc_mj.studies.tolerance import LawTolerances, cells_of, tolerances_of_laws

        cells = cells_of(studied, self.draws, self._path(studied).with_suffix(""))
        missing = []
        for index, law in enumerate(studied.laws):
            finished = cells.read(law.name) if self.resume else None
            if finished is None:
                missing.append(index)
            else:
                by_law[index] = finished.rows(studied)

        if not missing:
            return
        answers = len(studied.imperfections) * len(studied.conditions)
        with screen.progress(len(missing) * answers, "answers") as advance:
            executor = executor_for(len(missing))
            found = tolerances_of_laws(studied, missing, self.draws, executor, screen.notice)
            for index, rows in found:
                cells.write(LawTolerances.of(rows))
                by_law[index] = rows
                advance(studied.laws[index].name, answers)

    def _path(self, studied: ToleranceStudy) -> Path:
        """Return the path of the result."""
        return self.out / f"tolerance_{result_name(studied.experiment.path)}.json"

    def _draw(self, studied: ToleranceStudy, rows: list[Tolerance]) -> tuple[Path, ...]:
        """Draw the figures; returns their paths."""
        from grosmc_mj.studies.matrix import write_charts
        from grosmc_mj.studies.tolerance_answer import NOTE, charts

        title = f"{studied.target}: what of its bench each law stands"
        return write_charts(self._path(studied), title, charts(studied, rows), NOTE)


def _in_order(by_law: Mapping[int, list[Tolerance]]) -> list[Tolerance]:
    """Return the rows of all finished laws, in the order of the laws."""
    rows: list[Tolerance] = []
    for index in sorted(by_law):
        rows.extend(by_law[index])
    return rows
