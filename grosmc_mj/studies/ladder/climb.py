"""Climb of a law: its verdicts rung by rung, from its equations to the complete machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from grosmc_mj.experiments.measured import MEASURED
from grosmc_mj.output.results.verdicts import Verdict, by_law

# Groups of steps: a rung with all rungs below it, and a rung alone on a sampled plant.
UP_TO = "up to"
ALONE = "alone"
# Rungs that decide nothing of the model's: the book's misprints, and the real machine.
_BESIDE = ("printed", MEASURED)


def climbs(rows: Iterable[Verdict], condition: str) -> dict[str, list[Verdict]]:
    """Return the climb of each law that has begun to climb under a condition."""
    climbing = [row for row in rows if (row.group, row.condition) == (UP_TO, condition)]
    return by_law(row for row in climbing if row.step not in _BESIDE)


def fallen(rungs: Sequence[Verdict], claim: str) -> Verdict | None:
    """Return the first rung on which a claim is not kept; None if it is kept wherever judged."""
    for row in rungs:
        if row.claims.get(claim, 0.0) > 1:
            return row
    return None
