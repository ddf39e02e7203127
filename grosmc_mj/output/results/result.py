"""Form of every result: its answers, its tables and charts, and its comparable values.

Terminal, JSON, page and ``diff`` show these fields; a command's own numbers stand beside them, for
programs, so that none of the four depends on a study.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from grosmc_mj.ground.errors import first_names
from grosmc_mj.output.results.document import origin
from grosmc_mj.output.results.tables import Table

# Version of this form.
SCHEMA = 2
# Letters that steer a terminal, or turn the direction of writing.
_STEERING = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def _harmless(text: str) -> str:
    """Write letters that steer a terminal as escapes: a result may come from somebody else."""
    return _STEERING.sub(lambda match: repr(match[0])[1:-1], text)


Text = Annotated[str, Field(max_length=20_000), AfterValidator(_harmless)]
# A number; null where JSON has none, for infinities and NaN.
Number = float | None

# Largest number of names of what is not finished in a headline.
_MOST_MISSING = 8

# Verdicts of answers, the worst first.
NOT_KEPT = "not kept"
OPEN = "not decided"
MEASURED = "measured"
KEPT = "kept"
VERDICTS = (NOT_KEPT, OPEN, MEASURED, KEPT)


def finite(value: float | None) -> Number:
    """Return a finite number; None for infinities and NaN, which JSON does not have."""
    if value is None or not math.isfinite(value):
        return None
    return value


class Part(BaseModel):
    """Part of a result; its numbers are finite, and a text is not read as a number."""

    model_config = ConfigDict(allow_inf_nan=False, frozen=True, strict=True)


class Answer(Part):
    """Answer to a question.

    Attributes:
        question: The question, such as ``Run of servo/case1``.
        verdict: One of ``VERDICTS``.
        words: The answer.
        more: Next sentence, such as the requirement that is nearest to its limit.
        standard: What the verdict compares with, where it is no requirement: ``expected`` or
            ``recorded``.
        faults: Faults that were found, a line each: runs that ended early, premises that fail,
            results that differ.
        notes: Notes beside the verdict, a line each: ideals of the model, loads that do nothing or
            that no input matches, requirements that cannot fail.
    """

    question: Text
    verdict: Literal["not kept", "not decided", "measured", "kept"]
    words: Text
    more: Text = ""
    standard: Literal["", "expected", "recorded"] = ""
    faults: Sequence[Text] = ()
    notes: Sequence[Text] = ()

    @property
    def verdict_words(self) -> str:
        """The verdict for people: a refuted claim that is expected so is ``as expected``."""
        if self.standard and self.verdict == KEPT:
            return f"as {self.standard}"
        if self.standard and self.verdict == NOT_KEPT:
            return f"not as {self.standard}"
        return self.verdict

    @property
    def good(self) -> bool:
        """True if it is kept, or measured where nothing is required."""
        return self.verdict in (KEPT, MEASURED)


class Standing(Part):
    """Where a law stands in a case: where it breaks, if it does.

    Attributes:
        case: The case, SYSTEM/CASE.
        law: Name of the law.
        breaks_at: First rung, plant or imperfection that it fails on; empty if it fails nowhere.
        requirement: Requirement that decides, as the curves of the case name it; empty for none.
        words: Deciding requirement with its number, or how far the law goes.
        share: Measured over allowed value of that requirement; None without a measurement.
        complete: False if an interrupted study may still find a failure.
        required: True if a requirement decides; else the run is compared with the record.
    """

    case: Text
    law: Text
    breaks_at: Text = ""
    requirement: Text = ""
    words: Text = ""
    share: Number = None
    complete: bool = True
    required: bool = True


class Value(Part):
    """Number or word that two results are compared by.

    Attributes:
        name: Name of the quantity, the same in every result.
        value: A number, a verdict, or None.
        unit: Unit of a number.
        better: 1 if more is better, -1 if less is better, else 0; ``diff`` orders verdicts itself.
        relative: Tolerance between machines as a share of ``size``; 0.1 for what switching
            amplifies.
        absolute: Tolerance between machines in the unit of the value.
        size: Number that ``relative`` is a share of; None for the value itself.
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
        name: Name in the legend.
        x: Numbers or words.
        y: Numbers; None where there is none.
        texts: Text of each point; empty for none.
        good: Whether the requirement holds at each point; empty if nothing is required.
        joined: Whether a line joins the points.
        bound: Whether it is a bound of the others: dashed, in the colour of the text.
    """

    name: Text
    x: Sequence[float | Text]
    y: Sequence[Number]
    texts: Sequence[Text] = ()
    good: Sequence[bool | None] = ()
    joined: bool = True
    bound: bool = False


class LineChart(Part):
    """One quantity over another; an axis whose numbers are far apart is logarithmic.

    Attributes:
        name: Title of the chart.
        titles: Titles of the two axes.
        lines: The curves.
        limit: Value of a line along the first axis; None for none.
        marks: Values of lines along the second axis.
        points: Points that are marked.
        equal: Whether both axes have one scale.
    """

    form: Literal["lines"] = "lines"
    name: Text
    titles: tuple[Text, Text]
    lines: Sequence[Series]
    limit: Number = None
    marks: Sequence[float] = ()
    points: Sequence[tuple[float, float]] = ()
    equal: bool = False


class CellChart(Part):
    """Coloured cells: one colour below zero and another one above it.

    Attributes:
        name: Title of the chart.
        rows: Names of the rows.
        columns: Names of the columns.
        values: Value of each cell; None for no cell.
        texts: Text in each cell.
        whys: Explanation of each cell.
        most: Value of the end of the colour scale, to both sides.
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
        cls,
        name: str,
        cells: Mapping[tuple[str, str], tuple[float, str, str]],
        most: float,
    ) -> CellChart:
        """Return the chart of cells that are given by row and column.

        Args:
            name: Title of the chart.
            cells: Value, text and explanation of each cell; rows and columns in their order.
            most: Value of the end of the colour scale, to both sides.
        """
        rows = list(dict.fromkeys(row for row, _ in cells))
        columns = list(dict.fromkeys(column for _, column in cells))

        values, texts, whys = [], [], []
        for row in rows:
            entries = [cells.get((row, column), (None, None, None)) for column in columns]
            values.append([value for value, _, _ in entries])
            texts.append([text for _, text, _ in entries])
            whys.append([why for _, _, why in entries])

        return cls(
            name=name,
            rows=rows,
            columns=columns,
            values=values,
            texts=texts,
            whys=whys,
            most=most,
        )


