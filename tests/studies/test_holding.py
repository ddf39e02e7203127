"""The laws that hold pole and cart: their equations in closed form, and their runs on physics."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from shipped import find_case, nominal_controller, run_case

from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum import cart as holding
from grosmc_mj.cases.cart_pendulum.cart import (
    LEAN,
    force_needed,
    holding_ism,
    holding_lqr,
    holding_pfl,
)
from grosmc_mj.chapter.claims.measurements.cart import (
    CART_BAND,
    SYSTEM,
    UNCERTAINTIES,
    amplification,
    holding_case,
    projected_law,
    projections_of,
    rail_half_length,
    uncertainty,
)  # fmt: skip
from grosmc_mj.control.reaching import sliding_dynamics
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization
from grosmc_mj.control.uncertainty import StateUncertainty
from grosmc_mj.errors import ArgumentError, GainError
from grosmc_mj.experiments.catalogue import chapter_controller, find_experiment
from grosmc_mj.experiments.metrics import settling_time
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

PHYSICS = MujocoPlant.load(SYSTEM)
NOMINAL = PHYSICS.analytic()
LARGER = BodyEdit("pole", mass_scale=4.0, length_scale=4.0)
SMOOTH = Realization(find_switching("implicit"), 1e-3)
IMPLICIT = Settings(switching="implicit", surface="discrete")


def member(mass: float, length: float) -> AnalyticPlant:
    """The plant with a scaled pole."""
    p = NOMINAL.parameters
    return replace(NOMINAL, parameters=replace(p, m=mass * p.m, L=length * p.L))


def members(count: int) -> list[AnalyticPlant]:
    """Random members of the declared family."""
    random = np.random.default_rng(1)
    return [member(*random.uniform(1.0, 4.0, 2)) for _ in range(count)]


def force_for(plant: AnalyticPlant, x: Array, w: float) -> tuple[float, float]:
    """The force that makes theta'' = w, and theta'' per force, from x' = f + g u."""
    drift, pushed = plant.derivative(x)[3], plant.derivative(x, 1.0)[3]
    return (w - drift) / (pushed - drift), pushed - drift


# cart-pfl: the bound of the force


def test_the_force_bounds_what_any_member_needs_and_the_bound_is_attained() -> None:
    """|u_t - u| + f + eta/E_t, from the plants' equations, is within the closed form.

    At rest and leaning against w the heaviest, longest pole needs all of it.
    """
    p, random = holding_pfl(NOMINAL).parameters, np.random.default_rng(0)
    draws = [
        (plant, random.uniform([-3, -1.5, -5, -8], [3, 1.5, 5, 8]), random.uniform(-30, 30))
        for plant in members(400)
    ]
    attained = member(4.0, 4.0), np.array([0.0, 0.7, 0.0, 0.0]), -3.0
    needed = bound = 0.0
    for plant, x, w in [*draws, attained]:
        (u, E), (u_t, E_t) = force_for(NOMINAL, x, w), force_for(plant, x, w)
        needed, bound = abs(u_t - u) + p.force + p.eta / E_t, force_needed(abs(w), x, E, p)
        # Rounding of forces of up to 1e4 N.
        assert needed <= bound * (1 + 1e-9)
    assert bound == pytest.approx(needed, rel=1e-9)
    p = holding_pfl(NOMINAL, StateUncertainty(force=0.3, reaching_rate=0.7)).parameters
    assert force_needed(5.0, np.array([0.0, 0.4, 0.0, 2.0]), 2.0, p) == pytest.approx(0.3 + 0.35)


def test_the_shaped_angle_cannot_overshoot_and_near_rest_the_law_is_its_lqr() -> None:
    law, x = holding_pfl(NOMINAL), 1e-4 * np.array([3.0, 1.0, -2.0, 1.0])
    K = law.designed.lqr.K[0]
    assert K[3] ** 2 >= 4 * K[1]
    memory = law.memory()
    law.input_at(0.0, x, memory)
    # Of an angle and a position that are small the bound on the lean is not felt.
    assert memory.v[0] == pytest.approx(-K @ x, rel=1e-6)
    # p'' = l w - g theta and theta'' = w, from the plant itself: w by feedback linearization.
    x, w, p = np.array([0.0, 1e-5, 0.0, 0.0]), 2e-5, NOMINAL.parameters
    u, _ = force_for(NOMINAL, x, w)
    assert NOMINAL.derivative(x, u)[2] == pytest.approx(4 * p.L / 3 * w - p.g * x[1], rel=1e-8)


# cart-ism: gains and sliding dynamics


