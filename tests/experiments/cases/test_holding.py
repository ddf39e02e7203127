"""The laws that hold pole and cart: their equations in closed form, and their runs on physics."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shipped import nominal_controller

from grosmc_mj.chapter.claims.measurements import cart
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.settings import Settings
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.linearization import linearize
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.kinds import cart as holding
from grosmc_mj.theory.control.kinds.cart import (
    LEAN,
    force_needed,
    holding_ism,
    holding_lqr,
    holding_pfl,
)
from grosmc_mj.theory.control.reaching import sliding_dynamics
from grosmc_mj.theory.control.switching import find_switching
from grosmc_mj.theory.control.task import Realization
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty
from grosmc_mj.theory.plants import AnalyticPlant

SYSTEM = "cart_pendulum"
PHYSICS = MujocoPlant.load(SYSTEM)
NOMINAL = PHYSICS.analytic()
LARGER = BodyEdit("pole", mass_scale=4.0, length_scale=4.0)
IMPLICIT = Settings(switching="implicit", surface="discrete")


def member(mass: float, length: float) -> AnalyticPlant:
    """The plant with a scaled pole."""
    p = NOMINAL.parameters
    return replace(NOMINAL, parameters=replace(p, m=mass * p.m, L=length * p.L))


def members(count: int) -> list[AnalyticPlant]:
    """The largest and random members of the declared family."""
    random = np.random.default_rng(1)
    scales = [random.uniform(1.0, 4.0, 2) for _ in range(count)]
    return [member(4.0, 4.0), *(member(mass, length) for mass, length in scales)]


def force_for(plant: AnalyticPlant, x: Array, w: float) -> tuple[float, float]:
    """The force that makes theta'' = w, and theta'' per force, from x' = f + g u."""
    drift = plant.derivative(x)[3]
    per_force = plant.derivative(x, 1.0)[3] - drift
    return (w - drift) / per_force, per_force


def need_and_bound(plant: AnalyticPlant, x: Array, w: float) -> tuple[float, float]:
    """|u_t - u| + f + eta/E_t of a member, and its bound in closed form."""
    p = holding_pfl(NOMINAL).parameters
    u, E = force_for(NOMINAL, x, w)
    u_t, E_t = force_for(plant, x, w)
    return abs(u_t - u) + p.force + p.eta / E_t, force_needed(abs(w), x, E, p)


def test_the_force_bounds_the_need_of_any_member() -> None:
    """|u_t - u| + f + eta/E_t, from the plants' equations, is within the closed form."""
    random = np.random.default_rng(0)
    for plant in members(30):
        x = random.uniform([-3, -1.5, -5, -8], [3, 1.5, 5, 8])
        needed, bound = need_and_bound(plant, x, random.uniform(-30, 30))
        # Rounding of forces of up to 1e4 N.
        assert needed <= bound * (1 + 1e-9)


def test_the_largest_pole_at_rest_against_w_needs_all_of_the_force() -> None:
    x = np.array([0.0, 0.7, 0.0, 0.0])
    needed, bound = need_and_bound(member(4.0, 4.0), x, -3.0)
    assert bound == pytest.approx(needed, rel=1e-9)


def test_without_uncertainty_of_the_pole_the_force_is_f_plus_eta_over_E() -> None:
    """0.3 N, and 0.7 rad/s^2 over 2 rad/s^2 per N."""
    uncertainty = StateUncertainty(force=0.3, reaching_rate=0.7)
    p = holding_pfl(NOMINAL, uncertainty).parameters
    x = np.array([0.0, 0.4, 0.0, 2.0])
    assert force_needed(5.0, x, 2.0, p) == pytest.approx(0.3 + 0.35)


def test_the_family_of_the_shaped_law_is_told_in_words() -> None:
    uncertainty = StateUncertainty(mass=2.0, length=3.0, force=0.5)
    declared = holding_pfl(NOMINAL, uncertainty).designed.declared
    assert declared == "m up to x2, L up to x3, forces up to 0.5 N on the cart"


