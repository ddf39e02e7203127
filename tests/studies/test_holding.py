"""The laws that hold pole and cart: their equations in closed form, and their runs on physics."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from shipped import nominal_controller

from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum import cart as holding
from grosmc_mj.cases.cart_pendulum.cart import (
    LEAN,
    force_needed,
    holding_ism,
    holding_lqr,
    holding_pfl,
)
from grosmc_mj.chapter.claims.measurements import cart
from grosmc_mj.control.reaching import sliding_dynamics
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization
from grosmc_mj.control.uncertainty import StateUncertainty
from grosmc_mj.errors import GainError
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.simulate import simulate

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
    return [member(4.0, 4.0), *(member(*random.uniform(1.0, 4.0, 2)) for _ in range(count))]


def force_for(plant: AnalyticPlant, x: Array, w: float) -> tuple[float, float]:
    """The force that makes theta'' = w, and theta'' per force, from x' = f + g u."""
    drift, pushed = plant.derivative(x)[3], plant.derivative(x, 1.0)[3]
    return (w - drift) / (pushed - drift), pushed - drift


def test_the_force_bounds_the_need_of_any_member_and_the_bound_is_attained() -> None:
    """|u_t - u| + f + eta/E_t, from the plants' equations, is within the closed form.

    At rest and leaning against w the heaviest, longest pole needs all of it.
    """
    p, random = holding_pfl(NOMINAL).parameters, np.random.default_rng(0)
    draws = [
        (plant, random.uniform([-3, -1.5, -5, -8], [3, 1.5, 5, 8]), random.uniform(-30, 30))
        for plant in members(400)
    ]
    needed = bound = 0.0
    for plant, x, w in [*draws, (member(4.0, 4.0), np.array([0.0, 0.7, 0.0, 0.0]), -3.0)]:
        (u, E), (u_t, E_t) = force_for(NOMINAL, x, w), force_for(plant, x, w)
        needed, bound = abs(u_t - u) + p.force + p.eta / E_t, force_needed(abs(w), x, E, p)
        # Rounding of forces of up to 1e4 N.
        assert needed <= bound * (1 + 1e-9)
    assert bound == pytest.approx(needed, rel=1e-9)
    p = holding_pfl(NOMINAL, StateUncertainty(force=0.3, reaching_rate=0.7)).parameters
    assert force_needed(5.0, np.array([0.0, 0.4, 0.0, 2.0]), 2.0, p) == pytest.approx(0.3 + 0.35)


def test_the_shaped_angle_cannot_overshoot_and_near_rest_the_law_is_its_lqr() -> None:
    law, x = holding_pfl(NOMINAL), 1e-4 * np.array([3.0, 1.0, -2.0, 1.0])
    K, memory = law.designed.lqr.K[0], law.memory()
    assert K[3] ** 2 >= 4 * K[1]
    law.input_at(0.0, x, memory)
    # Of an angle and a position that are small the bound on the lean is not felt.
    assert memory.v[0] == pytest.approx(-K @ x, rel=1e-6)
    # p'' = l w - g theta and theta'' = w, from the plant itself: w by feedback linearization.
    x, w, p = np.array([0.0, 1e-5, 0.0, 0.0]), 2e-5, NOMINAL.parameters
    u, _ = force_for(NOMINAL, x, w)
    assert NOMINAL.derivative(x, u)[2] == pytest.approx(4 * p.L / 3 * w - p.g * x[1], rel=1e-8)


