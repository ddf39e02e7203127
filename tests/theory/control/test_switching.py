"""Switching laws: accuracy and chattering against sample time, bounds, limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.switching import (
    LAWS,
    RHO,
    VARIATION_OF_W,
    L,
    ScalarRun,
    W,
    crossings,
    law_for,
    order_of,
    scalar_run,
    scalar_samples,
)
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.switching import SWITCHINGS, find_switching

H = 1e-3
TIMES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)
# Two ways to one number of a few operations each: a few units in the last place.
ROUNDING = 1e-14


@cache
def with_gain(name: str, gain_ratio: float = 1.0, h: float = H) -> ScalarRun:
    return scalar_run(law_for(name), h, gain_ratio)


def second_sample(name: str, s: Any, k: float, rho: float, h: float = H, **numbers: float) -> Array:
    """phi of a run's second sample, h after its first."""
    law = find_switching(name, **numbers)
    sliding = np.atleast_1d(np.array(s, float))
    memory = law.new_memory(len(sliding), 2)()
    memory.elapsed = h
    law.reach(sliding, k, rho, memory, law.numbers, memory.phi)
    return memory.phi


# Accuracy and chattering against the sample time


class Accuracy(NamedTuple):
    """Accuracy of a law under w with |w| <= W and |w'| <= L.

    Attributes:
        low: Least order of max |s| in h.
        high: Largest order.
        bound: Bound of max |s| as a function of h.
        tightness: Share of the bound that max |s| reaches at least.
    """

    low: float
    high: float
    bound: Callable[[float], float]
    tightness: float = 0.0


ACCURACY = {
    # |s| is W or rho times h, up to how the samples fall on the peaks of w. h W is moved between
    # two samples on top of what one sample of rho can overshoot.
    "sign": Accuracy(0.85, 1.15, lambda h: h * (RHO + W)),
    # For the smooth laws a relative (pi h)^2 at most; the layer is W/rho.
    "boundary-layer": Accuracy(0.99, 1.01, lambda h: 2 * h * RHO * W / RHO),
    # Bounds that are no worse than they need be: w reaches W and w' reaches L in every cycle.
    "implicit": Accuracy(0.99, 1.01, lambda h: h * W, tightness=0.99),
    "implicit-estimate": Accuracy(1.99, 2.01, lambda h: h**2 * L, tightness=0.99),
    # Between 1.8 and 6 L h^2, as its own oscillation falls on the samples: over a factor of 16 in
    # h a factor of 3 can tilt the fit by 0.4. The bound is measured; no closed form is known.
    "super-twisting": Accuracy(1.6, 2.4, lambda h: 6.5 * h**2 * L),
    # The edge of its band, 4 epsilon h with epsilon at W, overshot by what the gain lags behind w.
    "adaptive": Accuracy(0.95, 1.05, lambda h: 1.1 * 4 * W * h),
}
each_time = pytest.mark.parametrize("h", TIMES)


@pytest.mark.parametrize("name", LAWS)
def test_s_has_the_order_of_its_law_in_the_sample_time(name: str) -> None:
    accuracy = ACCURACY[name]
    rows = [with_gain(name, h=h) for h in TIMES]
    assert accuracy.low < order_of(rows) < accuracy.high


@each_time
@pytest.mark.parametrize("name", LAWS)
def test_s_stays_inside_the_bound_of_its_law(name: str, h: float) -> None:
    accuracy = ACCURACY[name]
    bound = accuracy.bound(h)
    largest = with_gain(name, h=h).max_sliding
    assert accuracy.tightness * bound <= largest <= bound * (1 + 1e-9)


@each_time
def test_sign_law_jumps_by_its_gain_at_every_zero(h: float) -> None:
    """By 2 rho, and s has some zeros at every few samples."""
    row = with_gain("sign", h=h)
    assert row.total_variation == pytest.approx(2 * RHO * row.crossings, rel=0.02)
    assert 0.5 < row.crossings * h < 1


@each_time
def test_super_twisting_has_a_ripple_of_its_slope_and_the_adaptive_law_a_small_gain(
    h: float,
) -> None:
    assert with_gain("super-twisting", h=h).total_variation < 1.6 * VARIATION_OF_W
    sign = with_gain("sign", h=h)
    assert with_gain("adaptive", h=h).total_variation < 0.1 * sign.total_variation


