"""By what the runs of a campaign were judged, and what MuJoCo overturned of the equations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.runs.part import OVERTURNED, SCREENED, ReplicateCounts

# How many runs are named.
_NAMED = 16


class Judges(NamedTuple):
    """Who judged the runs of one controller.

    Attributes:
        runs: How many there are.
        by_equations: How many of them the equations judged; MuJoCo the others.
        overturned: Of how many MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The widest band about a limit within which margins were confirmed, in parts of it.
    """

    runs: int
    by_equations: int
    overturned: int
    overturned_runs: list[int]
    band: float


def judges_of(
    counts: ReplicateCounts, columns: Mapping[str, Mapping[str, Array]]
) -> dict[str, Judges]:
    """Who judged, by controller; none where runs were not to be screened.

    Args:
        counts: Of all runs.
        columns: ``id``, ``overturned`` and ``band`` of the first runs, by controller.
    """
    return {
        law: Judges(
            runs=int(each["runs"].sum()),
            by_equations=int(each[SCREENED].sum()),
            overturned=int(each[OVERTURNED].sum()),
            overturned_runs=_first(columns[law]["id"][columns[law]["overturned"] > 0]),
            band=float(columns[law]["band"].max(initial=0.0)),
        )
        for law, each in counts.items()
        if SCREENED in each
    }


def _first(ids: Array) -> list[int]:
    """The first few."""
    return ids[:_NAMED].astype(np.int64).tolist()


def judged_words(judges: Mapping[str, Judges]) -> str:
    """One sentence on who judged all runs; empty where the equations judged none."""
    several = judges.values()
    by_equations = sum(each.by_equations for each in several)
    runs = sum(each.runs for each in several)
    if not by_equations:
        return ""
    band = max(each.band for each in several)
    said = (
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit); "
    )
    wrong = [
        f"{law} {', '.join(map(str, each.overturned_runs))}"
        + (", ..." if each.overturned > len(each.overturned_runs) else "")
        for law, each in judges.items()
        if each.overturned
    ]
    if not wrong:
        return f"{said}no verdict overturned."
    count = sum(each.overturned for each in several)
    return f"{said}MuJoCo overturned verdicts of {count}: {'; '.join(wrong)}."