def test_the_gains_are_the_suprema_over_the_family() -> None:
    """|G (A_t - B_t K - A + B K)| / |G B_t| is gamma1 at most, and eta makes up for min G B_t."""
    law = holding_ism(NOMINAL)
    p, optimum, worst, ratios = law.parameters, law.designed.lqr, 0.0, []
    for plant in members(3000):
        A_t, B_t = linearize(plant)
        added = A_t - B_t @ p.K - optimum.closed_loop
        worst = max(worst, float(np.linalg.norm(p.G @ added) / abs((p.G @ B_t).item())))
        ratios.append((p.G @ B_t).item() / (p.G @ optimum.B).item())
    assert 0.9 * p.gamma1 < worst <= p.gamma1
    assert p.eta * min(ratios) == pytest.approx(holding.UNCERTAINTY.reaching_rate)
    declared = StateUncertainty(mass=4.0, length=9.0).members(NOMINAL)
    p, scaled = NOMINAL.parameters, [plant.parameters for _, plant in declared]
    corners = {(a, b) for a in (1.0, 2.0, 4.0) for b in (1.0, 3.0, 9.0)}
    assert {(m.m / p.m, m.L / p.L) for m in scaled} == corners


def test_matched_parts_leave_the_sliding_dynamics_and_every_member_slides_to_rest() -> None:
    """On s = 0 G x' is G (A - B K) x."""
    optimum, random = holding_lqr(NOMINAL).designed.lqr, np.random.default_rng(2)
    for G in (np.linalg.pinv(optimum.B), random.normal(size=(1, 4))):
        A_t = optimum.A + optimum.B @ random.normal(size=(1, 4)) * 10
        B_t = 0.3 * optimum.B
        dynamics = sliding_dynamics(optimum, G, A_t, B_t)
        scale = float(np.linalg.norm(A_t) * np.linalg.norm(B_t) * np.linalg.norm(G))
        scale *= 1e-12 / abs((G @ B_t).item())
        np.testing.assert_allclose(dynamics, optimum.closed_loop, rtol=0, atol=scale)
    G_of_law = holding_ism(NOMINAL).parameters.G
    for plant in [NOMINAL, *members(50)]:
        for G in filter(np.any, cart.projections_of(optimum).values()):
            slope = G @ sliding_dynamics(optimum, G, *linearize(plant))
            np.testing.assert_allclose(slope, G @ optimum.closed_loop, rtol=1e-9, atol=1e-9)
        poles = np.linalg.eigvals(sliding_dynamics(optimum, G_of_law, *linearize(plant)))
        # Its slowest pole under 4m and 4L is -0.619/s.
        assert poles.real.max() < -0.6


def test_a_law_that_no_gain_can_hold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    B3, B4 = linearize(NOMINAL)[1][2:, 0]
    for G, words in (
        # G B = -0.2 B_3, but the longer pole turns less per force: G B_t > 0.
        ([[0.0, 0.0, 1.0, -1.2 * B3 / B4]], "choose another G"),
        ([[1.0, 0.0]], "must be 1 x 4"),
        ([[1.0, 0.0, 0.0, 0.0]], "singular"),
        ([[0.0, 0.0, math.inf, 0.0]], "finite"),
    ):
        with pytest.raises(GainError, match=words):
            holding_ism(NOMINAL, G=G)
    for numbers in ({"mass": 0.9}, {"length": 0.0}, {"force": -1.0}, {"reaching_rate": 0.0}):
        with pytest.raises(GainError, match="must"):
            StateUncertainty(**dict[str, Any](numbers))
    monkeypatch.setattr(holding, "WEIGHTS", (np.diag([1.0, 1e5, 1.0, 1.0]), 1.0))
    with pytest.raises(GainError, match="let the angle overshoot"):
        holding_pfl(NOMINAL)
    # A cart held so stiffly that a longer pole makes the sliding dynamics unstable; a heavier
    # one does not.
    monkeypatch.setattr(holding, "WEIGHTS", (np.diag([10.0, 100.0, 1.0, 1.0]), 1.0))
    with pytest.raises(GainError, match="sliding dynamics have a pole"):
        holding_ism(NOMINAL)
    holding_ism(NOMINAL, uncertainty=StateUncertainty(mass=4.0, force=0.05))


