"""grosmc-mj validate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.claims import documents, print_refuted
from grosmc_mj.cli.commands import Validate
from grosmc_mj.cli.films import film_results
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.runs import RunResult
    from grosmc_mj.studies.agreement.measure import Agreement


def validate(command: Validate) -> int:
    """Run, print, write, compare."""
    from grosmc_mj.chapter import expected_results as expected
    from grosmc_mj.chapter.claims.ledger import CLAIMS, judge, verdict_differences
    from grosmc_mj.chapter.document import document
    from grosmc_mj.chapter.figures import drawable, write_figures
    from grosmc_mj.experiments.experiment import select_experiments
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.report.document import write_json
    from grosmc_mj.studies.agreement.measure import agreements, disagreements

    started, seed = time.perf_counter(), 0
    settings = Settings(
        command.engine,  # pyright: ignore[reportArgumentType]  checked by Settings
        command.control_period,
        command.timestep,
        command.integrator,  # pyright: ignore[reportArgumentType]  checked by the plant
        command.switching,
        command.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
    )
    experiments = [
        each.with_settings(**settings.changes())
        for each in select_experiments(command.systems, command.case)
    ]
    selected = [each.case for each in experiments]
    if command.record and settings != Settings():
        raise ArgumentError(
            "--record needs the default settings: leave out --engine, --control-period, "
            "--timestep, --integrator, --switching and --surface"
        )
    systems = list(dict.fromkeys(case.system for case in selected))
    results: list[RunResult] = []
    found: list[Agreement] = []
    differing: list[str] | None = None
    figures: list[Path] = []
    findings: list[Finding] = []
    claims: list[Claim] = []
    if command.claims and command.case is None and not command.record and settings == Settings():
        claims = [claim for claim in CLAIMS if claim.system in systems]
    console, target = screen.console(), command.out / "validation.json"
    complete = False
    try:
        steps = sum(len(each.laws) for each in experiments) + len(systems) + len(claims)
        with screen.progress(steps) as advance:
            for experiment in experiments:
                for result in experiment.runs():
                    results.append(result)
                    advance(result.key)
            for system in systems:
                found += agreements(system, seed=seed)
                advance(f"{system}: analytic against physics")
            lab = Laboratory(settings, known=results)
            for claim in claims:
                findings.append(judge(lab, claim))
                advance(claim.id)
            if command.record:
                expected.record_expected(results, settings)
            differing = expected.differences(results, settings)
            if wrong := [*disagreements(found), *verdict_differences(findings)]:
                differing = [*(differing or []), *wrong]
            complete = True
            content = document(results, found, settings, selected, seed, differing, complete=True)
            write_json(target, {**content, "claims": documents(findings, lab)})
    finally:
        # What was computed is kept and shown, whatever happened since.
        if results and not complete:
            write_json(
                target, document(results, found, settings, selected, seed, None, complete=False)
            )
        if results:
            _show(console, results, found)
    if findings:
        print_refuted(console, findings)
    code = _verdict(console, differing, len(results))
    if command.figures:
        with screen.progress(len(drawable(selected)), "figures") as advance:
            for path in write_figures(results, command.out):
                figures.append(path)
                advance(path.name)
    console.print(
        f"{len(results)} runs, {len(findings)} claims and {len(figures)} figures in "
        f"{time.perf_counter() - started:.1f} s; {target}"
    )
    if command.films:
        film_results(console, results, settings, command.out)
    return code


def _show(console: Console, results: Sequence[RunResult], found: Sequence[Agreement]) -> None:
    """Print the tables of what was computed."""
    from grosmc_mj.experiments import tables
    from grosmc_mj.studies.agreement.report import agreement_table

    for table in tables.results_tables(results):
        console.print(table)
        console.print()
    console.print(tables.LEGEND, style="dim")
    for line in tables.endings(results):
        console.print(line, style="red", soft_wrap=True)
    console.print(tables.gains_table(results))
    if found:
        console.print(agreement_table(found))


def _verdict(console: Console, differing: list[str] | None, count: int) -> int:
    """Say whether the results are as recorded."""
    if differing is None:
        console.print("Not compared with the recorded results: they hold for other settings.")
        return screen.DONE
    for line in differing:
        console.print(f"differs: {line}", style="red", soft_wrap=True)
    if differing:
        console.print(f"{len(differing)} results differ from the recorded ones.", style="bold red")
        return screen.DIFFERS
    console.print(f"All {count} runs are as recorded.", style="bold green")
    return screen.DONE