@each_time
@pytest.mark.parametrize("name", ["boundary-layer", "implicit", "implicit-estimate"])
def test_smooth_laws_move_as_the_disturbance(name: str, h: float) -> None:
    """phi is -w a sample or two late: two zeros a cycle, and the variation of w, short by O(h).

    The last of the two seconds' samples ends the sum, and w moves by up to L h in one, pi h / 2 of
    its variation of 2 a second.
    """
    row = with_gain(name, h=h)
    assert row.total_variation == pytest.approx(VARIATION_OF_W, rel=3 * h)
    # One more or less in two cycles.
    assert row.crossings == pytest.approx(2, abs=0.5)


# The closed forms

SLIDING = st.lists(st.floats(-10, 10), min_size=1, max_size=3).filter(
    # s/|s| of numbers whose square underflows is zero.
    lambda s: not 0 < math.hypot(*s) < 1e-100
)
PROPORTIONAL = st.floats(0, 100)
SWITCHED = st.floats(1e-3, 100)
SAMPLE_TIME = st.floats(1e-5, 0.1)


def direction(s: list[float]) -> Array:
    """s/|s|, or zero at zero."""
    size = math.hypot(*s)
    return np.array(s) / size if size else np.zeros(len(s))


def rounding(s: list[float], k: float, rho: float, h: float) -> float:
    return ROUNDING * (k * 20 + rho + math.hypot(*s) / h)


# Laws of one entry have the formula of the laws of vectors.
@pytest.mark.parametrize(("name", "entries"), [("unit-vector", 3), ("sign", 1)])
@given(s=SLIDING, k=PROPORTIONAL, rho=SWITCHED, h=SAMPLE_TIME)
def test_explicit_laws_push_along_s(
    name: str, entries: int, s: list[float], k: float, rho: float, h: float
) -> None:
    s = s[:entries]
    expected = -(k * np.array(s) + rho * direction(s))
    phi = second_sample(name, s, k, rho, h)
    np.testing.assert_allclose(phi, expected, rtol=0, atol=rounding(s, k, rho, h))


@pytest.mark.parametrize(("name", "entries"), [("implicit-unit-vector", 3), ("implicit", 1)])
@given(s=SLIDING, k=PROPORTIONAL, rho=SWITCHED, h=SAMPLE_TIME)
def test_implicit_laws_never_push_past_zero(
    name: str, entries: int, s: list[float], k: float, rho: float, h: float
) -> None:
    """s+ = s + h (-k s+ - rho s+/|s+|), or zero within reach of it."""
    s = s[:entries]
    size = math.hypot(*s)
    next_size = max(size - h * rho, 0.0) / (1 + h * k)
    expected = direction(s) * (next_size - size) / h
    phi = second_sample(name, s, k, rho, h)
    np.testing.assert_allclose(phi, expected, rtol=0, atol=rounding(s, k, rho, h))


each_switching = pytest.mark.parametrize("name", SWITCHINGS)


@each_switching
def test_law_treats_inputs_alike_and_is_odd_in_s(name: str) -> None:
    phi = second_sample(name, [0.3, 0.3], 2.0, 5.0)
    assert phi[0] == phi[1] < 0
    np.testing.assert_array_equal(second_sample(name, [-0.3, -0.3], 2.0, 5.0), -phi)


@each_switching
def test_law_gives_nothing_at_zero(name: str) -> None:
    np.testing.assert_array_equal(second_sample(name, [0.0, 0.0], 2.0, 5.0), 0.0)


@each_switching
def test_law_gives_nothing_at_the_first_sample(name: str) -> None:
    """There is no reaching phase, and no time has passed."""
    law = find_switching(name)
    memory = law.new_memory(2, 2)()
    memory.phi[:] = math.nan
    law.reach(np.zeros(2), 2.0, 5.0, memory, law.numbers, memory.phi)
    assert memory.phi.tolist() == [0.0, 0.0]


@cache
def adaptive_run(push: float) -> tuple[Array, Array]:
    """Gains and s under a constant w for three seconds, then under none."""
    samples = scalar_samples(
        law_for("adaptive"),
        H,
        integral=lambda start, end: push * (end - start) * (end < 3),
    )
    # Each sample has the memory of the run, which changes.
    rows = [(row.memory.adapted[0], row.s) for row in samples]
    gains, s = np.array(rows).T
    return gains, s


