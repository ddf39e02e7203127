"""Statistics of campaigns against enumeration, closed forms and SciPy's own."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy import stats

from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.campaign.drivers import LEVEL, sensitivities
from grosmc_mj.studies.campaign.paired import paired
from grosmc_mj.studies.sweep.margin_summary import margin_summary
from grosmc_mj.studies.sweep.pass_rates import pass_rate, rate_shown, runs_needed

INF = math.inf


def clopper_pearson(kept: int, runs: int, doubt: float) -> tuple[float, float]:
    """The exact interval by quantiles of the beta distribution, half the doubt at each end."""
    low = stats.beta.ppf(doubt / 2, kept, runs - kept + 1) if kept else 0.0
    high = stats.beta.isf(doubt / 2, kept + 1, runs - kept) if kept < runs else 1.0
    return float(low), float(high)


COUNTS = pytest.mark.parametrize(("kept", "runs"), [(0, 9), (9, 9), (1, 2), (368, 369)])
CONFIDENCES = pytest.mark.parametrize("confidence", [0.5, 0.95])


@COUNTS
@CONFIDENCES
def test_the_interval_of_a_pass_rate_is_exact(kept: int, runs: int, confidence: float) -> None:
    rate = pass_rate(kept, runs, confidence)
    # Rounding of SciPy's root.
    expected = clopper_pearson(kept, runs, 1 - confidence)
    assert (rate.low, rate.high) == pytest.approx(expected, abs=1e-9)
    assert rate.rate == kept / runs


@COUNTS
@CONFIDENCES
def test_the_share_that_is_shown_is_exact(kept: int, runs: int, confidence: float) -> None:
    # So many kept are as unlikely as is allowed at that share.
    share = rate_shown(kept, runs, confidence)
    tail = stats.binom.sf(kept - 1, runs, share) if kept else 1 - confidence
    assert tail == pytest.approx(1 - confidence, rel=1e-9)
    assert (share == 0.0) == (kept == 0)


@pytest.mark.parametrize(("rate", "confidence"), [(1, 500), (500, 937), (500, 938), (990, 999)])
def test_runs_needed_is_the_smallest_number(rate: int, confidence: int) -> None:
    # Exact arithmetic is the oracle.
    share = Fraction(rate, 1000)
    doubt = 1 - Fraction(confidence, 1000)
    runs = runs_needed(rate / 1000, confidence / 1000)
    assert share**runs <= doubt
    assert runs == 1 or share ** (runs - 1) > doubt


NUMBERS_OF_RUNS = pytest.mark.parametrize("runs", [1, 19, 20, 21, 150])
NUMBERS_OF_DIVERGED_RUNS = pytest.mark.parametrize("diverged", [0, 1, 9])


def margins_of(runs: int, diverged: int) -> Array:
    """Return margins of runs, of which the first ones diverged."""
    margins = np.random.default_rng(runs).integers(-9, 9, runs) * 1e5 / 3
    margins[:diverged] = -INF
    return margins


@NUMBERS_OF_RUNS
@NUMBERS_OF_DIVERGED_RUNS
@pytest.mark.parametrize(
    ("percent", "name"),
    [(0, "least"), (1, "q01"), (5, "q05"), (50, "median"), (95, "q95")],
)
def test_a_quantile_has_its_share_of_the_margins_up_to_it(
    percent: int, name: str, runs: int, diverged: int
) -> None:
    margins = margins_of(runs, diverged)
    rising = sorted(margins.tolist())
    at_least = math.ceil(Fraction(percent * runs, 100))
    assert getattr(margin_summary(margins), name) == rising[max(at_least - 1, 0)]


@NUMBERS_OF_RUNS
@NUMBERS_OF_DIVERGED_RUNS
def test_the_value_at_risk_is_the_mean_of_the_worst(runs: int, diverged: int) -> None:
    margins = margins_of(runs, diverged)
    worst = sorted(margins.tolist())[: math.ceil(Fraction(runs, 20))]
    mean = -INF if -INF in worst else math.fsum(worst) / len(worst)
    # Rounding of a sum of at most eight numbers up to 1e6.
    assert margin_summary(margins).cvar == pytest.approx(mean, abs=8e6 * 2.3e-16)


@NUMBERS_OF_RUNS
@NUMBERS_OF_DIVERGED_RUNS
def test_diverged_runs_are_counted(runs: int, diverged: int) -> None:
    margins = margins_of(runs, diverged)
    summary = margin_summary(margins)
    assert (summary.diverged, summary.runs) == (margins.tolist().count(-INF), runs)


@pytest.mark.parametrize("confidence", [0.6, 0.95])
@pytest.mark.parametrize(("b", "c", "runs"), [(3, 7, 40), (0, 5, 9), (9, 0, 9), (0, 0, 1)])
def test_the_difference_of_two_rates_is_exact(b: int, c: int, runs: int, confidence: float) -> None:
    """The first law alone keeps b plants, the second alone c, both the others."""
    first = np.array([1.0] * b + [-1.0] * c + [1.0] * (runs - b - c))
    second = np.array([-1.0] * b + [1.0] * c + [1.0] * (runs - b - c))
    difference = paired(first, second, confidence)

    worse_low, worse_high = clopper_pearson(b, runs, (1 - confidence) / 2)
    better_low, better_high = clopper_pearson(c, runs, (1 - confidence) / 2)
    # Twice the tolerance of SciPy's roots, 2e-12.
    assert difference.low == pytest.approx(better_low - worse_high, abs=4e-12)
    assert difference.high == pytest.approx(better_high - worse_low, abs=4e-12)
    p_value = stats.binomtest(b, b + c).pvalue if b + c else 1.0
    assert difference.p_value == pytest.approx(p_value, rel=1e-9)


@pytest.mark.parametrize("runs", [6, 9, 60])
def test_the_median_is_covered_whatever_the_distribution(runs: int) -> None:
    # The differences are 1 to n: a bound is the number of its order statistic.
    change: Any = paired(np.zeros(runs), np.arange(1.0, runs + 1), 0.95)
    below = np.arange(runs + 1)
    covering = below[(change.median_low <= below) & (below < change.median_high)]
    assert 0.95 <= stats.binom.pmf(covering, runs, 0.5).sum() < 1
    assert change.median == (runs + 1) / 2
    # Any shorter interval of two order statistics that is as symmetric covers less.
    assert stats.binom.pmf(covering[1:-1], runs, 0.5).sum() < 0.95


PAIRS = [
    ([-INF], [-INF], 0),
    ([-INF], [1.0], INF),
    ([1.0, -INF], [-INF, 1.0], 0),
    ([-INF, -INF, 1.0], [-INF, -3.0, 2.0], 1.0),
    ([0.0] * 7, [-INF, *[1.5] * 6], 1.5),
]


@pytest.mark.parametrize(("first", "second", "median"), PAIRS)
def test_the_median_counts_runs_that_did_not_complete(
    first: list[float], second: list[float], median: float
) -> None:
    assert paired(np.array(first), np.array(second)).median == median


@pytest.mark.parametrize(("first", "second"), [(first, second) for first, second, _ in PAIRS])
def test_exchanging_laws_turns_the_difference_round(
    first: list[float], second: list[float]
) -> None:
    forward: Any = paired(np.array(first), np.array(second))
    backward: Any = paired(np.array(second), np.array(first))
    assert backward.median == -forward.median
    assert (backward.low, backward.high) == (-forward.high, -forward.low)
    assert backward.p_value == forward.p_value
    assert (backward.both, backward.neither) == (forward.both, forward.neither)
    assert backward.only_first == forward.only_second
    assert backward.only_second == forward.only_first


@pytest.mark.parametrize(("first", "second"), [(first, second) for first, second, _ in PAIRS])
def test_every_plant_is_counted_once(first: list[float], second: list[float]) -> None:
    pair = paired(np.array(first), np.array(second))
    counted = pair.both + pair.neither + pair.only_first + pair.only_second
    assert counted == pair.runs == len(first)


@pytest.mark.parametrize(("runs", "bins", "sign"), [(64, 8, 1), (400, 20, -1), (1600, 32, 1)])
def test_share_of_the_only_parameter(runs: int, bins: int, sign: int) -> None:
    # Within a bin of m = n / B the ranks vary by m² - 1, in all by n² - 1 (both over 12).
    x = np.random.default_rng(0).permutation(runs).astype(float)
    (driver,) = sensitivities({"x": x}, sign * np.exp(x / runs))
    m = runs // bins
    assert driver.share == pytest.approx(1 - m * (m + 1) / (runs * (runs + 1)), rel=1e-12)
    assert driver.correlation == pytest.approx(sign)


def share_beyond_chance(between: float, groups: int, runs: int) -> float:
    """Share of the variance between groups, less what chance gives."""
    chance = (groups - 1) / (runs - 1)
    return (between - chance) / (1 - chance)


def test_a_share_sees_what_is_not_monotone() -> None:
    x = np.arange(400) - 199.5
    (driver,) = sensitivities({"start angle": x}, -np.abs(x))
    assert driver.correlation == pytest.approx(0, abs=1e-12)
    # A bin of |x| has two of the same: as of the only parameter, in half as many bins.
    m, n = 20, 200
    between = 1 - (m * m - 1) / (n * n - 1)
    assert driver.share == pytest.approx(share_beyond_chance(between, 20, 400), rel=1e-12)


def test_shares_of_independent_parameters_are_those_of_their_variances() -> None:
    # Cells of a factorial plan with mean ranks 0, 1, 2, 3 apart: variances 4 : 1.
    a = np.tile([0.0, 0.0, 1.0, 1.0], 25)
    b = np.tile([0.0, 1.0, 0.0, 1.0], 25)
    columns = {"b": b, "a": a, "c": np.repeat([0.0, 1.0], 50)}
    drivers = sensitivities(columns, 2 * a + b)
    assert [driver.parameter for driver in drivers] == ["a", "b", "c"]
    shares = [share_beyond_chance(0.8, 2, 100), share_beyond_chance(0.2, 2, 100), 0]
    assert [driver.share for driver in drivers] == pytest.approx(shares, rel=1e-12)


def margins_driven_by(values: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Margins of 40 runs of which three did not complete, and finite ones with their ranks."""
    margins = random.normal(size=40).round(1) + values
    margins[:3] = -INF
    # SciPy's own ranks know no -inf; a number below all others has the same rank.
    return margins, np.where(margins == -INF, -1e9, margins)


