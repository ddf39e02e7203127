"""Intervals from independently scrambled replicates, against SciPy's and against simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from campaign_cases import DEVIATION, LQR, campaign, kept, servo
from scipy import stats

from grosmc_mj.campaign.family.sampling import REPLICATES, unit_points
from grosmc_mj.campaign.findings.basis import Basis
from grosmc_mj.campaign.findings.findings import ALL, findings
from grosmc_mj.campaign.findings.pairing import paired
from grosmc_mj.campaign.findings.replicates import (
    AGREE,
    INDEPENDENT,
    Draws,
    interval_of_mean,
    student,
)
from grosmc_mj.campaign.findings.sensitivity import sensitivities
from grosmc_mj.campaign.findings.statistics import (
    margin_summary,
    pass_rate,
    replicated_pass_rate,
)
from grosmc_mj.errors import ArgumentError

SOBOL = Basis(64, 64, "sobol", 0, REPLICATES)


def scipys(means, confidence):
    """SciPy's interval of Student's test."""
    found = stats.ttest_1samp(means, 0.0).confidence_interval(confidence)
    return found.low, found.high


@pytest.mark.parametrize("confidence", [0.5, 0.95])
@pytest.mark.parametrize("means", [[0.25, 0.75], [0.5, 0.5, 0.625, 0.75], np.arange(16) / 40])
def test_the_interval_is_students(means, confidence):
    found = student(np.array(means), confidence)
    assert (found.low, found.high) == pytest.approx(scipys(means, confidence), rel=1e-12)
    assert found.p_value == pytest.approx(stats.ttest_1samp(means, 0)[1], rel=1e-12)
    assert found.note == ""


def test_a_pass_rate_is_of_the_replicates_own_rates():
    kept_runs = [20, 24, 25, 27] * 4
    found = replicated_pass_rate(kept_runs, [32] * 16, 0.9)
    assert (found.kept, found.runs, found.rate) == (384, 512, 0.75)
    assert (found.low, found.high) == pytest.approx(scipys(np.array(kept_runs) / 32, 0.9))


def test_a_pass_rate_stays_between_none_and_all():
    found = replicated_pass_rate([1] + [2] * 15, [2] * 16, 0.95)
    assert found.high == 1.0
    assert scipys([0.5] + [1.0] * 15, 0.95)[1] > 1.0
    assert replicated_pass_rate([1] + [0] * 15, [2] * 16, 0.95).low == 0.0


def test_replicates_of_unequal_size_count_by_their_means_and_empty_ones_not_at_all():
    found = replicated_pass_rate([2, 1, 0, 0], [3, 2, 2, 0], 0.95)
    assert (found.kept, found.runs) == (3, 7)
    assert (found.low, found.high) == pytest.approx(
        np.clip(scipys([2 / 3, 1 / 2, 0.0], 0.95), 0, 1)
    )


@pytest.mark.parametrize("each", [0, 8, 5])
def test_replicates_that_agree_give_no_interval_and_say_so(each):
    found = replicated_pass_rate([each] * 16, [8] * 16)
    assert (found.low, found.high, found.rate) == (None, None, each / 8)
    assert found.note == "no interval: all replicates agree; --sampler random gives one"


def test_one_replicate_gives_no_interval():
    found = replicated_pass_rate([3, 0], [4, 0])
    assert (found.low, found.note) == (None, "no interval: there are runs of one replicate only")
    with pytest.raises(ArgumentError, match="no replicate has runs"):
        replicated_pass_rate([0, 0], [0, 0])


@pytest.mark.slow
def test_the_interval_covers_a_known_share_as_often_as_it_says():
    seeds, points = 400, 8 * REPLICATES
    # Of the unit square, x + y < 3/4 is 9/32; no boundary lies along a Sobol net's.
    covered = 0
    for seed in range(seeds):
        kept_runs = (unit_points("sobol", 2, seed, 0, points).sum(axis=1) < 0.75).reshape(-1, 16)
        found = replicated_pass_rate(kept_runs.sum(axis=0).tolist(), [8] * REPLICATES, 0.95)
        assert found.low is not None
        assert found.high is not None
        covered += found.low <= 9 / 32 <= found.high
    # What a binomial count of 400 at 95 % leaves once in 10^4 times on either side.
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], seeds, 0.95)
    assert low <= covered <= high


@pytest.mark.slow
def test_clopper_and_pearsons_is_wider_than_replicates_need():
    points = unit_points("sobol", 2, 0, 0, 4096).sum(axis=1) < 0.75
    ours = replicated_pass_rate(points.reshape(-1, 16).sum(axis=0).tolist(), [256] * 16)
    theirs = pass_rate(int(points.sum()), 4096)
    assert ours.low is not None
    assert ours.high is not None
    assert theirs.low is not None
    assert theirs.high is not None
    assert ours.high - ours.low < (theirs.high - theirs.low) / 2


# Mean margins, pairs and drivers.


def test_a_mean_margin_has_the_interval_of_its_draws():
    margins = np.random.default_rng(0).normal(size=64)
    replicated = margin_summary(margins, 0.9, SOBOL.draws(np.arange(64)))
    means = margins.reshape(-1, REPLICATES).mean(axis=0)
    assert (replicated.mean_low, replicated.mean_high) == pytest.approx(scipys(means, 0.9))
    alone = margin_summary(margins, 0.9)
    assert (alone.mean_low, alone.mean_high) == pytest.approx(scipys(margins, 0.9))
    assert alone.mean == replicated.mean == pytest.approx(margins.mean())


def test_runs_are_of_the_replicates_that_their_numbers_say():
    draws = SOBOL.draws(np.array([5, 6, 21, 22]))
    found = interval_of_mean(np.array([0.0, 4.0, 1.0, 6.0]), draws, 0.95)
    assert (found.low, found.high) == pytest.approx(scipys([0.5, 5.0], 0.95))


@pytest.mark.parametrize(
    ("values", "draws", "why"),
    [
        (np.ones(32), SOBOL.draws(np.arange(32)), AGREE),
        (np.ones(32), INDEPENDENT, "no interval: all runs agree"),
        (np.ones(1), INDEPENDENT, "no interval: there is one run only"),
        (np.array([-math.inf, 1.0]), INDEPENDENT, "no interval: a run did not complete"),
        (np.arange(9.0), Draws(None, "no interval: corners"), "no interval: corners"),
        (np.array([0.0, 2.2e-213]), Draws(np.array([0, 1])), AGREE),
    ],
)
def test_a_mean_without_an_interval_says_why(values, draws, why):
    assert interval_of_mean(values, draws, 0.95) == (None, None, None, why)


def test_a_difference_is_of_the_replicates_own_differences():
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=64), rng.normal(0.5, size=64)
    found = paired(first, second, 0.95, SOBOL.draws(np.arange(64)))
    gained = ((second >= 0).astype(float) - (first >= 0)).reshape(-1, REPLICATES).mean(axis=0)
    assert (found.low, found.high) == pytest.approx(scipys(gained, 0.95))
    own = [(law >= 0).reshape(-1, REPLICATES).mean(axis=0) for law in (second, first)]
    assert found.p_value == pytest.approx(stats.ttest_rel(*own).pvalue)
    assert (found.median_low, found.median_high) == (None, None)
    # Counts and medians are those of the runs, whoever drew them.
    alone = paired(first, second)
    assert found[:6] == alone[:6]
    assert found.median == alone.median


def test_a_difference_of_all_runs_has_no_interval_of_replicates():
    found = paired(-np.ones(32), np.ones(32), 0.95, SOBOL.draws(np.arange(32)))
    assert (found.difference, found.low, found.p_value, found.note) == (1.0, None, None, AGREE)


def test_drivers_have_p_and_intervals_of_independent_runs_only():
    x = np.random.default_rng(2).normal(size=64)
    (alone,) = sensitivities({"x": x}, x**3 + 1)
    (replicated,) = sensitivities({"x": x}, x**3 + 1, 0.95, SOBOL.draws(np.arange(64)))
    assert None not in alone
    assert replicated == alone._replace(low=None, high=None, p_value=None)


# What a campaign's findings make of it.


@pytest.mark.parametrize(("sampler", "says"), [("lhs", "Latin hyper"), ("corners", "no draw")])
def test_points_that_are_neither_give_no_interval(sampler, says, tmp_path):
    asked = campaign(servo(laws=LQR, limits=DEVIATION), sampler=sampler, runs=4)
    rate = findings(asked, kept(asked, tmp_path), 0.9).rates[ALL, "lqr"]
    assert (rate.runs, rate.low, rate.high) == (4, None, None)
    assert rate.note.startswith("no interval: ")
    assert says in rate.note


def test_random_runs_have_clopper_and_pearsons_and_mcnemars(tmp_path):
    asked = campaign(servo(), sampler="random")
    folder = kept(asked, tmp_path)
    found = findings(asked, folder, 0.9)
    own = {
        law: each["relative"] for law, each in folder.columns(asked, ["relative"], [0, 1]).items()
    }
    assert found.rates[ALL, "lqr"] == pass_rate(int((own["lqr"] >= 0).sum()), 8, 0.9)
    assert found.differences[ALL, "lqr", "grosmc"] == paired(own["lqr"], own["grosmc"], 0.9)


def test_sobol_runs_have_their_replicates(tmp_path):
    asked = campaign(servo(laws=LQR, limits=DEVIATION), runs=40, shard=16)
    folder = kept(asked, tmp_path)
    own = folder.columns(asked, ["relative"], range(3))["lqr"]["relative"] >= 0
    # 40 are two and a half times 16: eight replicates have three runs, eight two.
    rates = [own[replicate::REPLICATES].mean() for replicate in range(REPLICATES)]
    found = findings(asked, folder, 0.9)
    rate = found.rates[ALL, "lqr"]
    assert (rate.low, rate.high) == pytest.approx(scipys(rates, 0.9))
    assert (rate.kept, rate.runs) == (own.sum(), 40)
    assert found.sampled.replicates == REPLICATES
