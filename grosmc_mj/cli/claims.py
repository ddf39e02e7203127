"""grosmc-mj claims and premises, and the claims of grosmc-mj validate."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Claims, Premises
from grosmc_mj.errors import ArgumentError

if TYPE_CHECKING:
    from grosmc_mj.chapter.claims.claim import Claim, Finding
    from grosmc_mj.experiments.laboratory import Laboratory


def claims(command: Claims) -> int:
    """Judge, print, write, compare."""
    from grosmc_mj.chapter.claims.ledger import find_claim, select_claims
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.report.document import json_text, origin, write_json

    if command.explain is not None and command.system is not None:
        raise ArgumentError("--explain names one claim: leave out the system")
    if command.page is not None and (command.system or command.explain):
        raise ArgumentError("--page is about all claims: leave out the system and --explain")
    if command.page is not None and (command.page.suffix != ".md" or command.page.is_dir()):
        raise ArgumentError(f"--page {command.page} must be a file that ends in .md")
    if command.json and (command.explain or command.page or command.self_test):
        raise ArgumentError("--json is for the ledger: leave out --explain, --page and --self-test")
    if command.self_test and (command.explain or command.page):
        raise ArgumentError("--self-test tries claims: leave out --explain and --page")
    chosen = (
        select_claims(command.system) if command.explain is None else [find_claim(command.explain)]
    )
    settings = Settings()
    if command.self_test:
        return _self_test(settings, chosen, command.out)
    lab = Laboratory(settings)
    findings = judge_with_progress(lab, chosen)
    content = {**origin(0), "claims": documents(findings, lab)}
    console = Console(highlight=False, width=max(100, Console().width))
    if command.explain is not None:
        write_json(command.out / "claims" / f"{findings[0].claim.id}.json", content)
        _explain(console, findings[0], lab, command.out)
        return _compare(console, findings, quiet=False)
    write_json(command.out / "claims.json", content)
    if command.page is not None:
        from grosmc_mj.chapter.claims_page import write_page

        for path in write_page(findings, lab, command.page):
            console.print(str(path), soft_wrap=True)
    elif command.json:
        print(json_text(content), end="")
    else:
        print_ledger(console, findings)
    return _compare(console, findings, quiet=command.json)


def judge_with_progress(lab: Laboratory, chosen: Sequence[Claim]) -> list[Finding]:
    """Judge claims with a progress bar."""
    from grosmc_mj.chapter.claims.ledger import judge

    findings = []
    with screen.progress(len(chosen), "claims") as advance:
        for claim in chosen:
            findings.append(judge(lab, claim))
            advance(claim.id)
    return findings


def documents(findings: Sequence[Finding], lab: Laboratory) -> list[dict[str, Any]]:
    """Findings as plain values."""
    from grosmc_mj.chapter.claims_document import claim_document

    return [claim_document(finding, lab) for finding in findings]


def print_ledger(console: Console, findings: Sequence[Finding]) -> None:
    """The ledger, its legend and its sum."""
    from grosmc_mj.chapter.claims_tables import LEGEND, ledger_tables

    for table in ledger_tables(findings):
        console.print(table)
    console.print(LEGEND, style="dim", width=100)
    for finding in findings:
        if finding.because:
            console.print(
                f"{finding.claim.id}: a premise failed: {finding.because}", width=100, markup=False
            )
    console.print(_counts(findings))


def print_refuted(console: Console, findings: Sequence[Finding]) -> None:
    """The claims that are not supported, one line each; the rest are counted."""
    from grosmc_mj.chapter.claims.claim import Verdict
    from grosmc_mj.chapter.claims_tables import shown, word

    console.print(f"Claims of the chapter: {_counts(findings)}; grosmc-mj claims says which")
    for finding in findings:
        if finding.verdict is not Verdict.SUPPORTED:
            claim = finding.claim
            value = shown(finding.plants[claim.plants[-1]].measured)
            line = word(finding.verdict).append(f"  {claim.statement}", style="default not bold")
            needed = f" ({value}, must be {claim.sense} {claim.threshold:g} {claim.unit})"
            console.print(line.append(needed, style="dim not bold"), soft_wrap=True)


def _counts(findings: Sequence[Finding]) -> str:
    """How many claims have which verdict."""
    from grosmc_mj.chapter.claims.claim import Verdict

    counts = {v: sum(f.verdict is v for f in findings) for v in Verdict}
    return ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items())


def _compare(console: Console, findings: Sequence[Finding], *, quiet: bool) -> int:
    """Say which verdicts are not the expected ones."""
    from grosmc_mj.chapter.claims.ledger import verdict_differences

    differing = verdict_differences(findings)
    if not quiet:
        for line in differing:
            console.print(f"differs: {line}", style="red", soft_wrap=True)
        if not differing:
            console.print("All verdicts are as expected.", style="bold green")
    return screen.DIFFERS if differing else screen.DONE


def _explain(console: Console, finding: Finding, lab: Laboratory, out: Path) -> None:
    """The story of one claim, and its figure."""
    from grosmc_mj.chapter.claims_figures import write_picture
    from grosmc_mj.chapter.claims_tables import story

    for line in story(finding, lab):
        console.print(line, soft_wrap=True)
    path = write_picture(finding, lab, out / "claims" / f"{finding.claim.id}.png")
    console.print(f"  {'figure':<12}{path}", soft_wrap=True)


def _self_test(settings: Any, chosen: Sequence[Claim], out: Path) -> int:
    """Faults, and who notices."""
    from grosmc_mj.chapter.claims.faults import FAULTS, self_test
    from grosmc_mj.chapter.claims_tables import caught_table
    from grosmc_mj.report.document import origin, write_json

    console = Console(highlight=False, width=max(100, Console().width))
    with screen.progress(len(FAULTS), "faults") as advance:
        found = list(self_test(settings, chosen, advance=advance))
    noticed_by = {caught.fault.name: list(caught.claims) for caught in found}
    write_json(out / "self_test.json", {**origin(0), "noticed_by": noticed_by})
    console.print(caught_table(found, chosen))
    missed = [caught.fault.name for caught in found if not caught.claims]
    noticed = {name for caught in found for name in caught.claims}
    blind = [claim.id for claim in chosen if claim.id not in noticed]
    for words, names in (("not noticed by any claim", missed), ("notices no fault", blind)):
        if names:
            console.print(f"{', '.join(names)}: {words}", style="red", soft_wrap=True)
    if missed or blind:
        return screen.DIFFERS
    console.print("Every fault is noticed, and every claim notices one.", style="bold green")
    return screen.DONE


def premises(command: Premises) -> int:
    """The premises of each case."""
    from grosmc_mj.chapter.claims_document import audit_document
    from grosmc_mj.chapter.claims_tables import audit_table, worst_points
    from grosmc_mj.experiments.experiment import select_experiments
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.premises.audit import audit
    from grosmc_mj.report.document import origin, write_json

    lab = Laboratory(Settings())
    selected = select_experiments((command.system,), command.case)
    audits = [audit(lab, experiment, command.controller) for experiment in selected]
    target = command.out / f"premises_{command.system}.json"
    write_json(target, {**origin(None), "premises": [audit_document(each) for each in audits]})
    console = Console(highlight=False, width=max(100, Console().width))
    for found in audits:
        console.print(audit_table(found))
        for line in worst_points(found):
            console.print(line, style="#D55E00", markup=False, soft_wrap=True)
    console.print(
        "Margins are positive where the premise holds; over the declared operating region and "
        f"along the run. {target}",
        style="dim", soft_wrap=True,
    )  # fmt: skip
    return screen.DONE
