"""One form for every result: what it answers, its tables and charts, and its comparable values.

A command writes its own numbers beside these fields, for programs. The page and ``diff`` read
nothing but what stands here, so that neither knows any study.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from grosmc_mj.results.document import origin
from grosmc_mj.results.tables import Table

SCHEMA = 2
Text = Annotated[str, Field(max_length=20_000)]
# A value that JSON has no number for is null.
Number = float | None

# Verdicts of answers, the worst first.
NOT_KEPT, OPEN, MEASURED, KEPT = "not kept", "not decided", "measured", "kept"
VERDICTS = (NOT_KEPT, OPEN, MEASURED, KEPT)


def finite(value: float | None) -> Number:
    """The value, or None for one that JSON has no number for."""
    return value if value is not None and math.isfinite(value) else None


class Part(BaseModel):
    """Part of a result; numbers are finite, and a text is no number."""

    model_config = ConfigDict(allow_inf_nan=False, frozen=True, strict=True)


class Answer(Part):
    """The answer to a question.

    Attributes:
        question: Such as ``Run of servo/case1``.
        verdict: One of ``VERDICTS``.
        words: The answer.
        more: The next sentence, such as the requirement that is nearest to its limit.
    """

    question: Text
    verdict: Literal["not kept", "not decided", "measured", "kept"]
    words: Text
    more: Text = ""


class Standing(Part):
    """How a law stands in a case; of a run for every law, whether it keeps everything or not.

    Attributes:
        case: SYSTEM/CASE.
        law: Its name.
        breaks_at: Where it breaks first: rung, plant or imperfection; empty if it stands.
        words: The number that decides with its limit, or how far it stands.
        complete: Whether nothing was interrupted that may break it still.
        required: Whether it stands by a requirement; else its run is compared with the record.
    """

    case: Text
    law: Text
    breaks_at: Text = ""
    words: Text = ""
    complete: bool = True
    required: bool = True


class Value(Part):
    """One number or word that two results can be compared by.

    Attributes:
        name: Of the quantity, the same in every result.
        value: A number, a verdict, or None for none.
        unit: Of a number.
        better: 1 if more is better, -1 if less is, else 0; of verdicts ``diff`` knows it.
        relative: How closely it repeats on another machine, as a share of ``size``; 0.1 of what
            switching amplifies.
        absolute: The same in its unit.
        size: What ``relative`` is of; None for the value itself.
    """

    name: Text
    value: Number | Text = None
    unit: Text = ""
    better: Literal[-1, 0, 1] = 0
    relative: float = 1e-6
    absolute: float = 1e-9
    size: Number = None


class Series(Part):
    """Points of a chart.

    Attributes:
        name: In the legend.
        x: Numbers or words.
        y: None where there is none.
        texts: Of each point; empty for none.
        good: Whether what is required holds at each point; empty where nothing is.
        joined: Whether a line joins them.
    """

    name: Text
    x: Sequence[float | Text]
    y: Sequence[Number]
    texts: Sequence[Text] = ()
    good: Sequence[bool | None] = ()
    joined: bool = True


class LineChart(Part):
    """One quantity over another; an axis whose numbers are far apart is logarithmic.

    Attributes:
        name: Of the chart.
        titles: Of the axes.
        lines: The curves.
        limit: Dashed along the first axis.
        marks: Dotted along the second one.
    """

    form: Literal["lines"] = "lines"
    name: Text
    titles: tuple[Text, Text]
    lines: Sequence[Series]
    limit: Number = None
    marks: Sequence[float] = ()


class CellChart(Part):
    """Rows by columns: a cell is blue below zero and red above it, as far as ``most``.

    Attributes:
        name: Of the chart.
        rows: Names of the rows.
        columns: Names of the columns.
        values: Of each cell; None for no cell.
        texts: In the cells.
        whys: What more there is to say of each.
        most: Of the values.
    """

    form: Literal["cells"] = "cells"
    name: Text
    rows: Sequence[Text]
    columns: Sequence[Text]
    values: Sequence[Sequence[Number]]
    texts: Sequence[Sequence[Text | None]]
    whys: Sequence[Sequence[Text | None]]
    most: float

    @classmethod
    def of(
        cls, name: str, cells: Mapping[tuple[str, str], tuple[float, str, str]], most: float
    ) -> CellChart:
        """The chart of cells that are known by row and column: value, text and why."""
        rows, columns = (list(dict.fromkeys(key[i] for key in cells)) for i in (0, 1))

        def grid(part: int) -> list[list[Any]]:
            known = [[cells.get((row, x)) for x in columns] for row in rows]
            return [[None if cell is None else cell[part] for cell in line] for line in known]

        return cls(
            name=name, rows=rows, columns=columns, values=grid(0), texts=grid(1), whys=grid(2),
            most=most,
        )  # fmt: skip


class Letter(Part):
    """A letter of a grid, and its meaning."""

    letter: Text
    name: Text
    colour: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class GridChart(Part):
    """A letter for each cell of a plane.

    Attributes:
        name: Of the chart.
        axes: Title of each, and the end that it has to both sides.
        grid: A string for each value of the second axis, from the lowest.
        legend: Of the letters.
    """

    form: Literal["grid"] = "grid"
    name: Text
    axes: tuple[tuple[Text, float], tuple[Text, float]]
    grid: Sequence[Text]
    legend: Sequence[Letter]


Chart = Annotated[LineChart | CellChart | GridChart, Field(discriminator="form")]


class Sheet(Part):
    """A table and charts that belong together.

    Attributes:
        table: With its title and legend.
        charts: To choose from; none where the table says it all.
    """

    table: Table
    charts: Sequence[Chart] = ()


class Provenance(Part):
    """Where a result comes from.

    Attributes:
        versions: Of the packages that decide.
        git_revision: Of the checkout.
        machine: Its system, processor and cores.
        command: That made it.
        seed: Of what is random; None where nothing is.
        configuration: As resolved.
    """

    versions: dict[str, Text] = {}
    git_revision: Text | None = None
    machine: Text | None = None
    command: Text | None = None
    seed: int | None = None
    configuration: Any = None


class Result(Provenance):
    """What page and ``diff`` read of a result; its other fields are for programs.

    Attributes:
        kind: Of result, such as ``run`` or ``ladder``.
        complete: Whether it has all that was to be computed.
        answers: Of the page's first screen.
        standings: Where laws break.
        sheets: Tables and charts.
        values: What ``diff`` compares.
    """

    kind: Text
    schema_version: Literal[2]
    complete: bool = True
    answers: Sequence[Answer] = ()
    standings: Sequence[Standing] = ()
    sheets: Sequence[Sheet] = ()
    values: Sequence[Value] = ()


def result(
    kind: str,
    configuration: Any,
    *,
    seed: int | None = None,
    complete: bool = True,
    answers: Iterable[Answer] = (),
    standings: Iterable[Standing] = (),
    sheets: Iterable[Sheet] = (),
    values: Iterable[Value] = (),
    **numbers: Any,
) -> dict[str, Any]:
    """The content of a result's JSON file.

    Args:
        kind: Of result.
        configuration: As resolved.
        seed: Of what is random.
        complete: Whether it has all that was to be computed.
        answers: Of the page's first screen.
        standings: Where laws break.
        sheets: Tables and charts.
        values: What ``diff`` compares.
        numbers: The result's own fields, plain values.
    """
    shown = {"answers": answers, "standings": standings, "sheets": sheets, "values": values}
    return {
        "kind": kind,
        **origin(seed, SCHEMA),
        "complete": complete,
        "configuration": configuration,
        **numbers,
        **{name: [part.model_dump() for part in parts] for name, parts in shown.items()},
    }
