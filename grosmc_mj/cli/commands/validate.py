"""grosmc-mj validate."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.answering import AnsweringCommand, Question
from grosmc_mj.cli.command import OUTPUT, Figures, Flag, Out, command
from grosmc_mj.cli.commands.claims import judge_in_processes
from grosmc_mj.cli.commands.report import REPORT, report_on
from grosmc_mj.cli.films import film_results
from grosmc_mj.cli.targets import recorded_experiments
from grosmc_mj.ground.wording import counted

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.output.results.result import Result


@command
class ValidateCommand(AnsweringCommand):
    """Run the cases of the book chapter and say whether they come out as recorded.

    Every case of each SYSTEM (servo, cart_pendulum, arm, two_link_arm; by default all) runs in
    MuJoCo, on the chapter's equations with its misprints corrected and, where it has misprints, on
    the printed ones too, under LQR, GROSMC and the other laws of the case. Results are compared
    with those that the package has recorded. Figures (PNG and SVG, numbered as in the chapter) and
    validation.json go to --out. The claims of the chapter are judged too, as by grosmc-mj claims.

    Exit code: 0 if every result and verdict is as recorded, 1 if one differs, 2 if the command or
    the set-up is wrong.

    Attributes:
        targets: Systems to run, or cases of them.
        out: Folder for validation.json and the figures.
        claims: Judge the chapter's claims too; this needs every case of a SYSTEM.
        figures: Draw the figures.
        films: End with a film of each case, LQR beside GROSMC, in DIR/films. One that is
            there already, drawn from the same data, is kept.
        report: End with a page of all that lies in DIR, DIR/report.html.
        record: Record the results as expected, for review.
    """

    targets: Annotated[tuple[str, ...], Parameter(show_default="all systems")] = ()
    _: KW_ONLY
    out: Out = Path("renders")
    claims: Annotated[bool, Parameter(show_default="--claims")] = True
    figures: Figures = True
    films: Annotated[Flag, Parameter(group=OUTPUT)] = False
    report: Annotated[Flag, Parameter(group=OUTPUT)] = False
    record: Flag = False

    def questions(self) -> Sequence[Question]:
        """Return the one question of the cases."""
        return [_ValidateQuestion(self, self._selected())]

    def _selected(self) -> list[Experiment]:
        """Return the experiments of the targets, each once."""
        from grosmc_mj.theory.plants import SYSTEMS

        targets = self.targets or tuple(SYSTEMS)
        experiments: dict[Any, Experiment] = {}
        for target in targets:
            for experiment in recorded_experiments(target):
                experiments[experiment.key] = experiment
        return list(experiments.values())


class _ValidateQuestion(Question):
    """Do the chapter's cases come out as recorded?"""

    def __init__(self, command: ValidateCommand, experiments: Sequence[Experiment]) -> None:
        from grosmc_mj.chapter.validation import Validation

        self.path = command.out / "validation.json"
        self._command = command
        self._experiments = experiments
        self._done = Validation(experiments)
        self._start = time.perf_counter()

    def measure(self) -> None:
        """Run the cases and judge the claims; compare with MuJoCo and with the record."""
        from grosmc_mj.chapter.expected_results import record_expected

        claims = self._claims()
        runs = sum(len(experiment.laws) for experiment in self._experiments)
        with screen.progress(runs + len(self._systems) + len(claims)) as advance:
            self._compute(claims, advance)
            if self._command.record:
                record_expected(self._done.results)
            self._done.compare()

    def _compute(self, claims: Sequence[Claim], advance: Callable[[str], object]) -> None:
        """Run the cases, compare equations with MuJoCo, judge the claims."""
        from grosmc_mj.chapter.agreement import agreements
        from grosmc_mj.experiments.run_cache import RunCache
        from grosmc_mj.experiments.settings import Settings
        from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

        done = self._done
        for experiment in self._experiments:
            for result in experiment.runs():
                done.results.append(result)
                advance(result.key)

        for system in self._systems:
            done.agreements.extend(agreements(MujocoPlant.load(system), seed=done.seed))
            advance(f"{system}: analytic against physics")

        lab = RunCache(Settings(), known=done.results)
        order = [claim.id for claim in claims]
        findings = judge_in_processes(lab, claims, advance)
        done.findings = sorted(findings, key=lambda finding: order.index(finding.claim.id))

    def _claims(self) -> list[Claim]:
        """Return the claims about the systems all of whose cases are selected."""
        from grosmc_mj.chapter.claims.ledger import CLAIMS

        if not self._command.claims or self._command.record:
            return []
        complete = [system for system in self._systems if self._has_all_cases(system)]
        return [claim for claim in CLAIMS if claim.system in complete]

    @property
    def _systems(self) -> list[str]:
        """The systems of the selected cases, each once."""
        return list(dict.fromkeys(case.system for case in self._experiments))

    def _has_all_cases(self, system: str) -> bool:
        """Return True if every recorded case of a system is selected."""
        selected = {case.key for case in self._experiments}
        return all(experiment.key in selected for experiment in recorded_experiments(system))

    def result(self, *, complete: bool) -> Result | None:
        """Return the result of the runs that are done."""
        if not self._done.results:
            return None
        return self._done.result()

    @property
    def missing(self) -> Sequence[str]:
        """Cases that are not run to their end, systems that are not compared, claims."""
        runs = Counter(run.case.key for run in self._done.results)
        compared = {agreement.system for agreement in self._done.agreements}
        judged = [finding.claim.id for finding in self._done.findings]
        cases = [case.target for case in self._experiments if runs[case.key] < len(case.laws)]
        systems = [
            f"{system} against its equations" for system in self._systems if system not in compared
        ]
        claims = [claim.id for claim in self._claims() if claim.id not in judged]
        return [*cases, *systems, *claims]

    def show(self, result: Result, *, full: bool, among: bool) -> None:
        """Write and print the result, and write the curves of each case."""
        from grosmc_mj.experiments.answer.curves import write_curves

        super().show(result, full=full, among=among)
        results = self._done.results
        for key in dict.fromkeys(run.case.key for run in results):
            runs = [run for run in results if run.case.key == key]
            case = runs[0].case
            write_curves(runs, f"{case.system}_{case.name}", self._command.out)

    def close(self) -> None:
        """Draw the figures, and write the films and the page that are asked for."""
        figures = self._write_figures() if self._command.figures else 0
        seconds = time.perf_counter() - self._start
        console = screen.console()
        console.print(f"{counted(figures, 'figure')}; {seconds:.1f} s", style="dim")

        out = self._command.out
        if self._command.films:
            film_results(console, self._done.results, out)
        if self._command.report:
            report_on(console, [out], out / REPORT)

    def _write_figures(self) -> int:
        """Draw the figures; returns how many."""
        from grosmc_mj.chapter.figures import drawable, write_figures

        count = len(drawable(self._done.selected))
        with screen.progress(count, "figures") as advance:
            for path in write_figures(self._done.results, self._command.out):
                advance(path.name)
        return count

    @property
    def kept(self) -> bool:
        """Whether everything is as recorded."""
        return not self._done.differences
