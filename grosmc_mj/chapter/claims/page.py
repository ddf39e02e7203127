"""The page about the claims, docs/claims.md, generated from the findings."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import jinja2

from grosmc_mj.chapter.claims.claim import ClaimFinding
from grosmc_mj.chapter.claims.picture import write_picture
from grosmc_mj.chapter.claims.story import (
    claim_tables,
    claims_tables,
    has_story,
    story_of,
    turning_table,
)
from grosmc_mj.chapter.claims.sweep import stored_sweeps
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.files import atomic_write
from grosmc_mj.output.results.tables import Table, table, words

_HOME = Path(__file__)


def write_page(findings: Sequence[ClaimFinding], lab: RunCache, path: Path) -> list[Path]:
    """Write the page and, in a folder beside it, the figure of each defect and refuted claim.

    Returns:
        The page and its figures.

    Raises:
        SetupError: If a file cannot be written.
    """
    stories = [finding for finding in findings if has_story(finding)]
    figures = []
    for finding in stories:
        figure = path.parent / "figures" / f"{finding.claim.id}.png"
        figures.append(write_picture(finding, lab, figure))

    page = _page_text(findings, stories, lab)
    with atomic_write(path) as part:
        part.write_text(page.rstrip() + "\n", encoding="utf-8")
    return [path, *figures]


def _page_text(
    findings: Sequence[ClaimFinding], stories: Sequence[ClaimFinding], lab: RunCache
) -> str:
    """The page in Markdown, with links from the claims' names to their stories."""
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(_HOME.with_suffix(".md").read_text(encoding="utf-8"))
    tables = claims_tables(findings)
    page = template.render(
        T=f"{1e3 * lab.settings.control_period:g}",
        brief=tables[:2],
        tables=tables[2:],
        stories=stories,
        facts=story_of,
        claim_tables=claim_tables,
        appendix=[turning_table(stored_sweeps()), slips_table()],
    )
    if not stories:
        return page

    # A name in a cell or a list, not one within a text or a path.
    names = "|".join(re.escape(finding.claim.id) for finding in stories)
    return re.sub(rf"(?<=[ |])({names})(?=[,:;]? )", r"[\1](#\1)", page)


def slips_table() -> Table:
    """Return the table of the slips of the pen in the chapter, in its order."""
    slips = tomllib.loads(_HOME.with_name("slips.toml").read_text(encoding="utf-8"))["slip"]
    return table(
        "Slips",
        words(*slips[0]),
        [list(slip.values()) for slip in slips],
        legend="The meaning is plain and no result depends on it. Statements that are judged are "
        "not here.",
    )
