"""Declared uncertainty: its distributions against SciPy's, its samplers, its scaling."""

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from campaigns import AMPLITUDE, BETWEEN_BOTH, BOTH, MASS, campaign, plain, uncertain
from scipy import stats

from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.sweep.distributions import Distribution, distribution
from grosmc_mj.studies.sweep.family import corner_points, random_points

INF = math.inf
SHARES = np.array([2.0**-53, 1e-6, 0.01, 0.25, 0.5, 0.9, 1 - 1e-6])
D = 3


def drawn(kind: str, unit: str = "", **numbers: Any) -> Distribution:
    """The distribution of a table."""
    return distribution(DistributionTable(distribution=kind, **numbers), unit)


def cut_off(least: float, most: float, mean: float, size: float) -> Any:
    """SciPy's normal distribution within an interval."""
    return stats.truncnorm((least - mean) / size, (most - mean) / size, mean, size)


@pytest.mark.parametrize(
    ("ours", "scipys"),
    [
        (drawn("uniform", least=-1, most=3), stats.uniform(-1, 4)),
        (drawn("loguniform", least=0.1, most=10), stats.loguniform(0.1, 10)),
        (drawn("triangular", least=1, mode=2, most=5), stats.triang(0.25, 1, 4)),
        (drawn("triangular", least=1, mode=1, most=5), stats.triang(0, 1, 4)),
        (drawn("triangular", least=1, mode=5, most=5), stats.triang(1, 1, 4)),
        (drawn("normal", mean=2, deviation=0.5), stats.norm(2, 0.5)),
        (drawn("lognormal", median=2, spread=0.5), stats.lognorm(0.5, scale=2)),
        (drawn("lognormal", "kg", median="500 g", spread=0.3), stats.lognorm(0.3, scale=0.5)),
        (drawn("normal", mean=0.5, deviation=2, least=-1, most=3), cut_off(-1, 3, 0.5, 2)),
        (drawn("normal", mean=0.5, deviation=2, most=3), cut_off(-INF, 3, 0.5, 2)),
        (drawn("normal", mean=0.5, deviation=0.5, least=0), cut_off(0, INF, 0.5, 0.5)),
        (distribution(["0 deg", "360 deg"], "rad"), stats.uniform(0, 2 * math.pi)),
    ],
)
def test_quantiles_invert_the_distribution_function(ours: Distribution, scipys: Any) -> None:
    # Rounding of a value moves its share by the density there; all densities here are below 12.
    np.testing.assert_allclose(scipys.cdf(ours.quantiles(SHARES)), SHARES, rtol=1e-12, atol=1e-15)
    assert ours.support == scipys.support()


@pytest.mark.parametrize(
    "ours",
    [
        # 50 standard deviations.
        drawn("normal", mean=1, deviation=0.01, least=0.5, most=2.0),
        drawn("normal", mean=1, deviation=0.01, most=1.9),
        # The median of what is symmetric in its logarithm.
        drawn("lognormal", median=1, spread=0.3, least=0.5, most=2),
    ],
)
def test_a_distribution_is_cut_off_where_its_function_is_0_or_1(ours: Distribution) -> None:
    assert np.all(np.isfinite(ours.quantiles(SHARES)))
    assert ours.quantiles(np.array([0.5])) == pytest.approx(1, rel=1e-14)


def test_an_end_that_is_not_given_is_infinite() -> None:
    assert drawn("lognormal", median=1, spread=0.3, least=0.5).support == (0.5, INF)


@pytest.mark.parametrize("points", [corner_points, partial(random_points, seed=7)])
def test_a_point_is_the_same_whatever_the_part(points: Callable[..., Array]) -> None:
    cuts = [0, 1, 2, 5, 8]
    parts = [points(D, first=a, count=b - a) for a, b in itertools.pairwise(cuts)]
    assert np.array_equal(np.concatenate(parts), points(D, first=0, count=8))


SEEDS = (0, 1, 2)
FIRST = (0, 64, 128)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("first", FIRST)
def test_random_points_lie_inside_the_cube(seed: int, first: int) -> None:
    points = random_points(D, seed, first, 64)
    assert np.all((points > 0) & (points < 1))


def test_no_random_number_occurs_twice() -> None:
    """In points of all seeds."""
    starts = itertools.product(SEEDS, FIRST)
    points = [random_points(D, seed, first, 64).ravel() for seed, first in starts]
    # Philox makes four numbers at a time: a point of nine needs three such blocks.
    points.append(random_points(9, 9, 0, 64).ravel())
    numbers = np.concatenate(points)
    assert len(np.unique(numbers)) == numbers.size


