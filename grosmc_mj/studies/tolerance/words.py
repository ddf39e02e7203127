"""Tolerance of a law to an imperfection in words: amounts with their units."""

from __future__ import annotations

import math

from grosmc_mj.ground.wording import spelled
from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.tolerance.imperfections import Imperfection


def with_words(row: Verdict, imperfection: Imperfection) -> Verdict:
    """Return a tolerance with the amount in the cell of a table, and in words."""
    text = _largest(row, imperfection)
    if row.kept_again:
        text += "*"
    row = row.changed(text=text)
    if row.tightest:
        return row.changed(words=f"{row.cell}; then breaks: {reason(row)}")
    return row.changed(words=row.cell)


def _largest(row: Verdict, imperfection: Imperfection) -> str:
    """The largest amount that is kept, without its unit."""
    if row.impossible:
        return "-"
    if not imperfection.amounts:
        return "yes" if row.kept else "no"
    if row.largest_kept is None:
        return "no"
    if only_without(row, imperfection):
        return "none"

    amount = imperfection.text(row.largest_kept)
    if row.smallest_failed is not None:
        return amount
    return f"≤ {amount}" if imperfection.limits else f"≥ {amount}"


def only_without(row: Verdict, imperfection: Imperfection) -> bool:
    """Whether all is kept only without it: with less than half a timestep of it at most."""
    return not row.largest_kept or imperfection.amount(row.largest_kept) == 0


def weakness(row: Verdict) -> float:
    """Return the smallest factor that fails, by which tolerances are compared."""
    if row.impossible:
        return 0.0
    if row.smallest_failed is None:
        return math.inf
    return row.smallest_failed


def reason(row: Verdict) -> str:
    """Return the requirement that fails, in words."""
    return spelled(row.tightest)


def amount_text(imperfection: Imperfection, factor: float) -> str:
    """Return the amount for a factor with its unit; of all at once the factor."""
    return f"{imperfection.text(factor)} {imperfection.unit[0]}"
