"""What each claim turns on: its choices varied one by one, and where its answer changes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.chapter.claims.claim import Choice, Claim, Measured
from grosmc_mj.chapter.claims.ledger import tried
from grosmc_mj.experiments.laboratory import Laboratory

# What `claims --sweep --record` has stored.
STORED = Path(__file__).resolve().parents[1] / "sweeps.json"
# How finely the value is told at which an answer changes.
_HALVINGS = 5


class Swept(NamedTuple):
    """One claim over one of its choices, on the plant that decides.

    Attributes:
        claim: Its id.
        choice: Name of the choice.
        printed: Whether the chapter prints it.
        values: As written, what was measured with it, and whether the claim holds; None without.
        flips: Where its answer changes; empty if it does not.
    """

    claim: str
    choice: str
    printed: bool
    values: tuple[tuple[str, float | None, bool | None], ...]
    flips: str


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
            found = {repr(value): _at(lab, claim, choice, value) for value in choice.values}
            answers = [_answer(claim, found[repr(value)]) for value in choice.values]
            values = tuple(
                (choice.written(value), found[repr(value)].value, answer)
                for value, answer in zip(choice.values, answers, strict=True)
            )
            flips = _flips(lab, claim, choice, answers)
            yield Swept(claim.id, choice.name, choice.printed, values, flips)
        advance(claim.id)


def _at(lab: Laboratory, claim: Claim, choice: Choice, value: Any) -> Measured:
    """What is measured with a value, on the plant that decides."""
    return tried(lab, claim, claim.plants[-1], choice, value)


def _answer(claim: Claim, measured: Measured) -> bool | None:
    """Whether the claim holds; None where nothing can be told."""
    return None if measured.broken else claim.holds(measured)


def _flips(lab: Laboratory, claim: Claim, choice: Choice, answers: Sequence[bool | None]) -> str:
    """Where the answer changes."""
    told = [pair for pair in zip(choice.values, answers, strict=True) if pair[1] is not None]
    said = []
    for (low, before), (high, after) in itertools.pairwise(told):
        if before is after:
            continue
        if not (isinstance(low, float) and isinstance(high, float)):
            said.append(f"between {choice.written(low)} and {choice.written(high)}")
            continue
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            same = _answer(claim, _at(lab, claim, choice, middle)) is before
            low, high = (middle, high) if same else (low, middle)
        said.append(f"at {choice.written(float(f'{(low + high) / 2:.3g}'))}")
    return "; ".join(said)


def sweep_document(found: Sequence[Swept]) -> list[dict[str, Any]]:
    """As plain values."""
    return [
        {
            **each._asdict(),
            "values": [
                {"choice": written, "measured": value, "holds": holds}
                for written, value, holds in each.values
            ],
        }
        for each in found
    ]


def flips_of(claim: Claim) -> list[tuple[Choice, str]]:
    """The choices that a claim's answer changes with by the record, and where."""
    flips = stored_flips().get(claim.id, {})
    return [(choice, flips[choice.name]) for choice in claim.choices if choice.name in flips]


@cache
def stored_flips() -> dict[str, dict[str, str]]:
    """By claim, the choices that its answer changes with and where; empty before a record."""
    if not STORED.is_file():
        return {}
    flips: dict[str, dict[str, str]] = {}
    for each in json.loads(STORED.read_text(encoding="utf-8"))["sweeps"]:
        if each["flips"]:
            flips.setdefault(each["claim"], {})[each["choice"]] = each["flips"]
    return flips
