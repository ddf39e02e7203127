"""Tables of the documentation that are made from the documents of ladders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from grosmc_mj.output.results.result import ReportTable
from grosmc_mj.output.results.tables import Table, table, words
from grosmc_mj.output.results.verdicts import Verdict, first_failed
from grosmc_mj.studies.ladder.answer import CLAIMS
from grosmc_mj.studies.ladder.climb import climbs

# Of a rival on a machine.
_QUICK = ", as quick as the actuator allows"
# Laws for people, by the names that they have in the ladders: of the adaptive gain where a rival
# has its name, and elsewhere.
_LAWS: Mapping[str, Sequence[str]] = {
    "LQR": ("lqr",),
    f"LQI{_QUICK}": ("lqi, quick",),
    f"PID{_QUICK}": ("fl-pid, quick",),
    "ADRC": ("adrc",),
    f"ADRC{_QUICK}": ("adrc, quick",),
    "GROSMC, sign function": ("sign",),
    "GROSMC, boundary layer": ("boundary-layer",),
    "GROSMC, implicit": ("implicit",),
    "GROSMC, implicit with estimate": ("implicit-estimate",),
    "GROSMC, super-twisting": ("super-twisting",),
    "GROSMC, adaptive gain": ("grosmc adaptive", "adaptive"),
}
# Those of the first page.
_FEW = ("LQR", "ADRC", "GROSMC, sign function", "GROSMC, implicit", "GROSMC, adaptive gain")
# Laws with tuned numbers, which are as quick as they were tuned to be.
_TUNED: Mapping[str, Sequence[str]] = {
    "LQR": ("lqr",),
    f"LQI{_QUICK}": ("lqi",),
    f"PID{_QUICK}": ("fl-pid",),
    "ADRC": ("adrc",),
    "GROSMC, sign function": ("sign",),
    "GROSMC, boundary layer": ("boundary-layer",),
    "GROSMC, implicit": ("implicit",),
    "GROSMC, super-twisting": ("super-twisting",),
    "GROSMC, adaptive gain": ("grosmc adaptive", "adaptive"),
}
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
    return _failures_text(documents, list(_LAWS))


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
        cells = [_first_failure(in_file.get(system), _LAWS[law]) for system in systems]
        if any(cells):
            rows.append([law, *cells])
        cells = [_first_failure(tuned.get(system), _TUNED.get(law, ())) for system in systems]
        if any(cells):
            # Where no numbers were found there is no such case.
            rows.append([f"{law.removesuffix(_QUICK)}, tuned", *(cell or "-" for cell in cells)])
    columns = words("law", *(_SYSTEMS[system] for system in systems))
    return "\n".join(table("", columns, rows).markdown())


def _first_failure(document: Mapping[str, Any] | None, names: Sequence[str]) -> str:
    """The first rung on which a law fails, with the draws that keep it; empty without the law."""
    if document is None:
        return ""
    rows = [Verdict.model_validate(row) for row in document["verdicts"]]
    climbed = climbs(rows, document["conditions"][0]["name"])
    for name in names:
        if name not in climbed:
            continue
        rungs = climbed[name]
        failed = first_failed(rungs)
        if failed is None:
            return "kept?" if any(row.turned_by for row in rungs) else "kept"
        words_of_failure = failed.step
        if failed.partly:
            words_of_failure += f" ({failed.kept_draws} of {failed.draws})"
        return f"{words_of_failure}?" if failed.turned_by else words_of_failure
    return ""


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