def test_the_shaped_angle_cannot_overshoot() -> None:
    K = holding_pfl(NOMINAL).designed.lqr.K[0]
    assert K[3] ** 2 >= 4 * K[1]


def test_near_rest_the_law_is_its_lqr() -> None:
    """Of an angle and a position that are small the bound on the lean is not felt."""
    law = holding_pfl(NOMINAL)
    x = 1e-4 * np.array([3.0, 1.0, -2.0, 1.0])
    memory = law.memory()
    law.input_at(0.0, x, memory)
    assert memory.v[0] == pytest.approx(-law.designed.lqr.K[0] @ x, rel=1e-6)


def test_the_cart_accelerates_by_the_pole_that_it_turns() -> None:
    """p'' = l w - g theta, theta'' = w from the plant itself: w by feedback linearization."""
    p = NOMINAL.parameters
    x = np.array([0.0, 1e-5, 0.0, 0.0])
    w = 2e-5
    u, _ = force_for(NOMINAL, x, w)
    acceleration = NOMINAL.derivative(x, u)[2]
    assert acceleration == pytest.approx(4 * p.L / 3 * w - p.g * x[1], rel=1e-8)


def test_the_gains_are_the_suprema_over_the_family() -> None:
    """|G (A_t - B_t K - A + B K)| / |G B_t| is gamma1 at most, and eta makes up for min G B_t."""
    law = holding_ism(NOMINAL)
    p = law.parameters
    optimum = law.designed.lqr
    worst = 0.0
    ratios = []
    for plant in members(300):
        A_t, B_t = linearize(plant)
        added = A_t - B_t @ p.K - optimum.closed_loop
        GB_t = (p.G @ B_t).item()
        worst = max(worst, float(np.linalg.norm(p.G @ added) / abs(GB_t)))
        ratios.append(GB_t / (p.G @ optimum.B).item())
    # The worst plant is a corner of the family: both are one number, rounded in different ways.
    assert 0.9 * p.gamma1 < worst <= p.gamma1 * (1 + 1e-12)
    assert p.eta * min(ratios) == pytest.approx(holding.UNCERTAINTY.reaching_rate)


def test_members_of_a_family_are_a_geometric_grid_of_three_by_three() -> None:
    p = NOMINAL.parameters
    scales = set()
    for _, plant in StateUncertainty(mass=4.0, length=9.0).members(NOMINAL):
        scales.add((plant.parameters.m / p.m, plant.parameters.L / p.L))
    assert scales == {(mass, length) for mass in (1.0, 2.0, 4.0) for length in (1.0, 3.0, 9.0)}


OPTIMUM = holding_lqr(NOMINAL).designed.lqr
PROJECTIONS = cart.projections_of(OPTIMUM)
WITH_SURFACE = [name for name, G in PROJECTIONS.items() if G is not None]


@pytest.mark.parametrize(
    "G",
    [np.linalg.pinv(OPTIMUM.B), np.random.default_rng(2).normal(size=(1, 4))],
    ids=["B+", "random"],
)
def test_matched_parts_leave_the_sliding_dynamics(G: Array) -> None:
    random = np.random.default_rng(3)
    A_t = OPTIMUM.A + OPTIMUM.B @ random.normal(size=(1, 4)) * 10
    B_t = 0.3 * OPTIMUM.B
    dynamics = sliding_dynamics(OPTIMUM, G, A_t, B_t)
    scale = float(np.linalg.norm(A_t) * np.linalg.norm(B_t) * np.linalg.norm(G))
    rounding = scale * 1e-12 / abs((G @ B_t).item())
    np.testing.assert_allclose(dynamics, OPTIMUM.closed_loop, rtol=0, atol=rounding)


@pytest.mark.parametrize("name", WITH_SURFACE)
def test_s_stays_zero_on_the_sliding_dynamics_of_every_member(name: str) -> None:
    """On s = 0 G x' is G (A - B K) x."""
    G: Any = PROJECTIONS[name]
    for plant in [NOMINAL, *members(50)]:
        slope = G @ sliding_dynamics(OPTIMUM, G, *linearize(plant))
        np.testing.assert_allclose(slope, G @ OPTIMUM.closed_loop, rtol=1e-9, atol=1e-9)


