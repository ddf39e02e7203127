"""Search for the tolerance to each imperfection: equations search, MuJoCo confirms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.sweep.confirmation import MarginConfirmation, drawn_at_random
from grosmc_mj.studies.sweep.search import Search, grid_of, run_searches
from grosmc_mj.studies.target import Condition, StudiedLaw
from grosmc_mj.studies.tolerance.imperfections import Imperfection
from grosmc_mj.studies.tolerance.words import with_words
from grosmc_mj.studies.trials import Trial, Trials

# Factors in an octave of the grid that is searched for the first failure: most are no whole
# multiples of the bench's amounts, nor of its control period.
PER_OCTAVE = 4
# The same below the first failure found: sign switching may fail between two that are kept.
FINER = 32
# Factors up to this many times the largest that is kept are tried.
BEYOND = 2.0**5
# Ratio of the smallest factor that fails to the largest that is kept, at which a search ends.
RESOLUTION = 2.0**0.125


def geometric_mean(low: float, high: float) -> float | None:
    """Return the middle of two factors; None if they are near enough to end a search."""
    if high / low <= RESOLUTION * (1 + 1e-9):
        return None
    return math.sqrt(low * high)


class ToleranceSearch(Search):
    """Search for the tolerance of a law to one imperfection under one condition.

    Args:
        law: The law.
        imperfection: The imperfection.
        condition: The condition.
        local: Whether no grid is tried: from the factors that are known on.

    Attributes:
        results: Verdicts by factor; 0 is without the imperfection.
        sure: Factors of which all random runs have been made.
    """

    def __init__(
        self,
        law: StudiedLaw,
        imperfection: Imperfection,
        condition: Condition,
        *,
        local: bool = False,
    ) -> None:
        least = imperfection.least
        most = imperfection.most
        super().__init__(
            geometric_mean,
            most,
            least=least,
            grid=[] if local else grid_of(least, most, PER_OCTAVE),
            beyond=BEYOND,
            # Whether the bench's own amount is kept is answered by a run of it.
            asked=[1.0] if least <= 1.0 <= most else [],
            finer=grid_of(least, most, FINER),
            same=self.trial,
        )
        self.law = law
        self.imperfection = imperfection
        self.condition = condition
        self.results: dict[float, Verdict] = {}
        self.sure: set[float] = set()

    def trial(self, factor: float) -> Trial:
        """Return the trial of a factor."""
        loop = self.imperfection.at(factor)
        return Trial(self.law, self.condition, loop, self.imperfection.control_period(factor))

    def note(self, factor: float, result: Verdict) -> None:
        """Note the verdict on a factor."""
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

    def next_factors(self) -> list[float]:
        """Return the factors to be tried now; none when the search is done."""
        if self.fails_without:
            return []
        if not self.imperfection.amounts:
            return [] if self.known else [1.0]
        return super().next_factors()

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

    def tolerance(self, physics_agrees: bool | None) -> Verdict:
        """Return the answer, in factors on the bench's amounts.

        Args:
            physics_agrees: Whether MuJoCo gives the same; None where it was not run.
        """
        first = self.results[0.0]
        end = self.results.get(self.failed or 0.0, first)
        kept_ideally = first.kept or (bool(first.impossible) and self.largest is not None)
        largest_kept = (self.largest or 0.0) if kept_ideally else None
        smallest_failed = self.failed if kept_ideally else 0.0
        share = math.inf
        if smallest_failed is None:
            share = 0.0
        elif largest_kept:
            share = 1 / largest_kept

        tightest = ""
        if not end.kept:
            tightest = end.tightest or end.ended
        verdict = Verdict(
            law=self.law.name,
            step=self.imperfection.name,
            condition=self.condition.name,
            share=share,
            tightest=tightest,
            ended=end.ended,
            impossible=self.impossible,
            kept_draws=int(share <= 1),
            largest_kept=largest_kept,
            smallest_failed=smallest_failed,
            kept_again=tuple(self.again),
            physics_agrees=physics_agrees,
        )
        return with_words(verdict, self.imperfection)


def search_tolerances(searches: Sequence[ToleranceSearch], trials: Trials) -> None:
    """Run every search to its end, all runs of a round in one batch.

    Where something is random, the first run looks for the amount, and all of them must keep it.
    """
    unknown = [search for search in searches if 0.0 not in search.results]
    ideal = trials.over_draws([search.trial(0.0) for search in unknown])
    for search, verdict in zip(unknown, ideal, strict=True):
        search.note(0.0, verdict)

    def first_runs(tried: Sequence[tuple[ToleranceSearch, float]]) -> list[bool]:
        verdicts = trials.results([(search.trial(factor), 0) for search, factor in tried])
        for (search, factor), verdict in zip(tried, verdicts, strict=True):
            search.note(factor, verdict)
        return [verdict.kept for verdict in verdicts]

    while True:
        run_searches(searches, first_runs)
        unsure = [(search, factor) for search in searches for factor in search.unsure()]
        if not unsure:
            return
        verdicts = trials.over_draws([search.trial(factor) for search, factor in unsure])
        for (search, factor), verdict in zip(unsure, verdicts, strict=True):
            search.note(factor, verdict)
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
            margins[j, i] = 1 - search.results[end].share
    checked = drawn_at_random(count)
    checked[min(range(count), key=lambda i: searches[i].weakness)] = True
    confirmation = MarginConfirmation(margins, np.zeros(count, bool), checked)

    agreed: dict[ToleranceSearch, bool] = {}
    for rows in confirmation.rounds():
        chosen = [searches[i] for i in rows]
        # Noted first: the results of a search that MuJoCo answers otherwise are replaced.
        ends = [
            [(search.trial(end), search.results[end].draw) for end in search.ends]
            for search in chosen
        ]
        confirmed = _confirmed(chosen, physics)
        agreed |= confirmed

        by_physics = np.full((2, len(rows)), np.nan)
        for i, runs in enumerate(ends):
            by_physics[: len(runs), i] = [1 - physics.known[run].share for run in runs]
        overturned = np.array([not confirmed[search] for search in chosen])
        confirmation.note_margins(rows, overturned, by_physics)
    return agreed


def _confirmed(searches: Sequence[ToleranceSearch], physics: Trials) -> dict[ToleranceSearch, bool]:
    """Whether MuJoCo agrees at both ends of each; where it differs, its own answer replaces it.

    Of several runs the one that decides is made.
    """
    ends = [(search, end) for search in searches for end in search.ends]
    runs = [(search.trial(end), search.results[end].draw) for search, end in ends]
    theirs = {
        search: ToleranceSearch(search.law, search.imperfection, search.condition, local=True)
        for search in searches
    }
    differing: dict[ToleranceSearch, ToleranceSearch] = {}
    for (search, end), verdict in zip(ends, physics.results(runs), strict=True):
        theirs[search].note(end, verdict)
        if verdict.kept != search.results[end].kept:
            differing[search] = theirs[search]

    search_tolerances(list(differing.values()), physics)
    for search, other in differing.items():
        search.known = other.known
        search.results = other.results
    return {search: search not in differing for search in searches}
