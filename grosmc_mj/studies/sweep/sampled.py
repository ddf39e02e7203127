"""Runs that a statement about a campaign rests on, and the words of its statistics."""

from __future__ import annotations

from typing import NamedTuple

from grosmc_mj.ground.wording import plural, unit_after
from grosmc_mj.output.results.tables import number

NO_PROOF = "Absence of failures among the runs sampled is no proof that there are none."
# The ranges are somebody's declaration, their distributions a choice.
DESIGN = "Shares are of the declared design, not probabilities."
# Names of what every run is rated by, beside the file's requirements.
ALL = "all requirements"
COMPLETES = "completes"


class SampledRuns(NamedTuple):
    """Runs that a statement about a campaign rests on.

    Attributes:
        runs: Number of runs of each law that are done.
        planned: Number of runs of a complete campaign.
        sampler: random or corners.
        seed: The campaign's seed.
    """

    runs: int
    planned: int
    sampler: str
    seed: int

    @property
    def words(self) -> str:
        """Text for a title: ``512 of 4096 runs, random, seed 0``."""
        runs = f"{self.runs}"
        if self.runs != self.planned:
            runs += f" of {self.planned}"
        return f"{runs} {plural(self.planned, 'run')}, {self.sampler}, seed {self.seed}"

    @property
    def independent(self) -> bool:
        """Whether the runs are independent random draws, which alone give intervals."""
        return self.sampler == "random"

    @property
    def intervals(self) -> str:
        """Clause on how intervals are computed, or why there are none."""
        if self.independent:
            return "intervals and p: of independent runs"
        return f"no interval: --sampler {self.sampler} draws no independent runs; random does"

    @property
    def footnote(self) -> str:
        """Limits of the sample: unproved claims, the population of its shares, its intervals."""
        sentence = self.intervals[0].upper() + self.intervals[1:]
        return f"{NO_PROOF} {DESIGN} {sentence}."

    @property
    def sentences(self) -> str:
        """The last lines of every legend: the sample and its limits."""
        return f"{self.words}. {self.footnote}"


def p_value_words(p: float | None) -> str:
    """Return a p-value; a dash where there is none."""
    if p is None:
        return "-"
    if p < 1e-4:
        return "< 1e-4"
    return f"{p:.2g}"


def between(
    unit: str,
    value: float,
    low: float | None,
    high: float | None,
) -> str:
    """Return a signed number over its interval, if it has one; an end may be open."""
    words = f"{_signed(value)}{unit_after(unit)}"
    if low is None:
        return words
    return f"{words}\n({_signed(low)} .. {_signed(high)})"


def _signed(value: float | None) -> str:
    """A number with its sign."""
    sign = "+" if value and value > 0 else ""
    return sign + number(value)
