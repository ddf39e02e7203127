"""The choices of each claim varied one by one, and where its answer changes."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from grosmc_mj.chapter.claims.claim import Choice, Claim
from grosmc_mj.chapter.claims.judging import measure_with
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.studies.sweep.search import Halved, Search, run_searches

# Written by `claims sweep --record`.
STORED = Path(__file__).resolve().parents[1] / "sweeps.json"
# Bisections between two numbers with different answers.
_HALVINGS = 5


def sweep(
    lab: RunCache,
    claims: Sequence[Claim],
    advance: Callable[[str], object] = lambda _: None,
) -> Iterator[dict[str, Any]]:
    """Vary every choice of every claim; claims that share a choice share its runs.

    Args:
        lab: Cache of the runs.
        claims: Claims whose choices are varied.
        advance: Called after each claim with its id.

    Yields:
        Claim and choice as plain values: the measured value for each value of the choice on the
        plant that decides, whether the claim holds there (None if it cannot be judged), and where
        its answer flips; empty if it does not.
    """
    for claim in claims:
        for choice in claim.choices:
            values = []
            answers = []
            for value in choice.values:
                measured, holds = _at(lab, claim, choice, value)
                trial = {"choice": choice.written(value), "measured": measured, "holds": holds}
                values.append(trial)
                answers.append(holds)
            yield {
                "claim": claim.id,
                "choice": choice.name,
                "printed": choice.printed,
                "values": values,
                "flips": "; ".join(_flips(lab, claim, choice, answers)),
            }
        advance(claim.id)


def _at(
    lab: RunCache, claim: Claim, choice: Choice, value: Any
) -> tuple[float | None, bool | None]:
    """The measured value on the plant that decides, and whether the claim holds there."""
    measured = measure_with(lab, claim, claim.plants[-1], choice, value)
    if measured.broken:
        return measured.value, None
    return measured.value, claim.holds(measured)


def _flips(
    lab: RunCache, claim: Claim, choice: Choice, answers: Sequence[bool | None]
) -> Iterator[str]:
    """Yield where the answer changes; between two numbers it is found by bisection."""
    pairs = zip(choice.values, answers, strict=True)
    judged = [(value, holds) for value, holds in pairs if holds is not None]
    for (low, before), (high, after) in itertools.pairwise(judged):
        if before is after:
            continue
        if not (isinstance(low, float) and isinstance(high, float)):
            yield f"between {choice.written(low)} and {choice.written(high)}"
            continue

        flip = f"{_flip_between(lab, claim, choice, low, high, before):.3g}"
        yield f"at {choice.written(float(flip))}"


def _flip_between(
    lab: RunCache, claim: Claim, choice: Choice, low: float, high: float, before: bool
) -> float:
    """Return where the answer between two numbers is no longer that of the first one."""

    def at(share: float) -> float:
        return low + share * (high - low)

    def as_before(tried: Sequence[tuple[Search, float]]) -> list[bool]:
        return [_at(lab, claim, choice, at(share))[1] is before for _, share in tried]

    search = Search(Halved(0.0, 2.0**-_HALVINGS), 1.0)
    search.known |= {0.0: True, 1.0: False}
    run_searches([search], as_before)
    assert search.largest is not None
    assert search.failed is not None
    return at((search.largest + search.failed) / 2)


# The tables of all claims ask for it.
@cache
def stored_sweeps() -> list[dict[str, Any]]:
    """Return the recorded sweeps of all claims."""
    return json.loads(STORED.read_text(encoding="utf-8"))["sweeps"]


def stored_flips(claim: str) -> dict[str, str]:
    """Return the choices that change a claim's answer by the record, and where."""
    flips = dict[str, str]()
    for row in stored_sweeps():
        if row["claim"] == claim and row["flips"]:
            flips[row["choice"]] = row["flips"]
    return flips
