"""Switching laws: accuracy and chattering against sample time, bounds, limits, both engines."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from shipped import case_plant, find_case, nominal_controller, of_case, run_case, run_on

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balance
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.switching import (
    SWITCHINGS,
    Switching,
    find_switching,
)
from grosmc_mj.control.task import Realization
from grosmc_mj.errors import ArgumentError, GainError, GrosmcError
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.file.reading import resolved_text
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.experiments.metrics import crossings
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import Settings, Surface
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.studies import switching as chattering
from grosmc_mj.studies.switching import (
    CASES,
    GAIN,
    LAWS,
    OWN_VARIATION,
    PUSH,
    SLOPE,
    Benchmark,
    CaseRow,
    SwitchingRun,
    benchmark,
    cases_of,
    experiments,
    law_for,
    measure_case,
    order,
    orders,
    run_experiment,
    scalar_samples,
    write_switching_figure,
)

H = 1e-3
TIMES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)
each_law = pytest.mark.parametrize("name", SWITCHINGS)
scalar_law = pytest.mark.parametrize("name", LAWS)
# Two ways to one number of a few operations each: a few units in the last place.
ROUNDING = 1e-14


@cache
def swept(name: str) -> tuple[Benchmark, ...]:
    """The scalar benchmark of one law over the sample times."""
    return tuple(benchmark(law_for(name), h) for h in TIMES)


@cache
def with_gain(name: str, gain_ratio: float, h: float = H) -> Benchmark:
    """The scalar benchmark with a wrong input gain."""
    return benchmark(law_for(name), h, gain_ratio)


def asked(law: Switching, s: tuple[float, ...], k: float, rho: float, h: float) -> Array:
    """phi of a run's second sample, h after its first."""
    memory = law.new_memory(len(s), 2)()
    memory.elapsed = h
    law.reach(np.array(s), k, rho, memory, law.numbers, memory.phi)
    return memory.phi


# Accuracy: the order of max |s| in the sample time


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        # |s| is W or rho times h, up to how the samples fall on the peaks of w: for the smooth
        # laws a relative (pi h)^2 at most, for the others a good part of one sample's step.
        ("sign", 0.85, 1.15),
        ("boundary-layer", 0.99, 1.01),
        ("implicit", 0.99, 1.01),
        ("implicit-estimate", 1.99, 2.01),
        # Between 1.8 and 6 L h^2, as its own oscillation falls on the samples: over a factor of
        # 16 in h such a factor of 3 can tilt the fit by 0.4.
        ("super-twisting", 1.6, 2.4),
        # The edge of its band, 4 epsilon h with epsilon at W, overshot by some percent.
        ("adaptive", 0.95, 1.05),
    ],
)
def test_order_of_accuracy_on_the_scalar_benchmark(name, low, high):
    assert low < orders(swept(name))[name] < high


@pytest.mark.parametrize(
    ("name", "bound"),
    [
        # h W is moved between two samples on top of what one sample of rho can overshoot.
        ("sign", lambda h: h * (GAIN + PUSH)),
        ("boundary-layer", lambda h: 2 * h * GAIN * PUSH / GAIN),  # layer W/rho
        ("implicit", lambda h: h * PUSH),
        ("implicit-estimate", lambda h: h**2 * SLOPE),
        ("super-twisting", lambda h: 6.5 * h**2 * SLOPE),  # measured; no closed form is known
        # The band's edge at epsilon = W, and what the gain lags behind w.
        ("adaptive", lambda h: 1.1 * 4 * PUSH * h),
    ],
)
def test_s_stays_inside_the_bound_of_its_law(name, bound):
    for row in swept(name):
        assert row.max_sliding <= bound(row.h) * (1 + 1e-9), f"h = {row.h:g}"


@pytest.mark.parametrize(
    ("name", "bound"),
    [("implicit", lambda h: h * PUSH), ("implicit-estimate", lambda h: h**2 * SLOPE)],
)
def test_bounds_of_the_implicit_laws_are_reached(name, bound):
    """They are no worse than they need be: w reaches W and w' reaches L within every cycle."""
    for row in swept(name):
        assert row.max_sliding >= 0.99 * bound(row.h)


# Chattering