@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_the_correlation_is_scipy_s(seed: int) -> None:
    random = np.random.default_rng(seed)
    values = random.integers(0, 2, 40).astype(float) if seed % 2 else random.normal(size=40)
    margins, finite = margins_driven_by(values, random)
    (driver,) = sensitivities({"x": values}, margins)
    expected: Any = stats.spearmanr(values, finite)
    assert driver.correlation == pytest.approx(expected.statistic, abs=1e-12)


def test_the_share_is_that_of_kruskal_and_wallis() -> None:
    random = np.random.default_rng(1)
    levels = random.integers(0, 2, 40).astype(float)
    margins, finite = margins_driven_by(levels, random)
    (driver,) = sensitivities({"x": levels}, margins)
    expected = stats.kruskal(finite[levels == 0], finite[levels == 1])
    share = share_beyond_chance(expected.statistic / 39, 2, 40)
    assert driver.share == pytest.approx(share, rel=1e-11)


@pytest.mark.parametrize("effect", [0.0, 0.2])
def test_one_number_has_the_p_value_of_kruskal_and_wallis(effect: float) -> None:
    # Of one number nothing is corrected; 1,999 permutations leave four standard errors.
    random = np.random.default_rng(3)
    levels = random.integers(0, 2, 400).astype(float)
    margins = random.normal(size=400) + effect * levels
    (driver,) = sensitivities({"x": levels}, margins)
    expected = stats.kruskal(margins[levels == 0], margins[levels == 1]).pvalue
    assert driver.p_value == pytest.approx(expected, abs=4 * math.sqrt(0.25 / 2000))


