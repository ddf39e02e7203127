"""The tables of tolerances in ``docs/as_built.md``, from what the study has written."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from grosmc_mj.results.tables import markdown_table, numbers, words
from grosmc_mj.studies.tolerance.answers import (
    by_weakness,
    cell_text,
    disagreements,
    heading,
    least,
    stands_ideally,
    weakness,
)
from grosmc_mj.studies.tolerance.document import tolerances_in


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """A heading and a table for each document, in Markdown."""
    return "\n\n".join(_table(document) for document in documents)


def _table(document: Mapping[str, Any]) -> str:
    """Laws by imperfections: the least over the conditions that a law keeps ideally."""
    rows = tolerances_in(document)
    found = {(row.law, row.imperfection): row for row in least(rows)}
    columns = by_weakness(list(found.values()))
    conditions = {
        law: [c["name"] for c in document["conditions"] if stands_ideally(rows, law, c["name"])]
        for law in dict.fromkeys(law for law, _ in found)
    }

    def strength(law: str) -> tuple[int, float]:
        whole = (weakness(row) for (of, each), row in found.items() if of == law and each.whole)
        return len(conditions[law]), next(whole, 0.0)

    cells = []
    for law in sorted(conditions, key=strength, reverse=True):
        own = (found.get((law, each)) for each in columns)
        told = ["" if row is None else cell_text(row) for row in own]
        cells.append([law, ", ".join(conditions[law]), *told])
    lines = markdown_table(
        [*words("law", "keeps ideally"), *numbers(*map(heading, columns))], cells
    )
    asked, differ = disagreements(rows)
    title = f"**{document['configuration']['target']}**"
    said = f"MuJoCo was asked about {asked} of the answers, and differs on {differ}."
    return "\n".join([title, "", *lines, "", said])