def test_the_gains_are_the_suprema_over_the_family() -> None:
    """|G (A_t - B_t K - A + B K)| / |G B_t| is gamma1 at most, and eta makes up for min G B_t."""
    law = holding_ism(NOMINAL)
    p, optimum = law.parameters, law.designed.lqr
    worst = 0.0
    for plant in members(3000):
        A_t, B_t = linearize(plant)
        added = A_t - B_t @ p.K - optimum.closed_loop
        worst = max(worst, float(np.linalg.norm(p.G @ added) / abs((p.G @ B_t).item())))
    assert 0.9 * p.gamma1 < worst <= p.gamma1
    ratios = [
        (p.G @ linearize(plant)[1]).item() / (p.G @ optimum.B).item()
        for plant in [member(4.0, 4.0), *members(500)]
    ]
    assert p.eta * min(ratios) == pytest.approx(holding.UNCERTAINTY.reaching_rate)


def test_sliding_dynamics() -> None:
    """Matched parts leave them; G x' = G (A - B K) x on s = 0; every member slides to rest."""
    optimum, random = holding_lqr(NOMINAL).designed.lqr, np.random.default_rng(2)
    for _ in range(20):
        A_t = optimum.A + optimum.B @ random.normal(size=(1, 4)) * 10
        B_t = optimum.B * random.uniform(0.1, 3)
        for G in (np.linalg.pinv(optimum.B), random.normal(size=(1, 4))):
            dynamics = sliding_dynamics(optimum, G, A_t, B_t)
            scale = float(np.linalg.norm(A_t) * np.linalg.norm(B_t) * np.linalg.norm(G))
            scale *= 1e-12 / abs((G @ B_t).item())
            np.testing.assert_allclose(dynamics, optimum.closed_loop, rtol=0, atol=scale)
    for plant in members(20):
        for G in [G for G in projections_of(optimum).values() if G is not None]:
            slope = G @ sliding_dynamics(optimum, G, *linearize(plant))
            np.testing.assert_allclose(slope, G @ optimum.closed_loop, rtol=1e-9, atol=1e-9)
    G = holding_ism(NOMINAL).parameters.G
    for plant in [NOMINAL, member(4.0, 4.0), *members(200)]:
        poles = np.linalg.eigvals(sliding_dynamics(optimum, G, *linearize(plant)))
        # Its slowest pole under 4m and 4L is -0.619/s.
        assert poles.real.max() < -0.6


B3, B4 = linearize(NOMINAL)[1][2:, 0]