@pytest.mark.parametrize("name", ["boundary-layer", "implicit", "implicit-estimate"])
def test_smooth_laws_move_the_input_as_much_as_the_disturbance_moves(name):
    """phi is -w a sample or two late: two zeros a cycle, and the variation of w.

    Short by O(h): the last of the two seconds' samples ends the sum, and w moves by up to L h in
    one, pi h / 2 of its variation of 2 a second.
    """
    for row in swept(name):
        assert row.total_variation == pytest.approx(OWN_VARIATION, rel=3 * row.h)
        assert row.crossings == pytest.approx(2, abs=0.5)  # one more or less in two cycles


def test_sign_law_moves_the_input_more_the_faster_it_is_sampled():
    """It jumps by 2 rho at every zero, and has some of these at every few samples."""
    for row in swept("sign"):
        assert row.total_variation == pytest.approx(2 * GAIN * row.crossings, rel=0.02)
        assert 0.5 < row.crossings * row.h < 1


def test_other_laws_move_it_less_than_sign():
    """Super-twisting adds a ripple of L, whatever h; the adaptive law switches by a small gain."""
    for row in swept("super-twisting"):
        assert row.total_variation < 1.6 * OWN_VARIATION
    for mild, harsh in zip(swept("adaptive"), swept("sign"), strict=True):
        assert mild.total_variation < 0.1 * harsh.total_variation


def test_crossings_count_changes_of_sign_once():
    assert crossings(np.array([0.0, 1.0, 0.0, 2.0, -1.0, 0.0, 3.0])) == 2
    assert crossings(np.zeros(5)) == 0


def test_crossings_of_a_case_are_per_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """s that changes its sign at every one of a quarter of a second's samples."""
    case = replace(find_case("servo", "nominal"), duration=0.25)
    result = run_case(case, "corrected", "grosmc", Settings(engine="python"))
    signs = np.where(np.arange(250) % 2, -0.1, 0.3)
    made_up = replace(result, trajectory=replace(result.trajectory, sliding=signs))
    monkeypatch.setattr(chattering, "run_experiment", lambda *_: made_up)
    row = measure_case(SwitchingRun(find_experiment("servo", "nominal"), "sign", "printed", H))
    assert row.crossings == 249 / 0.25
    value = {name: metric.value or 0.0 for name, metric in result.metrics.items()}
    assert row.cost_continuous == value["cost_continuous"] / value["cost_optimal"]
    spent = (value["cost_whole"] - value["cost_continuous"]) / 0.25
    assert row.cost_rate == pytest.approx(spent / value["cost_optimal"], rel=1e-12)


def test_order_of_a_power_is_its_exponent():
    assert order(TIMES, [3 * h**1.7 for h in TIMES]) == pytest.approx(1.7)


# The closed forms


@given(
    s=st.floats(-10, 10),
    k=st.floats(0, 100),
    rho=st.floats(1e-3, 100),
    h=st.floats(1e-5, 1e-1),
)
def test_implicit_law_solves_its_implicit_inclusion(s, k, rho, h):
    """s+ = s + h (-k s+ - rho S) with S in Sgn(s+), the set-valued sign."""
    (phi,) = asked(find_switching("implicit"), (s,), k, rho, h).tolist()
    after = s + h * phi
    selected = (s - (1 + h * k) * after) / (h * rho)
    # What s and h rho lose to rounding, in the unit of S.
    scale = ROUNDING * (1 + h * k) * (1 + abs(s) / (h * rho))
    assert abs(selected) <= 1 + scale
    if abs(after) > ROUNDING * abs(s):
        assert selected == pytest.approx(math.copysign(1, after), rel=0, abs=scale)


@pytest.mark.parametrize(
    ("vector", "scalar"), [("unit-vector", "sign"), ("implicit-unit-vector", "implicit")]
)
@given(s=st.floats(-10, 10), k=st.floats(0, 100), rho=st.floats(1e-3, 100))
def test_unit_vector_form_of_one_input_is_the_scalar_law(vector, scalar, s, k, rho):
    expected = asked(find_switching(scalar), (s,), k, rho, H)
    found = asked(find_switching(vector), (s,), k, rho, H)
    # s/|s| of numbers whose square underflows is zero.
    if abs(s) > 1e-150 or s == 0:
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=ROUNDING * (k * 10 + rho + abs(s) / H)
        )


