"""Search for the tolerance to each imperfection: equations search, MuJoCo confirms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grosmc_mj.studies.sweep.confirmation import MarginConfirmation, drawn_at_random
from grosmc_mj.studies.sweep.search import Search
from grosmc_mj.studies.target import Condition
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.row import Tolerance
from grosmc_mj.studies.tolerance.trials import Trial, TrialResult, Trials

# Factors in an octave of the grid that is searched for the first failure: most are no whole
# multiples of the bench's amounts, nor of its control period.
PER_OCTAVE = 4
# The same below the first failure found: sign switching may fail between two that are kept.
FINER = 32
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Ratio of the smallest factor that fails to the largest that is kept, at which a search ends.
RESOLUTION = 2.0**0.125


def geometric_mean(low: float, high: float) -> float:
    """Return the middle of two factors."""
    return math.sqrt(low * high)


def resolved(low: float, high: float) -> bool:
    """Whether two factors are near enough to end a search."""
    return high / low <= RESOLUTION * (1 + 1e-9)


class ToleranceSearch(Search):
    """Search for the tolerance of a law to one imperfection under one condition."""

    def __init__(self, imperfection: Imperfection, condition: Condition) -> None:
        super().__init__(
            imperfection.most,
            geometric_mean,
            resolved,
            least=imperfection.least,
            per_octave=PER_OCTAVE,
            same=self.trial,
        )
        self.imperfection = imperfection
        self.condition = condition
        self.results: dict[float, TrialResult] = {}
        # Factors of which all random runs have been made.
        self.sure: set[float] = set()

    def trial(self, factor: float) -> Trial:
        """Return the trial of a factor."""
        loop = self.imperfection.at(factor)
        return Trial(self.condition, loop, self.imperfection.control_period(factor))

    def note(self, factor: float, result: TrialResult) -> None:
        """Note the result of a factor."""
        self.results[factor] = result
        if factor > 0:
            self.known[factor] = result.kept

    @property
    def fails_without(self) -> bool:
        """Whether it fails without the imperfection, so that less of it cannot help."""
        return not self.results[0.0].kept and not self.results[0.0].impossible

    @property
    def weakness(self) -> tuple[bool, float]:
        """Key of the least search; a condition that is not kept ideally comes last."""
        return self.fails_without, self.largest or 0.0

    @property
    def impossible(self) -> str:
        """Why such a loop cannot exist, with any amount; empty if it can."""
        reasons = [result.impossible for factor, result in self.results.items() if factor > 0]
        if reasons and all(reasons):
            return reasons[0]
        return ""

    @property
    def ends(self) -> list[float]:
        """The largest factor that is kept, 0 if none is, and the smallest that fails."""
        ends = [self.largest or 0.0]
        if self.failed is not None and not self.impossible:
            ends.append(self.failed)
        return ends

    def next_factors(self, *, local: bool) -> list[float]:
        """Return the factors to be tried now, near those that were tried or on the grid."""
        if self.fails_without:
            return []
        if not self.imperfection.amounts:
            return [] if self.known else [1.0]
        factors = self.factors() if local else self.on_grid(BEYOND)
        if factors:
            return factors
        # Whether the bench's own amount is kept is answered by a run of it.
        if self.imperfection.least <= 1.0 <= self.imperfection.most and 1.0 not in self.known:
            return [1.0]
        return self.finely(FINER)

    def unsure(self) -> list[float]:
        """Return the kept factors that count and are known from the first run alone.

        They are the largest one, and the bench's own.
        """
        factors: list[float] = []
        for factor in dict.fromkeys((self.largest, 1.0)):
            if factor is None or factor in self.sure or not self.known.get(factor, False):
                continue
            if self.imperfection.at(factor).drawn:
                factors.append(factor)
        return factors

    def tolerance(self, law: str, agrees: bool | None) -> Tolerance:
        """Return the answer for a law."""
        first = self.results[0.0]
        end = self.results.get(self.failed or 0.0, first)
        return Tolerance(
            law=law,
            imperfection=self.imperfection,
            condition=self.condition.name,
            kept_ideally=first.kept or (bool(first.impossible) and self.largest is not None),
            largest_kept=self.largest or 0.0,
            smallest_failed=self.failed,
            kept_again=self.again,
            breaks="" if end.kept else end.worst,
            physics_agrees=agrees,
            impossible=self.impossible,
        )


def run_searches(
    searches: Sequence[ToleranceSearch], trials: Trials, *, local: bool = False
) -> None:
    """Run every search to its end, all runs of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    unknown = [search for search in searches if 0.0 not in search.results]
    ideal = trials.worst([search.trial(0.0) for search in unknown])
    for search, outcome in zip(unknown, ideal, strict=True):
        search.note(0.0, outcome)

    while True:
        tried = [(search, x) for search in searches for x in search.next_factors(local=local)]
        if tried:
            outcomes = trials.results([(search.trial(factor), 0) for search, factor in tried])
            for (search, factor), outcome in zip(tried, outcomes, strict=True):
                search.note(factor, outcome)
            continue

        unsure = [(search, factor) for search in searches for factor in search.unsure()]
        if not unsure:
            return
        outcomes = trials.worst([search.trial(factor) for search, factor in unsure])
        for (search, factor), outcome in zip(unsure, outcomes, strict=True):
            search.note(factor, outcome)
            search.sure.add(factor)


