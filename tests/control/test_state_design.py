"""Section 2's laws on the linearization of any plant."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.control.design import linear_lqr, realized, state_grosmc
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task, state_task
from grosmc_mj.control.uncertainty import StateUncertainty
from grosmc_mj.errors import ArgumentError, GainError, ModelError
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.plants import OperatingPoint, equilibrium


def hanging() -> gm.AnalyticPlant:
    """A damped pendulum with a torque: at rest anywhere, under a torque."""
    a, w, m, c = sp.symbols("angle rate m c")
    return gm.affine_plant(
        "hanging", states={"angle": "rad", "rate": "rad/s"}, inputs={"torque": "N m"},
        f=[w, (-9.81 * m * sp.sin(a) - c * w) / m], g=[0, 1 / m], h=[a],
        parameters={"m": 2.0, "c": 0.5},
    )  # fmt: skip


def two_carts() -> gm.AnalyticPlant:
    """Two inputs that reach both carts."""
    names = sp.symbols("p1 p2 v1 v2 k")
    p1, p2, v1, v2, k = names
    return gm.affine_plant(
        "carts", states={"p1": "m", "p2": "m", "v1": "m/s", "v2": "m/s"},
        inputs={"u1": "N", "u2": "N"}, f=[v1, v2, k * (p2 - p1), k * (p1 - p2)],
        g=[[0, 0], [0, 0], [1, 0.2], [0.1, 1]], h=[p1, p2], parameters={"k": 3.0},
    )  # fmt: skip


def task(angle: float = 0.8) -> Task:
    plant = hanging()
    return state_task(plant, np.diag([10.0, 1.0]), 1.0, equilibrium(plant, {0: angle}))


@pytest.mark.parametrize("make", [linear_lqr, state_grosmc])
def test_it_stays_where_it_rests(make: Any) -> None:
    """The input that holds it is in the law, and costs nothing."""
    made = task()
    law = make(made)
    run = gm.simulate(made.plant, law, made.reference.x, duration=1.0)
    np.testing.assert_allclose(run.state - made.reference.x, 0, atol=1e-12)
    np.testing.assert_allclose(run.input, made.reference.u[0], rtol=1e-12)
    assert np.abs(run.memory["v"]).max() < 1e-12
    assert made.reference.u[0] == pytest.approx(9.81 * 2 * np.sin(0.8))


def test_its_optimum_starts_where_the_run_does() -> None:
    """In the states' own coordinates, about the operating point."""
    made = task()
    law = linear_lqr(made)
    run = gm.simulate(made.plant, law, made.reference.x + np.array([0.05, 0.1]), duration=0.02)
    found = compare_with_optimum(run, law)
    np.testing.assert_allclose(found.optimum[0], run.state[0, [0]], rtol=1e-12)
    np.testing.assert_allclose(found.reference[0], made.reference.x[[0]], rtol=1e-12)


@pytest.mark.parametrize("plant", [hanging, two_carts])
def test_the_engines_agree_bit_for_bit(plant: Any) -> None:
    made = plant()
    n = len(made.system.states)
    for law in (linear_lqr, state_grosmc):
        controller = law(state_task(made, np.eye(n), 1.0))
        runs = [gm.simulate(made, controller, np.full(n, 0.2), duration=0.5, engine=engine)
                for engine in ("native", "python")]  # fmt: skip
        np.testing.assert_array_equal(runs[0].state, runs[1].state)
        np.testing.assert_array_equal(runs[0].memory["v"], runs[1].memory["v"])


def test_matched_uncertainty_leaves_the_nominal_optimum() -> None:
    """Damping is matched: what is left is what sampling leaves, |s| <= T |w|; LQR is far off."""
    made = task(0.0)
    declared = StateUncertainty(scales={"c": (1.0, 6.0)}, force=0.1, reaching_rate=0.5)
    laws = [linear_lqr(made), state_grosmc(made, declared)]
    laws[1] = realized(laws[1], Realization(find_switching("implicit"), 1e-3))
    true, away = made.plant.changed(scales={"c": 6.0}), []
    pushed = []
    for law in laws:
        run = gm.simulate(true, law, [0.05, 0.0], duration=4.0)
        pushed.append(np.abs(2.5 * run.state[:, 1]).max())
        optimum = law.designed.lqr.optimal_trajectory(run.state[0], run.time)
        away.append(np.abs(run.state - optimum)[:, 0].max())
    assert away[1] < 1e-3 * pushed[1]
    assert away[0] > 20 * away[1]


