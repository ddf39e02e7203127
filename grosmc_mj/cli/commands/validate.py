"""grosmc-mj validate."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands.claims import judge_in_processes
from grosmc_mj.cli.commands.report import REPORT, report_on
from grosmc_mj.cli.films import film_results
from grosmc_mj.cli.targets import CASES, recorded_experiments
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim
    from grosmc_mj.chapter.validation import Validation
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.runs import RunResult, Settings


@dataclass(frozen=True)
class ValidateCommand(Command):
    """Run the chapter's cases and say whether they come out as recorded.

    Every case of each SYSTEM (servo, cart_pendulum, arm, two_link_arm; all of them, if none is
    named) runs on the analytic plants (the chapter's printed equations where they are misprinted,
    and the corrected ones) and in MuJoCo, under LQR, GROSMC and what else its system has. Figures
    (PNG and SVG, numbered as in the chapter) and validation.json go to --out. The claims of the
    chapter are judged as by grosmc-mj claims.

    Exit code: 0 if every result and verdict is as the repository has it, 1 if one differs, 2 if the
    command or the set-up is wrong, or the settings are not those that the results are recorded
    with, so that nothing can be compared.

    Attributes:
        targets: Systems to run, or cases of them.
        engine: native compiles law and loop; python steps the same law in an ordinary loop,
            a few times slower and the same to rounding.
        control_period: Time between two samples of the law, in s; a multiple of the timestep.
        timestep: Physics timestep, in s.
        integrator: MuJoCo's integrator: RK4, implicitfast, implicit or Euler.
        switching: Switching law of the sliding mode laws: sign as in the chapter, boundary-layer,
            implicit, implicit-estimate, super-twisting, adaptive, unit-vector or
            implicit-unit-vector.
        surface: printed, or discrete: zero at every sample of the nominal plant.
        out: Folder for validation.json and the figures.
        claims: Whether to judge the chapter's claims too; this needs every case of a SYSTEM and
            the default settings.
        figures: Whether to draw the figures.
        films: Whether to end with a film of each case, LQR beside GROSMC, in DIR/films. One that is
            there already, drawn from the same data, is kept.
        report: Whether to end with a page of all that lies in DIR, DIR/report.html.
        record: Record the results as expected, for review; needs the default settings.
    """

    targets: Annotated[
        Positional[tuple[str, ...]],
        arg(metavar=f"[{CASES} ...]", name="target", help_behavior_hint="(default: all systems)"),
    ] = ()
    engine: Annotated[str, arg(metavar="native|python")] = "native"
    control_period: Annotated[float, arg(metavar="S")] = 1e-3
    timestep: Annotated[float, arg(metavar="S")] = 1e-3
    integrator: Annotated[str, arg(metavar="NAME")] = "RK4"
    switching: Annotated[str, arg(metavar="NAME")] = "sign"
    surface: Annotated[str, arg(metavar="printed|discrete")] = "printed"
    out: Annotated[Path, arg(metavar="DIR")] = Path("renders")
    claims: bool = True
    figures: bool = True
    films: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    report: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False

    def execute(self) -> int:
        """Run, write, compare, print."""
        from grosmc_mj.chapter.expected_results import record_expected
        from grosmc_mj.chapter.validation import Validation
        from grosmc_mj.experiments.laboratory import Laboratory
        from grosmc_mj.results.document import write_json

        started, settings = time.perf_counter(), self._settings()
        experiments = [one.with_settings(**settings.changes()) for one in self._selected()]
        done = Validation(settings, [one.case for one in experiments])
        target, claims = self.out / "validation.json", self._claims(done)
        systems = dict.fromkeys(case.system for case in done.selected)
        steps = sum(len(one.laws) for one in experiments) + len(systems) + len(claims)
        try:
            with screen.progress(steps) as advance:
                _compute(done, experiments, claims, advance)
                if self.record:
                    record_expected(done.results, settings)
                done.compare()
        finally:
            # What was computed is kept and shown, whatever happened since.
            if done.results:
                try:
                    write_json(target, done.document(Laboratory(settings)))
                finally:
                    _say(done, full=self.verbose)
                self._write_curves(done.results)
        console, figures = screen.console(), self._draw(done)
        console.print(f"{len(figures)} figures; {time.perf_counter() - started:.1f} s", style="dim")
        screen.say_files(console, target)
        if self.films:
            film_results(console, done.results, settings, self.out)
        if self.report:
            report_on(console, [self.out], self.out / REPORT)
        if done.differences:
            return screen.DIFFERS
        return screen.WRONG if done.differing is None else screen.DONE

    def _settings(self) -> Settings:
        """How the cases are run.

        Raises:
            ArgumentError: If others than the default ones are to be recorded.
        """
        from grosmc_mj.experiments.runs import Settings

        settings = Settings(**{one.name: getattr(self, one.name) for one in fields(Settings)})
        if self.record and settings != Settings():
            raise ArgumentError(
                "--record needs the default settings: leave out --engine, --control-period, "
                "--timestep, --integrator, --switching and --surface"
            )
        return settings

    def _selected(self) -> list[Experiment]:
        """The experiments of the targets, each once."""
        from grosmc_mj.plants import SYSTEMS

        experiments = [
            experiment
            for target in self.targets or tuple(SYSTEMS)
            for experiment in recorded_experiments(target)
        ]
        return list({one.key: one for one in experiments}.values())

    def _claims(self, done: Validation) -> list[Claim]:
        """The claims about the systems all of whose cases are selected."""
        from grosmc_mj.chapter.claims.ledger import CLAIMS
        from grosmc_mj.experiments.runs import Settings

        if not self.claims or self.record or done.settings != Settings():
            return []
        systems = dict.fromkeys(case.system for case in done.selected)
        cases = {name: [one.case for one in recorded_experiments(name)] for name in systems}
        whole = [name for name in systems if all(case in done.selected for case in cases[name])]
        return [claim for claim in CLAIMS if claim.system in whole]

    def _write_curves(self, results: Sequence[RunResult]) -> None:
        """The curves of each case, for the page."""
        from grosmc_mj.experiments.curves import write_curves

        for case in dict.fromkeys(result.case for result in results):
            own = [result for result in results if result.case == case]
            write_curves(own, f"{case.system}_{case.name}", self.out)

    def _draw(self, done: Validation) -> list[Path]:
        """The figures."""
        from grosmc_mj.chapter.figures import drawable, write_figures

        if not self.figures:
            return []
        paths: list[Path] = []
        with screen.progress(len(drawable(done.selected)), "figures") as advance:
            for path in write_figures(done.results, self.out):
                paths.append(path)
                advance(path.name)
        return paths


def _compute(
    done: Validation,
    experiments: Sequence[Experiment],
    claims: Sequence[Claim],
    advance: Callable[[str], object],
) -> None:
    """Run the cases, compare equations with MuJoCo, judge the claims."""
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.physics.mujoco_plant import MujocoPlant
    from grosmc_mj.sweep.agreement import agreements

    for experiment in experiments:
        for result in experiment.runs():
            done.results.append(result)
            advance(result.key)
    for system in dict.fromkeys(case.system for case in done.selected):
        done.agreements.extend(agreements(MujocoPlant.load(system), seed=done.seed))
        advance(f"{system}: analytic against physics")
    lab = Laboratory(done.settings, known=done.results)
    done.findings = judge_in_processes(lab, claims, advance)


def _say(done: Validation, *, full: bool) -> None:
    """The answer, and the tables."""
    from grosmc_mj.chapter.validation import deviations_table, systems_table
    from grosmc_mj.experiments import tables
    from grosmc_mj.sweep.agreement import agreement_table

    console = screen.console()
    good = done.complete and done.differing is not None and not done.differences
    screen.say_verdict(console, done.words, good=good)
    screen.say_lines(console, [f"differs: {line}" for line in done.differences], all=full)
    console.print(systems_table(done), deviations_table(done.results))
    if full:
        console = screen.wide_console()
        console.print(*tables.results_tables(done.results), tables.LEGEND)
        for line in tables.endings(done.results):
            console.print(line, style="red", soft_wrap=True)
        console.print(tables.gains_table(done.results), agreement_table(done.agreements))
