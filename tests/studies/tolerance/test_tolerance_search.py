"""Search for a tolerance: the first failure counts, and MuJoCo looks at the answers in doubt."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from grosmc_mj.output.results.verdicts import Verdict, verdict_of
from grosmc_mj.studies.sweep.confirmation import LEAST_BAND
from grosmc_mj.studies.sweep.search import Search, grid_of, run_searches
from grosmc_mj.studies.tolerance import search as tolerance_search
from grosmc_mj.studies.tolerance.imperfections import LEAST, MOST
from grosmc_mj.studies.tolerance.search import (
    BEYOND,
    FINER,
    PER_OCTAVE,
    RESOLUTION,
    ToleranceSearch,
    confirm_searches,
    geometric_mean,
    search_tolerances,
)
from grosmc_mj.studies.tolerance.tolerance import tolerance_study
from grosmc_mj.studies.trials import Trial


def answered(
    keeps: Callable[[float], bool],
    begin: float = 0.0,
    *,
    most: float = MOST,
    per_octave: int = PER_OCTAVE,
    **options: Any,
) -> Search:
    """A search on its grid, or from where another one ended, which tries no factor twice."""
    search = Search(
        geometric_mean,
        most,
        least=LEAST,
        grid=[] if begin else grid_of(LEAST, most, per_octave),
        beyond=BEYOND,
        finer=grid_of(LEAST, most, FINER),
        **options,
    )
    if begin:
        search.known[begin] = keeps(begin)

    def passing(tried: list[tuple[Search, float]]) -> list[bool]:
        assert not {factor for _, factor in tried} & set(search.known)
        return [keeps(factor) for _, factor in tried]

    run_searches([search], passing)
    return search


@pytest.mark.parametrize(
    ("keeps", "begin", "bound", "again"),
    [
        (lambda x: x <= 0.07, 0.0, 0.07, []),
        (lambda x: x <= 1.0, 0.0, 1.0, []),
        (lambda x: x <= 700.0, 0.0, 700.0, []),
        # Physics walks from where the equations end.
        (lambda x: x <= 5, 0.5, 5, []),
        (lambda x: x <= 5, 40.0, 5, []),
        (lambda x: x <= 3 or 8 <= x <= 16, 0.0, 3, [(8, 16)]),
        # The first failure counts though larger amounts are kept.
        (lambda x: not 0.2 < x < 0.28, 0.0, 0.2, [(2**-1.75, MOST)]),
        # A failure between two of the grid that are kept, as of the servo's sgn with a lag.
        (lambda x: not 1.19 < x < 1.26 and x <= 1.35, 0.0, 1.19, [(2 ** (11 / 32), 2**0.375)]),
        (lambda x: not 1.19 < x < 1.26 and x <= 1.35, 1.3, 1.19, [(2 ** (11 / 32), 1.3)]),
        # Whole multiples of a period may be kept where all else is not.
        (lambda x: x <= 11 or x == 16, 0.0, 11, [(16, 16)]),
    ],
)
def test_the_bound_is_searched_from_below(
    keeps: Callable[[float], bool],
    begin: float,
    bound: float,
    again: list[tuple[float, float]],
) -> None:
    search: Any = answered(keeps, begin)
    resolution = RESOLUTION * 1.001
    assert search.largest <= bound < search.failed <= search.largest * resolution
    assert search.again == again


def test_a_search_halves_the_ratio_of_two_factors() -> None:
    assert geometric_mean(2.0, 18.0) == 6.0


@pytest.mark.parametrize(("keeps", "largest", "failed"), [(True, MOST, None), (False, None, LEAST)])
def test_a_search_without_a_bound_ends_at_its_largest_or_least_factor(
    keeps: bool, largest: float | None, failed: float | None
) -> None:
    search = answered(lambda _: keeps)
    assert (search.largest, search.failed, search.again) == (largest, failed, [])


def test_a_grid_ends_at_the_largest_factor() -> None:
    bounded = answered(lambda _: True, most=3.0, per_octave=1)
    assert sorted(bounded.known) == [0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 3.0]


def test_times_on_a_grid_are_tried_once() -> None:
    coarse: Any = answered(lambda x: round(4 * x) <= 5, same=lambda x: round(4 * x))
    assert (round(4 * coarse.largest), round(4 * coarse.failed)) == (5, 6)


# The bench's own amount.


def result(share: float, draw: int = 0) -> Verdict:
    """The verdict on a run that uses this share of its limit."""
    return verdict_of({"deviation_below": share}, draw=draw)


def search_for(name: str, *, local: bool = False) -> ToleranceSearch:
    """A search about the servo's GROSMC by sgn and one of its imperfections."""
    studied = tolerance_study("servo", ["sign"])
    return ToleranceSearch(studied.laws[0], studied.kinds[name], studied.conditions[0], local=local)


