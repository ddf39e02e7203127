"""grosmc-mj validate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
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
    from rich.console import Console

    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.case import Case
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.runs import RunResult, Settings
    from grosmc_mj.results.tables import Table
    from grosmc_mj.studies.agreement import Agreement


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
        from grosmc_mj.chapter import expected_results as expected
        from grosmc_mj.chapter.claims.ledger import CLAIMS, verdict_differences
        from grosmc_mj.chapter.claims_document import claims_document
        from grosmc_mj.chapter.document import document
        from grosmc_mj.experiments.laboratory import Laboratory
        from grosmc_mj.experiments.runs import Settings
        from grosmc_mj.physics.mujoco_plant import MujocoPlant
        from grosmc_mj.results.document import write_json
        from grosmc_mj.studies.agreement import agreements, disagreements

        started, seed = time.perf_counter(), 0
        settings = Settings(
            self.engine,  # pyright: ignore[reportArgumentType]  checked by Settings
            self.control_period,
            self.timestep,
            self.integrator,  # pyright: ignore[reportArgumentType]  checked by the plant
            self.switching,
            self.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
        )
        experiments = [one.with_settings(**settings.changes()) for one in self._selected()]
        selected = [one.case for one in experiments]
        if self.record and settings != Settings():
            raise ArgumentError(
                "--record needs the default settings: leave out --engine, --control-period, "
                "--timestep, --integrator, --switching and --surface"
            )
        systems = list(dict.fromkeys(case.system for case in selected))
        steps = sum(len(one.laws) for one in experiments)
        done = _Validation(settings, selected, [], [], [])
        claims: list[Claim] = []
        if self.claims and not self.record and settings == Settings():
            claims = [claim for claim in CLAIMS if claim.system in _whole(selected)]
        target, complete = self.out / "validation.json", False
        try:
            with screen.progress(steps + len(systems) + len(claims)) as advance:
                for experiment in experiments:
                    for result in experiment.runs():
                        done.results.append(result)
                        advance(result.key)
                for system in systems:
                    done.agreements.extend(agreements(MujocoPlant.load(system), seed=seed))
                    advance(f"{system}: analytic against physics")
                lab = Laboratory(settings, known=done.results)
                done.findings = judge_in_processes(lab, claims, advance)
                if self.record:
                    expected.record_expected(done.results, settings)
                done.differing = expected.differences(done.results, settings)
                done.failed = [
                    *disagreements(done.agreements),
                    *verdict_differences(done.findings),
                ]
                complete = True
                content = document(
                    done.results, done.agreements, settings, selected, seed, done.differing,
                    done.failed, complete=True,
                )  # fmt: skip
                write_json(target, {**content, **claims_document(done.findings, lab)})
        finally:
            # What was computed is kept and shown, whatever happened since.
            if done.results and not complete:
                content = document(
                    done.results, done.agreements, settings, selected, seed, None, complete=False
                )
                write_json(target, content)
            if done.results:
                self._say(done, complete=complete)
                self._write_curves(done.results)
        console, figures = screen.console(), self._draw(done)
        console.print(f"{len(figures)} figures; {time.perf_counter() - started:.1f} s", style="dim")
        screen.say_files(console, target)
        if self.films:
            film_results(console, done.results, settings, self.out)
        if self.report:
            report_on(console, [self.out], self.out / REPORT)
        if done.differing or done.failed:
            return screen.DIFFERS
        return screen.WRONG if done.differing is None else screen.DONE

    def _selected(self) -> list[Experiment]:
        """The experiments that are asked for, each once."""
        from grosmc_mj.plants import SYSTEMS

        found = [
            experiment
            for target in self.targets or tuple(SYSTEMS)
            for experiment in recorded_experiments(target)
        ]
        return list({one.key: one for one in found}.values())

    def _say(self, done: _Validation, *, complete: bool) -> None:
        """The answer, and the tables."""
        from grosmc_mj.chapter.claims.claim import Kind

        console = screen.console()
        if complete:
            _say_verdict(console, done, full=self.verbose)
        else:
            words = f"Not complete: {len(done.results)} runs are done."
            screen.say_verdict(console, words, good=False)
        console.print(_systems_table(done))
        if done.findings:
            own = sum(each.claim.kind is Kind.QUESTION for each in done.findings)
            console.print(
                "Of what the chapter says, one verdict a sentence, its equations and proofs "
                "included. Refuted: physics does not show it. "
                f"{own} questions of this project are not counted: grosmc-mj claims names all.",
                style="dim",
            )
        console.print(_deviations_table(done.results))
        if self.verbose:
            _tables(screen.wide_console(), done)

    def _write_curves(self, results: Sequence[RunResult]) -> None:
        """The curves of each case, for the page."""
        from grosmc_mj.experiments.curves.document import write_curves

        for case in dict.fromkeys(each.case for each in results):
            own = [each for each in results if each.case == case]
            write_curves(own, f"{case.system}_{case.name}", self.out)

    def _draw(self, done: _Validation) -> list[Path]:
        """The figures."""
        from grosmc_mj.chapter.figures import drawable, write_figures

        paths: list[Path] = []
        if self.figures:
            with screen.progress(len(drawable(done.selected)), "figures") as advance:
                for path in write_figures(done.results, self.out):
                    paths.append(path)
                    advance(path.name)
        return paths


@dataclass
class _Validation:
    """What has been computed so far.

    Attributes:
        settings: How.
        selected: What was asked for.
        results: Runs.
        agreements: Analytic plants against physics.
        findings: Claims.
        differing: What is not as recorded, a line each; None if it cannot be compared.
        failed: Equations that differ from MuJoCo, and verdicts that are not the expected ones.
    """

    settings: Settings
    selected: list[Case]
    results: list[RunResult]
    agreements: list[Agreement]
    findings: list[Finding]
    differing: list[str] | None = None
    failed: list[str] = field(default_factory=list)


def _whole(selected: Sequence[Case]) -> list[str]:
    """The systems all of whose cases are selected."""
    from grosmc_mj.cli.targets import recorded_experiments

    systems = dict.fromkeys(case.system for case in selected)
    return [
        name for name in systems if all(one.case in selected for one in recorded_experiments(name))
    ]


def _say_verdict(console: Console, done: _Validation, *, full: bool) -> None:
    """Say whether the results are as recorded."""
    from grosmc_mj.chapter.expected_results import other_settings

    differing = [*(done.differing or ()), *done.failed]
    if done.differing is None:
        other = ", ".join(other_settings(done.settings))
        words = f"Nothing was compared with the recorded results, whose settings differ: {other}."
        screen.say_verdict(console, words, good=False)
    elif differing:
        words = f"{len(differing)} results differ from the recorded ones."
        screen.say_verdict(console, words, good=False)
    else:
        words = f"All {len(done.results)} runs are as recorded."
        if done.findings:
            words += f" All {len(done.findings)} verdicts of the ledger are as expected."
        screen.say_verdict(console, words, good=True)
    screen.say_lines(console, [f"differs: {line}" for line in differing], all=full)


def _systems_table(done: _Validation) -> Table:
    """Of each system: runs, those that ended early, accelerations against MuJoCo's, verdicts."""
    from grosmc_mj.chapter.claims.claim import Kind, Verdict, verdicts_of

    rows = []
    for system in dict.fromkeys(case.system for case in done.selected):
        runs = [each for each in done.results if each.case.system == system]
        worst = [
            each.acceleration
            for each in done.agreements
            if each.system == system and each.variant == "corrected"
        ]
        own = [each for each in done.findings if each.claim.system == system]
        verdicts = [
            verdict
            for kind in Kind
            if kind is not Kind.QUESTION
            for verdict in verdicts_of(own, kind)
        ]
        counts = [str(verdicts.count(verdict)) if verdicts else "-" for verdict in Verdict]
        ended = sum(bool(each.ended) for each in runs)
        agreement = f"{max(worst):.1e}" if worst else "-"
        count = f"{len(runs)}" + (f" ({ended} early)" if ended else "")
        rows.append((system, count, agreement, *counts))
    columns = ("system", "runs", "to MuJoCo", *(verdict.value for verdict in Verdict))
    return screen.brief_table("", columns, rows)


