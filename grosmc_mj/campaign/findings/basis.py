"""The sample that a statement rests on, and what the sample does not prove."""

from __future__ import annotations

from typing import NamedTuple

NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
# The ranges are somebody's declaration, their distributions a choice.
DESIGN = "Shares are of the declared design, not probabilities."
_POINTS = {
    "sobol": "points of a Sobol sequence",
    "lhs": "points of Latin hypercubes",
    "corners": "corners of the ranges",
}


class Basis(NamedTuple):
    """The runs that a statement about a campaign rests on.

    Attributes:
      runs: Runs that are done, of each law.
      planned: Runs that the campaign shall have.
      sampler: random, sobol, lhs or corners.
      seed: The campaign's seed.
    """

    runs: int
    planned: int
    sampler: str
    seed: int

    @property
    def words(self) -> str:
        """For a title: ``512 of 4096 runs, random, seed 0``."""
        of = "" if self.runs == self.planned else f" of {self.planned}"
        return f"{self.runs}{of} runs, {self.sampler}, seed {self.seed}"

    @property
    def independent(self) -> bool:
        """Whether the runs are independent random draws, which alone give intervals."""
        return self.sampler == "random"

    @property
    def no_interval(self) -> str:
        """Why statements have no interval, as a clause; empty if they have one."""
        if self.independent:
            return ""
        points = _POINTS.get(self.sampler, f"points of {self.sampler}")
        return f"no interval: {points} are not independent runs; --sampler random draws those"

    @property
    def intervals(self) -> str:
        """How intervals are computed, or why there are none, as a sentence."""
        reason = self.no_interval or "intervals and p: of independent runs"
        return f"{reason[0].upper()}{reason[1:]}."

    @property
    def footnote(self) -> str:
        """Limits of the sample: unproved claims, the population of its shares, its intervals."""
        return f"{NO_PROOF} {DESIGN} {self.intervals}"
