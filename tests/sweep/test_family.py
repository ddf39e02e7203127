"""The declared uncertainty: its distributions against SciPy's, its samplers, its scaling."""

import itertools
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from campaign_cases import BOTH, CORRELATED, INERTIA, campaign, of, plain
from scipy import stats

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.sweep.family import Distribution, corner_points, distribution, random_points

INF = math.inf
SHARES = np.array([2.0**-53, 1e-6, 0.01, 0.25, 0.5, 0.9, 1 - 1e-6])
D = 3


def drawn(kind: str, unit: str = "", **numbers: Any) -> Distribution:
    return distribution(DistributionTable(distribution=kind, **numbers), unit)


def cut_off(least: float, most: float, mean: float, size: float) -> Any:
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


def test_distributions_are_cut_off_where_the_distribution_function_is_0_and_1() -> None:
    for ours in (
        # 50 standard deviations.
        drawn("normal", mean=1, deviation=0.01, least=0.5, most=2.0),
        drawn("normal", mean=1, deviation=0.01, most=1.9),
        # The median of what is symmetric in its logarithm.
        drawn("lognormal", median=1, spread=0.3, least=0.5, most=2),
    ):
        assert np.all(np.isfinite(ours.quantiles(SHARES)))
        assert ours.quantiles(np.array([0.5])) == pytest.approx(1, rel=1e-14)
    assert drawn("lognormal", median=1, spread=0.3, least=0.5).support == (0.5, INF)


@pytest.mark.parametrize("points", [corner_points, partial(random_points, seed=7)])
def test_a_point_is_the_same_whatever_the_part(points: Callable[..., Array]) -> None:
    cuts = [0, 1, 2, 5, 8]
    parts = [points(D, first=a, count=b - a) for a, b in itertools.pairwise(cuts)]
    assert np.array_equal(np.concatenate(parts), points(D, first=0, count=8))


def test_random_points_of_all_seeds_differ_and_lie_inside_the_cube() -> None:
    starts = itertools.product(range(3), range(0, 192, 64))
    several = [random_points(D, seed, first, 64) for seed, first in starts]
    assert all(np.all((points > 0) & (points < 1)) for points in several)
    # Philox makes four numbers at a time: a point of nine needs three such blocks.
    numbers = np.concatenate([*map(np.ravel, several), random_points(9, 9, 0, 64).ravel()])
    assert len(np.unique(numbers)) == numbers.size


def test_the_corners_are_all_corners() -> None:
    corners = corner_points(D, 0, 8).tolist()
    assert sorted(map(tuple, corners)) == list(itertools.product((0.0, 1.0), repeat=D))


def test_the_copula_correlates_and_keeps_the_marginals() -> None:
    family = campaign(plain(BOTH + CORRELATED.replace("0.5", "-0.8"))).family
    values = family.values(random_points(2, 1, 0, 4096))
    # Spearman's coefficient of a Gaussian copula; its standard error is at most that of none.
    expected, rank = 6 / np.pi * np.arcsin(-0.8 / 2), stats.rankdata(values, axis=0)
    assert abs(np.corrcoef(rank.T)[0, 1] - expected) < 4 / np.sqrt(4096)
    # Largest distance from the uniform distribution that one in 10^4 samples exceeds.
    shares = (np.sort(values, axis=0) - [1, -1]) / 2
    distance = np.abs(shares - (np.arange(4096)[:, None] + 0.5) / 4096).max()
    assert distance < 2.23 / np.sqrt(4096)


def test_nominal_values_are_the_files_own_and_no_disturbance() -> None:
    edited = '[[edit]]\nbody = "rotor"\nmass_scale = 2\n[[edit]]\njoint = "shaft"\ndamping = 0.3\n'
    others = (
        of("joint", "shaft", "damping = [0, 1]")
        + of("disturbance", "load", 'onset = ["0.01 s", "0.03 s"]')
        + of("disturbance", "hum", 'frequency = ["0.5 Hz", "2 Hz"]')
        + of("start", "rotor speed", 'value = ["-1 rad/s", "3 rad/s"]')
    )
    family = campaign(plain(BOTH + others) + edited).family
    assert family.nominal.tolist() == [2.0, 0.0, 0.3, 0.02, 2 * math.pi, 0.0]
    own = campaign(plain(of("body", "rotor", "mass_scale = [1, 2]", "nominal = 1.5")))
    assert own.family.nominal.tolist() == [1.5]


def test_scaling_moves_values_along_the_line_from_the_nominal_ones_as_far_as_they_can_be() -> None:
    family = campaign(plain()).family
    values = family.values(np.array([[0.0, 0.0], [1.0, 0.75]]))
    assert values.tolist() == [[1.0, -1.0], [3.0, 0.5]]
    assert family.scaled(values, 2.0).tolist() == [[1.0, -2.0], [5.0, 1.0]]
    assert family.scaled(values, 0.0).tolist() == [[1.0, 0.0], [1.0, 0.0]]
    # The largest scale is where the least value meets zero.
    for spread, largest in (("[0.5, 2]", 2), ("[0.75, 1]", 4), ("[1, 2]", 8)):
        assert campaign(plain(INERTIA.replace("[1, 3]", spread))).largest_scale == pytest.approx(
            largest, rel=1e-8
        )
    one, other = campaign(plain(), shard=3), campaign(plain(), runs=100, shard=64)
    assert np.array_equal(one.values(range(6, 8)), other.values(range(100))[6:8])
