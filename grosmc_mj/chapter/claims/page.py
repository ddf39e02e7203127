"""The page on what the chapter says, generated from the claims."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import jinja2

from grosmc_mj.chapter.claims.claim import Finding
from grosmc_mj.chapter.claims.picture import write_picture
from grosmc_mj.chapter.claims.story import (
    claim_tables,
    claims_tables,
    facts,
    is_told,
    turning_table,
)
from grosmc_mj.chapter.claims.sweep import stored_sweeps
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.files import written_aside
from grosmc_mj.results.tables import Table, table, words

_HOME = Path(__file__)


def write_page(findings: Sequence[Finding], lab: Laboratory, path: Path) -> list[Path]:
    """Write the page and, in a folder beside it, the figure of each defect and refuted claim.

    Returns:
        The page and its figures.

    Raises:
        SetupError: If a file cannot be written.
    """
    stories = [finding for finding in findings if is_told(finding)]
    figures = [
        write_picture(finding, lab, path.parent / "figures" / f"{finding.claim.id}.png")
        for finding in stories
    ]
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    tables = claims_tables(findings)
    page = environment.from_string(_HOME.with_suffix(".md").read_text(encoding="utf-8")).render(
        T=f"{1e3 * lab.settings.control_period:g}",
        brief=tables[:2],
        tables=tables[2:],
        stories=stories,
        facts=facts,
        claim_tables=claim_tables,
        appendix=[turning_table(stored_sweeps()), slips_table()],
    )
    names = "|".join(re.escape(finding.claim.id) for finding in stories)
    if names:
        page = re.sub(rf"(?<=[ |])({names})(?=[,:;]? )", r"[\1](#\1)", page)
    with written_aside(path) as part:
        part.write_text(page.rstrip() + "\n", encoding="utf-8")
    return [path, *figures]


def slips_table() -> Table:
    """Slips of the pen in the chapter, in its order."""
    rows = tomllib.loads(_HOME.with_name("slips.toml").read_text(encoding="utf-8"))["slip"]
    legend = (
        "The meaning is plain and no result depends on it. Statements that are judged are not here."
    )
    return table("Slips", words(*rows[0]), [list(row.values()) for row in rows], legend=legend)
