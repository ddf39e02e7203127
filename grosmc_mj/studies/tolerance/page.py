"""The tables of tolerances in ``docs/as_built.md``, from what the study has written.

``python -m grosmc_mj.studies.tolerance.page docs/as_built.md FILE.json ...`` is the end of
``make as-built``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.errors import GrosmcError
from grosmc_mj.report.marked import replace_marked
from grosmc_mj.report.tables import number

BEGIN, END = "<!-- tolerances -->", "<!-- /tolerances -->"
# Amounts of a loop are small: these have prefixes, the largest that leaves a number above one.
_PREFIXED = ("s", "rad", "m")


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """A heading and a table for each document, in Markdown."""
    return "\n\n".join(_table(document) for document in documents)


def _table(document: Mapping[str, Any]) -> str:
    """Laws by imperfections: the least over the conditions that a law keeps ideally."""
    found: dict[tuple[str, str], Mapping[str, Any]] = {}
    rows: Sequence[Mapping[str, Any]] = document["tolerances"]
    ideally = {
        (row["law"], row["condition"]) for row in rows if row["kept_ideally"] and _graded(row)
    }
    for row in rows:
        if (row["law"], row["condition"]) not in ideally or row["impossible"]:
            continue
        key = row["law"], row["imperfection"]
        found[key] = min(found.get(key, row), row, key=_factor)
    laws = list(dict.fromkeys(law for law, _ in found))
    columns = list(dict.fromkeys(name for _, name in found))
    columns.sort(key=lambda name: min(_factor(found[law, name]) for law in laws))
    conditions = {law: [c["name"] for c in document["conditions"] if (law, c["name"]) in ideally]
                  for law in laws}  # fmt: skip
    laws.sort(key=lambda law: (-len(conditions[law]), -_factor(found[law, "all"])))
    lines = [
        f"**{document['configuration']['target']}**",
        "",
        "| law | keeps ideally | " + " | ".join(columns) + " |",
        "|---|---|" + "---:|" * len(columns),
    ]
    for law in laws:
        cells = [law, ", ".join(conditions[law]), *(_cell(found[law, name]) for name in columns)]
        lines.append("| " + " | ".join(cells) + " |")
    asked, differ = (document["physics"][key] for key in ("answers_checked", "answers_that_differ"))
    lines += ["", f"MuJoCo was asked about {asked} of the answers, and differs on {differ}."]
    return "\n".join(lines)


def _graded(row: Mapping[str, Any]) -> bool:
    """Whether it has an amount, and is not there or not."""
    return row["imperfection"] != "estimated rates"


def _factor(row: Mapping[str, Any]) -> float:
    """The largest factor up to which all is kept."""
    kept = row["largest_kept"]
    return kept["factor"] if row["kept_ideally"] and kept else 0.0


def _cell(row: Mapping[str, Any]) -> str:
    """The amount of the first part with its unit, or the factor of all."""
    if not _graded(row):
        return "yes" if row["kept_ideally"] and row["smallest_failed"] is None else "no"
    kept = row["largest_kept"]
    if not row["kept_ideally"] or kept is None:
        return "no"
    part = kept["parts"][0]
    value, unit = kept["shown"], part["unit"]
    if row["imperfection"] == "all":
        value, unit = kept["factor"], "x"
    elif unit in _PREFIXED:
        power = 1 if value * 1e3 >= 1 or not value else 2
        value, unit = value * 1000**power, "mµ"[power - 1] + unit
    elif not unit:
        value, unit = 100 * value, "%"
    limits = "limit" in part["quantity"] and row["imperfection"] != "all"
    sign = "" if row["smallest_failed"] else "≤ " if limits else "≥ "
    return f"{sign}{number(value)} {unit}{'*' if row['kept_again'] else ''}"


if __name__ == "__main__":
    try:
        page, *files = map(Path, sys.argv[1:])
        replace_marked(
            page, BEGIN, END, lambda: tolerances_text(json.loads(f.read_text()) for f in files)
        )
    except (GrosmcError, OSError, ValueError, KeyError) as error:
        sys.exit(f"PAGE.md FILE.json ...: {error}")
