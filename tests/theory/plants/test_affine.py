"""Plants of the user's own: their numbers, their designs, their equilibria and wrong ones."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.theory.control.design import linear_lqr
from grosmc_mj.theory.plants import AnalyticPlant, OperatingPoint, equilibrium

x, x1, x2, a = sp.symbols("x x1 x2 a")
CHAIN: dict[str, Any] = {
    "states": {"x1": "m", "x2": "m/s"},
    "inputs": {"u": "N"},
    "g": [0, 1],
    "h": [x1],
}
FIRST_ORDER: dict[str, Any] = {
    "states": {"x": "1"},
    "inputs": {"u": "1"},
    "g": [1],
    "h": [x],
    "parameters": {},
}


def chain(f1: Any = x2, f2: Any = 0, g2: Any = 1, **numbers: float) -> AnalyticPlant:
    """A second-order plant with x1 as its output."""
    arguments = {**CHAIN, "f": [f1, f2], "g": [0, g2], "parameters": numbers}
    return gm.affine_plant("chain", **arguments)


def first_order(f: Any, **changes: Any) -> AnalyticPlant:
    """A first-order plant."""
    arguments = {**FIRST_ORDER, "f": [f], **changes}
    return gm.affine_plant("w", **arguments)


def inner(rate: Any, h: Any = x1) -> Any:
    """Zero dynamics of x1' = u with a state inside, x2' = rate."""
    arguments: dict[str, Any] = {**CHAIN, "f": [0, rate], "g": [1, 0], "h": [h], "parameters": {}}
    plant = gm.affine_plant("inner", **arguments)
    return gm.feedback_linearization(plant.system.symbolic_equations).zero_dynamics()


def task(plant: AnalyticPlant, *degrees: int) -> gm.Task:
    reference = gm.control.setpoints(*(degrees or (2,)))
    error = gm.control.ErrorCoordinates(plant.system, reference)
    return gm.Task(plant, error, gm.control.Setpoint(0.0), np.diag([10.0, 1.0]), 1.0)


# Numbers and designs


def test_with_parameters_changes_a_number() -> None:
    plant = chain(f2=a * x1, a=1.0)
    assert plant.changed(a=2.0).parameters.a == 2.0


@pytest.mark.parametrize(
    ("outputs", "controlled"), [([x2], (1,)), ([x1 + x2], (0,)), ([sp.sinh(x1)], (0,))]
)
def test_a_run_is_judged_by_the_outputs_that_are_states_or_by_the_first_state(
    outputs: Any, controlled: tuple[int, ...]
) -> None:
    plant = gm.affine_plant("chain", **CHAIN | {"f": [x2, 0], "h": outputs, "parameters": {}})
    assert plant.system.controlled == controlled


@pytest.mark.parametrize(("where", "words"), [("a gap", "a gap"), ("", "x > 0")])
def test_a_region_has_the_words_of_its_user_or_those_of_its_condition(
    where: str, words: str
) -> None:
    plant = first_order(0, region=x > 0, where=where)
    assert plant.system.region == words
    assert plant.system.linearizable([0.1])
    assert not plant.system.linearizable([-0.1])


def test_jacobian_is_exact_whatever_the_parameters_are_called() -> None:
    """A parameter may be named like an input's symbol."""
    A, B = chain(f2=-sp.Symbol("u0") * x1, u0=3.0).jacobian([0.5, 0.0], [7.0])
    assert A.tolist() == [[0.0, 1.0], [-3.0, 0.0]]
    assert B.tolist() == [[0.0], [1.0]]


def test_the_linear_design_model_is_exact() -> None:
    """A finite step would make something else of a sine as quick as this."""
    design = linear_lqr(task(chain(f2=sp.sin(100 * x1)))).designed.lqr
    assert design.A[1, 0] == pytest.approx(100.0, rel=1e-12)


@cache
def unmatched_law() -> gm.Controller:
    """A law for x1' = a x2 with an unknown a."""
    plant = chain(f1=a * x2, a=1.0)
    declared = gm.Uncertainty({"a": (1.0, 3.0)}, (), (1.0, 1.0), 0.1)
    return gm.regulating_grosmc(task(plant), declared, G=[[5.0, 1.0]])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_gains_cover_an_uncertainty_in_the_row_without_an_input(side: float) -> None:
    """x1' = a x2 with a unknown is not matched, but G = [5, 1] sees it."""
    plant = chain(f1=a * x2, a=1.0)
    law = unmatched_law()
    p = law.parameters
    S = p.G @ law.designed.lqr.closed_loop

    random = np.random.default_rng(0)
    for _ in range(50):
        z = random.uniform(-1, 1, 2)
        true_plant = plant.changed(a=random.uniform(1, 3))
        x = law.coordinates.place(0.0, z, p)
        alpha, E = law.coordinates.dynamics(0.0, x, p)
        rho = p.eta + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * np.linalg.norm(p.GB @ E)
        switching = np.linalg.solve(p.GB, [side * rho])
        u = np.linalg.solve(E, -(p.K @ z) - alpha - switching)
        # x is z, for both are measured from zero.
        s_rate = p.G @ true_plant.derivative(x, u) - S @ z
        assert side * s_rate <= -0.1 + 1e-9


@pytest.mark.parametrize(
    "plant",
    [
        pytest.param(chain(g2=a * sp.Float("1e-10"), a=5e10), id="gain small by its numbers"),
        pytest.param(chain(f2=sp.log(x1 - 2) + sp.sqrt(-a), a=-2.0), id="drift on half the space"),
    ],
)
def test_relative_degree_of_a_hard_case(plant: AnalyticPlant) -> None:
    assert gm.feedback_linearization(plant.system.symbolic_equations).relative_degree == (2,)