def _deviations_table(results: Sequence[RunResult]) -> Table:
    """How far each law strays from its nominal optimum in MuJoCo."""
    from grosmc_mj.experiments.tables import metric_cell

    physics = [each for each in results if each.plant == "physics"]
    found = {
        (each.case.system, each.case.name, each.controller.name): metric_cell(
            each.metrics.get("deviation")
        )
        + (" (!)" if each.ended else "")
        for each in physics
    }
    laws = list(dict.fromkeys(law for _, _, law in found))
    rows = []
    for system, case in dict.fromkeys((system, case) for system, case, _ in found):
        cells = [found.get((system, case, law), "") for law in laws]
        rows.append((f"{system}/{case}", *cells))
    title = "In MuJoCo, max|x1-x1*|: how far each law strays from its nominal optimum"
    return screen.brief_table(title, ("case", *laws), rows, most=14)


def _tables(console: Console, done: _Validation) -> None:
    """Everything that was measured."""
    from grosmc_mj.experiments import tables
    from grosmc_mj.studies.agreement import agreement_table

    for table in tables.results_tables(done.results):
        console.print()
        console.print(table)
    console.print()
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings(done.results):
        console.print(line, style="red", soft_wrap=True)
    console.print(tables.gains_table(done.results))
    if done.agreements:
        console.print(agreement_table(done.agreements))
