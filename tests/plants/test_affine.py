"""Plants of the user's own, the designs for them, where they rest, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.control.design import linear_lqr
from grosmc_mj.control.reaching import nominal
from grosmc_mj.errors import ArgumentError, GainError, ModelError, PremiseError
from grosmc_mj.plants import AnalyticPlant, equilibrium

x, x1, x2, a, b = sp.symbols("x x1 x2 a b")
CHAIN: dict[str, Any] = {
    "states": {"x1": "m", "x2": "m/s"}, "inputs": {"u": "N"}, "g": [0, 1], "h": [x1],
}  # fmt: skip


def chain(f1: Any = x2, f2: Any = 0, g2: Any = 1, **numbers: float) -> AnalyticPlant:
    """A second-order plant with x1 as its output."""
    return gm.affine_plant("chain", **{**CHAIN, "f": [f1, f2], "g": [0, g2], "parameters": numbers})


def first(f: Any, **others: Any) -> AnalyticPlant:
    """A first-order plant."""
    return gm.affine_plant("w", **{"states": {"x": "1"}, "inputs": {"u": "1"}, "f": [f], "g": [1],
                                   "h": [x], "parameters": {}, **others})  # fmt: skip


def inner(rate: Any, h: Any = x1) -> Any:
    """x1' = u with a state inside, x2' = rate."""
    plant = gm.affine_plant(
        "inner", **{**CHAIN, "f": [0, rate], "g": [1, 0], "h": [h]}, parameters={}
    )
    return gm.feedback_linearization(plant.system.equations)


def two_masses(**numbers: float) -> AnalyticPlant:
    """Two masses that the inputs push crosswise."""
    y1, v1, y2, v2, c = sp.symbols("y1 v1 y2 v2 c")
    return gm.affine_plant(
        "masses", states={"y1": "m", "v1": "m/s", "y2": "m", "v2": "m/s"},
        inputs={"u1": "N", "u2": "N"}, f=[v1, 0, v2, 0], g=[[0, 0], [1, c], [0, 0], [-c, 1]],
        h=[y1, y2], parameters={"c": 0.0, **numbers},
    )  # fmt: skip


def task(
    plant: AnalyticPlant, *targets: float, degrees: tuple[int, ...] = (2,), R: float = 1.0
) -> gm.Task:
    error, n = (
        gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(*degrees)),
        len(plant.system.states),
    )
    Q = np.diag([10.0, 1.0]) if n == 2 else np.eye(n)
    target = gm.control.Setpoints(*targets) if len(targets) > 1 else gm.control.Setpoint(*targets)
    return gm.Task(plant, error, target, Q, R)


def test_other_numbers_are_those_of_the_plant_and_no_input_of_the_jacobian() -> None:
    plant = chain(f2=a * x1, a=1.0)
    assert plant.with_parameters(a=2.0).parameters.a == 2.0
    A, B = chain(f2=-sp.Symbol("u0") * x1, u0=3.0).jacobian([0.5, 0.0], [7.0])
    assert (A.tolist(), B.tolist()) == ([[0.0, 1.0], [-3.0, 0.0]], [[0.0], [1.0]])


def test_linearization_about_zero_error_is_exact_and_one_number_weighs_every_input() -> None:
    """A finite step would make something else of a sine as quick as this."""
    design = linear_lqr(task(chain(f2=sp.sin(100 * x1)))).designed.lqr
    assert design.A[1, 0] == pytest.approx(100.0, rel=1e-12)
    both = task(two_masses(), 0.0, 0.0, degrees=(2, 2), R=2.0).optimum(linearizing=True)
    assert both.R.tolist() == [[2.0, 0.0], [0.0, 2.0]]


DECLARED = gm.Uncertainty({"b": (1.0, 2.0)}, (), (1.0, 1.0), 0.1)


def test_gains_cover_what_reaches_s_through_the_row_without_an_input() -> None:
    """x1' = a x2 with a unknown is not matched, but G = [5, 1] sees it."""
    plant = chain(f1=a * x2, a=1.0)
    declared = replace(DECLARED, scales={"a": (1.0, 3.0)})
    law = gm.regulating_grosmc(task(plant), declared, G=[[5.0, 1.0]])
    p, design, random = law.parameters, law.designed.lqr, np.random.default_rng(0)
    S = p.G @ design.closed_loop
    for _ in range(50):
        z = random.uniform(-1, 1, 2)
        x = law.coordinates.place(0.0, z, p)
        true = plant.with_parameters(a=random.uniform(1, 3))
        alpha, E = law.coordinates.dynamics(0.0, x, p)
        u_0 = np.linalg.solve(E, -(p.K @ z) - alpha)
        motion = law.coordinates.error_dynamics([0.0], x[None], p, true)
        condition = nominal(law.designed, p, [0.0], x[None], z[None]).reaching(motion)
        drift, gain = motion[0][0], motion[1][0]
        assert condition.push[0] == pytest.approx(p.G @ (drift + gain @ u_0) - S @ z, abs=1e-12)
        assert condition.R[0] == pytest.approx(p.G @ gain / (p.GB @ E), rel=1e-12)
        rho = p.eta + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * np.linalg.norm(p.GB @ E)
        assert abs(condition.push[0, 0]) - rho * condition.R[0, 0, 0] <= -0.1 + 1e-9