class Letter(Part):
    """Letter of a grid, with its name in the legend and its colour #RRGGBB."""

    letter: Text
    name: Text
    colour: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class GridChart(Part):
    """A letter for each cell of a plane.

    Attributes:
        name: Title of the chart.
        axes: Title of each axis, and its limit to both sides.
        grid: A string for each value of the second axis, from the lowest.
        legend: The letters.
    """

    form: Literal["grid"] = "grid"
    name: Text
    axes: tuple[tuple[Text, float], tuple[Text, float]]
    grid: Sequence[Text]
    legend: Sequence[Letter]


ResultChart = Annotated[LineChart | CellChart | GridChart, Field(discriminator="form")]


class ReportTable(Part):
    """A table and the charts of it.

    Attributes:
        table: The table.
        charts: Charts to choose from; empty for none.
        brief: Whether the table belongs to a brief answer on the terminal.
    """

    table: Table
    charts: Sequence[ResultChart] = ()
    brief: bool = False


def report_tables(tables: Iterable[Table], brief: int) -> list[ReportTable]:
    """Return the tables that have rows, without charts; the first ones are for a brief answer."""
    parts = [ReportTable(table=table) for table in tables if table.rows]
    return [part.model_copy(update={"brief": index < brief}) for index, part in enumerate(parts)]


class Provenance(Part):
    """Kind and origin of a document.

    Attributes:
        kind: Kind of document: ``curves``, ``film``, or that of a result such as ``ladder``.
        versions: Versions of the packages that its numbers depend on.
        git_revision: Revision of the checkout.
        machine: System, processor and cores of the machine.
        command: Command that made it.
        seed: Seed of the random numbers; None if there are none.
        configuration: Configuration with all defaults.
    """

    kind: Text
    versions: dict[str, Text] = {}
    git_revision: Text | None = None
    machine: Text | None = None
    command: Text | None = None
    seed: int | None = None
    configuration: Any = None


class Result(Provenance):
    """Result of a command that judges or measures.

    Its further fields are numbers for programs; the page and ``diff`` do not read them.

    Attributes:
        complete: False if an interruption left out a part.
        answers: Answers on the first screen.
        standings: Where each law stands in its case.
        sheets: Tables and charts.
        remarks: How the answers were obtained, a line each: the loop, assumed numbers, the share
            of runs that MuJoCo confirmed.
        values: Values that ``diff`` compares.
    """

    model_config = ConfigDict(extra="allow")

    schema_version: Literal[2]
    complete: bool = True
    answers: Sequence[Answer] = ()
    standings: Sequence[Standing] = ()
    sheets: Sequence[ReportTable] = ()
    remarks: Sequence[Text] = ()
    values: Sequence[Value] = ()

    @property
    def kept(self) -> bool:
        """True if every answer is good."""
        return all(answer.good for answer in self.answers)

    def unfinished(self, missing: Sequence[str]) -> Result:
        """Return the result of a part of the work: open, but for what is not kept already.

        Args:
            missing: Names of what is not finished, with which the first answer begins.
        """
        answers = []
        for answer in self.answers:
            verdict = NOT_KEPT if answer.verdict == NOT_KEPT else OPEN
            words = answer.words
            if missing and not answers:
                words = f"Not finished: {first_names(missing, _MOST_MISSING)}; so far: {words}"
            answers.append(answer.model_copy(update={"verdict": verdict, "words": words}))
        return self.model_copy(update={"complete": False, "answers": answers})


def result(
    kind: str,
    configuration: Any,
    *,
    seed: int | None = None,
    complete: bool = True,
    answers: Iterable[Answer] = (),
    standings: Iterable[Standing] = (),
    sheets: Iterable[ReportTable] = (),
    remarks: Iterable[str] = (),
    values: Iterable[Value] = (),
    **numbers: Any,
) -> Result:
    """Return a result of this checkout, machine and command.

    Args:
        kind: Kind of result.
        configuration: Configuration with all defaults.
        seed: Seed of the random numbers; None if there are none.
        complete: False if an interruption left out a part.
        answers: Answers on the first screen.
        standings: Where each law stands in its case.
        sheets: Tables and charts.
        remarks: How the answers were obtained, a line each.
        values: Values that ``diff`` compares.
        numbers: Further fields for programs, plain values.
    """
    return Result(
        kind=kind,
        **origin(seed, SCHEMA),
        configuration=configuration,
        complete=complete,
        answers=list(answers),
        standings=list(standings),
        sheets=list(sheets),
        remarks=list(remarks),
        values=list(values),
        **numbers,
    )