def test_the_gains_are_those_of_the_worst_member() -> None:
    """By hand: B = [0, 1/m], so G = [0, m], r = 1/1.5 and |G dA| = |c - c'| of the rate."""
    made = task(0.0)
    declared = StateUncertainty(scales={"m": (1.0, 1.5)}, force=0.3, reaching_rate=0.2)
    p = state_grosmc(made, declared).parameters
    np.testing.assert_allclose(p.G, [[0.0, 2.0]], atol=1e-12)
    assert p.eta == pytest.approx(0.2 * 1.5)
    assert p.gamma0 == pytest.approx(0.3)
    A, B, K = made.plant.linearization()[0], made.plant.linearization()[1], p.K
    heavy = made.plant.changed(scales={"m": 1.5})
    A_t, B_t = heavy.linearization()
    expected = np.linalg.norm(p.G @ (A_t - B_t @ K - A + B @ K)) * 1.5
    assert p.gamma1 == pytest.approx(expected)


def test_a_member_that_does_not_rest_there_costs_a_constant() -> None:
    """The nominal torque does not hold a heavier one: m' g sin is missing, over its own m'."""
    made = task(0.8)
    p = state_grosmc(made, StateUncertainty(scales={"m": (1.0, 1.5)})).parameters
    weight = 9.81 * np.sin(0.8)
    # x'' = -g sin + u_e/m' = -g sin (1 - m/m'), seen through G = m and r = m/m'.
    assert p.gamma0 == pytest.approx(2.0 * weight * (1 - 1 / 1.5) * 1.5)


def test_a_push_where_the_input_acts_is_a_disturbance_of_the_input() -> None:
    """A force on the cart, in N, and the input's own 0.7 N."""
    cart = gm.MujocoPlant.load("cart_pendulum").analytic()
    made = state_task(cart, np.eye(4), 1.0)
    asked = StateUncertainty(body="cart", push=0.7), StateUncertainty(force=0.7)
    for each in asked:
        assert state_grosmc(made, each).parameters.gamma0 == pytest.approx(0.7)


@pytest.mark.parametrize(
    ("unit", "G", "wanted"), [("N", None, "N s"), ("1", None, "s"), ("N", [[0.0, 3.0]], "1")]
)
def test_s_has_the_unit_of_the_input_times_time(unit: str, G: Any, wanted: str) -> None:
    """Where G B is 1; of another G it is told no unit."""
    a, w = sp.symbols("a w")
    plant = gm.affine_plant(
        "free", states={"a": "m", "w": "m/s"}, inputs={"u": unit}, f=[w, -a], g=[0, 1], h=[a],
        parameters={},
    )  # fmt: skip
    assert state_grosmc(state_task(plant, np.eye(2), 1.0), G=G).designed.sliding_unit == wanted


def test_two_inputs_take_the_least_of_the_symmetric_part() -> None:
    made = state_task(two_carts(), np.eye(4), 1.0)
    law = state_grosmc(made, StateUncertainty(scales={"k": (0.5, 2.0)}))
    A, B = made.plant.linearization()
    others = [made.plant.changed(scales={"k": s}).linearization()[0] for s in (0.5, 2.0)]
    worst = max(np.linalg.norm(law.parameters.G @ (A_t - A)) for A_t in others)
    assert law.parameters.gamma1 == pytest.approx(worst / np.sqrt(2))
    assert B.shape == (4, 2)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"mass": 0.5}, "mass = 0.5 must be finite and 1 or more"),
        ({"length": "two"}, "length = 'two' must be finite and 1 or more"),
        ({"push": -1.0}, "push = -1 must be finite and not negative"),
        ({"reaching_rate": 0.0}, "reaching_rate = 0 must be finite and positive"),
        ({"scales": {"m": (2.0, 1.0)}}, r"ranges .* above 0, unlike m = \(2.0, 1.0\)"),
        ({"scales": {"m": 2.0}}, r"ranges .* above 0, unlike m = 2"),
    ],
)
def test_wrong_declarations_are_refused(numbers: dict[str, Any], said: str) -> None:
    with pytest.raises(GainError, match=said):
        StateUncertainty(**numbers)


def test_what_the_plant_has_not_is_told() -> None:
    with pytest.raises(ModelError, match="scale a parameter instead"):
        state_grosmc(task(), StateUncertainty(mass=2.0))
    with pytest.raises(ModelError, match="unknown parameter"):
        state_grosmc(task(), StateUncertainty(scales={"M": (1.0, 2.0)}))
    with pytest.raises(GainError, match="no body '' that could be pushed: valid: none"):
        state_grosmc(task(), StateUncertainty(push=1.0))
    with pytest.raises(ArgumentError, match=r"limit = 0 must be positive"):
        state_grosmc(task(), limit=0.0)
    moving = OperatingPoint(np.array([0.8, 0.0]), np.zeros(1))
    with pytest.raises(ArgumentError, match="is no equilibrium"):
        linear_lqr(state_task(hanging(), np.eye(2), 1.0, moving))
    with pytest.raises(ArgumentError, match="must be a plant"):
        state_task("hanging", np.eye(2), 1.0)
