"""Judges of a campaign's runs: how many the equations judged, and what MuJoCo overturned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.sweep.confirmation import confirmation_words, wrong_at_most
from grosmc_mj.sweep.screening import EQUATIONS

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
        """Count the judges of one controller's rows."""
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


def screening_sentences(judges: Mapping[str, ScreeningSummary]) -> str:
    """Say who judged all runs, and what is known of their verdicts.

    Args:
        judges: By law.

    Returns:
        Sentences; nothing where MuJoCo judged all.
    """
    by_equations = sum(judge.by_equations for judge in judges.values())
    band = max((judge.band for judge in judges.values()), default=0.0)
    # Without a model in MuJoCo nothing is screened: equations are the plant.
    if not by_equations or not band:
        return ""

    runs = sum(judge.runs for judge in judges.values())
    difference = max(judge.difference for judge in judges.values())
    sentences = [
        f"{by_equations:,} of {runs:,} runs judged by the equations, {runs - by_equations:,} in "
        f"MuJoCo (band {band:.2g} of a limit; margins confirmed differ by {difference:.2g})."
    ]
    for law, judge in judges.items():
        if judge.drawn:
            words = confirmation_words(judge.drawn, judge.drawn_overturned)
            sentences.append(f"{law}: {words}.")
        if judge.overturned:
            runs_named = ", ".join(map(str, judge.overturned_runs))
            if judge.overturned > len(judge.overturned_runs):
                runs_named += ", ..."
            sentences.append(f"MuJoCo overturned {judge.overturned}: {runs_named}.")
    return " ".join(sentences)
