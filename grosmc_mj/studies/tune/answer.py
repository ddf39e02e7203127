"""Answer of a tuning: words, tables, charts and document."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted, plural, spelled, titled
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    LineChart,
    ReportTable,
    Result,
    Series,
    finite,
    result,
)
from grosmc_mj.output.results.tables import Table, number, numbers, table, words
from grosmc_mj.output.results.verdicts import Verdict, standings, values_of, worst_failed, worst_of
from grosmc_mj.studies.matrix import conditions_document
from grosmc_mj.studies.target import under
from grosmc_mj.studies.tune.row import TUNED, TunedLaw, TunedNumberRow
from grosmc_mj.studies.tune.shares import TriedDesign
from grosmc_mj.studies.tune.tune import TuneStudy

LEGEND = (
    "Share: measured over allowed value, in the worst of the other draws; above 1 it is not kept."
)
# Share of a requirement's least share that counts as less, in parts of that at the best design.
_NOTABLY_LESS = 0.9


class Binding(NamedTuple):
    """A requirement under a condition, with the share that a design uses of it."""

    condition: str
    requirement: str
    share: float

    @property
    def words(self) -> str:
        """The requirement with its condition."""
        return f"{spelled(self.requirement)}{under(self.condition)}"


class Conflict(NamedTuple):
    """Two requirements that exclude each other, as far as designs were tried.

    Attributes:
        binding: The tightest at the best design.
        least: Least share of it that a design uses.
        other: The tightest at that design.
    """

    binding: Binding
    least: float
    other: Binding

    @property
    def words(self) -> str:
        """The conflict in a sentence."""
        return (
            f"of the designs tried, none keeps both {self.binding.words} and {self.other.words}: "
            f"where the first comes to {number(self.least)} of its limit, the second is at "
            f"{number(self.other.share)} of its own"
        )


def shares_of(design: TriedDesign) -> dict[tuple[str, str], float]:
    """Return the share that a design uses of each limit, by condition and requirement."""
    return {
        (condition, requirement): share
        for condition, shares in design.shares.items()
        for requirement, share in shares.items()
    }


def binding(shares: Mapping[tuple[str, str], float]) -> Binding:
    """Return the requirement with the largest share."""
    condition, requirement = max(shares, key=lambda key: shares[key])
    return Binding(condition, requirement, shares[condition, requirement])


def conflict(row: TunedLaw) -> Conflict | None:
    """Return the two requirements that exclude each other; None if only one is in the way.

    The tightest requirement at the best design excludes the one that is the tightest where it alone
    is kept best.
    """
    first = binding(shares_of(row.designs[row.best]))
    key = first.condition, first.requirement
    designs = [shares_of(design) for design in row.designs if design.complete]
    shares = min(designs, key=lambda shares: shares.get(key, math.inf))
    if shares.get(key, math.inf) > _NOTABLY_LESS * first.share:
        return None
    return Conflict(first, shares[key], binding(shares))


# -- words -----------------------------------------------------------------------------------------


def law_answer(study: TuneStudy, row: TunedLaw) -> Answer:
    """Return the answer on a law."""
    bound = binding(shares_of(row.designs[row.best]))
    runs = f"{row.runs:,} {plural(row.runs, 'run')}"
    more = ""
    if not row.complete:
        verdict = OPEN
        answer = f"{row.law}: {_nearest(bound)} at best, {runs}"
    elif not row.found:
        verdict = NOT_KEPT
        answer = f"None found for {row.law} in {runs}; nearest: {_nearest(bound)}"
        found = conflict(row)
        more = f"Go on with --resume --runs {2 * study.runs}, other ranges or another law."
        if found is not None:
            more = f"{row.law}: {found.words}. {more}"
    else:
        worst = worst_of(row.after)
        place = Binding(worst.condition, worst.tightest, worst.share).words
        verdict = KEPT if row.kept else NOT_KEPT
        keeps = "keeps all" if row.kept else "does not keep all"
        where = ""
        if any(item.drawn for item in study.conditions):
            where = f" on other draws, {number(row.share)} on its own"
        answer = f"{row.law} {keeps}: {number(worst.share)} of {place}{where}; {runs}"
    return Answer(
        question=f"Tuning of {study.target}: {row.law}",
        verdict=verdict,
        words=answer,
        more=more,
        notes=[f"{row.law}: {line}" for line in _range_notes(row)],
    )


def _nearest(bound: Binding) -> str:
    """The tightest requirement of a design, with its share, in words."""
    if math.isinf(bound.share):
        return f"{bound.words} is never reached"
    return f"{bound.words} {number(bound.share)} times its limit"


def _range_notes(row: TunedLaw) -> Iterator[str]:
    """Yield a line on each range that has grown, and on each best number at the end of one."""
    for tuned in row.numbers:
        ends = f"{number(tuned.low)} to {number(tuned.high)}"
        if tuned.grown:
            yield f"the best {tuned.path} lay at the end of its range, which became {ends}"
        elif tuned.at_end:
            yield f"the best {tuned.path} lies at the end of its range, {ends}"


# -- tables ----------------------------------------------------------------------------------------


def numbers_table(rows: Sequence[TunedLaw]) -> Table:
    """Return the numbers of the laws before and after."""
    columns = [
        *words("law", "number"),
        *numbers("in the file", "tuned", "searched from", "to"),
        *words("unit"),
    ]
    lines = []
    for row in rows:
        for tuned in row.numbers:
            cells = [tuned.before, tuned.after, tuned.low, tuned.high]
            lines.append([row.law, tuned.path, *map(number, cells), tuned.unit])
    return table("Numbers", columns, lines, grouped=True)


def requirements_table(study: TuneStudy, rows: Sequence[TunedLaw]) -> Table:
    """Return the share used of each requirement before and after, on draws of no search."""
    columns = [*words("law", "condition", "requirement"), *numbers("in the file", "tuned")]
    lines: list[list[str]] = []
    for row in rows:
        for before, after in zip(row.before, row.after, strict=True):
            for name in after.shares:
                pair = [_share(before, name), _share(after, name)]
                words_of = spelled(name)
                lines.append([row.law, before.condition, words_of, *pair])
            kept = [f"{item.kept_draws} of {item.draws}" for item in (before, after)]
            lines.append([row.law, before.condition, "draws that keep all", *kept])
    return table("Requirements", columns, lines, grouped=True, legend=LEGEND)


def _share(verdict: Verdict, name: str) -> str:
    """The share that a verdict has of a requirement."""
    share = verdict.shares.get(name, math.inf)
    return "never" if math.isinf(share) else number(share)


def summary_table(rows: Sequence[TunedLaw]) -> Table:
    """Return a line for each law: draws kept and the worst share, before and after."""
    columns = [
        *words("law"),
        *numbers("file: kept", "worst share", "tuned: kept", "worst share", "on its own draws"),
        *numbers("runs"),
    ]
    lines = []
    for row in rows:
        cells = [*_kept_and_worst(row.before), *_kept_and_worst(row.after)]
        lines.append([row.law, *cells, number(row.share), f"{row.runs}"])
    return table("Laws", columns, lines, legend=LEGEND)


def _kept_and_worst(verdicts: Sequence[Verdict]) -> list[str]:
    """Draws kept of all conditions together, and the worst share."""
    if not verdicts:
        return ["-", "-"]
    kept = sum(verdict.kept_draws for verdict in verdicts)
    draws = sum(verdict.draws for verdict in verdicts)
    worst = max(verdict.share for verdict in verdicts)
    return [f"{kept} of {draws}", "never" if math.isinf(worst) else number(worst)]


# -- charts ----------------------------------------------------------------------------------------


def charts(row: TunedLaw) -> list[LineChart]:
    """Return the charts of a law: requirements over the search, and the map of two numbers."""
    return [_over_search(row), _number_map(row)]


def _over_search(row: TunedLaw) -> LineChart:
    """Share of each requirement at the best design so far, under the worst condition."""
    lines: dict[str, tuple[list[float], list[float | None]]] = {}
    best = math.inf
    for index, design in enumerate(row.designs):
        if not design.complete or design.value >= best:
            continue
        best = design.value
        worst: dict[str, float] = {}
        for (_, requirement), share in shares_of(design).items():
            worst[requirement] = max(worst.get(requirement, 0.0), share)
        for requirement, share in worst.items():
            x, y = lines.setdefault(spelled(requirement), ([], []))
            x.append(float(index + 1))
            y.append(finite(share))
    return LineChart(
        name=f"{row.law}: best so far",
        titles=("designs tried", "share of the limit, worst condition"),
        lines=[Series(name=name, x=x, y=y) for name, (x, y) in lines.items()],
        limit=1.0,
    )


def _number_map(row: TunedLaw) -> LineChart:
    """Designs over the two numbers that matter most, kept and not kept."""
    # Of a design that lost a race it is known that it is not kept if its share is above 1.
    designs = [design for design in row.designs if design.complete or design.value > 0]
    designs = [design for design in designs if not design.refused]
    points = np.array([design.point for design in designs])
    values = np.array([design.value for design in designs])
    complete = np.array([design.complete for design in designs])
    first, second = _influential(points[complete], values[complete])

    x = [row.numbers[first].value(coordinate) for coordinate in points[:, first].tolist()]
    y: list[Any]
    if first == second:
        y = [finite(design.share) for design in designs]
        y_title = "share of the tightest limit"
    else:
        y = [row.numbers[second].value(coordinate) for coordinate in points[:, second].tolist()]
        y_title = _axis(row.numbers[second])
    good = values <= 0
    lines = [
        Series(name=name, x=_at(x, where), y=_at(y, where), joined=False)
        for name, where in (("kept", good), ("not kept", ~good))
        if where.any()
    ]
    if first != second:
        best = row.numbers[first].after, row.numbers[second].after
        lines.append(Series(name="best", x=[best[0]], y=[best[1]], joined=False))
    titles = (_axis(row.numbers[first]), y_title)
    return LineChart(name=f"{row.law}: designs tried", titles=titles, lines=lines)


def _at(values: Sequence[Any], where: NDArray[np.bool_]) -> list[Any]:
    return [value for value, chosen in zip(values, where, strict=True) if chosen]


def _axis(tuned: TunedNumberRow) -> str:
    return titled(tuned.path, tuned.unit)


def _influential(points: Array, values: Array) -> tuple[int, int]:
    """Indices of the two coordinates that the order of the values follows most.

    By the distance from the best point: a number is best somewhere within its range.
    """
    count = points.shape[1]
    if count == 1 or len(points) < 3:
        return 0, min(1, count - 1)
    away = np.abs(points - points[values.argmin()])
    ranks = np.argsort(np.argsort(np.column_stack([away, values]), axis=0), axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.nan_to_num(np.atleast_2d(np.corrcoef(ranks.T))[-1, :-1])
    first, second = np.argsort(-correlation, kind="stable")[:2].tolist()
    return min(first, second), max(first, second)


# -- document ------------------------------------------------------------------------------------


def tune_result(study: TuneStudy, rows: Sequence[TunedLaw], *, complete: bool) -> Result:
    """Return the result of a tuning.

    Args:
        study: The target.
        rows: Its rows.
        complete: Whether nothing was interrupted.
    """
    judged = [row for row in rows if row.complete]
    sheets = [
        ReportTable(table=summary_table(rows), brief=len(rows) > 1),
        ReportTable(
            table=numbers_table(rows),
            charts=[chart for row in rows for chart in charts(row)],
            brief=True,
        ),
        ReportTable(table=requirements_table(study, judged), brief=len(rows) == 1),
    ]
    return result(
        "tune",
        study.configuration(),
        seed=study.seed,
        complete=complete,
        answers=[law_answer(study, row) for row in rows],
        standings=standings(
            study.target, _verdicts(judged), worst_failed, _standing_words, complete=complete
        ),
        sheets=sheets,
        remarks=_remarks(study),
        values=values_of(study.target, _verdicts(judged)),
        target=study.target,
        conditions=conditions_document(item.condition for item in study.conditions),
        laws=[_law_document(row) for row in rows],
    )


def _remarks(study: TuneStudy) -> list[str]:
    names = ", ".join(item.name for item in study.conditions)
    drawn = any(item.drawn for item in study.conditions)
    draws = "nothing is drawn at random"
    if drawn:
        other = plural(study.held_out, "other one")
        draws = f"tuned on {counted(study.draws, 'draw')}, judged on {study.held_out} {other}"
    return [
        f"Asked under: {names}; {draws}.",
        f"A search ends at {study.target_share:g} of each limit, or with its runs; seed "
        f"{study.seed}.",
    ]


def _verdicts(rows: Iterable[TunedLaw]) -> list[Verdict]:
    """Verdicts on the tuned laws, on draws of no search; of an interrupted one that of its best."""
    verdicts = []
    for row in rows:
        bound = binding(shares_of(row.designs[row.best]))
        best = Verdict(
            law=row.law,
            step=TUNED,
            condition=bound.condition,
            share=row.share,
            tightest=bound.requirement,
        )
        verdicts += row.after or [best]
    return verdicts


def _standing_words(verdicts: Sequence[Verdict]) -> str:
    """The worst verdict on a law in words."""
    worst = worst_of(verdicts)
    return f"{number(worst.share)} of {Binding(worst.condition, worst.tightest, 0.0).words}"


def _law_document(row: TunedLaw) -> dict[str, Any]:
    """Row of a law as plain values."""
    found = conflict(row)
    return {
        **row.model_dump(exclude={"designs"}),
        "found": row.found,
        "kept": row.kept,
        "conflict": None if found is None else found.words,
        "designs": [
            {"point": design.point, "value": design.value, "complete": design.complete}
            for design in row.designs
        ],
    }
