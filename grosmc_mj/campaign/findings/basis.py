"""What was sampled, and what that does not prove, in the words of every table and figure."""

from __future__ import annotations

from typing import NamedTuple

NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
_CAVEATS = {
    "random": "",
    "corners": (
        "Corners are extreme plants, no draw from a distribution: "
        "rates and intervals describe these runs only."
    ),
}
_EVEN = (
    "Intervals and p-values hold for independent runs (sampler random); "
    "{} points are spread more evenly than that."
)
_POINTS = {"sobol": "Sobol", "lhs": "Latin hypercube"}


class Basis(NamedTuple):
    """What a statement about a campaign is based on.

    Attributes:
      runs: Runs that are done, of each law.
      planned: Runs that the campaign shall have.
      sampler: sobol, lhs, random or corners.
      seed: The campaign's seed.
    """

    runs: int
    planned: int
    sampler: str
    seed: int

    @property
    def words(self) -> str:
        """For a title: ``512 of 4096 runs, sobol, seed 0``."""
        of = "" if self.runs == self.planned else f" of {self.planned}"
        return f"{self.runs}{of} runs, {self.sampler}, seed {self.seed}"

    @property
    def footnote(self) -> str:
        """What the sample does not prove, and where its intervals are not exact."""
        caveat = _CAVEATS.get(self.sampler, _EVEN.format(_POINTS.get(self.sampler, self.sampler)))
        return f"{NO_PROOF} {caveat}".strip()