def false_alarms(campaigns: int, runs: int, numbers: int, completed: float) -> int:
    """Campaigns in which a number is named as a driver though none has an influence.

    Args:
        campaigns: Number of campaigns.
        runs: Runs of each.
        numbers: Uncertain numbers of each.
        completed: Share of the runs that complete; the others have a margin of -inf.
    """
    alarms = 0
    for seed in range(campaigns):
        random = np.random.default_rng(seed)
        margins = np.where(random.random(runs) < completed, random.normal(size=runs), -INF)
        values = {f"number {i}": random.random(runs) for i in range(numbers)}
        alarms += sensitivities(values, margins)[0].drives
    return alarms


@pytest.mark.slow
@pytest.mark.parametrize("completed", [1.0, 0.5])
def test_one_in_a_hundred_campaigns_of_irrelevant_numbers_names_a_driver(completed: float) -> None:
    # At a rate of 1 % more alarms than this have a probability of 1e-4; before, 92 % were false.
    most = stats.binom.isf(1e-4, 60, LEVEL)
    assert false_alarms(60, runs=64, numbers=5, completed=completed) <= most


@pytest.mark.parametrize("seed", range(5))
def test_a_number_that_explains_half_of_a_margin_is_named_among_irrelevant_ones(seed: int) -> None:
    random = np.random.default_rng(seed)
    values = {f"number {i}": random.normal(size=64) for i in range(5)}
    margins = values["number 2"] + random.normal(size=64)
    drivers = sensitivities(values, margins)
    assert [driver.parameter for driver in drivers if driver.drives] == ["number 2"]


