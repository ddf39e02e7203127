"""Where each law stands by its verdicts on runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from grosmc_mj.output.results.result import StudyVerdict, finite
from grosmc_mj.output.results.verdicts import Verdict, by_law


def standings_of(case: str, rows: Iterable[Verdict], *, complete: bool) -> Iterator[StudyVerdict]:
    """Yield where each law stands by its row that is the furthest beyond its limit or nearest."""
    for of_law in by_law(rows).values():
        worst = max(of_law, key=lambda row: row.share)
        yield StudyVerdict(
            case=case,
            law=worst.law,
            breaks_at="" if worst.kept else worst.step,
            requirement=worst.tightest,
            words=worst.words,
            share=finite(worst.share),
            complete=complete,
        )