@given(s=st.tuples(*[st.floats(-10, 10)] * 3), rho=st.floats(1e-3, 100))
def test_unit_vector_points_at_zero_with_the_strength_rho(s, rho):
    size = float(np.linalg.norm(s))
    if size > 1e-100:
        expected = -rho * np.array(s) / size
        np.testing.assert_allclose(
            asked(find_switching("unit-vector"), s, 0.0, rho, H), expected, atol=1e-13 * rho
        )
        # By implicit Euler the same, but never past zero.
        reached = expected * min(1.0, size / (H * rho))
        found = asked(find_switching("implicit-unit-vector"), s, 0.0, rho, H)
        np.testing.assert_allclose(found, reached, atol=ROUNDING * (rho + size / H))


@each_law
def test_law_treats_every_input_alike_and_asks_nothing_on_the_surface(name):
    law = find_switching(name)
    phi = asked(law, (0.3, 0.3), 2.0, 5.0, H)
    assert phi[0] == phi[1] < 0
    np.testing.assert_array_equal(asked(law, (-0.3, -0.3), 2.0, 5.0, H), -phi)
    np.testing.assert_array_equal(np.abs(asked(law, (0.0, 0.0), 2.0, 5.0, H)), 0.0)


@each_law
def test_first_sample_asks_nothing(name):
    """There is no reaching phase: s(0) = 0, and no time has passed."""
    for m in (1, 2):
        law = find_switching(name)
        memory = law.new_memory(m, 2)()
        memory.phi[:] = math.nan
        law.reach(np.zeros(m), 2.0, 5.0, memory, law.numbers, memory.phi)
        assert memory.phi.tolist() == [0.0] * m


# The adaptive gain


@pytest.mark.parametrize("push", [0.5, 2.0])
def test_adaptive_gain_finds_what_is_needed_and_holds_s_in_its_band(push):
    """Against a constant w the gain hunts about |w|, where s is on the edge of the band."""
    law = law_for("adaptive")
    gains, s = [], []
    for row in scalar_samples(law, H, push=lambda start, end: push * (end - start)):
        gains.append(float(row.memory.adapted[0]))
        s.append(row.s)
    assert min(gains) >= law.numbers.least
    # From `least` it must grow by far more than it hunts by, 20 %, and overshoots once.
    assert 1.2 * push < max(gains) < 2 * push
    assert np.mean(gains[2000:]) == pytest.approx(push, rel=0.01)
    assert np.abs(s[2000:]).max() < 1.1 * 4 * push * H


def test_adaptive_gain_falls_to_its_least_and_no_further_when_nothing_pushes():
    law = find_switching("adaptive", share=0.02, least=0.05)
    memory = law.new_memory(1, 1)()
    memory.adapted[:], memory.elapsed = 0.5, H
    s, gains = 5e-4, []
    for _ in range(4000):
        law.reach(np.array([s]), 0.0, 1.0, memory, law.numbers, memory.phi)
        s += H * float(memory.phi[0])
        gains.append(float(memory.adapted[0]))
    assert min(gains) == gains[-1] == law.numbers.least
    assert np.all(np.diff(gains) <= 0)


def test_the_estimating_law_is_bounded_by_rho_times_its_gain():
    """Far away, but for the estimate, which at first takes all of s for the work of w."""
    (phi,) = asked(find_switching("implicit-estimate", gain=2.0), (10.0,), 0.0, 5.0, H).tolist()
    assert phi + 10.0 / H == pytest.approx(-2.0 * 5.0, rel=1e-9)


# Limits under a wrong input gain


@pytest.mark.parametrize("name", ["implicit", "implicit-estimate"])
def test_implicit_laws_stand_a_small_gain_error(name):
    """|s| is h W/r or h^2 L/r, without chatter."""
    bound = H * PUSH if name == "implicit" else H**2 * SLOPE
    for gain_ratio in (0.55, 0.8, 1.25):
        row = with_gain(name, gain_ratio)
        assert row.max_sliding == pytest.approx(bound / gain_ratio, rel=0.01)
        assert row.total_variation == pytest.approx(OWN_VARIATION / gain_ratio, rel=0.01)


