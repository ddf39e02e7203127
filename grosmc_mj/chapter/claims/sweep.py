"""What each claim turns on: its choices varied one by one, and where its answer changes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.chapter.claims.claim import Choice, Claim
from grosmc_mj.chapter.claims.judging import tried
from grosmc_mj.experiments.laboratory import Laboratory

# Written by `claims sweep --record`.
STORED = Path(__file__).resolve().parents[1] / "sweeps.json"
# How finely the value is found at which an answer changes.
_HALVINGS = 5


class Swept(NamedTuple):
    """One claim over one of its choices, on the plant that decides.

    Attributes:
        claim: Its id.
        choice: The choice.
        values: The measured value at each of the choice's, and whether the claim holds; None
            without.
        flips: Where its answer changes; empty if it does not.
    """

    claim: str
    choice: Choice
    values: tuple[tuple[float | None, bool | None], ...]
    flips: str

    def document(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "claim": self.claim,
            "choice": self.choice.name,
            "printed": self.choice.printed,
            "values": [
                {"choice": self.choice.written(value), "measured": measured, "holds": holds}
                for value, (measured, holds) in zip(self.choice.values, self.values, strict=True)
            ],
            "flips": self.flips,
        }


def sweep(
    lab: Laboratory, claims: Sequence[Claim], advance: Callable[[str], object] = lambda _: None
) -> Iterator[Swept]:
    """Vary every choice of every claim; those that share a choice share its runs.

    Args:
        lab: Where it is measured.
        claims: Whose choices.
        advance: Called after each claim with its id.
    """
    for claim in claims:
        for choice in claim.choices:
            values = tuple(_at(lab, claim, choice, value) for value in choice.values)
            yield Swept(claim.id, choice, values, _flips(lab, claim, choice, values))
        advance(claim.id)


def _at(
    lab: Laboratory, claim: Claim, choice: Choice, value: Any
) -> tuple[float | None, bool | None]:
    """The measured value on the plant that decides, and whether the claim holds there."""
    measured = tried(lab, claim, claim.plants[-1], choice, value)
    return measured.value, None if measured.broken else claim.holds(measured)


def _flips(
    lab: Laboratory,
    claim: Claim,
    choice: Choice,
    values: Sequence[tuple[float | None, bool | None]],
) -> str:
    """Where the answer changes."""
    answers = [
        (value, holds)
        for value, (_, holds) in zip(choice.values, values, strict=True)
        if holds is not None
    ]
    flips = []
    for (low, before), (high, after) in itertools.pairwise(answers):
        if before is after:
            continue
        if not (isinstance(low, float) and isinstance(high, float)):
            flips.append(f"between {choice.written(low)} and {choice.written(high)}")
            continue
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = _at(lab, claim, choice, middle)[1] is before
            low, high = (middle, high) if same else (low, middle)
        flips.append(f"at {choice.written(float(f'{(low + high) / 2:.3g}'))}")
    return "; ".join(flips)


def flips_of(claim: Claim) -> list[tuple[Choice, str]]:
    """The choices that a claim's answer changes with by the record, and where."""
    flips = stored_flips().get(claim.id, {})
    return [(choice, flips[choice.name]) for choice in claim.choices if choice.name in flips]


@cache
def stored_flips() -> dict[str, dict[str, str]]:
    """By claim, the choices that its answer changes with and where."""
    flips: dict[str, dict[str, str]] = {}
    for row in json.loads(STORED.read_text(encoding="utf-8"))["sweeps"]:
        if row["flips"]:
            flips.setdefault(row["claim"], {})[row["choice"]] = row["flips"]
    return flips
