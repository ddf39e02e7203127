"""Matrix of laws, steps and conditions: the form of the answers of ladder and tolerance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from grosmc_mj.output.charts.charts import write_cells
from grosmc_mj.output.charts.figure import in_lines
from grosmc_mj.output.results.result import CellChart
from grosmc_mj.output.results.tables import Table, numbers, table, words
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


class Cell(NamedTuple):
    """Verdict on a law at a step under a condition.

    Attributes:
        law: Name of the law.
        step: Name of the step, such as a rung or an imperfection.
        condition: Name of the condition.
        verdict: Whether all requirements are kept, in all draws or some; empty for no such run.
        text: Its number, for a table.
        broken: The requirement that breaks; empty if none does.
        mark: What its colour cannot say: draws, or a question mark.
        words: Explanation.
    """

    law: str
    step: str
    condition: str
    verdict: Literal["kept", "partly", "failed", ""]
    text: str
    broken: str = ""
    mark: str = ""
    words: str = ""


def verdict_table(
    title: str,
    cells: Iterable[Cell],
    headings: Mapping[str, str],
    legend: str = "",
    beside: Mapping[str, Mapping[str, str]] | None = None,
) -> Table:
    """Return a table of laws by steps, with the number of each cell.

    Args:
        title: Title of the table.
        cells: The cells, at most one of a law and a step.
        headings: Headings of the columns, by step.
        legend: Legend of the table.
        beside: Columns beside the names of the laws: words by law, by heading.
    """
    beside = beside or {}
    texts: dict[str, dict[str, str]] = {}
    for cell in cells:
        texts.setdefault(cell.law, {})[cell.step] = cell.text

    rows = []
    for law, of_law in texts.items():
        about = [words_of[law] for words_of in beside.values()]
        rows.append([law, *about, *(of_law.get(step, "") for step in headings)])
    columns = [*words("law", *beside), *numbers(*headings.values())]
    return table(title, columns, rows, legend=legend)


def verdict_chart(
    title: str, cells: Sequence[Cell], headings: Mapping[str, str], *, climbing: bool
) -> CellChart:
    """Return a chart of laws by steps: one colour for kept, one for failed, one for some draws.

    Args:
        title: Title of the chart.
        cells: The cells, at most one of a law and a step.
        headings: Headings of the columns, by step.
        climbing: Whether each step has all those before it, so that a requirement is named where
            it first breaks alone.
    """
    by_place = {(cell.law, cell.step): cell for cell in cells}
    placed: dict[tuple[str, str], tuple[float, str, str]] = {}
    for law in dict.fromkeys(cell.law for cell in cells):
        named = ""
        for step, heading in headings.items():
            cell = by_place.get((law, step))
            if cell is None or not cell.verdict:
                continue

            labels = []
            if cell.broken and not (climbing and cell.broken == named):
                labels.append(_short_name(cell.broken))
                named = cell.broken
            if cell.mark:
                labels.append(cell.mark)
            placed[law, heading] = (_VALUES[cell.verdict], "\n".join(labels), cell.words)
    return CellChart.of(title, placed, 1.0)


def charts_by_condition(
    conditions: Iterable[Condition],
    cells: Iterable[Cell],
    headings: Mapping[str, str],
    *,
    climbing: bool,
) -> dict[str, CellChart]:
    """Return the chart of each condition that has cells, see ``verdict_chart``."""
    cells_under: dict[str, list[Cell]] = {}
    for cell in cells:
        cells_under.setdefault(cell.condition, []).append(cell)

    charts = {}
    for condition in conditions:
        if condition.name in cells_under:
            title = f"{condition.name}: {condition.title}"
            chart = verdict_chart(title, cells_under[condition.name], headings, climbing=climbing)
            charts[condition.name] = chart
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
    figures = []
    for condition, chart in charts.items():
        figure = path.with_suffix(".png")
        if figures:
            figure = path.with_name(f"{path.stem}_{condition.replace(' ', '_')}.png")
        figures.append(write_cells(figure, title, [chart], note))
    return tuple(figures)


def _short_name(requirement: str) -> str:
    """Return the name of a requirement for a cell: settles, final error, input; in short lines."""
    name = requirement.replace("_", " ").removeprefix("the ")
    for ending in _ENDINGS:
        name = name.removesuffix(ending)
    return in_lines(name, _LETTERS)


def conditions_document(conditions: Iterable[Condition]) -> list[dict[str, str]]:
    """Return the conditions of a study as plain values."""
    return [{"name": condition.name, "title": condition.title} for condition in conditions]


def law_document(law: StudiedLaw) -> dict[str, Any]:
    """Return a law of a study as plain values."""
    return {"name": law.name, "predicts": law.predict, "sampled": law.sampled}
