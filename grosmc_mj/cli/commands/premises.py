"""grosmc-mj claims --premises."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.results.palette import FAILED

if TYPE_CHECKING:
    from pathlib import Path

    from grosmc_mj.assumptions.audit import Audit
    from grosmc_mj.results.tables import Table


def audit_premises(target: str, controller: str, out: Path, *, full: bool) -> int:
    """Check the premises of each case, write them, print what fails.

    Args:
        target: SYSTEM or SYSTEM/CASE.
        controller: Whose premises.
        out: Folder for premises_SYSTEM.json.
        full: Whether to print all premises too.
    """
    from grosmc_mj.assumptions.robot import audit_of
    from grosmc_mj.chapter.claims_document import audit_document
    from grosmc_mj.chapter.claims_tables import audit_table, worst_points
    from grosmc_mj.experiments.catalogue import find_experiments
    from grosmc_mj.experiments.laboratory import Laboratory
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.results.document import origin, write_json

    lab, found = Laboratory(Settings()), find_experiments(target)
    # The theorems know of no loop: of a system its benches are left out.
    experiments = [one for one in found if one.case.loop is None] or found
    audits = [audit_of(lab, experiment, controller) for experiment in experiments]
    file = out / f"premises_{experiments[0].case.system}.json"
    write_json(file, {**origin(None), "premises": [audit_document(each) for each in audits]})
    console = screen.console()
    failed, judged = (
        sum(len(each.failed()) for each in audits),
        sum(len(each.premises) for each in audits),
    )
    words = f"All {judged} premises of {controller} hold."
    if failed:
        words = f"{failed} of {judged} premises of {controller} fail."
    screen.say_verdict(console, words, good=not failed)
    if failed:
        console.print(_failures(audits))
        points = [f"{found.case.name}: {line}" for found in audits for line in worst_points(found)]
        screen.say_lines(console, points, FAILED, all=full)
    console.print(_counts(audits))
    console.print(
        "Margins are positive where the premise holds; over the declared operating region and "
        "along the run.",
        style="dim",
    )
    screen.say_files(console, file)
    for found in audits if full else ():
        console.print(audit_table(found))
    return screen.DONE


def _failures(audits: Sequence[Audit]) -> Table:
    """The premises that fail, a line each, the largest shortfall first."""
    rows = []
    for audit in audits:
        for premise in audit.failed():
            readings = [each for each in (premise.region, premise.along) if each is not None]
            worst = min(readings, key=lambda each: each.margin)
            unit = "" if premise.unit == "1" else f" {premise.unit}"
            shares = [f"{100 * each.violated:.0f} %" for each in readings]
            margin = f"{worst.margin:.3g}{unit}"
            cells = (audit.case.name, premise.name, margin, ", ".join(shares), premise.restores)
            rows.append((worst.margin, cells))
    rows.sort(key=lambda row: row[0])
    columns = ("case", "FAILS", "least margin", "violated", "restored by")
    return screen.brief_table("", columns, [cells for _, cells in rows], words=5)


def _counts(audits: Sequence[Audit]) -> Table:
    """How many premises hold in each case."""
    rows = []
    for audit in audits:
        holding = len(audit.premises) - len(audit.failed())
        rows.append((audit.case.name, audit.case.title, f"{holding} of {len(audit.premises)}"))
    return screen.brief_table("", ("case", "", "premises that hold"), rows, words=2)