def test_the_corners_are_all_corners() -> None:
    corners = corner_points(D, 0, 8).tolist()
    assert sorted(map(tuple, corners)) == list(itertools.product((0.0, 1.0), repeat=D))


N = 4096


@pytest.fixture(scope="module")
def correlated() -> Array:
    """Values of two correlated numbers, (n, 2)."""
    opposed = {**BETWEEN_BOTH, "coefficient": -0.8}
    return campaign(plain(correlation=opposed)).family.values(random_points(2, 1, 0, N))


def test_the_copula_correlates(correlated: Array) -> None:
    # Spearman's coefficient of a Gaussian copula; its standard error is at most that of none.
    expected = 6 / np.pi * np.arcsin(-0.8 / 2)
    ranks = stats.rankdata(correlated, axis=0)
    assert abs(np.corrcoef(ranks.T)[0, 1] - expected) < 4 / np.sqrt(N)


def test_the_copula_keeps_the_marginals(correlated: Array) -> None:
    # Both are uniform, of width 2 from 1 and -1.
    shares = (np.sort(correlated, axis=0) - [1, -1]) / 2
    expected = (np.arange(N)[:, None] + 0.5) / N
    # Largest distance from the uniform distribution that one in 10^4 samples exceeds.
    assert np.abs(shares - expected).max() < 2.23 / np.sqrt(N)


def test_nominal_values_are_those_of_the_file_and_no_disturbance() -> None:
    edits = [{"body": "rotor", "mass_scale": 2}, {"joint": "shaft", "damping": 0.3}]
    numbers = [
        *BOTH,
        uncertain("edit.shaft.damping", 0, 1),
        uncertain("disturbance.load.onset", "0.01 s", "0.03 s"),
        uncertain("disturbance.hum.frequency", "0.5 Hz", "2 Hz"),
        uncertain("run.start.rotor speed", "-1 rad/s", "3 rad/s"),
    ]
    nominal = campaign(plain(*numbers, edit=edits)).family.nominal.tolist()
    assert nominal == [2.0, 0.0, 0.3, 0.02, 2 * math.pi, 0.0]


def test_a_search_moves_over_all_of_a_range_and_up_to_a_tail_without_an_end() -> None:
    heavier = {"distribution": "lognormal", "median": 2, "spread": 0.1, "least": 1.5}
    speed = {"distribution": "normal", "mean": "0 rad/s", "deviation": "2 rad/s"}
    unbounded = uncertain("run.start.rotor speed", speed)
    numbers = [AMPLITUDE, uncertain("edit.rotor.mass_scale", heavier), unbounded]
    low, high = campaign(plain(*numbers)).family.search_bounds
    assert low.tolist() == [0.0, 0.0, 0.001]
    assert high.tolist() == [1.0, 0.999, 0.999]


def test_a_nominal_value_may_be_given() -> None:
    assert campaign(plain({**MASS, "nominal": 1.5})).family.nominal.tolist() == [1.5]


def test_scaling_moves_values_along_the_line_from_the_nominal_ones() -> None:
    family = campaign(plain()).family
    values = family.values(np.array([[0.0, 0.0], [1.0, 0.75]]))
    assert values.tolist() == [[1.0, -1.0], [3.0, 0.5]]
    assert family.scaled(values, 2.0).tolist() == [[1.0, -2.0], [5.0, 1.0]]
    assert family.scaled(values, 0.0).tolist() == [[1.0, 0.0], [1.0, 0.0]]


@pytest.mark.parametrize(
    ("least", "largest"),
    # Where the least value meets zero; without such a value it is 8.
    [(0.5, 2), (0.75, 4), (1, 8)],
)
def test_the_largest_scale_is_where_a_value_is_impossible(least: float, largest: float) -> None:
    declared = campaign(plain(uncertain("edit.rotor.mass_scale", least, 2)))
    assert declared.largest_scale == pytest.approx(largest, rel=1e-8)


def test_values_of_a_run_depend_on_its_number_alone() -> None:
    small = campaign(plain(), shard=3)
    large = campaign(plain(), runs=100, shard=64)
    assert np.array_equal(small.values(range(6, 8)), large.values(range(100))[6:8])