def test_every_member_slides_to_rest() -> None:
    """Its slowest pole under 4m and 4L is -0.619/s."""
    G = holding_ism(NOMINAL).parameters.G
    for plant in [NOMINAL, *members(50)]:
        poles = np.linalg.eigvals(sliding_dynamics(OPTIMUM, G, *linearize(plant)))
        assert poles.real.max() < -0.6


B3, B4 = linearize(NOMINAL)[1][2:, 0]


@pytest.mark.parametrize(
    ("G", "words"),
    [
        # G B = -0.2 B_3, but the longer pole turns less per force: G B_t > 0.
        ([[0.0, 0.0, 1.0, -1.2 * B3 / B4]], "choose another G"),
        ([[1.0, 0.0]], "must be 1 x 4"),
        ([[1.0, 0.0, 0.0, 0.0]], "singular"),
        ([[0.0, 0.0, math.inf, 0.0]], "finite"),
    ],
)
def test_a_projection_that_no_gain_can_hold_is_refused(G: list[list[float]], words: str) -> None:
    with pytest.raises(GainError, match=words):
        holding_ism(NOMINAL, G=G)


@pytest.mark.parametrize(
    "numbers", [{"mass": 0.9}, {"length": 0.0}, {"force": -1.0}, {"reaching_rate": 0.0}]
)
def test_an_uncertainty_without_sense_is_refused(numbers: dict[str, Any]) -> None:
    with pytest.raises(GainError, match="must"):
        StateUncertainty(**numbers)


def test_weights_that_let_the_angle_overshoot_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(holding, "WEIGHTS", (np.diag([1.0, 1e5, 1.0, 1.0]), 1.0))
    with pytest.raises(GainError, match="let the angle overshoot"):
        holding_pfl(NOMINAL)


def test_a_cart_that_is_held_too_stiffly_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A longer pole makes the sliding dynamics unstable; a heavier one does not."""
    monkeypatch.setattr(holding, "WEIGHTS", (np.diag([10.0, 100.0, 1.0, 1.0]), 1.0))
    with pytest.raises(GainError, match="sliding dynamics have a pole"):
        holding_ism(NOMINAL)
    holding_ism(NOMINAL, uncertainty=StateUncertainty(mass=4.0, force=0.05))


def sizes_under(uncertainty: str) -> tuple[float, float]:
    """Spectral norms of the matched and the unmatched part under a change of the pole."""
    model = linearize(PHYSICS.changed(cart.UNCERTAINTIES[uncertainty]))
    matched, unmatched = cart.uncertainty(OPTIMUM, model)
    return float(np.linalg.norm(matched, 2)), float(np.linalg.norm(unmatched, 2))


def test_mass_is_matched_and_length_is_not() -> None:
    """To rounding of MuJoCo's differences, 1e-10 of the largest entry of A."""
    matched, unmatched = sizes_under("4m")
    assert unmatched < 1e-9 * matched
    matched, unmatched = sizes_under("4L")
    assert unmatched > 0.5 * matched


LARGEST = linearize(member(4.0, 4.0))


def test_the_matched_part_is_orthogonal_to_the_unmatched_one_and_both_are_the_whole() -> None:
    matched, unmatched = cart.uncertainty(OPTIMUM, LARGEST)
    assert matched.T @ unmatched == pytest.approx(np.zeros((4, 4)), abs=1e-10)
    A_t, B_t = LARGEST
    added = A_t - B_t @ OPTIMUM.K - OPTIMUM.closed_loop
    np.testing.assert_allclose(matched + unmatched, added, rtol=1e-7, atol=1e-12)