each_push = pytest.mark.parametrize("push", [0.5, 2.0])


@each_push
def test_adaptive_gain_finds_the_size_of_the_disturbance(push: float) -> None:
    """The gain hunts about |w|, where s is on the edge of the band."""
    gains, s = adaptive_run(push)
    # From `least` it must grow by far more than it hunts by, 20 %, and overshoots once.
    assert 1.2 * push < max(gains) < 2 * push
    assert np.mean(gains[2000:3000]) == pytest.approx(push, rel=0.01)
    assert np.abs(s[2000:3000]).max() < 1.1 * 4 * push * H


@each_push
def test_adaptive_gain_falls_to_its_least_without_a_disturbance(push: float) -> None:
    gains, _ = adaptive_run(push)
    assert np.all(np.diff(gains[3002:]) <= 0)
    assert min(gains) == gains[-1] == law_for("adaptive").numbers.least


def test_a_width_scales_the_layer_and_a_gain_scales_rho() -> None:
    """phi = -(k s + g rho sat(s / (width h g rho))), with an s inside the layer and one outside."""
    phi = second_sample("boundary-layer", [H, 100 * H], 3.0, 5.0, gain=0.5, width=4.0)
    assert phi == pytest.approx([-3 * H - 1 / 4.0, -300 * H - 2.5], rel=1e-12)


def test_an_estimate_at_first_takes_s_for_the_work_of_the_disturbance() -> None:
    phi = second_sample("implicit-estimate", 10.0, 0.0, 5.0, gain=2.0)
    assert phi.item() + 10.0 / H == pytest.approx(-2.0 * 5.0, rel=1e-9)


def test_super_twisting_adds_up_its_slope() -> None:
    """phi = z - k s - 1.5 sqrt(L |s|) sgn s, z' = -1.1 L sgn s, with L the gain times the slope."""
    law = find_switching("super-twisting", gain=2.0, slope=50.0)
    memory = law.new_memory(1, 2)()
    memory.elapsed = H
    phi = np.zeros((2, 1))
    for row in phi:
        law.reach(np.array([-0.04]), 3.0, 5.0, memory, law.numbers, row)
    assert phi[:, 0] == pytest.approx([0.12 + 3.0, 0.12 + 3.0 + 0.11])


@pytest.mark.parametrize(("s", "adapted"), [(-3e-3, 0.44), (5e-3, 0.6)])
def test_an_adaptive_gain_falls_in_its_band_and_grows_beyond(s: float, adapted: float) -> None:
    """By share |s|/h, within and beyond 4 gain epsilon h, which is 4e-3."""
    law = find_switching("adaptive", gain=2.0, share=0.02)
    memory = law.new_memory(1, 2)()
    memory.elapsed = H
    memory.adapted[:] = 0.5
    phi = np.zeros(1)
    law.reach(np.array([s]), 3.0, 5.0, memory, law.numbers, phi)
    assert memory.adapted == pytest.approx([adapted])
    assert phi == pytest.approx([-(3.0 * s + 2.0 * math.copysign(adapted, s))])


# Input gains r times the nominal one. The linear zone of the implicit law multiplies s by 1 - r:
# beyond r = 2 it is left again at every sample, and s stays where saturation holds it,
# |s| <= h ((r - 1) rho + W). With the estimate it is z^2 - 2 (1 - r) z + (1 - r), stable for
# 0 < r < 4/3 (Jury); saturated, the estimate itself obeys w+ = (1 - r) w + ...: unstable from
# r = 2 on. It needs no authority of rho, which holds only what w changes by in a sample.

BOUNDS = {"implicit": H * W, "implicit-estimate": H**2 * L}


@pytest.mark.parametrize("r", [0.55, 1.25])
@pytest.mark.parametrize("name", BOUNDS)
def test_implicit_laws_do_not_chatter_in_their_linear_zone(name: str, r: float) -> None:
    """|s| is h W/r or h^2 L/r."""
    row = with_gain(name, r)
    assert row.max_sliding == pytest.approx(BOUNDS[name] / r, rel=0.01)
    assert row.total_variation == pytest.approx(VARIATION_OF_W / r, rel=0.01)


