"""Matrix of laws, steps and conditions: the form of the answers of ladder and tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.ground.wording import spelled
from grosmc_mj.output.charts.chart import in_lines
from grosmc_mj.output.charts.of_results import cells_chart
from grosmc_mj.output.results.result import CellChart
from grosmc_mj.output.results.tables import Table, numbers, table, words
from grosmc_mj.output.results.verdicts import Verdict, by_law
from grosmc_mj.studies.target import Condition, StudiedLaw

# Value of a verdict in a chart of cells.
_VALUES = {"kept": -1.0, "partly": 0.0, "failed": 1.0}
# Last words of the names of requirements, which a cell has no room for.
_ENDINGS = (" within", " below")
# Letters in a line of a cell.
_LETTERS = 11
NOTE = (
    "Green: all requirements are kept. Orange: the named requirement is not. Yellow: kept in some "
    "draws of what is random, so many of so many. ?: an assumed number, at half or at twice its "
    "value, turns the verdict."
)


def verdict_table(
    title: str,
    rows: Iterable[Verdict],
    headings: Mapping[str, str],
    *,
    legend: str = "",
    beside: Mapping[str, Mapping[str, str]] | None = None,
    text: Callable[[Verdict], str] = lambda row: row.cell,
) -> Table:
    """Return a table of laws by steps.

    Args:
        title: Title of the table.
        rows: The verdicts, at most one of a law and a step.
        headings: Headings of the columns, by step.
        legend: Legend of the table.
        beside: Columns beside the names of the laws: words by law, by heading.
        text: Returns the text of a verdict.
    """
    beside = beside or {}
    cells = []
    for law, of_law in by_law(rows).items():
        texts = {row.step: text(row) for row in of_law}
        about = [words_of[law] for words_of in beside.values()]
        cells.append([law, *about, *(texts.get(step, "") for step in headings)])
    columns = [*words("law", *beside), *numbers(*headings.values())]
    return table(title, columns, cells, legend=legend)


def verdict_chart(
    title: str, rows: Iterable[Verdict], headings: Mapping[str, str], *, climbing: bool
) -> CellChart:
    """Return a chart of laws by steps: one colour for kept, one for failed, one for some draws.

    Args:
        title: Title of the chart.
        rows: The verdicts, at most one of a law and a step.
        headings: Headings of the columns, by step.
        climbing: Whether each step has all those before it, so that a requirement is named where
            it first breaks alone.
    """
    placed: dict[tuple[str, str], tuple[float, str, str]] = {}
    for law, of_law in by_law(rows).items():
        by_step = {row.step: row for row in of_law}
        named = ""
        for step, heading in headings.items():
            row = by_step.get(step)
            if row is None or not row.state:
                continue

            labels = []
            if row.broken and not (climbing and row.broken == named):
                labels.append(_short_name(row.broken))
                named = row.broken
            labels.append(_marks(row))
            placed[law, heading] = (
                _VALUES[row.state],
                "\n".join(filter(None, labels)),
                _explanation(row),
            )
    return CellChart.of(title, placed, 1.0)


def _marks(row: Verdict) -> str:
    """Draws that keep all, and marks: a cell's colour does not show them."""
    draws = f"{row.kept_draws} of {row.draws}" if row.partly else ""
    return " ".join(filter(None, (draws, row.marks)))


def _explanation(row: Verdict) -> str:
    """The words of a verdict, and what turns it."""
    if not row.turned_by:
        return row.words
    return f"{row.words}; turned by {', '.join(row.turned_by)}"


def charts_by_condition(
    conditions: Iterable[Condition],
    rows: Sequence[Verdict],
    headings: Mapping[str, str],
    *,
    climbing: bool,
) -> dict[str, CellChart]:
    """Return the chart of each condition that has rows, see ``verdict_chart``."""
    charts = {}
    for condition in conditions:
        under_it = [row for row in rows if row.condition == condition.name]
        if under_it:
            title = f"{condition.name}: {condition.title}"
            charts[condition.name] = verdict_chart(title, under_it, headings, climbing=climbing)
    return charts


def write_charts(
    path: Path, title: str, charts: Mapping[str, CellChart], note: str
) -> tuple[Path, ...]:
    """Draw the chart of each condition in a figure of its own, and return the paths.

    Args:
        path: Path of the result: the figure of the first condition has its name.
        title: Title of the figures.
        charts: The charts, by condition.
        note: Text below each.

    Raises:
        SetupError: If a file cannot be written.
    """
    # Imported here: a result without figures needs no matplotlib.
    from grosmc_mj.output.charts.figure import write_chart

    figures = []
    for condition, chart in charts.items():
        figure = path.with_suffix(".png")
        if figures:
            figure = path.with_name(f"{path.stem}_{condition.replace(' ', '_')}.png")
        figures.append(write_chart(cells_chart(title, [chart], note), figure))
    return tuple(figures)


def _short_name(requirement: str) -> str:
    """Return the name of a requirement for a cell: settles, final error, input; in short lines."""
    name = spelled(requirement).removeprefix("the ")
    for ending in _ENDINGS:
        name = name.removesuffix(ending)
    return in_lines(name, _LETTERS)


def conditions_document(conditions: Iterable[Condition]) -> list[dict[str, str]]:
    """Return the conditions of a study as plain values."""
    return [{"name": condition.name, "title": condition.title} for condition in conditions]


def law_document(law: StudiedLaw) -> dict[str, Any]:
    """Return a law of a study as plain values."""
    return {"name": law.name, "predicts": law.predict, "sampled": law.sampled}
