"""The search finds the least of functions that are known."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from grosmc_mj.studies.tune.search import Ranges, Search


class Known:
    """A function of points (n, d), one run each; with racing a loser gets another value."""

    runs_of_point = 1

    def __init__(self, values: Callable[[np.ndarray], np.ndarray], *, races: bool = False) -> None:
        self.values = values
        self.races = races
        self.points: list[np.ndarray] = []

    def __call__(self, points: np.ndarray, beat: np.ndarray) -> tuple[np.ndarray, int]:
        self.points.extend(points)
        values = self.values(points)
        if self.races:
            values = np.where(values > beat, beat + 1e-3, values)
        return values, len(points)


def unit_square(hard: float = math.inf) -> Ranges:
    return Ranges(np.zeros(2), np.ones(2), np.full(2, -hard), np.full(2, hard))


def rosenbrock(points: np.ndarray) -> np.ndarray:
    """Rosenbrock's valley over the square of side 4 about 0; its least value 0 is at (1, 1)."""
    x, y = (4 * points - 2).T
    return (1 - x) ** 2 + 100 * (y - x**2) ** 2


def small_region(points: np.ndarray) -> np.ndarray:
    """A plain with a hole that 0.3 % of a grid of 200 x 200 cells lie in."""
    radius = math.sqrt(0.003 / math.pi)
    distance = np.linalg.norm(points - [0.83, 0.21], axis=1)
    return np.where(distance < radius, 0.5, 1.5)


def test_the_least_of_rosenbrocks_valley_is_found():
    search = Search(Known(rosenbrock), unit_square(), np.full(2, 0.1), budget=600, target=1e-3)
    search.run()
    assert search.reached
    assert search.best is not None
    assert 4 * search.best.point - 2 == pytest.approx([1, 1], abs=0.1)


def test_a_region_of_three_thousandths_is_found_from_nine_of_ten_seeds():
    edges = (np.arange(200) + 0.5) / 200
    grid = np.stack(np.meshgrid(edges, edges), axis=-1).reshape(-1, 2)
    assert np.mean(small_region(grid) < 1) == pytest.approx(0.003, rel=0.05)

    found = 0
    for seed in range(10):
        known = Known(small_region)
        search = Search(known, unit_square(), np.full(2, 0.1), budget=3000, target=0.99, seed=seed)
        search.run()
        found += search.reached
    assert found >= 9


def test_where_the_best_lies_at_an_end_the_range_grows_up_to_its_bound():
    valley = Known(lambda points: np.linalg.norm(points - [2.5, -0.5], axis=1))
    ranges = Ranges(np.zeros(2), np.ones(2), np.array([0.0, -0.25]), np.array([math.inf, 1.0]))
    search = Search(valley, ranges, np.full(2, 0.5), budget=1500, target=0.26)
    search.run()
    assert search.reached
    assert search.best is not None
    assert search.best.point == pytest.approx([2.5, -0.25], abs=0.1)
    assert (0, 1) in ranges.grown
    assert ranges.low.tolist() == [0.0, -0.25]


def test_no_point_lies_outside_ranges_that_cannot_grow():
    slope = Known(lambda points: points.sum(axis=1))
    search = Search(slope, unit_square(0.0), np.full(2, 0.5), budget=300)
    ranges = search.ranges
    ranges.hard_low[:] = 0.0
    ranges.hard_high[:] = 1.0
    search.run()
    points = np.array(slope.points)
    assert points.min() >= 0.0
    assert points.max() <= 1.0
    assert search.best is not None
    assert search.best.point == pytest.approx([0, 0], abs=1e-6)


def test_the_first_point_is_the_one_given():
    known = Known(rosenbrock)
    Search(known, unit_square(), np.array([0.3, 0.6]), budget=12).run()
    assert known.points[0].tolist() == [0.3, 0.6]


@pytest.mark.parametrize("seed", range(3))
def test_values_of_losers_change_nothing(seed: int):
    histories = []
    for races in (False, True):
        known = Known(rosenbrock, races=races)
        search = Search(known, unit_square(), np.full(2, 0.1), budget=400, seed=seed)
        search.run()
        histories.append([(best.value, best.point.tolist()) for best in search.history])
    assert histories[0] == histories[1]


@pytest.mark.parametrize("budget", [1, 11, 12, 30, 257])
def test_no_more_runs_are_made_than_the_budget(budget: int):
    known = Known(rosenbrock)
    search = Search(known, unit_square(), np.full(2, 0.1), budget=budget)
    search.run()
    assert search.runs == len(known.points) == budget


def test_a_search_repeats_to_the_bit():
    first, second = Known(rosenbrock), Known(rosenbrock)
    for known in (first, second):
        Search(known, unit_square(), np.full(2, 0.1), budget=500, seed=3).run()
    assert np.array_equal(first.points, second.points)