@pytest.mark.parametrize(
    ("weights", "law", "numbers", "said"),
    [
        ((np.diag([1.0, 1e5, 1.0, 1.0]), 1.0), holding_pfl, {}, "let the angle overshoot"),
        # A cart held so stiffly that a longer pole makes the sliding dynamics unstable.
        ((np.diag([10.0, 100.0, 1.0, 1.0]), 1.0), holding_ism, {}, "sliding dynamics have a pole"),
        # G B = -0.2 B_3, but the longer pole turns less per force: G B_t > 0.
        (None, holding_ism, {"G": [[0.0, 0.0, 1.0, -1.2 * B3 / B4]]}, "choose another G"),
        (None, holding_ism, {"G": [[1.0, 0.0]]}, "must be 1 x 4"),
        (None, holding_ism, {"G": [[1.0, 0.0, 0.0, 0.0]]}, "singular"),
        (None, holding_ism, {"G": [[0.0, 0.0, math.inf, 0.0]]}, "finite"),
        *(
            (None, lambda _, **x: StateUncertainty(**x), numbers, "must")
            for numbers in (
                {"mass": 0.9}, {"length": 0.0}, {"mass": math.nan}, {"force": -1.0},
                {"force": math.nan}, {"reaching_rate": 0.0},
            )
        ),
    ],
)  # fmt: skip
def test_what_no_gain_can_hold_is_refused(
    weights: Any, law: Any, numbers: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if weights is not None:
        monkeypatch.setattr(holding, "WEIGHTS", weights)
    with pytest.raises(GainError, match=said):
        law(NOMINAL, **numbers)
    if law is holding_ism and weights is not None:
        # It is the length: with the nominal one any mass will do.
        holding_ism(NOMINAL, uncertainty=StateUncertainty(mass=4.0, force=0.05))


def test_the_family_has_its_corners() -> None:
    p, declared = NOMINAL.parameters, StateUncertainty(mass=4.0, length=9.0)
    numbers = [plant.parameters for _, plant in declared.members(NOMINAL)]
    found = {(m.m / p.m, m.L / p.L) for m in numbers}
    assert found == {(a, b) for a in (1.0, 2.0, 4.0) for b in (1.0, 3.0, 9.0)}


def test_mujocos_linear_model_gives_the_same_laws() -> None:
    model = linearize(PHYSICS)
    for ours, expected in zip(model, linearize(NOMINAL), strict=True):
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    for make in (holding_lqr, holding_ism):
        ours, theirs = make(NOMINAL).designed.gains, make(NOMINAL, model).designed.gains
        assert ours.keys() == theirs.keys()
        np.testing.assert_allclose(list(ours.values()), list(theirs.values()), rtol=1e-8)


def test_the_cases_of_validate_do_not_run_them() -> None:
    for name in ("cart-lqr", "cart-ism", "cart-pfl"):
        assert chapter_controller(name, NOMINAL).name == name
    with pytest.raises(ArgumentError, match="did you mean 'cart-ism'"):
        chapter_controller("cart-imp", NOMINAL)


# What is unmatched


def test_mass_is_matched_and_length_is_not_and_the_parts_are_orthogonal() -> None:
    optimum, sizes = holding_lqr(NOMINAL).designed.lqr, {}
    for name, edit in UNCERTAINTIES.items():
        parts = uncertainty(optimum, linearize(PHYSICS.edited(edit)))
        sizes[name] = [np.linalg.norm(part, 2) for part in parts]
    # Rounding of MuJoCo's differences, 1e-10 of the largest entry of A.
    assert sizes["4m"][1] < 1e-9 * sizes["4m"][0]
    assert sizes["4L"][1] > 0.5 * sizes["4L"][0]
    A_t, B_t = linearize(member(4.0, 4.0))
    matched, unmatched = uncertainty(optimum, (A_t, B_t))
    np.testing.assert_allclose(matched.T @ unmatched, 0, atol=1e-10)
    added = A_t - B_t @ optimum.K - optimum.closed_loop
    np.testing.assert_allclose(matched + unmatched, added, atol=1e-12)


def test_amplification_is_the_length_of_b_over_what_g_sees() -> None:
    """phi_u is along (-B_4, B_3) in the rates: [0 0 1 0] makes it |B|/B_3 times as long.

    Among the rates' projections only B+ has the least, 1, and nothing matched is amplified.
    """
    optimum, model = holding_lqr(NOMINAL).designed.lqr, linearize(member(4.0, 4.0))
    B, matrices = optimum.B[:, 0], projections_of(optimum)
    length = np.linalg.norm(B)
    for name, factor in (("B+", 1.0), ("[0 0 1 0]", length / B[2]), ("[0 0 0 1]", length / B[3])):
        assert amplification(optimum, matrices[name], model) == pytest.approx(factor)
    random = np.random.default_rng(3)
    for _ in range(50):
        value = amplification(optimum, random.normal(size=(1, 4)), model)
        assert value is not None
        assert value >= 1 - 1e-12
    assert amplification(optimum, np.linalg.pinv(optimum.B), linearize(member(4.0, 1.0))) is None


def test_the_cart_settles_when_it_stays_on_the_rail_of_the_model() -> None:
    time = np.arange(0.0, 10.001, 0.01)
    assert settling_time(time, np.zeros_like(time), CART_BAND).value == 0.0
    once = np.where(time < 3.0 - 1e-9, 1.0, CART_BAND)
    assert settling_time(time, once, CART_BAND).value == pytest.approx(3.0)
    for never in (np.where(time < 9.5, 1.0, 0.0), np.ones_like(time)):
        assert settling_time(time, never, CART_BAND).note == "not reached"
    model = PHYSICS.model
    posts = [model.geom(i).pos[0] for i in range(model.ngeom) if "post" in model.geom(i).name]
    assert rail_half_length(PHYSICS) == max(posts) == -min(posts)


# On physics


@cache
def held(case: str, law: str) -> Trajectory:
    return holding_case(case).with_settings(**IMPLICIT.changes()).run("physics", law).trajectory


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cart-ism", "cart-pfl"])
@pytest.mark.parametrize("case", ["nominal", "case1", "case2"])
def test_pole_and_cart_are_held(case: str, law: str) -> None:
    run = held(case, law)
    late = run.state[run.time > run.time[-1] - 5]
    assert np.abs(late[:, 0]).max() < 0.005
    assert np.abs(late[:, 1]).max() < 1e-3
    # Measured: 1.04 m at most.
    assert np.abs(run.state[:, 0]).max() < 1.2


@pytest.mark.slow
def test_the_chapters_law_coasts_away() -> None:
    run = held("nominal", "grosmc")
    speed = run.state[run.time > 5, 2]
    assert np.ptp(speed) < 1e-3 * abs(speed.mean())
    assert abs(run.state[-1, 0]) > 15


@pytest.mark.slow
def test_lqr_of_small_angles_costs_what_the_riccati_equation_says() -> None:
    """J = x0' P x0 / 2 on physics, for 0.1 degrees, sampled at 1 kHz."""
    law = nominal_controller(SYSTEM, "cart-lqr", "corrected")
    design, x0 = law.designed.lqr, np.array([0.0, math.radians(0.1), 0.0, 0.0])
    run = simulate(PHYSICS, law, x0, duration=20.0)
    of_state = np.trapezoid(np.einsum("ti,ij,tj->t", run.state, design.Q, run.state), run.time)
    cost = 0.5 * (of_state + float(design.R[0, 0]) * run.input**2 @ np.diff(run.time))
    # Half a sample of delay, 0.5 ms, against time constants of 70 ms: 1 % at most.
    assert cost == pytest.approx(design.optimal_cost(x0), rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("G", ["B+", "[0 0 1 0]", "[0 0 0 1]", "B'P"])
def test_physics_follows_the_sliding_dynamics(G: str) -> None:
    """From 1 degree under 4m and 4L x is exp(sliding dynamics t) x0, not the optimum."""
    optimum = nominal_controller(SYSTEM, "cart-lqr", "corrected").designed.lqr
    matrix = projections_of(optimum)[G]
    assert matrix is not None
    plant, start = PHYSICS.edited(LARGER), math.radians(1.0)
    x0 = np.array([0.0, -start, 0.0, 0.0])
    run = simulate(plant, projected_law(matrix, SMOOTH), x0, duration=8.0)
    dynamics = sliding_dynamics(optimum, matrix, *linearize(plant))
    # Only the matrix of an optimum's trajectory is needed: A - B K with B = 0.
    predicted = optimum._replace(A=dynamics, B=0 * optimum.B).optimal_trajectory(x0, run.time)[:, 1]
    ideal = optimum.optimal_trajectory(x0, run.time)[:, 1]
    assert np.abs(run.state[:, 1] - predicted).max() < 0.03 * start
    assert np.abs(ideal - predicted).max() > 0.2 * start


@pytest.mark.slow
def test_the_angle_stays_within_its_start_or_the_lean() -> None:
    how = find_experiment(SYSTEM, "nominal").with_settings(**IMPLICIT.changes()).realization
    law = nominal_controller(SYSTEM, "cart-pfl", "corrected", how)
    angles = [5.0, 15.0, 25.0, 45.0, 60.0]
    starts = [[p, math.radians(angle), 0.0, 0.0] for angle in angles for p in (0.0, 10.0)]
    for plant in (PHYSICS, PHYSICS.edited(LARGER)):
        runs = simulate([plant] * len(starts), law, starts, duration=10.0)
        for start, state in zip(starts, runs.state, strict=True):
            # A sample's delay of the switching input.
            assert np.abs(state[:, 1]).max() <= 1.01 * max(start[1], LEAN)


@pytest.mark.slow
@pytest.mark.parametrize("switching", ["sign", "implicit"])
@pytest.mark.parametrize("law", ["cart-lqr", "cart-ism", "cart-pfl"])
def test_engines_agree_bit_for_bit(law: str, switching: str) -> None:
    case = find_case(SYSTEM, "case1")
    how = find_experiment(SYSTEM, "case1").with_settings(switching=switching).realization
    controller, plant = (
        nominal_controller(SYSTEM, law, "corrected", how),
        PHYSICS.edited(*case.edits),
    )
    native, python = (
        simulate(plant, controller, case.x0, duration=0.5, engine=engine)
        for engine in ("native", "python")
    )
    for name in ("state", "command", "sliding"):
        np.testing.assert_array_equal(getattr(native, name), getattr(python, name))


@pytest.mark.slow
@pytest.mark.parametrize(("edit", "low", "high"), [("mass", 0.0, 0.02), ("length", 0.1, 1.0)])
def test_mass_leaves_the_optimum_and_length_does_not(edit: str, low: float, high: float) -> None:
    case, start = replace(find_case(SYSTEM, "nominal"), duration=6.0), math.radians(10)
    edits = (BodyEdit("pole", 4.0 if edit == "mass" else 1.0, 4.0 if edit == "length" else 1.0),)
    result = run_case(replace(case, edits=edits), "physics", "cart-ism", IMPLICIT)
    assert low * start <= np.abs(result.comparison.deviation).max() <= high * start
