"""Statements that follow from rows of verdicts: where a law stands, and what ``diff`` compares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from grosmc_mj.output.results.result import KEPT, NOT_KEPT, Standing, Value, finite
from grosmc_mj.output.results.verdicts import Verdict, by_law

# Tolerance of a share or an amount between machines, which switching amplifies.
_SWITCHED = 0.1


def standing_of(case: str, row: Verdict, *, words: str = "", complete: bool = True) -> Standing:
    """Return where a law stands by the row that decides.

    Args:
        case: The case, SYSTEM/CASE.
        row: The row.
        words: Words in place of those of the row.
        complete: Whether nothing was interrupted.
    """
    return Standing(
        case=case,
        law=row.law,
        breaks_at="" if row.kept else row.step,
        requirement=row.tightest,
        words=words or row.words,
        share=finite(row.share),
        complete=complete,
    )


def standings_of(case: str, rows: Iterable[Verdict], *, complete: bool) -> Iterator[Standing]:
    """Yield where each law stands by its row that is the furthest beyond its limit or nearest."""
    for of_law in by_law(rows).values():
        worst = max(of_law, key=lambda row: row.share)
        yield standing_of(case, worst, complete=complete)


def values_of(target: str, rows: Iterable[Verdict], *, searched: bool = False) -> Iterator[Value]:
    """Yield the values that two results are compared by.

    Args:
        target: The target, SYSTEM/CASE.
        rows: Rows of runs: whether all is kept, and the share of the tightest limit.
        searched: Whether they are rows of searches: whether all is kept without the imperfection,
            and the largest amount that is kept.
    """
    for row in rows:
        if row.impossible:
            continue
        step = f"{row.group} {row.step}".lstrip()
        name = f"{target} {row.condition} {row.law}, {step}"
        if searched:
            ideally = NOT_KEPT if row.largest_kept is None else KEPT
            largest = row.largest_kept or 0.0
            yield Value(name=f"{name}: ideally", value=ideally)
            yield Value(name=f"{name}: largest kept", value=largest, better=1, relative=_SWITCHED)
        else:
            used = finite(row.share)
            yield Value(name=name, value=KEPT if row.kept else NOT_KEPT)
            yield Value(
                name=f"{name}: share of the limit", value=used, better=-1, relative=_SWITCHED
            )
