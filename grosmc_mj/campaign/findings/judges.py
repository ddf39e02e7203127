"""Who judged the runs of a campaign, and how many verdicts of the equations may be wrong."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.campaign.runs.part import DRAWN, DRAWN_OVERTURNED, OVERTURNED, SCREENED, Counts

# How many runs are named, and with which confidence the share of wrong verdicts is bounded.
_NAMED, CONFIDENCE = 16, 0.95


class Judges(NamedTuple):
    """Who judged the runs of one controller.

    Attributes:
        runs: How many there are.
        by_equations: How many of them the equations judged; MuJoCo the others.
        overturned: Of how many MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The band about a limit within which margins were confirmed, in parts of it.
        difference: Largest difference of a least margin that was confirmed, in parts of a limit.
        drawn: Runs that were confirmed by chance alone.
        drawn_overturned: Of how many of these MuJoCo overturned a verdict.
    """

    runs: int
    by_equations: int
    overturned: int
    overturned_runs: list[int]
    band: float
    difference: float
    drawn: int
    drawn_overturned: int

    @property
    def wrong_at_most(self) -> float:
        """Share of the runs that equations judge of which MuJoCo would overturn a verdict, at most.

        One-sided bound of Clopper and Pearson at 95 %, from the runs confirmed by chance.
        """
        if not self.drawn:
            return 1.0
        test = stats.binomtest(self.drawn_overturned, self.drawn, alternative="less")
        return float(test.proportion_ci(CONFIDENCE, method="exact").high)


def judges_of(counts: Counts, columns: Mapping[str, Mapping[str, Array]]) -> dict[str, Judges]:
    """Who judged, by controller; none where runs were not to be screened.

    Args:
        counts: Of all runs.
        columns: ``id``, ``relative``, ``screened``, ``overturned`` and ``band`` of the first runs,
            by controller.
    """
    return {
        law: Judges(
            runs=count["runs"],
            by_equations=count[SCREENED],
            overturned=count[OVERTURNED],
            overturned_runs=own["id"][own["overturned"] > 0][:_NAMED].astype(int).tolist(),
            band=float(own["band"].max(initial=0.0)),
            difference=_difference(own["screened"], own["relative"]),
            drawn=count[DRAWN],
            drawn_overturned=count[DRAWN_OVERTURNED],
        )
        for law, count in counts.items()
        if SCREENED in count
        for own in [columns[law]]
    }


def _difference(screened: Array, relative: Array) -> float:
    """Largest difference of two columns of margins, of runs that completed in both."""
    both = np.isfinite(screened) & np.isfinite(relative)
    return float(np.abs(screened[both] - relative[both]).max(initial=0.0))


def judged_words(judges: Mapping[str, Judges]) -> str:
    """Who judged all runs, and what is known of their verdicts; empty where MuJoCo judged all."""
    by_equations = sum(judge.by_equations for judge in judges.values())
    runs = sum(judge.runs for judge in judges.values())
    if not by_equations:
        return ""
    band, difference = (
        max(getattr(judge, name) for judge in judges.values()) for name in ("band", "difference")
    )
    sentences = [
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit; margins confirmed differ by {difference:.2g})."
    ]
    if difference > band:
        sentences.append("That is more than the band: --screen none judges all in MuJoCo.")
    for law, judge in judges.items():
        sentences.append(
            f"{law}: of {judge.drawn} confirmed at random, {judge.drawn_overturned} overturned: at "
            f"most {100 * judge.wrong_at_most:.2g} % of those by the equations at "
            f"{100 * CONFIDENCE:g} %."
        )
        if judge.overturned:
            more = ", ..." if judge.overturned > len(judge.overturned_runs) else ""
            named = ", ".join(map(str, judge.overturned_runs))
            sentences.append(f"MuJoCo overturned {judge.overturned}: {named}{more}.")
    return " ".join(sentences)