def test_gains_hold_for_one_switch_for_both_inputs() -> None:
    masses = two_masses()
    declared = gm.Uncertainty({"c": (0.2, 1.2)}, (), (1.0,) * 4, 0.1)
    # Pushed crosswise by as much as it should be straight on: dominance has nothing left.
    crossed = replace(task(masses, 0.0, 0.0, degrees=(2, 2)), plant=masses.with_parameters(c=0.5))
    unit = gm.Realization(gm.control.find_switching("unit-vector"))
    law = gm.control.realized(gm.regulating_grosmc(crossed, declared), unit)
    run = gm.simulate(masses.with_parameters(c=0.6), law, [1.0, 0.0, -1.0, 0.0], duration=2.0)
    assert run.sliding is not None
    assert np.linalg.norm(run.sliding, axis=1).max() < 0.05


# Feedback linearization of hard cases


@pytest.mark.parametrize(
    # A gain that is small by its numbers is no zero; an expression that only part of the space has.
    ("changes", "value"),
    [({"g2": a * sp.Float("1e-10")}, 5e10), ({"f2": sp.log(x1 - 2) + sp.sqrt(-a)}, -2.0)],
)
def test_relative_degree_of_hard_cases(changes: dict[str, Any], value: float) -> None:
    equations = chain(**changes, a=value).system.equations
    assert gm.feedback_linearization(equations).relative_degree == (2,)


def test_zero_dynamics_at_rest_have_poles() -> None:
    zero = inner(-x2).zero_dynamics()
    assert zero is not None
    assert zero.poles(None).tolist() == [-1.0]


# Where plants rest

SPRING = """
<mujoco><worldbody><body name="b"><joint name="j" type="slide" axis="0 0 1" stiffness="100"/>
<geom size="0.1" mass="2"/></body></worldbody>
<actuator><motor name="m" joint="j" ctrllimited="true" ctrlrange="-5 5"/></actuator></mujoco>
"""


def test_a_plant_rests_next_to_where_it_is_used_under_the_input_that_holds_it() -> None:
    tank = first(-0.3 * sp.sqrt(x), near={"x": 1.0})  # not defined below zero
    point = equilibrium(tank, {0: 4.0})
    np.testing.assert_allclose([*point.x, *point.u], [4.0, 0.6], rtol=1e-9)
    point = equilibrium(gm.MujocoPlant.load("cart_pendulum"), {0: 0.3})
    assert [*point.x, *point.u] == [0.3, 0.0, 0.0, 0.0, 0.0]
    held = equilibrium(gm.Robot.from_mjcf(SPRING).plant, {0: -0.16})
    np.testing.assert_allclose(held.u, [2 * 9.81 - 16.0], rtol=1e-6)
    for near in (0.8, -0.8):
        plant = first(x**3 - x, g=[0 * x], near={"x": near})
        assert equilibrium(plant).x[0] == pytest.approx(np.sign(near), abs=1e-6)


# What is refused


