"""Summary of a screening: runs that the equations judged, and verdicts that MuJoCo overturned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.campaign.screening import EQUATIONS
from grosmc_mj.studies.sweep.confirmation import confirmation_words, wrong_at_most

# Runs that MuJoCo overturned are named, up to so many.
_NAMED = 16


class ScreeningSummary(NamedTuple):
    """Shares of the equations and of MuJoCo in judging the runs of one controller.

    Attributes:
        runs: Number of runs.
        by_equations: Number of runs that the equations judged; MuJoCo judged the others.
        overturned: Number of runs of which MuJoCo overturned a verdict of the equations.
        overturned_runs: Numbers of the first of these.
        band: The band about a limit within which margins were confirmed, in parts of it.
        difference: Largest difference of a least margin that was confirmed, in parts of a limit.
        drawn: Number of runs that were confirmed by chance alone.
        drawn_overturned: Number of these of which MuJoCo overturned a verdict.
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
        """Bound on the share of the runs by equations of which MuJoCo would overturn a verdict."""
        return wrong_at_most(self.drawn, self.drawn_overturned)

    @classmethod
    def of(cls, rows: Mapping[str, Array]) -> ScreeningSummary:
        """Return the summary of one controller's rows."""
        difference = np.abs(rows["screened"] - rows["relative"])
        overturned = rows["overturned"] > 0
        drawn = rows["drawn"] > 0
        return cls(
            runs=len(overturned),
            by_equations=int((rows["judged_by"] == EQUATIONS).sum()),
            overturned=int(overturned.sum()),
            overturned_runs=rows["id"][overturned][:_NAMED].astype(int).tolist(),
            band=float(rows["band"].max()),
            difference=float(difference[np.isfinite(difference)].max(initial=0.0)),
            drawn=int(drawn.sum()),
            drawn_overturned=int((drawn & overturned).sum()),
        )


def screening_sentences(summaries: Mapping[str, ScreeningSummary]) -> str:
    """Say who judged all runs, and what is known of their verdicts.

    Args:
        summaries: By law.

    Returns:
        Sentences; nothing where MuJoCo judged all.
    """
    by_equations = sum(summary.by_equations for summary in summaries.values())
    band = max((summary.band for summary in summaries.values()), default=0.0)
    # Without a model in MuJoCo nothing is screened: equations are the plant.
    if not by_equations or not band:
        return ""

    runs = sum(summary.runs for summary in summaries.values())
    difference = max(summary.difference for summary in summaries.values())
    sentences = [
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit; margins confirmed differ by {difference:.2g})."
    ]
    for law, summary in summaries.items():
        if summary.drawn:
            words = confirmation_words(summary.drawn, summary.drawn_overturned)
            sentences.append(f"{law}: {words}.")
        if summary.overturned:
            runs_named = ", ".join(map(str, summary.overturned_runs))
            if summary.overturned > len(summary.overturned_runs):
                runs_named += ", ..."
            sentences.append(f"MuJoCo overturned {summary.overturned}: {runs_named}.")
    return " ".join(sentences)