B = OPTIMUM.B[:, 0]


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("B+", 1.0),
        ("[0 0 1 0]", np.linalg.norm(B) / B[2]),
        ("[0 0 0 1]", np.linalg.norm(B) / B[3]),
    ],
)
def test_a_projection_amplifies_the_unmatched_part(name: str, factor: float) -> None:
    """phi_u is along (-B_4, B_3) in the rates: [0 0 1 0] makes it |B|/B_3 times as long."""
    amplification = cart.amplification(OPTIMUM, PROJECTIONS[name], LARGEST)
    assert amplification == pytest.approx(factor)


def test_no_projection_amplifies_less_than_the_pseudoinverse() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        value = cart.amplification(OPTIMUM, random.normal(size=(1, 4)), LARGEST)
        assert value is not None
        assert value >= 1 - 1e-12


def test_nothing_matched_is_amplified() -> None:
    heavier = linearize(member(4.0, 1.0))
    assert cart.amplification(OPTIMUM, PROJECTIONS["B+"], heavier) is None


def test_the_cart_s_centre_can_go_as_far_as_the_posts() -> None:
    geoms = [PHYSICS.model.geom(i) for i in range(PHYSICS.model.ngeom)]
    posts = [geom.pos[0] for geom in geoms if "post" in geom.name]
    half = cart.rail_half_length(PHYSICS)
    assert half == max(posts)
    assert half == -min(posts)


# On physics.


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cart-ism", "cart-pfl"])
@pytest.mark.parametrize("case", ["nominal", "case1", "case2"])
def test_cart_and_pole_are_held_near_the_middle_of_the_rail(case: str, law: str) -> None:
    """Measured: 1.04 m from it at most."""
    experiment = cart.holding_case(case).changed(**IMPLICIT.changes())
    run = experiment.run("physics", law).trajectory
    late = run.state[run.time > run.time[-1] - 5]
    assert np.abs(late[:, 0]).max() < 0.005
    assert np.abs(late[:, 1]).max() < 1e-3
    assert np.abs(run.state[:, 0]).max() < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("G", ["B+", "[0 0 1 0]", "[0 0 0 1]", "B'P"])
def test_physics_follows_the_sliding_dynamics(G: str) -> None:
    """From 1 degree under 4m and 4L x is exp(sliding dynamics t) x0, not the optimum."""
    optimum = nominal_controller(SYSTEM, "cart-lqr", "corrected").designed.lqr
    matrix: Any = cart.projections_of(optimum)[G]
    plant = PHYSICS.changed(LARGER)
    start = math.radians(1.0)
    x0 = np.array([0.0, -start, 0.0, 0.0])
    law = cart.projected_law(matrix, Realization(find_switching("implicit"), 1e-3))
    run = simulate(plant, law, x0, duration=8.0)
    dynamics = sliding_dynamics(optimum, matrix, *linearize(plant))
    # Only the matrix of an optimum's trajectory is needed: A - B K with B = 0.
    sliding = optimum._replace(A=dynamics, B=0 * optimum.B)
    predicted = sliding.optimal_trajectory(x0, run.time)[:, 1]
    ideal = optimum.optimal_trajectory(x0, run.time)[:, 1]
    assert np.abs(run.state[:, 1] - predicted).max() < 0.03 * start
    assert np.abs(ideal - predicted).max() > 0.2 * start


@pytest.mark.slow
@pytest.mark.parametrize("plant", [PHYSICS, PHYSICS.changed(LARGER)], ids=["nominal", "larger"])
def test_the_angle_stays_within_its_start_or_the_lean(plant: MujocoPlant) -> None:
    nominal = find_experiment(SYSTEM, "nominal")
    realization = nominal.changed(**IMPLICIT.changes()).realization
    law = nominal_controller(SYSTEM, "cart-pfl", "corrected", realization)
    angles = [math.radians(angle) for angle in (5, 15, 25, 45, 60)]
    starts = [[p, angle, 0.0, 0.0] for angle in angles for p in (0.0, 10.0)]
    runs = simulate([plant] * len(starts), law, starts, duration=10.0)
    for start, state in zip(starts, runs.state, strict=True):
        # A sample's delay of the switching input.
        assert np.abs(state[:, 1]).max() <= 1.01 * max(start[1], LEAN)