def plant(**changes: Any) -> AnalyticPlant:
    right = {**CHAIN, "f": [x2, a], "parameters": {"a": 1.0}}
    assert gm.affine_plant("chain", **right).parameters.a == 1.0
    return gm.affine_plant("chain", **{**right, **changes})


def gains(**changes: Any) -> Any:
    law = gm.regulating_grosmc(task(chain(g2=b, b=1.0)), DECLARED)
    assert law.designed.gains["eta"] == pytest.approx(0.1)
    return gm.regulating_grosmc(task(chain(g2=b, b=1.0)), replace(DECLARED, **changes))


REFUSED: list[tuple[Callable[[], Any], str]] = [
    *((lambda changes=changes: plant(**changes), words) for changes, words in (
        ({"parameters": {}}, "a: no number, and none of x1, x2"),
        ({"parameters": {"a": 1.0, "b": 2.0}}, "b: a number that is in no equation"),
        ({"parameters": {"a": np.nan}}, "a = nan must be finite"),
        ({"parameters": {"a": "1"}}, "a = '1' must be finite"),
        ({"f": [x2]}, "f has 1 rows of 1, must have one for each of 2 states"),
        ({"f": [x2, "1/*"]}, "must be a list of expressions"),
        ({"f": [x2, None]}, "must be a list of expressions"),
        ({"h": [x1, x2]}, "1 inputs are named, g has 1 columns and h 2 outputs"),
        ({"states": ["x1", "x2"]}, "states = .* must be a valid dictionary"),
        ({"f": [sp.Symbol("x2", real=True), a]}, "x2: another symbol than the state"),
    )),
    (lambda: plant().with_parameters(q=2.0), r"unknown parameter of chain 'q': valid: a"),
    (lambda: plant().with_parameters(a=np.nan), "a = nan must be finite"),
    (lambda: chain().jacobian([0.0] * 3, [0.0]), r"x has shape \(3,\), u \(1,\)"),
    (lambda: first(x, near={"y": 1.0}), "near: unknown state 'y'"),
    (lambda: first(x * sp.Symbol("u") ** 2), r"u: an input outside of g.*make it a state"),
    (lambda: linear_lqr(task(chain(f2=-9.8))), r"no equilibrium without input.*-9\.8"),
    *((lambda degrees=degrees: task(chain(), degrees=degrees),
       r"relative degrees \(2,\), the reference has") for degrees in ((3,), (2, 2), (1,))),
    (lambda: task(two_masses(), 0.0, degrees=(2, 2)),
     "the reference has no value at t = 0: 'Setpoint'"),
    (lambda: gains(scales={"m": (1.0, 2.0)}), "unknown parameter of chain 'm': valid: b"),
    (lambda: gains(wrench=(1.0,) * 6), "6 wrench components, must have 0"),
    (lambda: gains(region=(1.0,)), "1 bounds of the operating region, must have 2"),
    *((lambda e=e: gm.tracking_grosmc(task(chain()), k=1.0, epsilon=e),
       r"epsilon = .* must be finite and positive") for e in (0.0, -1.0, np.inf, np.nan)),
    (lambda: gm.Realization("implicit"),  # pyright: ignore[reportArgumentType]
     r"switching = 'implicit' must be a switching law"),
    (lambda: inner(-x2 - 2).zero_dynamics().poles(None), "not at rest at zero"),
    (lambda: inner(-x2, x1**2 - 4).zero_dynamics(), "2 branches"),
    (lambda: equilibrium(gm.Robot.from_mjcf(SPRING).plant, {0: 0.0}),
     r"under inputs cut to \[-5\.0\] ... \[5\.0\]"),
    (lambda: equilibrium(gm.MujocoPlant.load("cart_pendulum"), {1: 0.5, 3: 0.0, 2: 0.0}),
     r"rests nowhere near .* with pole angle = 0\.5"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED)
def test_a_wrong_plant_design_or_point_is_one_clear_line(
    call: Callable[[], Any], words: str
) -> None:
    with pytest.raises(
        (ArgumentError, ModelError, GainError, PremiseError), match=words
    ) as refused:
        call()
    assert "\n" not in str(refused.value)
