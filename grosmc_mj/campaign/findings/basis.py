"""What was sampled, and what that does not prove, in the words of every table and figure."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from grosmc_mj.campaign.findings.replicates import Draws

NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
# What a share is of: ranges that somebody declared, with distributions that are a choice.
DESIGN = "Shares are of the declared design, not probabilities."
_NOT_INDEPENDENT = "neither independent nor in replicates; --sampler sobol or random gives one"
_WHY_NOT = {
    "sobol": "no interval: points of one Sobol sequence, of an older version, are no replicates",
    "lhs": f"no interval: Latin hypercube points are {_NOT_INDEPENDENT}",
    "corners": "no interval: corners are extreme plants, no draw",
}


class Basis(NamedTuple):
    """What a statement about a campaign is based on.

    Attributes:
      runs: Runs that are done, of each law.
      planned: Runs that the campaign shall have.
      sampler: sobol, lhs, random or corners.
      seed: The campaign's seed.
      replicates: Independent ones that the runs belong to in turn; 0 if to none.
    """

    runs: int
    planned: int
    sampler: str
    seed: int
    replicates: int = 0

    @property
    def words(self) -> str:
        """For a title: ``512 of 4096 runs, sobol, seed 0``."""
        of = "" if self.runs == self.planned else f" of {self.planned}"
        return f"{self.runs}{of} runs, {self.sampler}, seed {self.seed}"

    @property
    def why_not(self) -> str:
        """Why its statements have no intervals; empty if they have."""
        return "" if self.replicates else _WHY_NOT.get(self.sampler, "")

    @property
    def independent(self) -> bool:
        """Whether statistics of independent runs hold."""
        return not self.replicates and not self.why_not

    @property
    def intervals(self) -> str:
        """What its intervals are, or why there are none, as a sentence."""
        if self.replicates:
            return (
                f"Intervals and p: Student's t over the means of {self.replicates} independently "
                "scrambled replicates, approximate near 0 and 100 %."
            )
        if self.why_not:
            return f"{self.why_not[0].upper()}{self.why_not[1:]}."
        return "Intervals and p: of independent runs."

    @property
    def footnote(self) -> str:
        """What the sample does not prove, what its shares are of, and what intervals it gives."""
        return f"{NO_PROOF} {DESIGN} {self.intervals}"

    def draws(self, ids: NDArray[Any]) -> Draws:
        """How runs of these numbers were drawn."""
        return Draws(ids % self.replicates if self.replicates else None, self.why_not)
