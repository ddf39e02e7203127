"""grosmc-mj validate."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import OUTPUT, Command, Figures, Flag, Out, command
from grosmc_mj.cli.commands.claims import judge_in_processes
from grosmc_mj.cli.commands.report import REPORT, report_on
from grosmc_mj.cli.exit_codes import DIFFERS, DONE
from grosmc_mj.cli.films import film_results
from grosmc_mj.cli.targets import recorded_experiments
from grosmc_mj.ground.files import require_writable

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim
    from grosmc_mj.chapter.validation import Validation
    from grosmc_mj.experiments.experiment import Experiment


@command
class ValidateCommand(Command):
    """Run the chapter's cases and say whether they come out as recorded.

    Every case of each SYSTEM (servo, cart_pendulum, arm, two_link_arm; all of them, if none is
    named) runs on the analytic plants (the chapter's printed equations where they are misprinted,
    and the corrected ones) and in MuJoCo, under LQR, GROSMC and what else its system has. Figures
    (PNG and SVG, numbered as in the chapter) and validation.json go to --out. The claims of the
    chapter are judged as by grosmc-mj claims.

    Exit code: 0 if every result and verdict is as the repository has it, 1 if one differs, 2 if the
    command or the set-up is wrong.

    Attributes:
        targets: Systems to run, or cases of them.
        out: Folder for validation.json and the figures.
        claims: Whether to judge the chapter's claims too; this needs every case of a SYSTEM.
        figures: Whether to draw the figures.
        films: End with a film of each case, LQR beside GROSMC, in DIR/films. One that is
            there already, drawn from the same data, is kept.
        report: End with a page of all that lies in DIR, DIR/report.html.
        record: Record the results as expected, for review.
    """

    targets: Annotated[tuple[str, ...], Parameter(show_default="all systems")] = ()
    _: KW_ONLY
    out: Out = Path("renders")
    claims: bool = True
    figures: Figures = True
    films: Annotated[Flag, Parameter(group=OUTPUT)] = False
    report: Annotated[Flag, Parameter(group=OUTPUT)] = False
    record: Flag = False

    def execute(self) -> int:
        """Run the cases, compare them with the record, write and print the result."""
        from grosmc_mj.chapter.expected_results import record_expected
        from grosmc_mj.chapter.validation import Validation

        start = time.perf_counter()
        require_writable(self._path)
        experiments = self._selected()
        done = Validation(experiments)
        claims = self._claims(done)
        runs = sum(len(experiment.laws) for experiment in experiments)
        steps = runs + len(_systems(done)) + len(claims)
        try:
            with screen.progress(steps) as advance:
                _compute(done, experiments, claims, advance)
                if self.record:
                    record_expected(done.results)
                done.compare()
        finally:
            # Results are kept and shown, whatever happened since.
            if done.results:
                self._write(done)

        figures = self._draw(done) if self.figures else 0
        seconds = time.perf_counter() - start
        console = screen.console()
        console.print(f"{figures} figures; {seconds:.1f} s", style="dim")
        if self.films:
            film_results(console, done.results, self.out)
        if self.report:
            report_on(console, [self.out], self.out / REPORT)
        return DIFFERS if done.differences else DONE

    def _selected(self) -> list[Experiment]:
        """Return the experiments of the targets, each once."""
        from grosmc_mj.theory.plants import SYSTEMS

        targets = self.targets or tuple(SYSTEMS)
        experiments: dict[Any, Experiment] = {}
        for target in targets:
            for experiment in recorded_experiments(target):
                experiments[experiment.key] = experiment
        return list(experiments.values())

    def _claims(self, done: Validation) -> list[Claim]:
        """Return the claims about the systems all of whose cases are selected."""
        from grosmc_mj.chapter.claims.ledger import CLAIMS

        if not self.claims or self.record:
            return []
        complete = [system for system in _systems(done) if _has_all_cases(done, system)]
        return [claim for claim in CLAIMS if claim.system in complete]

    @property
    def _path(self) -> Path:
        """Path of the result."""
        return self.out / "validation.json"

    def _write(self, done: Validation) -> None:
        """Write the results and the curves of each case, and print the answer."""
        from grosmc_mj.experiments.answer.curves import write_curves

        screen.say_result(done.result(), self._path, full=self.verbose)
        for key in dict.fromkeys(result.case.key for result in done.results):
            results = [result for result in done.results if result.case.key == key]
            case = results[0].case
            write_curves(results, f"{case.system}_{case.name}", self.out)

    def _draw(self, done: Validation) -> int:
        """Draw the figures; returns how many."""
        from grosmc_mj.chapter.figures import drawable, write_figures

        count = len(drawable(done.selected))
        with screen.progress(count, "figures") as advance:
            for path in write_figures(done.results, self.out):
                advance(path.name)
        return count


def _systems(done: Validation) -> list[str]:
    """Return the systems of the selected cases, each once."""
    return list(dict.fromkeys(case.system for case in done.selected))


def _has_all_cases(done: Validation, system: str) -> bool:
    """Return True if every recorded case of a system is selected."""
    experiments = recorded_experiments(system)
    selected = {case.key for case in done.selected}
    return all(experiment.key in selected for experiment in experiments)


def _compute(
    done: Validation,
    experiments: Sequence[Experiment],
    claims: Sequence[Claim],
    advance: Callable[[str], object],
) -> None:
    """Run the cases, compare equations with MuJoCo, judge the claims."""
    from grosmc_mj.chapter.agreement import agreements
    from grosmc_mj.experiments.run_cache import RunCache
    from grosmc_mj.experiments.settings import Settings
    from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

    for experiment in experiments:
        for result in experiment.runs():
            done.results.append(result)
            advance(result.key)

    for system in _systems(done):
        done.agreements.extend(agreements(MujocoPlant.load(system), seed=done.seed))
        advance(f"{system}: analytic against physics")

    lab = RunCache(Settings(), known=done.results)
    done.findings = judge_in_processes(lab, claims, advance)