# Equilibria

SPRING = """
<mujoco><worldbody><body name="b"><joint name="j" type="slide" axis="0 0 1" stiffness="100"/>
<geom size="0.1" mass="2"/></body></worldbody>
<actuator><motor name="m" joint="j" ctrllimited="true" ctrlrange="-4 5"/></actuator></mujoco>
"""


def test_an_equilibrium_has_the_input_that_holds_it() -> None:
    """The search begins at ``near``, for the drift is not defined below zero."""
    tank = first_order(-0.3 * sp.sqrt(x), near={"x": 1.0})
    point = equilibrium(tank, {0: 4.0})
    np.testing.assert_allclose([*point.x, *point.u], [4.0, 0.6], rtol=1e-9)


def test_the_cart_rests_anywhere_without_input() -> None:
    point = equilibrium(gm.MujocoPlant.load("cart_pendulum"), {0: 0.3})
    assert [*point.x, *point.u] == [0.3, 0.0, 0.0, 0.0, 0.0]


def held_spring(position: float) -> OperatingPoint:
    return equilibrium(gm.Robot.from_mjcf(SPRING).plant, {0: position})


def test_a_motor_bears_the_weight_that_a_spring_does_not() -> None:
    np.testing.assert_allclose(held_spring(-0.16).u, [2 * 9.81 - 16.0], rtol=1e-6)


@pytest.mark.parametrize(("near", "expected"), [(0.8, 1.0), (-0.8, -1.0)])
def test_the_equilibrium_next_to_near_is_found(near: float, expected: float) -> None:
    plant = first_order(x**3 - x, g=[0 * x], near={"x": near})
    assert equilibrium(plant).x[0] == pytest.approx(expected, abs=1e-6)


# Refusals


def plant(**changes: Any) -> AnalyticPlant:
    arguments = {**CHAIN, "f": [x2, a], "parameters": {"a": 1.0}, **changes}
    return gm.affine_plant("chain", **arguments)


def require_refused_in_one_line(call: Any, words: str) -> None:
    with pytest.raises(GrosmcError, match=words) as refused:
        call()
    assert "\n" not in str(refused.value)


REAL_X2 = sp.Symbol("x2", real=True)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"parameters": {}}, "a: no number, and no state has that symbol: x1, x2; of a state"),
        ({"parameters": {"a": 1.0, "b": 2.0}}, "b: a number that is in no equation"),
        ({"parameters": {"a": np.nan}}, "a = nan must be finite"),
        ({"f": [x2]}, "f has 1 rows of 1, must have one for each of 2 states"),
        ({"f": [x2, "1/*"]}, "must be a list of expressions"),
        ({"f": [x2, None]}, "must be a list of expressions"),
        ({"h": [x1, x2]}, "1 inputs are named, g has 1 columns and h 2 outputs"),
        ({"f": [REAL_X2, a]}, "x2: another symbol than the state"),
        ({"near": {"y": 1.0}}, "near: unknown state 'y'"),
        ({"f": [x2, a * sp.Symbol("u")]}, "u: an input outside of g.*make it a state"),
    ],
)
def test_a_wrong_plant_is_refused(changes: dict[str, Any], words: str) -> None:
    require_refused_in_one_line(lambda: plant(**changes), words)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: plant().changed(q=2.0), "unknown parameter of chain 'q': valid: a"),
        (lambda: plant().changed(a=np.nan), "a = nan must be finite"),
        (lambda: chain().jacobian([0.0] * 3, [0.0]), r"x has shape \(3,\), u \(1,\)"),
        (lambda: linear_lqr(task(chain(f2=-9.8))), r"no equilibrium without input.*-9\.8"),
        (lambda: linear_lqr(task(chain(f2=-9.8))), r'with law = "fl-lqr" in a table \[laws'),
        (lambda: task(chain(), 3), r"relative degrees \(2,\), the reference has"),
        (lambda: task(chain(), 2, 2), r"relative degrees \(2,\), the reference has"),
        (
            lambda: gm.Realization("implicit"),  # pyright: ignore[reportArgumentType]
            r"switching = 'implicit' must be a switching law",
        ),
        (lambda: inner(-x2 - 2).poles(None), "not at rest at zero"),
        (lambda: inner(-x2, x1**2 - 4), "2 branches"),
        # Beyond the upper limit, and beyond the lower one.
        (lambda: held_spring(0.0), r"under inputs cut to \[-4\] ... \[5\]"),
        (lambda: held_spring(-0.32), r"under inputs cut to \[-4\] ... \[5\]"),
        (
            lambda: equilibrium(gm.MujocoPlant.load("cart_pendulum"), {1: 0.5, 3: 0.0, 2: 0.0}),
            r"rests nowhere near .* with pole angle = 0\.5",
        ),
    ],
)
def test_a_question_without_an_answer_is_refused(call: Any, words: str) -> None:
    require_refused_in_one_line(call, words)


# Names and symbols


def test_a_state_may_have_a_symbol_beside_its_name() -> None:
    """A start names states, not their symbols."""
    named = {"angle": ("rad", "x1"), "speed": ("rad/s", "x2")}
    arguments: Any = {**CHAIN, "states": named, "f": [x2, -a * x1], "parameters": {"a": 2.0}}
    plant = gm.affine_plant("chain", **arguments, near={"speed": 0.5})
    assert [state.name for state in plant.system.states] == ["angle", "speed"]
    assert plant.system.near == (0.0, 0.5)
    rates = chain(x2, -a * x1, a=2.0).derivative([0.3, 0.2], 1.0)
    np.testing.assert_array_equal(plant.derivative([0.3, 0.2], 1.0), rates)
