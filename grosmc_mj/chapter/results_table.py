"""The table of results in a page, from a validation.json."""

from __future__ import annotations

from typing import Any

from grosmc_mj.experiments.metrics.recorded import Metric, cost_shares
from grosmc_mj.results.tables import markdown_table, number, numbers, words

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
