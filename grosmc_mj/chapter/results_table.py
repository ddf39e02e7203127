"""The table of results in a page, written from a validation.json.

``python -m grosmc_mj.chapter.results_table PAGE.md validation.json`` is what ``make results`` runs.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from grosmc_mj.errors import SetupError
from grosmc_mj.experiments.metrics.recorded import Metric, cost_shares
from grosmc_mj.report.markdown import markdown_table
from grosmc_mj.report.marked import replace_marked
from grosmc_mj.report.tables import number, numbers, words

BEGIN, END = "<!-- results -->", "<!-- /results -->"
_COLUMNS = (
    ("max |x1 − x1\\*|", "deviation"),
    ("settled", "settling_time"),
    ("max |s|", "max_sliding"),
    ("J(u_c) / J\\*", "continuous"),
    ("J(u_d) / J\\* per s", "rest"),
    ("max |u|", "max_input"),
    ("cart travel", "cart_travel"),
)


def results_table(document: dict[str, Any]) -> str:
    """The table, in Markdown, of the runs on physics in a validation.json."""
    columns = [*words("system", "case", "law"), *numbers(*(title for title, _ in _COLUMNS))]
    rows = []
    for run in document["runs"]:
        if run["plant"] != "physics":
            continue
        metrics = {name: Metric(**each) for name, each in run["metrics"].items()}
        shares = cost_shares(metrics, run["valid_until"]["value"])
        metrics |= dict(zip(("continuous", "rest"), shares, strict=True))
        cells = [_cell(metrics.get(name)) for _, name in _COLUMNS]
        rows.append([run["system"], run["case"], run["controller"], *cells])
    return "\n".join(markdown_table(columns, rows))


def _cell(metric: Metric | None) -> str:
    """A value with its unit."""
    if metric is None or metric.value is None:
        return "not reached" if metric is not None and metric.note == "not reached" else ""
    return number(metric.value) + ("" if metric.unit in ("1", "1/s") else f" {metric.unit}")


def write_table(readme: Path, results: Path) -> None:
    """Put the table between the README's marks.

    Raises:
        SetupError: If a file or a mark is missing.
    """
    for path in (readme, results):
        if not path.is_file():
            raise SetupError(f"{path} is missing: run make validate in the checkout first")
    document = json.loads(results.read_text(encoding="utf-8"))
    replace_marked(readme, BEGIN, END, lambda: results_table(document))


if __name__ == "__main__":
    try:
        write_table(*map(Path, sys.argv[1:3]))
    except (SetupError, TypeError) as error:
        sys.exit(f"PAGE.md and validation.json: {error}")