def test_mass_is_matched_and_length_is_not_and_g_amplifies_the_unmatched_part() -> None:
    """phi_u is along (-B_4, B_3) in the rates: [0 0 1 0] makes it |B|/B_3 times as long.

    Among the rates' projections only B+ has the least, 1, and nothing matched is amplified.
    """
    optimum, sizes = holding_lqr(NOMINAL).designed.lqr, {}
    for name, edit in cart.UNCERTAINTIES.items():
        parts = cart.uncertainty(optimum, linearize(PHYSICS.edited(edit)))
        sizes[name] = [np.linalg.norm(part, 2) for part in parts]
    # Rounding of MuJoCo's differences, 1e-10 of the largest entry of A.
    assert sizes["4m"][1] < 1e-9 * sizes["4m"][0]
    assert sizes["4L"][1] > 0.5 * sizes["4L"][0]
    model = linearize(member(4.0, 4.0))
    matched, unmatched = cart.uncertainty(optimum, model)
    assert matched.T @ unmatched == pytest.approx(np.zeros((4, 4)), abs=1e-10)
    added = model[0] - model[1] @ optimum.K - optimum.closed_loop
    np.testing.assert_allclose(matched + unmatched, added, rtol=1e-7, atol=1e-12)
    B, G = optimum.B[:, 0], cart.projections_of(optimum)
    length = np.linalg.norm(B)
    for name, factor in (("B+", 1.0), ("[0 0 1 0]", length / B[2]), ("[0 0 0 1]", length / B[3])):
        assert cart.amplification(optimum, G[name], model) == pytest.approx(factor)
    random = np.random.default_rng(3)
    values = [cart.amplification(optimum, random.normal(size=(1, 4)), model) for _ in range(50)]
    assert all(value is not None and value >= 1 - 1e-12 for value in values)
    assert cart.amplification(optimum, G["B+"], linearize(member(4.0, 1.0))) is None
    names = [PHYSICS.model.geom(i) for i in range(PHYSICS.model.ngeom)]
    posts = [geom.pos[0] for geom in names if "post" in geom.name]
    assert cart.rail_half_length(PHYSICS) == max(posts) == -min(posts)


# On physics.


@pytest.mark.slow
@pytest.mark.parametrize("law", ["cart-ism", "cart-pfl"])
@pytest.mark.parametrize("case", ["nominal", "case1", "case2"])
def test_pole_and_cart_are_held(case: str, law: str) -> None:
    run = cart.holding_case(case).with_settings(**IMPLICIT.changes()).run("physics", law).trajectory
    late = run.state[run.time > run.time[-1] - 5]
    assert np.abs(late[:, 0]).max() < 0.005
    assert np.abs(late[:, 1]).max() < 1e-3
    # Measured: 1.04 m at most.
    assert np.abs(run.state[:, 0]).max() < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("G", ["B+", "[0 0 1 0]", "[0 0 0 1]", "B'P"])
def test_physics_follows_the_sliding_dynamics(G: str) -> None:
    """From 1 degree under 4m and 4L x is exp(sliding dynamics t) x0, not the optimum."""
    optimum = nominal_controller(SYSTEM, "cart-lqr", "corrected").designed.lqr
    matrix: Any = cart.projections_of(optimum)[G]
    plant, start = PHYSICS.edited(LARGER), math.radians(1.0)
    x0 = np.array([0.0, -start, 0.0, 0.0])
    law = cart.projected_law(matrix, Realization(find_switching("implicit"), 1e-3))
    run = simulate(plant, law, x0, duration=8.0)
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
    starts = [[p, math.radians(a), 0.0, 0.0] for a in (5, 15, 25, 45, 60) for p in (0.0, 10.0)]
    for plant in (PHYSICS, PHYSICS.edited(LARGER)):
        runs = simulate([plant] * len(starts), law, starts, duration=10.0)
        for start, state in zip(starts, runs.state, strict=True):
            # A sample's delay of the switching input.
            assert np.abs(state[:, 1]).max() <= 1.01 * max(start[1], LEAN)
