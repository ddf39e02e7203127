"""Points of the unit cube: each by the seed and its own number, and spread as its sampler says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from campaign_cases import BOTH, LQR, campaign, servo
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from grosmc_mj.arrays import Array
from grosmc_mj.sweep.family import (
    HYPERCUBE,
    SEQUENCE,
    unit_points,
)

DIMENSIONS = 3
INDEPENDENT = ["sobol", "lhs", "random"]


def correlation(points: Array) -> float:
    """Pearson's coefficient of two columns."""
    centred = points - points.mean(axis=0)
    return float(np.mean(centred[:, 0] * centred[:, 1]) / np.prod(centred.std(axis=0)))


@pytest.mark.parametrize("sampler", [*INDEPENDENT, "corners"])
@settings(max_examples=25)
@given(data=st.data())
def test_a_point_is_the_same_whoever_asks(sampler: str, data: st.DataObject) -> None:
    most = 8 if sampler == "corners" else 400
    # Around the seam between two scrambles as well.
    seam = SEQUENCE - 200
    first = 0 if sampler == "corners" else data.draw(st.sampled_from([0, 100, seam]))
    whole = unit_points(sampler, DIMENSIONS, 7, first, most)
    cuts = sorted({0, most, *data.draw(st.lists(st.integers(0, most), max_size=4))})
    parts = [
        unit_points(sampler, DIMENSIONS, 7, first + a, b - a) for a, b in itertools.pairwise(cuts)
    ]
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("sampler", INDEPENDENT)
def test_another_seed_gives_other_points_inside_the_cube(sampler: str) -> None:
    one, other = (unit_points(sampler, DIMENSIONS, seed, 0, 256) for seed in (1, 2))
    assert not np.any(one == other)
    assert np.all((one > 0) & (one < 1))


def test_the_first_points_of_a_sequence_are_scipys_own() -> None:
    known = qmc.Sobol(DIMENSIONS, rng=np.random.default_rng([5, 0])).random_base2(6)
    assert np.array_equal(unit_points("sobol", DIMENSIONS, 5, 0, 64), known)


@pytest.mark.parametrize(("sampler", "block"), [("sobol", SEQUENCE), ("lhs", HYPERCUBE)])
def test_each_block_of_each_seed_is_randomised_anew(sampler: str, block: int) -> None:
    starts = itertools.product(range(3), range(0, 3 * block, block))
    several = [unit_points(sampler, DIMENSIONS, seed, first, 64) for seed, first in starts]
    for one, other in itertools.combinations(several, 2):
        assert not np.any(one == other)


def test_random_points_of_many_dimensions_share_no_numbers() -> None:
    # Philox makes four numbers at a time: a point of nine needs three such blocks.
    points = unit_points("random", 9, 0, 0, 64)
    assert len(np.unique(points)) == points.size


def test_each_sequence_is_a_net() -> None:
    for first in (0, SEQUENCE):
        # A (t, m, s)-net: in each dimension, one point in each of 256 intervals.
        cells = np.sort((unit_points("sobol", DIMENSIONS, 5, first, 256) * 256).astype(int), axis=0)
        assert np.array_equal(cells, np.tile(np.arange(256)[:, None], DIMENSIONS))


def test_each_128_points_of_lhs_are_a_latin_hypercube() -> None:
    points = unit_points("lhs", DIMENSIONS, 3, 0, 4 * HYPERCUBE)
    for cube in points.reshape(4, HYPERCUBE, DIMENSIONS):
        cells = np.sort((cube * HYPERCUBE).astype(int), axis=0)
        assert np.array_equal(cells, np.tile(np.arange(HYPERCUBE)[:, None], DIMENSIONS))


def test_corners_are_all_corners_once() -> None:
    points = unit_points("corners", DIMENSIONS, 0, 0, 8)
    assert {tuple(each) for each in points} == set(itertools.product((0.0, 1.0), repeat=DIMENSIONS))
    assert len(np.unique(points, axis=0)) == 8
    assert set(points.ravel()) == {0.0, 1.0}


def test_random_points_are_uniform_and_independent() -> None:
    points = unit_points("random", 2, 11, 0, 4096)
    # Standard errors of a mean and of a correlation of 4096 points; four of them.
    assert np.abs(points.mean(axis=0) - 0.5).max() < 4 / np.sqrt(12 * 4096)
    assert abs(correlation(points)) < 4 / np.sqrt(4096)


CORRELATED = '[[correlation]]\nbetween = ["rotor mass scale", "load amplitude"]\n'


@pytest.mark.parametrize("coefficient", [-0.8, 0.5])
def test_the_copula_correlates_and_keeps_the_marginals(coefficient: float) -> None:
    tables = f"{BOTH}{CORRELATED}coefficient = {coefficient}\n"
    family = campaign(servo(tables, laws=LQR, limits="")).family
    values = family.values(unit_points("random", 2, 1, 0, 4096))
    # Spearman's coefficient of a Gaussian copula; its standard error is at most that of none.
    expected = 6 / np.pi * np.arcsin(coefficient / 2)
    assert abs(correlation(stats.rankdata(values, axis=0)) - expected) < 4 / np.sqrt(4096)
    # Largest distance from the uniform distribution that one in 10^4 samples exceeds.
    shares = (np.sort(values, axis=0) - [1, -1]) / 2
    distance = np.abs(shares - (np.arange(4096)[:, None] + 0.5) / 4096).max()
    assert distance < 2.23 / np.sqrt(4096)


def test_runs_have_the_values_of_their_number_whatever_the_part() -> None:
    text = servo(laws=LQR, limits="")
    one, other = campaign(text, runs=8, shard=3), campaign(text, runs=100, shard=64)
    assert np.array_equal(one.values(range(6, 8)), other.values(range(100))[6:8])