def test_implicit_law_chatters_from_a_gain_ratio_of_two_on():
    """Its linear zone multiplies s by 1 - r: beyond r = 2 it is left again at every sample.

    s then stays where saturation holds it, |s| <= h ((r - 1) rho + W).
    """
    within, beyond = with_gain("implicit", 1.95), with_gain("implicit", 2.05)
    assert within.max_sliding < H * PUSH
    assert within.total_variation < OWN_VARIATION
    assert beyond.max_sliding > 4 * within.max_sliding
    assert beyond.max_sliding <= H * ((2.05 - 1) * GAIN + PUSH)
    assert beyond.total_variation > 500 * OWN_VARIATION
    assert beyond.crossings == pytest.approx(1 / H, rel=0.01)


def test_estimate_narrows_the_gain_ratio_to_four_thirds_and_diverges_from_two_on():
    """Its linear zone has z^2 - 2 (1 - r) z + (1 - r) = 0: stable for 0 < r < 4/3 (Jury).

    Saturated, the estimate itself obeys w+ = (1 - r) w + ...: unstable from r = 2 on.
    """
    within, beyond = with_gain("implicit-estimate", 1.3), with_gain("implicit-estimate", 1.37)
    for r, inside in ((1.3, True), (1.37, False), (0.05, True)):
        roots = np.roots([1, -2 * (1 - r), 1 - r])
        assert bool(np.abs(roots).max() < 1) is inside
    assert within.max_sliding < H**2 * SLOPE
    assert beyond.max_sliding > 100 * within.max_sliding
    assert beyond.crossings == pytest.approx(1 / H, rel=0.01)
    assert with_gain("implicit-estimate", 1.9).max_sliding < 20 * H
    assert with_gain("implicit-estimate", 2.1).max_sliding == math.inf


@pytest.mark.parametrize("name", ["sign", "boundary-layer", "implicit"])
def test_without_authority_sampling_faster_does_not_help(name):
    """With r rho < W nothing that rho sends can hold s: its excursion no longer shrinks with h.

    It is the integral of |w| - r rho while positive; 0.039 at r = 0.3, from w = 0.5 sin 2 pi t.
    """
    start = math.asin(0.3 / PUSH) / (2 * math.pi)
    excursion = PUSH * math.cos(2 * math.pi * start) / math.pi - 0.3 * (0.5 - 2 * start)
    for h in (2e-3, 1e-3):
        assert with_gain(name, 0.3, h).max_sliding == pytest.approx(excursion, abs=2.5 * h)
    held = with_gain(name, 0.55)
    assert held.max_sliding < 2 * H


def test_estimate_needs_no_authority_of_rho():
    """What it cancels is not bounded by rho: rho holds only what w changes by in a sample."""
    assert with_gain("implicit-estimate", 0.3).max_sliding < 1.1 * H**2 * SLOPE / 0.3


def test_super_twisting_needs_its_slope():
    """L is its gain: with a third of |w'| it follows w by far more than h^2."""
    found = benchmark(find_switching("super-twisting", slope=SLOPE / 3), H)
    assert found.max_sliding > 1000 * with_gain("super-twisting", 1.0).max_sliding


def test_boundary_layer_thinner_than_half_a_step_chatters():
    assert (
        benchmark(find_switching("boundary-layer", width=0.55), H).total_variation
        < 1.01 * OWN_VARIATION
    )
    assert (
        benchmark(find_switching("boundary-layer", width=0.45), H).total_variation
        > 100 * OWN_VARIATION
    )


# The surface of a sampled law


def free_sliding(plant: PlantName, surface: Surface, period: float) -> float:
    """Largest |s| on the nominal servo when nothing switches: what the surface itself errs by."""
    settings = Settings("python", period, period, surface=surface)
    realization = Realization(
        find_switching("sign", gain=0.0),
        of_case(find_case("servo", "nominal"), settings).realization.control_period,
    )
    law = nominal_controller("servo", "grosmc", "corrected", realization)
    case = replace(find_case("servo", "nominal"), duration=2.0)
    result = run_on(case, plant, law, case_plant(case, plant, settings), settings)
    assert result.trajectory.sliding is not None
    return float(np.abs(result.trajectory.sliding).max())


