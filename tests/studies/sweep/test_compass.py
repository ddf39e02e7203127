"""Compass search, where the worst point is known."""

from collections.abc import Callable

import numpy as np
import pytest

from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.sweep.compass import CompassSearch

CUBE = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
STARTS = np.random.default_rng(0).random((4, 3))
WORST = np.array([1.0, 0.0, 0.3])


def linear(points: Array) -> Array:
    """Least in a corner."""
    return points @ np.array([-1.0, 2.0, 0.5])


def least_of_two(points: Array) -> Array:
    """Least of margins, not differentiable at the worst point."""
    return np.abs(points - WORST).max(axis=1) - 1.0


def searched(order: Callable[[Array], Array], most: int) -> CompassSearch:
    """A search from four random starts."""
    search = CompassSearch(order, CUBE)
    search.descend(STARTS, search.judge(STARTS), most)
    return search


def test_a_corner_is_reached_exactly() -> None:
    assert searched(linear, 10_000).point.tolist() == [1.0, 0.0, 0.0]


def test_a_kink_is_found_to_a_step() -> None:
    np.testing.assert_allclose(searched(least_of_two, 10_000).point, WORST, atol=1 / 128)


def hole(points: Array) -> Array:
    """A plain with a hole that only the last start lies in."""
    distance = np.abs(points - [0.5, 0.25, 0.75]).sum(axis=1)
    return np.where(distance < 0.4, 8 * distance - 4.0, 1.0)


def test_the_worst_start_is_followed_first_and_leads_to_the_worst_point() -> None:
    """It is three steps away; the runs are enough for four starts, and all others lead nowhere."""
    starts = np.array([[0.0, 0.0, 0.0]] * 7 + [[0.375, 0.125, 0.875]])
    search = CompassSearch(hole, CUBE)
    search.descend(starts, search.judge(starts), 8 + 4 * 6 * 8)
    assert search.point.tolist() == [0.5, 0.25, 0.75]
    assert search.order == -4.0


@pytest.mark.parametrize("most", [4, 50, 200])
def test_no_more_runs_are_made_than_are_allowed(most: int) -> None:
    assert searched(linear, most).runs <= most


def test_the_worst_point_is_no_better_than_any_start() -> None:
    search = searched(linear, 4)
    assert search.order == linear(STARTS).min()


def test_the_bounds_are_kept() -> None:
    search = CompassSearch(linear, np.array([[0.1] * 3, [0.9] * 3]))
    search.descend(STARTS, search.judge(STARTS), 10_000)
    assert search.point.tolist() == [0.9, 0.1, 0.1]
