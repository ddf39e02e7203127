"""Answer of a tolerance study: words, tables, charts and document."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from grosmc_mj.ground.wording import counted_of
from grosmc_mj.output.charts.chart import in_lines
from grosmc_mj.output.results.result import (
    MEASURED,
    OPEN,
    Answer,
    CellChart,
    ReportTable,
    Result,
    result,
)
from grosmc_mj.output.results.tables import Table, number
from grosmc_mj.output.results.verdicts import Verdict, standings, values_of
from grosmc_mj.studies.matrix import (
    charts_by_condition,
    conditions_document,
    law_document,
    verdict_table,
)
from grosmc_mj.studies.target import StudiedLaw, under
from grosmc_mj.studies.tolerance.imperfections import ALL, Imperfection
from grosmc_mj.studies.tolerance.search import FINER, PER_OCTAVE, RESOLUTION
from grosmc_mj.studies.tolerance.tolerance import ToleranceStudy
from grosmc_mj.studies.tolerance.words import amount_text, only_without, reason, weakness

_STEP = f"{100 * (2 ** (1 / PER_OCTAVE) - 1):.0f} %"
_FINER_STEP = f"{100 * (2 ** (1 / FINER) - 1):.0f} %"
LEGEND = (
    "The largest amount up to which all that was tried is kept, of the first part; the first "
    f"failure found is within {100 * (RESOLUTION - 1):.0f} %. Tried in steps of {_STEP}, in the "
    f"octave below that failure of {_FINER_STEP}. no: not kept without it; none: only without it; "
    "≥ and ≤: kept up to the last that was tried; *: kept again beyond; !: MuJoCo differs from the "
    "equations, and counts."
)
NOTE = (
    "Green: all requirements are kept with what the bench has of it, and with all that was tried "
    "below. Orange: the named requirement is not. !: MuJoCo differs from the equations, and counts."
)
# Letters in a line of a header.
_LETTERS = 12
# Imperfections by name.
Kinds = Mapping[str, Imperfection]


def kept_ideally(rows: Iterable[Verdict], kinds: Kinds) -> set[tuple[str, str]]:
    """Return laws with the conditions under which each keeps all without any imperfection.

    Args:
        rows: The tolerances.
        kinds: The imperfections, by name.
    """
    sized = [row for row in rows if kinds[row.step].amounts]
    return {(row.law, row.condition) for row in sized if row.largest_kept is not None}


def least_of(rows: Sequence[Verdict], kinds: Kinds) -> dict[tuple[str, str], Verdict]:
    """Return the least by law and imperfection, over the conditions that the law stands."""
    least: dict[tuple[str, str], Verdict] = {}
    ideal = kept_ideally(rows, kinds)
    for row in rows:
        if (row.law, row.condition) in ideal:
            key = row.law, row.step
            least[key] = min(least.get(key, row), row, key=_strength)
    return least


def _strength(row: Verdict) -> tuple[float, float]:
    """Key by which tolerances are compared."""
    return weakness(row), row.largest_kept or 0.0


def verdict(rows: Sequence[Verdict], kinds: Kinds) -> str:
    """Return one sentence: which law breaks first, at which amount of which imperfection.

    Args:
        rows: The tolerances.
        kinds: The imperfections, by name.
    """
    broken = [row for row in rows if row.smallest_failed and kinds[row.step].single]
    if not broken:
        return "No single imperfection that was tried breaks what a law keeps without it."

    worst = min(broken, key=weakness)
    kind = kinds[worst.step]
    kept = "only without it"
    if worst.largest_kept and not only_without(worst, kind):
        kept = f"up to {_beside_bench(kind, worst.largest_kept)}"
    return (
        f"{worst.law} breaks first, by {kind.name}{under(worst.condition)}: all is kept {kept}; "
        f"the first failure found is at {_beside_bench(kind, weakness(worst))}: {reason(worst)}."
    )


def _beside_bench(kind: Imperfection, factor: float) -> str:
    """The amount for a factor, and the factor."""
    return f"{amount_text(kind, factor)} ({number(factor)} times the bench's)"


def confirmed(rows: Sequence[Verdict]) -> tuple[int, int]:
    """Return how many answers MuJoCo checked, and how many of them differ."""
    agrees = [row.physics_agrees for row in rows if row.physics_agrees is not None]
    return len(agrees), agrees.count(False)


def least_table(rows: Sequence[Verdict], kinds: Kinds, title: str) -> Table:
    """Return laws by imperfections: the least over the conditions that a law keeps ideally.

    The strongest law stands first, and the imperfection with the smallest tolerance.

    Args:
        rows: The tolerances.
        kinds: The imperfections, by name.
        title: Title of the table.
    """
    least = least_of(rows, kinds)
    ideal = kept_ideally(rows, kinds)
    conditions = dict.fromkeys(row.condition for row in rows)
    kept = {law: [name for name in conditions if (law, name) in ideal] for law, _ in least}

    # The weakest law decides the order of imperfections, the least of all at once that of laws.
    weakest: dict[str, float] = {}
    strength = {law: (len(names), 0.0) for law, names in kept.items()}
    for (law, kind), row in least.items():
        weakest.setdefault(kind, math.inf)
        if row.largest_kept is not None:
            weakest[kind] = min(weakness(row), weakest[kind])
        if kind == ALL:
            strength[law] = (len(kept[law]), weakness(row))

    ordered = sorted(weakest, key=weakest.__getitem__)
    chosen = []
    for law in sorted(kept, key=strength.__getitem__, reverse=True):
        chosen += [least[law, kind] for kind in ordered if (law, kind) in least]

    headings = {kind: in_lines(kinds[kind].heading, _LETTERS) for kind in ordered}
    ideally = {law: ", ".join(names) for law, names in kept.items()}
    return verdict_table(title, chosen, headings, legend=LEGEND, beside={"keeps ideally": ideally})


def charts(studied: ToleranceStudy, rows: Sequence[Verdict]) -> dict[str, CellChart]:
    """Return the chart of each condition: laws by imperfections."""
    headings = {kind.name: kind.name for kind in studied.imperfections}
    return charts_by_condition(studied.conditions, rows, headings, climbing=False)


@dataclass(frozen=True)
class _Standing:
    """Smallest tolerance of a law, for its standing.

    Attributes:
        kinds: The imperfections, by name.
    """

    kinds: Kinds

    def failed(self, rows: Sequence[Verdict]) -> Verdict | None:
        """Return the smallest tolerance of a law; None if it stands all that was tried."""
        kept = [row for row in rows if row.largest_kept is not None]
        if not kept:
            return rows[0].changed(step="ideal loop")
        failed = [row for row in kept if row.smallest_failed is not None]
        least = min(failed, key=lambda row: row.largest_kept or 0.0, default=None)
        if least is not None and least.step == ALL:
            return least.changed(step="all of them")
        return least

    def words(self, rows: Sequence[Verdict]) -> str:
        """Return words on the smallest tolerance of a law."""
        least = self.failed(rows)
        if least is None:
            return "stands all that was tried"
        if least.largest_kept is None:
            return "not kept even in an ideal loop"
        kind = self.kinds[ALL if least.step == "all of them" else least.step]
        amount = "only without it"
        if least.largest_kept and not only_without(least, kind):
            amount = f"up to {amount_text(kind, least.largest_kept)}"
        return f"kept {amount}, then {reason(least)} ({least.condition})"


def tolerance_result(studied: ToleranceStudy, rows: Sequence[Verdict], *, complete: bool) -> Result:
    """Return the result of a study of tolerances.

    Args:
        studied: The target.
        rows: Its tolerances.
        complete: Whether nothing was interrupted.
    """
    target = studied.target
    kinds = studied.kinds
    standing = _Standing(kinds)
    checked, differing = confirmed(rows)
    sheet = ReportTable(
        table=least_table(rows, kinds, f"{target}: tolerances"),
        charts=list(charts(studied, rows).values()),
        brief=True,
    )
    remarks = []
    if checked:
        remarks.append(f"MuJoCo confirmed {checked - differing} of {checked} answers.")
    return result(
        "tolerance",
        studied.configuration(),
        seed=studied.bench.seed,
        complete=complete,
        answers=[_document_answer(target, rows, kinds, complete=complete)],
        standings=standings(target, rows, standing.failed, standing.words, complete=complete),
        sheets=[sheet],
        remarks=remarks,
        values=values_of(target, rows),
        target=target,
        conditions=conditions_document(studied.conditions),
        imperfections=[_imperfection_document(kind) for kind in studied.imperfections],
        laws=[_law_document(studied, law) for law in studied.laws],
        physics={"answers_checked": checked, "answers_that_differ": differing},
        verdicts=[row.model_dump() for row in rows],
    )


def _document_answer(
    target: str, rows: Sequence[Verdict], kinds: Kinds, *, complete: bool
) -> Answer:
    laws = {row.law for row in rows}
    weak = {row.law for row in rows if row.largest_kept is None}
    keeping = counted_of(len(laws) - len(weak), len(laws), "law", "keeps", "keep")
    answer = f"{keeping} all in every ideal loop"
    return Answer(
        question=f"Tolerance of {target}",
        verdict=MEASURED if complete else OPEN,
        words=answer,
        more=verdict(rows, kinds),
    )


def _imperfection_document(kind: Imperfection) -> dict[str, Any]:
    return {
        "name": kind.name,
        "bench": kind.amount(1.0),
        "amounts": [amount._asdict() for amount in kind.amounts],
    }


def _law_document(studied: ToleranceStudy, law: StudiedLaw) -> dict[str, Any]:
    requirements = {}
    for condition in studied.conditions:
        limits = studied.limits(law, condition)
        requirements[condition.name] = [limit.words for limit in limits]
    return {**law_document(law), "requirements": requirements}


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Return a heading and the table of each document, for ``docs/tolerance.md``."""
    parts = []
    for document in documents:
        least = Table.model_validate(document["sheets"][0]["table"])
        lines = [line.replace("\n", " ") for line in least.markdown()]
        checked, differing = document["physics"].values()
        ending = f"MuJoCo confirmed {checked - differing} of {checked} answers."
        parts.append("\n".join([f"**{document['target']}**", "", *lines, "", ending]))
    return "\n\n".join(parts)