def confirm_searches(
    searches: Sequence[ToleranceSearch], physics: Trials
) -> dict[ToleranceSearch, bool]:
    """Confirm the least answer, some at random and all that are next to a limit.

    If MuJoCo differs on one that was not next to a limit, it confirms all.

    Returns:
        Whether MuJoCo agrees, of each search that it confirmed.
    """
    count = len(searches)
    margins = np.full((2, count), np.nan)
    for i, search in enumerate(searches):
        for j, end in enumerate(search.ends):
            margins[j, i] = search.results[end].margin
    checked = drawn_at_random(count)
    checked[min(range(count), key=lambda i: searches[i].weakness)] = True
    confirmation = MarginConfirmation(margins, np.zeros(count, bool), checked)

    agreed: dict[ToleranceSearch, bool] = {}
    while True:
        rows = confirmation.rows()
        if not len(rows):
            return agreed
        chosen = [searches[i] for i in rows]
        # Noted first: the results of a search that MuJoCo answers otherwise are replaced.
        ends = [
            [(search.trial(end), search.results[end].number) for end in search.ends]
            for search in chosen
        ]
        confirmed = _confirmed(chosen, physics)
        agreed |= confirmed

        by_physics = np.full((2, len(rows)), np.nan)
        for i, runs in enumerate(ends):
            by_physics[: len(runs), i] = [physics.known[run].margin for run in runs]
        overturned = np.array([not confirmed[search] for search in chosen])
        confirmation.note_margins(rows, overturned, by_physics)


def _confirmed(searches: Sequence[ToleranceSearch], physics: Trials) -> dict[ToleranceSearch, bool]:
    """Whether MuJoCo agrees at both ends of each; where it differs, its own answer replaces it.

    Of several runs the one that decides is made.
    """
    ends = [(search, end) for search in searches for end in search.ends]
    runs = [(search.trial(end), search.results[end].number) for search, end in ends]
    theirs = {search: ToleranceSearch(search.imperfection, search.condition) for search in searches}
    differing: dict[ToleranceSearch, ToleranceSearch] = {}
    for (search, end), outcome in zip(ends, physics.results(runs), strict=True):
        theirs[search].note(end, outcome)
        if outcome.kept != search.results[end].kept:
            differing[search] = theirs[search]

    run_searches(list(differing.values()), physics, local=True)
    for search, other in differing.items():
        search.known = other.known
        search.results = other.results
    return {search: search not in differing for search in searches}