@pytest.mark.parametrize("plant", ["corrected", "physics"])
def test_discrete_surface_is_zero_at_every_sample_of_the_nominal_plant(plant):
    """The optimal law alone keeps it; the printed one leaves by an Euler sum's O(T)."""
    periods = (4e-3, 2e-3)
    for period in periods:
        # A sum of some thousand terms of |S z| T <= 1e-3, each to 1e-16.
        assert free_sliding(plant, "discrete", period) < 1e-13
    printed = [free_sliding(plant, "printed", period) for period in periods]
    assert order(periods, printed) == pytest.approx(1, abs=0.01)
    assert printed[0] > 1e-5


def test_discrete_surface_is_for_one_control_period():
    law = nominal_controller(
        "servo", "grosmc", "corrected", Realization(find_switching("implicit"), 2e-3)
    )
    plant = MujocoPlant.load("servo").analytic()
    with pytest.raises(
        ArgumentError, match=r"designed for a control period of 0\.002 s, not 0\.001"
    ):
        simulate(plant, law, (0.0, 0.0), duration=0.01, control_period=1e-3)
    simulate(plant, law, (0.0, 0.0), duration=0.01, control_period=2e-3, engine="python")


# Wrong numbers and names


@pytest.mark.parametrize(
    "make",
    [
        lambda: find_switching("sign", gain=-1.0),
        lambda: find_switching("sign", gain=math.nan),
        lambda: find_switching("boundary-layer", width=0.0),
        lambda: find_switching("boundary-layer", width=-2.0),
        lambda: find_switching("super-twisting", slope=0.0),
        lambda: find_switching("super-twisting", slope=math.inf),
        lambda: find_switching("adaptive", share=-1.0),
        lambda: find_switching("adaptive", least=0.0),
        lambda: find_switching("implicit", gain=math.inf),
        lambda: find_switching("implicit-estimate", gain=-math.inf),
        lambda: find_switching("signum"),
    ],
)
def test_wrong_numbers_are_refused_in_one_line(make: Callable[[], Switching]):
    with pytest.raises(GainError) as raised:
        make()
    assert "\n" not in str(raised.value)


def test_settings_name_the_nearest_switching_law():
    with pytest.raises(ArgumentError, match="did you mean 'implicit-estimate'") as raised:
        Settings(switching="implict-estimate")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("period", [0.0, -1e-3, math.nan, math.inf])
def test_realization_refuses_a_control_period_that_is_none(period):
    with pytest.raises(ArgumentError, match="finite and positive"):
        Realization(find_switching("sign"), period)


def test_cases_are_the_chapter_s_or_the_user_s(tmp_path):
    assert {e.case.system for e in cases_of()} == set(CASES)
    assert [e.case.name for e in cases_of("servo")] == ["nominal", "case1", "case2"]
    assert {run.law for run in experiments(cases_of("arm"))} == set(LAWS)
    assert [e.case.name for e in cases_of("arm/case2")] == ["case2"]
    file = tmp_path / "mine.toml"
    file.write_text(resolved_text(shipped_files()["servo/case2"]))
    (mine,) = cases_of(str(file))
    period = 2e-3
    short = replace(mine, case=replace(mine.case, duration=0.5))
    row = measure_case(SwitchingRun(short, "implicit", "discrete", period), timestep=period)
    assert row.max_sliding > 0


@pytest.mark.parametrize(
    ("target", "says"),
    [
        ("serv", "did you mean 'servo'"),
        ("two_link_arm", "valid: servo, cart_pendulum, arm"),
        ("two_link_arm/case1", "has 2 inputs"),
        ("FILE", "none of lqr switches"),
    ],
)
def test_cases_that_the_study_has_nothing_to_say_of_are_refused(target, says, tmp_path):
    file = tmp_path / "mine.toml"
    lines = ['title = "x"', "[plant]", 'system = "servo"', "[run]", 'duration = "1 s"']
    start = ['start = { "rotor angle" = "1 rad" }', "[[controller]]", 'law = "lqr"']
    file.write_text("\n".join(lines + start))
    with pytest.raises(GrosmcError, match=says):
        cases_of(target.replace("FILE", str(file)))


@pytest.mark.slow
def test_figure_is_drawn_from_its_rows_alone(tmp_path):
    """Also of a law that diverges, and twice the same to the byte."""
    rows = [row for name in LAWS for row in swept(name)]
    beyond = [with_gain(name, r) for name in LAWS for r in (0.55, 2.1)]
    cases = [
        CaseRow(
            SwitchingRun(find_experiment("arm", "case1"), name, "discrete", 1e-3),
            1.0,
            1.0,
            1.0,
            1.0,
            1.0,
            1.0,
            1.0,
        )
        for name in LAWS
    ]
    paths = (tmp_path / f"{name}.png" for name in "ab")
    one, two = (write_switching_figure(rows, beyond, cases, path) for path in paths)
    for suffix in (".png", ".svg"):
        assert one.with_suffix(suffix).read_bytes() == two.with_suffix(suffix).read_bytes()


