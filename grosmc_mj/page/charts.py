"""What the page's charts are drawn from: curves with their films, claims, maps of studies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

from grosmc_mj.page.answers import so_far, standing_text, target_of, tolerance_text
from grosmc_mj.page.documents import (
    StoredClaim,
    StoredCurves,
    StoredFilm,
    StoredLadder,
    StoredPart,
    StoredTolerances,
)
from grosmc_mj.page.reading import Document
from grosmc_mj.page.sheets import Sheet, cells_chart, told_sheet
from grosmc_mj.page.studies.sheets import study_sheets
from grosmc_mj.results.palette import PLANTS

# Of the redness of what is not kept, and of the tolerance map: decades, and powers of two.
_MOST, _OCTAVES = 2.0, 6.0


def curves_data(content: StoredCurves, film: tuple[int, StoredFilm] | None) -> dict[str, Any]:
    """The curves of a case; with the number and the clock of its film."""
    case = content.model_dump(include={"system", "case", "title", "duration", "panels", "laws"})
    plants = dict.fromkeys(each.plant for panel in content.panels for each in panel.curves)
    clock = None
    if film is not None:
        number, beside = film
        form = beside.configuration.film
        clock = {"number": number, "start": form.start, "speed": form.speed}
    return {
        **case,
        "disturbances": [each.model_dump() for each in content.disturbances],
        "plants": {name: PLANTS.get(name, name) for name in plants},
        "film": clock,
    }


def claim_data(claim: StoredClaim) -> dict[str, Any]:
    """The values of a claim: on each plant, refined, and of each choice that was tried."""
    rows = []
    for name, found in claim.plants.items():
        rows.append({"row": name, "value": found.value, "what": found.verdict})
        values = found.evidence.get("values")
        if isinstance(values, list) and len(values) > 1 and _is_number(values[1]):
            rows.append({"row": name, "value": values[1], "what": "at half the control period"})
    for name, found in claim.plants.items():
        rows += [
            {"row": trial, "value": value, "what": f"tried on {name}"}
            for trial, value in found.trials.items()
        ]
    return {
        "rows": [each for each in rows if each["value"] is not None],
        "threshold": claim.threshold,
        "sense": claim.sense,
        "unit": "" if claim.unit == "1" else claim.unit,
    }


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and math.isfinite(value)


def sheets(documents: Iterable[Document]) -> list[Sheet]:
    """Of each condition of ladders and tolerances a map of laws; and what other studies found."""
    found: list[Sheet] = []
    for each in documents:
        content: StoredPart | Any = each.content
        if isinstance(content, StoredLadder):
            found += _ladder(target_of(each), content)
        elif isinstance(content, StoredTolerances):
            found += _tolerances(target_of(each), content)
        found += study_sheets(content)
    return [each for each in found if each.rows]


def _ladder(target: str, content: StoredLadder) -> Iterator[Sheet]:
    """Maps of where each law stands, and the rungs on which claims fall."""
    for condition in dict.fromkeys(row.condition for row in content.standings):
        for together in (True, False):
            rows = [
                row
                for row in content.standings
                if row.together is together and row.condition == condition
            ]
            title = "each rung on top of the others" if together else "each rung alone"
            cells = {
                (row.law, row.rung): (
                    _redness(row.kept, row.share_of_the_tightest_limit),
                    standing_text(row),
                    (row.tightest or "").replace("_", " "),
                )
                for row in rows
                if not row.impossible
            }
            named = f"{target}, {condition}: {title}"
            note = "Of the tightest limit, how much is used; above 1 it is not kept."
            note += so_far(content.complete)
            yield _map(named, note, cells, _MOST)
    stands = "stands" if content.complete else "stands so far"
    named = {each.claim for each in content.fallen}
    statements = {each.claim: each.statement for each in content.claims if each.claim in named}
    yield Sheet(
        f"{target}: on which rung claims of the chapter fall",
        " ".join(f"{claim}: {said}." for claim, said in statements.items()),
        ["law", "condition", "claim", "falls at"],
        [[each.law, each.condition, each.claim, each.rung or stands] for each in content.fallen],
    )


def _tolerances(target: str, content: StoredTolerances) -> Iterator[Sheet]:
    """Maps of how much of each imperfection each law stands."""
    for condition in dict.fromkeys(row.condition for row in content.tolerances):
        cells = {
            (row.law, row.imperfection): (
                _weakness(row.largest_kept.factor if row.largest_kept else 0.0)
                if row.kept_ideally
                else _OCTAVES,
                tolerance_text(row),
                f"then breaks: {row.breaks.replace('_', ' ')}" if row.breaks else "",
            )
            for row in content.tolerances
            if row.condition == condition and not row.impossible
        }
        named = f"{target}, {condition}: how much of it each law stands"
        note = "Blue: more than the bench has; red: less. no: not kept even without it."
        yield _map(named, note, cells, _OCTAVES)


def _redness(kept: bool, share: float | None) -> float:
    """What is kept is below zero; the further beyond its limit, the redder."""
    if kept:
        return -0.5 * _MOST
    return 0.1 * _MOST + 0.9 * min(math.log10(max(share, 1.0)) if share else _MOST, _MOST)


def _weakness(factor: float) -> float:
    """Octaves below what the bench has."""
    return -max(-_OCTAVES, min(_OCTAVES, math.log2(factor))) if factor > 0 else _OCTAVES


def _map(
    title: str, note: str, cells: dict[tuple[str, str], tuple[float, str, str]], most: float
) -> Sheet:
    """A cell for each law and column."""
    return told_sheet(title, note, "law", cells_chart(title, cells, most))