def test_a_load_that_begins_after_the_end_is_no_driver() -> None:
    # Its amplitude is drawn, but no margin depends on it.
    random = np.random.default_rng(0)
    mass = random.uniform(1, 3, 64)
    drivers = sensitivities({"late load": random.uniform(-1, 1, 64), "mass": mass}, -mass)
    assert {driver.parameter: driver.drives for driver in drivers} == {
        "mass": True,
        "late load": False,
    }


@pytest.mark.parametrize("index", range(3))
def test_a_p_value_is_that_of_the_largest_share_of_all_numbers(index: int) -> None:
    """Of independent numbers with no influence: that one of them shows a share as large."""
    random = np.random.default_rng(1)
    margins = random.normal(size=64)
    values = {f"number {i}": random.random(64) for i in range(3)}
    name = f"number {index}"
    together = {row.parameter: row.p_value for row in sensitivities(values, margins)}[name]
    (alone,) = sensitivities({name: values[name]}, margins)
    expected = 1 - (1 - (alone.p_value or 0)) ** 3
    # Four standard errors of 1,999 permutations, of three times the one alone besides.
    assert together == pytest.approx(expected, abs=4 * math.sqrt((1 + 9) * 0.25 / 2000))


RISING = np.arange(9.0)


def test_a_parameter_that_does_not_vary_comes_last_with_a_note() -> None:
    first, last = sensitivities({"held": np.ones(9), "x": RISING}, RISING)
    assert (first.parameter, last.parameter) == ("x", "held")
    assert last[1:] == (None, None, None, "the number does not vary")


def test_equal_margins_have_no_driver() -> None:
    (driver,) = sensitivities({"x": RISING}, np.full(9, -INF))
    assert (driver.share, driver.note) == (None, "the margins are all the same")


def test_few_runs_have_no_driver() -> None:
    (driver,) = sensitivities({"x": RISING[:2]}, RISING[:2])
    assert (driver.correlation, driver.note) == (None, "fewer than 4 runs")
