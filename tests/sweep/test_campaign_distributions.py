"""Distributions of uncertain numbers, against scipy's distribution functions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from grosmc_mj.experiments.file.schema import DistributionTable
from grosmc_mj.sweep.family import Distribution, distribution

SHARES = np.array([2.0**-53, 1e-6, 0.01, 0.25, 0.5, 0.9, 1 - 1e-6])


def made(**table: Any) -> Distribution:
    """A distribution of pure numbers."""
    return distribution(DistributionTable(**table), "")


WHOLE = [
    (made(distribution="uniform", least=-1, most=3), stats.uniform(-1, 4)),
    (made(distribution="loguniform", least=0.1, most=10), stats.loguniform(0.1, 10)),
    (made(distribution="triangular", least=1, mode=2, most=5), stats.triang(0.25, 1, 4)),
    (made(distribution="triangular", least=1, mode=1, most=5), stats.triang(0, 1, 4)),
    (made(distribution="triangular", least=1, mode=5, most=5), stats.triang(1, 1, 4)),
    (made(distribution="normal", mean=2, deviation=0.5), stats.norm(2, 0.5)),
    (made(distribution="lognormal", median=2, spread=0.5), stats.lognorm(0.5, scale=2)),
]


@pytest.mark.parametrize(("found", "known"), WHOLE, ids=lambda each: getattr(each, "words", ""))
def test_quantiles_invert_the_distribution_function(found: Distribution, known: Any) -> None:
    values = found.quantiles(SHARES)
    # Rounding of a value moves its share by the density there; all densities here are below 12.
    np.testing.assert_allclose(known.cdf(values), SHARES, rtol=1e-12, atol=1e-15)
    assert found.support == known.support()


@given(
    least=st.floats(-3, 1), width=st.floats(0.1, 4), mean=st.floats(-1, 1), size=st.floats(0.5, 2)
)
def test_a_cut_off_normal_is_scipys_truncated_one(
    least: float, width: float, mean: float, size: float
) -> None:
    most = least + width
    found = made(distribution="normal", mean=mean, deviation=size, least=least, most=most)
    known = stats.truncnorm((least - mean) / size, (most - mean) / size, mean, size)
    # Shares near 1 lose digits in both: the tails begin at least 1e-16 from it.
    np.testing.assert_allclose(found.quantiles(SHARES), known.ppf(SHARES), rtol=1e-9, atol=1e-9)
    assert found.support == (least, most)


@pytest.mark.parametrize(("least", "most"), [(0.5, 2.0), (-math.inf, 1.9), (0.1, math.inf)])
def test_ends_far_out_in_the_tails_are_kept(least: float, most: float) -> None:
    # 50 standard deviations: the distribution function is 0 and 1 there.
    ends = {"least": least, "most": most}
    table = {name: value for name, value in ends.items() if math.isfinite(value)}
    found = made(distribution="normal", mean=1, deviation=0.01, **table)
    assert found.support == (least, most)
    assert np.all(np.isfinite(found.quantiles(SHARES)))


def test_a_lognormal_is_cut_off_on_one_side_or_both() -> None:
    low = made(distribution="lognormal", median=1, spread=0.3, least=0.5)
    assert low.support == (0.5, math.inf)
    both = made(distribution="lognormal", median=1, spread=0.3, least=0.5, most=2)
    assert both.support == (0.5, 2)
    # The median of what is symmetric in its logarithm.
    symmetric = both.quantiles(np.array([0.5]))
    assert symmetric == pytest.approx(1, rel=1e-14)


def test_the_spread_of_a_lognormal_has_no_unit() -> None:
    table = DistributionTable(distribution="lognormal", median="500 g", spread=0.3)
    found = distribution(table, "kg")
    assert found.quantiles(np.array([0.5])) == pytest.approx(0.5, rel=1e-14)
    assert found.words == "lognormal: median 0.5, spread 0.3"


def test_the_ends_of_a_range_are_its_corners() -> None:
    found = distribution(["0 deg", "360 deg"], "rad")
    assert found.quantiles(np.array([0.0, 1.0])).tolist() == [0.0, 2 * math.pi]
