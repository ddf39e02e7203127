"""Tables of the documentation that are made from the documents of ladders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from grosmc_mj.output.results.result import ReportTable
from grosmc_mj.output.results.tables import Table, table, words
from grosmc_mj.output.results.verdicts import Verdict, first_failed
from grosmc_mj.studies.ladder.answer import CLAIMS
from grosmc_mj.studies.ladder.climb import climbs

# Ending of the name of a rival that is as quick as the actuator allows.
_QUICK = ", quick"
# Names of the laws in the order of the rows.
_LAWS = (
    "lqr",
    "lqi, quick",
    "fl-pid, quick",
    "adrc",
    "adrc, quick",
    "sign",
    "boundary-layer",
    "implicit",
    "implicit-estimate",
    "super-twisting",
    "grosmc adaptive",
)
# Those of the first page.
_FEW = ("lqr", "adrc", "sign", "implicit", "grosmc adaptive")
# Other name of a law where no rival has that one.
_ALONE = {"grosmc adaptive": "adaptive"}
# Laws that have tuned numbers under their name, which are as quick as they were tuned to be.
_NOT_TUNED = frozenset({"adrc, quick", "implicit-estimate"})
# Case of the laws with tuned numbers.
_TUNED_CASE = "tuned"
_SYSTEMS = {
    "servo": "servo",
    "cart_pendulum": "cart-pendulum",
    "arm": "arm",
    "two_link_arm": "two-link arm",
}


def few_failures_text(documents: Sequence[Mapping[str, Any]]) -> str:
    """Return the first rung on which five laws fail, on each machine, for the first page."""
    return _failures_text(documents, _FEW)


def failures_text(documents: Sequence[Mapping[str, Any]]) -> str:
    """Return the first rung on which each law fails, on each machine, for ``docs/ladder.md``."""
    return _failures_text(documents, _LAWS)


def _failures_text(documents: Sequence[Mapping[str, Any]], laws: Sequence[str]) -> str:
    """Table of the first rungs: a row a law, and a second one with its tuned numbers."""
    in_file: dict[str, Mapping[str, Any]] = {}
    tuned: dict[str, Mapping[str, Any]] = {}
    for document in documents:
        system, _, case = document["target"].partition("/")
        ladders = tuned if case == _TUNED_CASE else in_file
        ladders[system] = document

    systems = [system for system in _SYSTEMS if system in in_file or system in tuned]
    rows = []
    for law in laws:
        cells = [_first_failure(in_file.get(system), law) for system in systems]
        if any(cells):
            rows.append([law, *cells])
        if law in _NOT_TUNED:
            continue
        name = law.removesuffix(_QUICK)
        cells = [_first_failure(tuned.get(system), name) for system in systems]
        if any(cells):
            # Where no numbers were found there is no such case.
            rows.append([f"{name}, tuned", *(cell or "-" for cell in cells)])
    columns = words("law", *(_SYSTEMS[system] for system in systems))
    return "\n".join(table("", columns, rows).markdown())


def _first_failure(document: Mapping[str, Any] | None, law: str) -> str:
    """The first rung on which a law fails, with the draws that keep it; empty without the law."""
    if document is None:
        return ""
    rows = [Verdict.model_validate(row) for row in document["verdicts"]]
    climbed = climbs(rows, document["conditions"][0]["name"])
    rungs = climbed.get(law) or climbed.get(_ALONE.get(law, ""))
    if rungs is None:
        return ""

    failed = first_failed(rungs)
    if failed is None:
        return "kept?" if any(row.turned_by for row in rungs) else "kept"
    words_of_failure = failed.step
    if failed.partly:
        words_of_failure += f" ({failed.kept_draws} of {failed.draws})"
    return f"{words_of_failure}?" if failed.turned_by else words_of_failure


def ladders_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Return headings and tables of each document, for ``docs/ladder_tables.md``."""
    parts: list[str] = []
    for document in documents:
        sheets = [ReportTable.model_validate(sheet) for sheet in document["sheets"]]
        parts.append(f"**{document['target']}**: {document['title']}")
        parts += [_titled(sheet.table) for sheet in sheets if not sheet.brief]
        # A star would begin a list.
        parts += [f"\\{line}" for line in document["remarks"]]
        for sheet in sheets:
            if sheet.table.title == CLAIMS:
                parts += [_titled(sheet.table), sheet.table.legend]
    return "\n\n".join(parts)


def _titled(part: Table) -> str:
    return "\n".join([f"{part.title}:", "", *part.markdown()])
