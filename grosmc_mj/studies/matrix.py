"""Matrix of laws, steps and conditions: the form of the answers of ladder and tolerance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.result import CellChart
from grosmc_mj.results.tables import Table, numbers, table, words
from grosmc_mj.studies.studied import Condition, StudiedLaw

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


def chart_path(path: Path, condition: str, first: str) -> Path:
    """Return the path of the figure of a condition, beside the result.

    Args:
        path: Path of the result.
        condition: Name of the condition.
        first: Name of the first condition, whose figure has the name of the result.
    """
    if condition == first:
        return path.with_suffix(".png")
    return path.with_name(f"{path.stem}_{condition.replace(' ', '_')}.png")


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
    title: str, cells: Iterable[Cell], headings: Mapping[str, str], legend: str = ""
) -> Table:
    """Return a table of laws by steps, with the number of each cell.

    Args:
        title: Title of the table.
        cells: The cells, at most one of a law and a step.
        headings: Headings of the columns, by step.
        legend: Legend of the table.
    """
    texts: dict[str, dict[str, str]] = {}
    for cell in cells:
        texts.setdefault(cell.law, {})[cell.step] = cell.text

    rows = []
    for law, of_law in texts.items():
        rows.append([law, *(of_law.get(step, "") for step in headings)])
    columns = [*words("law"), *numbers(*headings.values())]
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
    placed: dict[tuple[str, str], tuple[float, str, str]] = {}
    named: dict[str, str] = {}
    for step, heading in headings.items():
        for cell in cells:
            if cell.step != step or not cell.verdict:
                continue
            labels = []
            if cell.broken and not (climbing and named.get(cell.law) == cell.broken):
                labels.append(short_name(cell.broken))
                named[cell.law] = cell.broken
            if cell.mark:
                labels.append(cell.mark)
            place = (cell.law, heading)
            placed[place] = (_VALUES[cell.verdict], "\n".join(labels), cell.words)

    # The rows of a chart are in the order of its cells.
    laws = list(dict.fromkeys(cell.law for cell in cells))
    columns = list(headings.values())
    in_order = sorted(
        placed.items(), key=lambda item: (laws.index(item[0][0]), columns.index(item[0][1]))
    )
    return CellChart.of(title, dict(in_order), 1.0)


def short_name(requirement: str) -> str:
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
