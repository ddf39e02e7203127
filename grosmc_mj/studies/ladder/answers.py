"""What the standings of a target say together, in words and numbers that people read."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from grosmc_mj.results.tables import number
from grosmc_mj.studies.ladder.measure import ENDED, Standing

# Said of a law, or of a claim, that no rung breaks.
STANDS = "stands"


def of_law(rows: Sequence[Standing], law: str, condition: str) -> list[Standing]:
    """A law's way up, rung by rung, from equations that are true."""
    return [
        row
        for row in rows
        if row.together
        and row.rung.plant != "printed"
        and row.law.name == law
        and row.condition.name == condition
    ]


def first_failed(rows: Sequence[Standing]) -> Standing | None:
    """The first rung on which something is not kept; None if all is kept on all."""
    return next((row for row in rows if not row.kept), None)


def fallen(rows: Sequence[Standing], claim: str) -> Standing | None:
    """The first rung on which a claim is not kept; None if it is kept wherever it is judged."""
    return next((row for row in rows if row.claims.get(claim, 0.0) > 1), None)


def judged_claims(rows: Sequence[Standing]) -> list[str]:
    """Ids of the claims that are judged on some rung, in the order of the file."""
    return list(dict.fromkeys(claim for row in rows for claim in row.claims))


def fall_text(rows: Sequence[Standing], claim: str) -> str:
    """Where a claim falls on a law's way up; empty of one that is not about this law."""
    if not any(claim in row.claims for row in rows):
        return ""
    row = fallen(rows, claim)
    return STANDS if row is None else row.rung.name


def share_text(row: Standing) -> str:
    """How much of the tightest limit is used, or why there is no number."""
    return cell_text(row.used, row.worst, row.impossible)


def cell_text(used: float, worst: str, impossible: str) -> str:
    """The same of a standing's numbers: 0.31, 8.2x, never."""
    if impossible:
        return "-"
    if worst == ENDED:
        return "ended"
    if math.isinf(used):
        return "never"
    return f"{number(used)}x" if used > 1 else number(used)


def deviation_text(deviation: float | None, worst: str, scale: float) -> str:
    """A distance from the optimum, in the unit of its scale."""
    if deviation is None:
        return "ended" if worst == ENDED else "-"
    return number(deviation * scale)


def reason(row: Standing) -> str:
    """What breaks on a rung, in words."""
    if row.impossible:
        return row.impossible
    if row.worst == ENDED:
        return row.worst
    what = row.worst.replace("_", " ")
    return f"{what}: never" if math.isinf(row.used) else f"{what}: {number(row.used)} times"


def verdict(rows: Sequence[Standing], condition: str) -> str:
    """Up to where laws climb, and what breaks most of them."""
    laws = list(dict.fromkeys(row.law.name for row in rows))
    ways = {law: of_law(rows, law, condition) for law in laws}
    standing = [law for law, way in ways.items() if way and way[-1].kept]
    failed = {law: row.rung.name for law, way in ways.items() if (row := first_failed(way))}
    breaks = Counter(rung for law, rung in failed.items() if law not in standing)
    said = f"{len(standing)} of {len(laws)} laws keep everything on the whole machine"
    if below := sum(law in failed for law in standing):
        said += f", {below} of them not on every rung below it"
    if not breaks:
        return f"{said}."
    most = ", ".join(f"{name} breaks {count}" for name, count in breaks.most_common(3))
    return f"{said}; {most}."