@pytest.mark.parametrize(
    ("name", "inside", "outside", "factor"),
    [("implicit", 1.95, 2.05, 4), ("implicit-estimate", 1.3, 1.37, 100)],
)
def test_implicit_laws_chatter_beyond_their_linear_zone(
    name: str, inside: float, outside: float, factor: float
) -> None:
    stable = with_gain(name, inside)
    unstable = with_gain(name, outside)
    assert stable.max_sliding < BOUNDS[name]
    assert unstable.max_sliding > factor * stable.max_sliding
    assert stable.total_variation < VARIATION_OF_W < unstable.total_variation / 500
    assert unstable.crossings == pytest.approx(1 / H, rel=0.01)


@pytest.mark.parametrize(
    ("name", "r", "bound"),
    [
        ("implicit", 2.05, H * ((2.05 - 1) * RHO + W)),
        ("implicit-estimate", 1.9, 20 * H),
        ("implicit-estimate", 0.3, 1.1 * H**2 * L / 0.3),
    ],
)
def test_saturation_bounds_s_beyond_the_linear_zone(name: str, r: float, bound: float) -> None:
    assert with_gain(name, r).max_sliding < bound


def test_the_estimate_diverges_with_twice_the_input_gain() -> None:
    assert with_gain("implicit-estimate", 2.1).max_sliding == math.inf


def test_super_twisting_needs_the_slope_of_the_disturbance() -> None:
    """L is its gain: with a third of |w'| it follows w by far more than h^2."""
    steep = scalar_run(find_switching("super-twisting", slope=L / 3), H)
    assert steep.max_sliding > 1000 * with_gain("super-twisting").max_sliding


def test_a_boundary_layer_of_half_a_step_chatters() -> None:
    wide = scalar_run(find_switching("boundary-layer", width=0.55), H)
    thin = scalar_run(find_switching("boundary-layer", width=0.45), H)
    assert wide.total_variation < 1.01 * VARIATION_OF_W
    assert thin.total_variation > 100 * VARIATION_OF_W


@pytest.mark.parametrize("h", [2e-3, 1e-3])
@pytest.mark.parametrize("name", ["sign", "implicit"])
def test_without_authority_sampling_faster_does_not_help(name: str, h: float) -> None:
    """With r rho < W the excursion is the integral of |w| - r rho while positive."""
    start = math.asin(0.3 / W) / (2 * math.pi)
    pushed = W * math.cos(2 * math.pi * start) / math.pi
    excursion = pushed - 0.3 * (0.5 - 2 * start)
    assert with_gain(name, 0.3, h).max_sliding == pytest.approx(excursion, abs=2.5 * h)


@pytest.mark.parametrize("name", ["sign", "implicit"])
def test_with_authority_s_stays_within_two_steps(name: str) -> None:
    assert with_gain(name, 0.55).max_sliding < 2 * H


# Runs of the nominal servo


@cache
def metrics_of(switching: str) -> dict[str, float]:
    """Metrics of the nominal servo in MuJoCo, sampled at its physics timestep."""
    experiment = find_experiment("servo", "nominal").changed(
        control_period=H,
        timestep=H,
        switching=switching,
        surface="printed" if switching == "sign" else "discrete",
    )
    metrics = experiment.run(law="grosmc").metrics
    return {name: metric.value for name, metric in metrics.items() if metric.value is not None}


each_implicit = pytest.mark.parametrize("name", ["implicit", "implicit-estimate"])


@each_implicit
def test_implicit_laws_cost_the_optimum(name: str) -> None:
    metrics = metrics_of(name)
    assert metrics["max_sliding"] < 1e-15
    assert metrics["cost_continuous"] == pytest.approx(metrics["cost_optimal"], rel=0.01)
    assert metrics["cost_whole"] == pytest.approx(metrics["cost_continuous"], rel=0.02)


@each_implicit
def test_implicit_laws_follow_the_optimum_and_do_not_chatter(name: str) -> None:
    sign = metrics_of("sign")
    assert metrics_of(name)["total_variation"] < 0.01 * sign["total_variation"]
    assert metrics_of(name)["deviation"] <= sign["deviation"]


def test_the_sign_law_s_chatter_costs() -> None:
    sign = metrics_of("sign")
    assert sign["cost_whole"] > 10 * sign["cost_optimal"]


def test_crossings_are_changes_of_the_sign() -> None:
    assert crossings(np.array([0.0, 1.0, 0.0, 2.0, -1.0, 0.0, 3.0])) == 2
