"""The choices of each claim varied one by one, and where its answer changes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from grosmc_mj.chapter.claims.claim import Choice, Claim
from grosmc_mj.chapter.claims.judging import tried
from grosmc_mj.experiments.laboratory import Laboratory

# Written by `claims sweep --record`.
STORED = Path(__file__).resolve().parents[1] / "sweeps.json"
# How finely the value is found at which an answer changes.
_HALVINGS = 5


def sweep(
    lab: Laboratory, claims: Sequence[Claim], advance: Callable[[str], object] = lambda _: None
) -> Iterator[dict[str, Any]]:
    """Vary every choice of every claim; those that share a choice share its runs.

    Args:
        lab: Where it is measured.
        claims: Whose choices.
        advance: Called after each claim with its id.

    Yields:
        Claim and choice as plain values: what is measured at each value of the choice on the plant
        that decides, whether the claim holds there (None if nothing can be told), and where its
        answer flips; empty if it does not.
    """
    for claim in claims:
        for choice in claim.choices:
            answers = [_at(lab, claim, choice, value) for value in choice.values]
            yield {
                "claim": claim.id,
                "choice": choice.name,
                "printed": choice.printed,
                "values": [
                    {"choice": choice.written(value), "measured": measured, "holds": holds}
                    for value, (measured, holds) in zip(choice.values, answers, strict=True)
                ],
                "flips": "; ".join(_flips(lab, claim, choice, [holds for _, holds in answers])),
            }
        advance(claim.id)


def _at(
    lab: Laboratory, claim: Claim, choice: Choice, value: Any
) -> tuple[float | None, bool | None]:
    """The measured value on the plant that decides, and whether the claim holds there."""
    measured = tried(lab, claim, claim.plants[-1], choice, value)
    return measured.value, None if measured.broken else claim.holds(measured)


def _flips(
    lab: Laboratory, claim: Claim, choice: Choice, answers: Sequence[bool | None]
) -> Iterator[str]:
    """Where the answer changes; of numbers halved down."""
    known = [pair for pair in zip(choice.values, answers, strict=True) if pair[1] is not None]
    for (low, before), (high, after) in itertools.pairwise(known):
        if before is after:
            continue
        if not (isinstance(low, float) and isinstance(high, float)):
            yield f"between {choice.written(low)} and {choice.written(high)}"
            continue
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = _at(lab, claim, choice, middle)[1] is before
            low, high = (middle, high) if same else (low, middle)
        yield f"at {choice.written(float(f'{(low + high) / 2:.3g}'))}"


@cache
def stored_sweeps() -> list[dict[str, Any]]:
    """The sweeps of all claims on record."""
    return json.loads(STORED.read_text(encoding="utf-8"))["sweeps"]


def stored_flips(claim: str) -> dict[str, str]:
    """The choices that a claim's answer changes with by the record, and where."""
    own = (row for row in stored_sweeps() if row["claim"] == claim)
    return {row["choice"]: row["flips"] for row in own if row["flips"]}