# Both engines


@pytest.mark.slow
@pytest.mark.parametrize(("system", "kind"), [("servo", "analytic"), ("two_link_arm", "physics")])
@each_law
def test_engines_agree_bit_for_bit_under_every_law(name, system, kind):
    """With one input and with two, in the compiled loop and in MuJoCo's callback."""
    case, twin = find_case(system, "case1"), MujocoPlant.load(system)
    law = chapter_controller("grosmc", twin.analytic(), Realization(find_switching(name), H))
    options: dict[str, Any] = {
        "duration": 0.3,
        "control_period": H,
        "disturbances": [replace(d, profile=math.cos) for d in case.disturbances],
    }
    plant = twin.analytic() if kind == "analytic" else twin
    native, python = (
        simulate(plant, law, case.x0, engine=engine, **options) for engine in ("native", "python")
    )
    for field in ("state", "input", "weighed", "sliding"):
        np.testing.assert_array_equal(getattr(native, field), getattr(python, field))
    assert np.ptp(native.input) > 0.1


# The chapter's cases in MuJoCo at 1 kHz

every_case = pytest.mark.parametrize(
    ("system", "case"), [(system, case) for system in CASES for case in CASES[system]]
)


@cache
def at_1_khz(system: str, case: str, name: str, surface: Surface = "discrete") -> CaseRow:
    row = measure_case(SwitchingRun(find_experiment(system, case), name, surface, H), timestep=H)
    assert not row.ended
    return row


@pytest.mark.slow
@pytest.mark.parametrize("surface", ["printed", "discrete"])
@every_case
def test_estimate_is_as_accurate_as_sign_for_a_hundredth_of_its_variation(system, case, surface):
    sign = at_1_khz(system, case, "sign", surface)
    estimate = at_1_khz(system, case, "implicit-estimate", surface)
    assert estimate.deviation <= sign.deviation
    assert estimate.total_variation < 0.01 * sign.total_variation


@pytest.mark.slow
@pytest.mark.parametrize("surface", ["printed", "discrete"])
@pytest.mark.parametrize("name", ["implicit", "implicit-estimate"])
def test_implicit_laws_cost_the_optimum_in_the_nominal_case(name, surface):
    """J of u_c within 1 % of J*, and u_d costs nothing; the sign law's costs J* each second."""
    found = at_1_khz("servo", "nominal", name, surface)
    sign = at_1_khz("servo", "nominal", "sign", surface)
    assert found.cost_continuous == pytest.approx(1, abs=0.01)
    assert sign.cost_continuous == pytest.approx(1, abs=0.01)
    assert abs(found.cost_rate) < 1e-3
    assert sign.cost_rate > 1


@pytest.mark.slow
def test_cost_of_a_law_does_not_grow_with_the_length_of_a_settled_run() -> None:
    """J with the whole input does, almost in proportion; u_d costs most in the transient."""
    short = find_experiment("servo", "nominal")
    long = replace(short, case=replace(short.case, duration=2 * short.case.duration))
    found = [measure_case(SwitchingRun(each, "sign", "printed", H)) for each in (short, long)]
    assert found[1].cost_rate == pytest.approx(found[0].cost_rate, rel=0.25)
    whole = [row.cost_continuous + row.cost_rate * n for row, n in zip(found, (1, 2), strict=True)]
    assert whole[1] > 1.5 * whole[0]
    assert found[1].cost_continuous == pytest.approx(found[0].cost_continuous, rel=0.01)