@pytest.mark.parametrize("kept_at_the_bench", [True, False])
def test_the_bench_s_own_amount_is_run(*, kept_at_the_bench: bool) -> None:
    """Physics begins where the equations end, at 0.98 and 1.06 of the bench."""
    search = search_for("actuator lag", local=True)
    kept = {0.0: True, 0.98: True, 1.0: kept_at_the_bench, 1.06: False}
    factors = [0.0, 0.98, 1.06]
    while factors:
        for factor in factors:
            passes = kept.get(factor, factor < 1.0)
            search.note(factor, result(0.5 if passes else 1.5))
        factors = search.next_factors()
    assert 1.0 in search.results
    assert search.tolerance(physics_agrees=False).kept is kept_at_the_bench


def test_the_bench_s_own_amount_is_kept_in_all_draws() -> None:
    search = search_for("computing missed")
    for factor in (1.0, 2.0):
        search.note(factor, result(0.5))
    assert search.unsure() == [2.0, 1.0]


# Confirmation in MuJoCo.


class AnsweredSearch:
    """A search that the equations have answered at one end, with this margin."""

    ends = (1.0,)

    def __init__(self, margin: float, largest: float) -> None:
        self.results = {1.0: result(1 - margin)}
        self.weakness = (False, largest)

    def trial(self, _: float) -> AnsweredSearch:
        return self


LEAST_OF_ALL = AnsweredSearch(0.5, 1.0)


def looked_at(
    band: float, difference: float, monkeypatch: pytest.MonkeyPatch, *, agrees: bool = True
) -> set[float]:
    """Margins, in bands, of the searches that MuJoCo looks at besides the least of all.

    Args:
        band: Band about a limit that is expected.
        difference: What the margin of the least search differs by in MuJoCo.
        monkeypatch: The patches.
        agrees: Whether the answers of MuJoCo are those of the equations.
    """
    bands = {AnsweredSearch(share * band, 2.0): share for share in (0.99, -0.99, 1.01, -1.01)}
    searches: Any = [LEAST_OF_ALL, *bands]
    known = {(search, 0): search.results[1.0] for search in searches}
    known[LEAST_OF_ALL, 0] = result(1 - 0.5 - difference)
    physics: Any = SimpleNamespace(known=known)

    monkeypatch.setattr(tolerance_search, "drawn_at_random", lambda count: np.zeros(count, bool))
    monkeypatch.setattr(tolerance_search, "_confirmed", lambda c, _: dict.fromkeys(c, agrees))
    confirmed = set(confirm_searches(searches, physics))
    assert LEAST_OF_ALL in confirmed
    return {share for search, share in bands.items() if search in confirmed}


@pytest.mark.parametrize(("difference", "band"), [(0.01, 0.1), (0.0, LEAST_BAND)])
def test_physics_looks_within_ten_times_the_largest_difference_of_a_margin(
    difference: float, band: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert looked_at(band, difference, monkeypatch) == {0.99, -0.99}


def test_physics_looks_at_every_tolerance_once_one_differs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    everything = {0.99, -0.99, 1.01, -1.01}
    assert looked_at(LEAST_BAND, 0.0, monkeypatch, agrees=False) == everything


def test_an_imperfection_that_a_law_does_not_stand_ideally_is_the_weakest() -> None:
    fails_without = search_for("actuator lag")
    fails_without.note(0.0, result(1.5))
    stands_little = search_for("actuator lag")
    stands_little.note(0.0, result(0.5))
    stands_little.note(1.0, result(1.5))
    assert stands_little.weakness < fails_without.weakness
    assert fails_without.next_factors() == []
    tolerance = fails_without.tolerance(physics_agrees=None)
    assert (tolerance.largest_kept, tolerance.share) == (None, math.inf)


class MadeUpRuns:
    """Runs that keep all up to an actuator's lag [s]."""

    def __init__(self, largest: float) -> None:
        self.largest = largest
        self.known: dict[tuple[Trial, int], Verdict] = {}

    def results(self, runs: list[tuple[Trial, int]]) -> list[Verdict]:
        for trial, draw in runs:
            actuators = trial.loop.actuators if trial.loop else ()
            lag = max((actuator.lag for actuator in actuators), default=0.0)
            self.known[trial, draw] = result(lag / self.largest)
        return [self.known[run] for run in runs]

    def over_draws(self, trials: list[Trial]) -> list[Verdict]:
        return self.results([(trial, 0) for trial in trials])


@pytest.mark.parametrize("factor", [1.2, 2.7, 5.0])
def test_where_physics_differs_its_own_answer_counts(factor: float) -> None:
    search = search_for("actuator lag")
    bench = search.imperfection.amount(1.0)
    equations: Any = MadeUpRuns(2.7 * bench)
    physics: Any = MadeUpRuns(factor * bench)
    search_tolerances([search], equations)
    (agrees,) = confirm_searches([search], physics).values()
    found: Any = search.tolerance(agrees)
    assert found.physics_agrees is (factor == 2.7)
    assert found.largest_kept <= factor < found.smallest_failed < 1.1 * found.largest_kept
