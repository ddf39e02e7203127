"""The statistics of campaigns against enumeration, closed forms and definitions."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from grosmc_mj.sweep import statistics
from grosmc_mj.sweep.statistics import pass_rate, rate_shown, runs_needed

INF = math.inf
MARGINS = st.lists(
    st.one_of(st.just(-INF), st.floats(-1e6, 1e6), st.integers(-2, 2).map(float)),
    min_size=1,
    max_size=150,
)


def of_arrays(function):
    """The function, called with lists in place of arrays."""

    def call(*values, **options):
        arrays = [
            {name: np.asarray(column, float) for name, column in value.items()}
            if isinstance(value, dict)
            else np.asarray(value, float)
            if np.ndim(value)
            else value
            for value in values
        ]
        return function(*arrays, **options)

    return call


margin_summary, paired, sensitivities = map(
    of_arrays, (statistics.margin_summary, statistics.paired, statistics.sensitivities)
)


# Pass rates.


@pytest.mark.parametrize("runs", [1, 2, 9, 40])
@pytest.mark.parametrize("confidence", [0.5, 0.95])
def test_interval_covers_every_rate(runs, confidence):
    found = [pass_rate(kept, runs, confidence) for kept in range(runs + 1)]
    for p in np.linspace(0, 1, 201):
        covering = [kept for kept, each in enumerate(found) if each.low <= p <= each.high]
        # Rounding of a sum of `runs` probabilities.
        assert stats.binom.pmf(covering, runs, p).sum() >= confidence - 1e-13


@pytest.mark.parametrize(("kept", "runs"), [(1, 2), (17, 20), (499, 512)])
def test_interval_ends_where_the_tails_are_half_the_doubt(kept, runs):
    found = pass_rate(kept, runs, 0.9)
    assert found.low is not None
    assert found.high is not None
    # Rounding of SciPy's root: |d tail / d p| < 60 at these, times its 1e-9 of p at most.
    assert stats.binom.sf(kept - 1, runs, found.low) == pytest.approx(0.05, abs=1e-7)
    assert stats.binom.cdf(kept, runs, found.high) == pytest.approx(0.05, abs=1e-7)
    assert found.low < found.rate == kept / runs < found.high


@given(rate=st.integers(1, 999), confidence=st.integers(1, 999))
def test_runs_needed_is_the_smallest_number(rate, confidence):
    # Exact arithmetic is the oracle; 0.999 and 0.999 need 6905 runs.
    share, doubt = Fraction(rate, 1000), 1 - Fraction(confidence, 1000)
    runs = runs_needed(rate / 1000, confidence / 1000)
    assert share**runs <= doubt
    assert runs == 1 or share ** (runs - 1) > doubt


@pytest.mark.parametrize(("kept", "runs"), [(1, 2), (299, 299), (368, 369), (950, 1000)])
@pytest.mark.parametrize("confidence", [0.9, 0.95, 0.999])
def test_the_share_that_is_shown_makes_so_many_kept_as_unlikely_as_is_allowed(
    kept, runs, confidence
):
    share = rate_shown(kept, runs, confidence)
    tail = sum(
        math.comb(runs, k) * share**k * (1 - share) ** (runs - k) for k in range(kept, runs + 1)
    )
    assert tail == pytest.approx(1 - confidence, rel=1e-9)
    assert rate_shown(0, runs, confidence) == 0.0


# Margins.


@given(MARGINS)
def test_quantiles_by_their_definition(margins):
    found = margin_summary(margins)
    quantiles = zip((0, 1, 5, 50, 95), found[:5], strict=True)
    for percent, value in quantiles:
        enough = [
            m
            for m in margins
            if Fraction(sum(other <= m for other in margins), len(margins))
            >= Fraction(percent, 100)
        ]
        assert value == min(enough)
    assert found.diverged == margins.count(-INF)
    assert found.runs == len(margins)


@given(MARGINS)
def test_cvar_is_the_mean_of_the_worst(margins):
    worst = sorted(margins)[: math.ceil(Fraction(len(margins), 20))]
    if -INF in worst:
        assert margin_summary(margins).cvar == -INF
    else:
        # Rounding of a sum of at most eight numbers up to 1e6.
        expected = math.fsum(worst) / len(worst)
        assert margin_summary(margins).cvar == pytest.approx(expected, abs=8e6 * 2.3e-16)


# Two laws on the same plants.


@pytest.mark.parametrize("confidence", [0.6, 0.95])
def test_difference_of_rates_is_covered(confidence):
    runs = 6
    counts = [(b, c) for b in range(runs + 1) for c in range(runs + 1 - b)]
    found = {(b, c): _with_counts(b, c, runs, confidence) for b, c in counts}
    shares = np.linspace(0, 1, 9)
    for first, second in itertools.product(shares, shares):
        if first + second > 1:
            continue
        law = stats.multinomial(runs, [first, second, max(1 - first - second, 0.0)])
        covered = sum(
            law.pmf([b, c, runs - b - c])
            for (b, c), each in found.items()
            # Both ends are differences of two numbers up to 1.
            if each.low is not None
            and each.high is not None
            and each.low - 1e-15 <= second - first <= each.high + 1e-15
        )
        assert covered >= confidence - 1e-12


@pytest.mark.parametrize("confidence", [0.6, 0.95])
@pytest.mark.parametrize(("b", "c", "runs"), [(3, 7, 40), (0, 5, 9), (9, 0, 9), (0, 0, 1)])
def test_ends_of_the_difference_are_the_formulas(b, c, runs, confidence):
    # Clopper and Pearson by quantiles of the beta distribution, a quarter of the doubt per end.
    tail = (1 - confidence) / 4

    def ends(kept):
        low = stats.beta.ppf(tail, kept, runs - kept + 1) if kept else 0.0
        return low, stats.beta.isf(tail, kept + 1, runs - kept) if kept < runs else 1.0

    found, worse, better = _with_counts(b, c, runs, confidence), ends(b), ends(c)
    # Twice the tolerance of SciPy's roots, 2e-12.
    assert found.low == pytest.approx(better[0] - worse[1], abs=4e-12)
    assert found.high == pytest.approx(better[1] - worse[0], abs=4e-12)


def _with_counts(b, c, runs, confidence):
    """Margins of which the first law alone keeps b, the second alone c, both the rest."""
    first = [1.0] * b + [-1.0] * c + [1.0] * (runs - b - c)
    second = [-1.0] * b + [1.0] * c + [1.0] * (runs - b - c)
    return paired(first, second, confidence)


@settings(max_examples=25)
@given(st.lists(st.tuples(*[st.sampled_from([-INF, -2.0, 0.0, 1.5])] * 2), min_size=1, max_size=30))
def test_exchanging_the_laws_turns_the_difference_round(margins):
    first, second = zip(*margins, strict=True)
    one, other = paired(first, second), paired(second, first)
    assert (one.only_first, one.only_second) == (other.only_second, other.only_first)
    assert (one.both, one.neither, one.p_value) == (other.both, other.neither, other.p_value)
    assert (one.difference, one.median) == (-other.difference, -other.median)
    for here, there in (
        ((one.low, one.high), (other.low, other.high)),
        ((one.median_low, one.median_high), (other.median_low, other.median_high)),
    ):
        assert here[0] is not None
        assert here[1] is not None
        assert there == (-here[1], -here[0])
    assert one.both + one.neither + one.only_first + one.only_second == one.runs == len(margins)


@pytest.mark.parametrize("runs", [6, 9, 60])
def test_median_is_covered_whatever_the_distribution(runs):
    # The differences are 1 to n: a bound is the number of its order statistic.
    found = paired(np.zeros(runs), np.arange(1.0, runs + 1), 0.95)
    below = np.arange(runs + 1)
    covering = below[(found.median_low <= below) & (below < found.median_high)]
    assert 0.95 <= stats.binom.pmf(covering, runs, 0.5).sum() < 1
    assert found.median == (runs + 1) / 2
    # Any shorter interval of two order statistics that is as symmetric covers less.
    assert stats.binom.pmf(covering[1:-1], runs, 0.5).sum() < 0.95


def test_runs_that_did_not_complete_are_compared():
    assert paired([-INF], [-INF]).median == 0
    assert paired([-INF], [1.0]).median == INF
    assert paired([1.0], [-INF]).median == -INF
    assert paired([1.0, -INF], [-INF, 1.0]).median == 0
    found = paired([-INF, -INF, 1.0], [-INF, -3.0, 2.0])
    assert (found.neither, found.both, found.median) == (2, 1, 1.0)


# What drives a margin.


@pytest.mark.parametrize(("runs", "bins"), [(64, 8), (400, 20), (4096, 32)])
@pytest.mark.parametrize("sign", [1, -1])
def test_share_of_the_only_parameter(runs, bins, sign):
    # Within a bin of m = n / B the ranks vary by m² - 1, in all by n² - 1 (both over 12).
    x = np.random.default_rng(0).permutation(runs)
    (found,) = sensitivities({"x": x}, sign * np.exp(x / runs))
    m = runs // bins
    assert found.share == pytest.approx(1 - m * (m + 1) / (runs * (runs + 1)), rel=1e-12)
    assert found.correlation == pytest.approx(sign)


@pytest.mark.parametrize(("runs", "inner"), [(4, 0.9), (16, 1 - 6 / 4080)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_few_runs_that_agree_are_no_certainty(runs, inner, sign):
    (found,) = sensitivities({"x": np.arange(runs)}, sign * np.arange(runs))
    half = stats.norm.isf(0.025) * np.sqrt((1 + inner**2 / 2) / (runs - 3))
    ends = sorted([sign, sign * np.tanh(np.arctanh(inner) - half)])
    assert (found.low, found.high) == pytest.approx(ends, rel=1e-12)


def test_share_sees_what_is_not_monotone():
    x = np.arange(400) - 199.5
    (found,) = sensitivities({"start angle": x}, -np.abs(x))
    assert found.correlation == pytest.approx(0, abs=1e-12)
    # A bin of |x| has two of the same: as of the only parameter, in half as many bins.
    m, n = 20, 200
    between = 1 - (m * m - 1) / (n * n - 1)
    chance = 19 / 399
    assert found.share == pytest.approx((between - chance) / (1 - chance), rel=1e-12)


def test_shares_of_two_independent_parameters():
    # Cells of a factorial plan with mean ranks 0, 1, 2, 3 apart: variances 4 : 1.
    a, b = (np.tile(each, 25) for each in ([0.0, 0.0, 1.0, 1.0], [0.0, 1.0, 0.0, 1.0]))
    margins = 2 * a + b
    first, second, third = sensitivities({"b": b, "a": a, "c": np.repeat([0.0, 1.0], 50)}, margins)
    chance = 1 / 99
    assert (first.parameter, second.parameter, third.parameter) == ("a", "b", "c")
    assert first.share == pytest.approx((0.8 - chance) / (1 - chance), rel=1e-12)
    assert second.share == pytest.approx((0.2 - chance) / (1 - chance), rel=1e-12)
    assert third.share == 0


def test_chance_gives_the_bias_that_is_taken_off():
    # The mean of the share between two bins over all orders of five runs is (B - 1) / (n - 1).
    between = []
    for margins in itertools.permutations(range(5)):
        (found,) = sensitivities({"x": np.arange(5)}, margins)
        assert found.share is not None
        raw = stats.chi2.isf(found.p_value, 1) / 4
        between.append(raw)
        assert found.share == pytest.approx(max(0, (raw - 0.25) / 0.75), abs=1e-9)
    # Rounding of the tail of chi-squared, there and back.
    assert np.mean(between) == pytest.approx(1 / 4, abs=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_correlation_and_p_value_are_scipys(seed):
    rng = np.random.default_rng(seed)
    levels = rng.integers(0, 2, 40) if seed % 2 else rng.normal(size=40)
    margins = rng.normal(size=40).round(1) + levels
    margins[:3] = -INF
    (found,) = sensitivities({"x": levels}, margins)
    # SciPy's own ranks know no -inf; a number below all others has the same rank.
    finite = np.where(margins == -INF, -1e9, margins)
    expected: Any = stats.spearmanr(levels, finite)
    assert found.correlation == pytest.approx(expected.statistic, abs=1e-12)
    if seed % 2:
        groups = [finite[levels == level] for level in (0, 1)]
        # Next to 1 it goes by the root of H, of which the last digits are rounding.
        statistic = stats.chi2.isf(found.p_value, 1)
        assert statistic == pytest.approx(stats.kruskal(*groups).statistic, rel=1e-11, abs=1e-12)


def test_correlation_is_covered_as_often_as_stated():
    # Normal variables of correlation 0.6 have the rank correlation 6/π arcsin(0.3).
    truth, trials, rng = 6 / math.pi * math.asin(0.3), 400, np.random.default_rng(1)
    covered = 0
    for _ in range(trials):
        x = rng.normal(size=60)
        (found,) = sensitivities({"x": x}, 0.6 * x + 0.8 * rng.normal(size=60), 0.9)
        assert found.low is not None
        assert found.high is not None
        covered += found.low <= truth <= found.high
    # Three standard deviations of a binomial share.
    assert covered / trials == pytest.approx(0.9, abs=3 * math.sqrt(0.9 * 0.1 / trials))


def test_nothing_to_tell_is_said():
    rising = np.arange(9.0)
    found = sensitivities({"held": np.ones(9), "x": rising}, rising)
    assert [each.parameter for each in found] == ["x", "held"]
    assert found[1][1:] == (None, None, None, None, None, "the parameter does not vary")
    (same,) = sensitivities({"x": rising}, np.full(9, -INF))
    assert (same.share, same.note) == (None, "the margins are all the same")
    (few,) = sensitivities({"x": [1.0, 2.0]}, [1.0, 2.0])
    assert (few.correlation, few.note) == (None, "fewer than 4 runs")