def needed(law: Controller, system: str, case: str, name: str) -> tuple[float, float, float]:
    """Along a run: the largest rho needed, the least of rho less that, and the largest |s|."""
    value = find_case(system, case)
    result = run_experiment(
        SwitchingRun(find_experiment(system, case), name, "discrete", H), timestep=H
    )
    run, true = result.trajectory, case_plant(value, "corrected", Settings())
    assert isinstance(true, AnalyticPlant)
    assert run.sliding is not None
    nothing = np.zeros(6 * len(run.system.bodies))
    found = [
        balance(
            law, true, float(run.time[i]), run.state[i],
            nothing if run.wrench is None else run.wrench[i],
        )
        for i in range(0, len(run.time) - 1, 20)
    ]  # fmt: skip
    required = max(b.required for b in found)
    margin = min(b.configured - b.required for b in found)
    return required, margin, float(np.abs(run.sliding).max())


@pytest.mark.slow
@every_case
def test_plain_implicit_law_stays_inside_its_own_bound_where_rho_suffices(system, case):
    """|s| <= T W, with W what rho must be under the true input gain, from the equations.

    The printed gain of the arm, 6 rad/s^2, is less than the 8.5 that its case 1 needs: there s
    leaves, and only the estimate, which needs no rho, holds it.
    """
    twin = MujocoPlant.load(system).analytic()
    law = chapter_controller("grosmc", twin, Realization(find_switching("implicit"), H))
    required, margin, s = needed(law, system, case, "implicit")
    if system == "arm":
        assert margin < -2
        assert s > 10 * H * required
        assert at_1_khz(system, case, "implicit-estimate").max_sliding < 0.01 * H * required
        return
    assert margin > 0
    # What W moves by within a sample, and the rounding of s where nothing pushes.
    assert s <= 1.001 * H * required + 1e-15


@pytest.mark.slow
def test_sign_law_does_not_find_the_discrete_surface():
    """Off it by rounding, sgn chatters as on the printed one: no surface helps it."""
    on = {s: at_1_khz("servo", "nominal", "sign", s).max_sliding for s in ("printed", "discrete")}
    assert on["discrete"] == pytest.approx(on["printed"], rel=0.05)
    assert at_1_khz("servo", "nominal", "implicit").max_sliding < 1e-15
    assert at_1_khz("servo", "nominal", "implicit", "printed").max_sliding > 1e-8


@pytest.mark.slow
@every_case
def test_other_laws_spare_the_input_with_the_declared_numbers(system, case):
    """Super-twisting and the adaptive gain, with the numbers of ``law_for``.

    Neither is as accurate as the sign law everywhere: z or the gain must first grow, so a step of
    W costs an |s| of the order of W^2/L, or of 4 W T and more.
    """
    sign = at_1_khz(system, case, "sign")
    for name in ("super-twisting", "adaptive"):
        row = at_1_khz(system, case, name)
        assert row.total_variation < 0.1 * sign.total_variation
        assert row.cost_rate < 0.5 * sign.cost_rate


@pytest.mark.slow
def test_command_writes_what_it_measured(tmp_path, capsys, monkeypatch):
    from grosmc_mj.cli import main

    # Coarser: the finest sample time takes as long as all others, the ratios are 41.
    ratios = chattering.GAIN_RATIOS[4::5]
    monkeypatch.setattr(
        chattering, "sample_time_sweep", partial(chattering.sample_time_sweep, TIMES)
    )
    monkeypatch.setattr(
        chattering, "gain_ratio_sweep", partial(chattering.gain_ratio_sweep, H, ratios)
    )
    with pytest.raises(SystemExit) as left:
        main(["study", "switching", "arm", "--out", str(tmp_path)])
    assert left.value.code == 0
    content = json.loads((tmp_path / "switching.json").read_text())
    assert content["schema_version"] == 2
    assert content["benchmark"]["orders"]["implicit-estimate"] == pytest.approx(2, abs=0.01)
    assert len(content["cases"]) == len(experiments(cases_of("arm")))
    diverged = [row for row in content["benchmark"]["gain_ratios"] if row["max_sliding"] is None]
    assert {row["law"] for row in diverged} == {"implicit-estimate"}
    assert min(row["gain_ratio"] for row in diverged) >= 2
    for suffix in (".png", ".svg"):
        assert (tmp_path / f"switching{suffix}").stat().st_size > 10_000
    lines = capsys.readouterr().out.rstrip("\n").split("\n")
    assert re.match(r"All \d+ runs in MuJoCo completed", lines[0])
    assert len(lines) <= 40
    assert [line for line in lines if cell_len(line.rstrip()) > 100] == []
    assert "implicit-estimate" in "\n".join(lines)
