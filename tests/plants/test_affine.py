"""Plants of the user's own, the designs for them, and what is wrong with either."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linear_lqr
from grosmc_mj.control.reaching import nominal
from grosmc_mj.errors import ArgumentError, GainError, ModelError, PremiseError
from grosmc_mj.plants import AnalyticPlant

x1, x2, a, b = sp.symbols("x1 x2 a b")
NO_WRENCH: tuple[float, ...] = ()


def chain(f1: Any = x2, f2: Any = 0, g2: Any = 1, **numbers: float) -> AnalyticPlant:
    """A second-order plant with x1 as its output."""
    return gm.affine_plant(
        "chain", states={"x1": "m", "x2": "m/s"}, inputs={"u": "N"}, f=[f1, f2], g=[0, g2],
        h=[x1], parameters=numbers,
    )  # fmt: skip


def task(plant: AnalyticPlant, target: float = 0.0) -> gm.Task:
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    return gm.Task(plant, error, gm.control.Setpoint(target), np.diag([10.0, 1.0]), 1.0)


def two_masses(**numbers: float) -> AnalyticPlant:
    """Two masses that the inputs push crosswise."""
    y1, v1, y2, v2, c = sp.symbols("y1 v1 y2 v2 c")
    return gm.affine_plant(
        "masses",
        states={"y1": "m", "v1": "m/s", "y2": "m", "v2": "m/s"},
        inputs={"u1": "N", "u2": "N"},
        f=[v1, 0, v2, 0],
        g=[[0, 0], [1, c], [0, 0], [-c, 1]],
        h=[y1, y2],
        parameters={"c": 0.0, **numbers},
    )


# What a plant must be


@pytest.mark.parametrize(
    ("changes", "says"),
    [
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
    ],
)
def test_a_wrong_plant_is_one_clear_line(changes: dict[str, Any], says: str) -> None:
    right: dict[str, Any] = {
        "states": {"x1": "m", "x2": "m/s"}, "inputs": {"u": "N"}, "f": [x2, a], "g": [0, 1],
        "h": [x1], "parameters": {"a": 1.0},
    }  # fmt: skip
    assert gm.affine_plant("chain", **right).parameters.a == 1.0
    with pytest.raises((ArgumentError, ModelError), match=says) as told:
        gm.affine_plant("chain", **{**right, **changes})
    assert "\n" not in str(told.value)


def test_a_plant_without_parameters_runs_the_same_in_both_engines() -> None:
    law = gm.linearized_lqr(task(chain(), 1.0))
    runs = [
        gm.simulate(chain_of_law, law, [0.0, 0.0], duration=0.5, engine=engine)
        for engine, chain_of_law in itertools.product(("native", "python"), (law_plant(law),))
    ]
    assert np.array_equal(runs[0].state, runs[1].state)
    assert runs[0].state[-1, 0] > 0.1


def law_plant(law: Controller) -> AnalyticPlant:
    """A plant of the very system that a law is for."""
    return AnalyticPlant(law.designed.error.system, law.parameters.plant)


def test_other_numbers_of_a_plant_are_checked() -> None:
    plant = chain(f2=a * x1, a=1.0)
    assert plant.with_parameters(a=2.0).parameters.a == 2.0
    with pytest.raises(ModelError, match=r"unknown parameter of chain 'q': valid: a"):
        plant.with_parameters(q=2.0)
    with pytest.raises(ModelError, match="a = nan must be finite"):
        plant.with_parameters(a=np.nan)


def test_jacobian_is_not_led_astray_by_a_parameter_called_u0() -> None:
    u0 = sp.Symbol("u0")
    A, B = chain(f2=-u0 * x1, u0=3.0).jacobian([0.5, 0.0], [7.0])
    assert A.tolist() == [[0.0, 1.0], [-3.0, 0.0]]
    assert B.tolist() == [[0.0], [1.0]]
    with pytest.raises(ArgumentError, match=r"x has shape \(3,\), u \(1,\)"):
        chain().jacobian([0.0] * 3, [0.0])


# What a design must be


def test_linearization_about_zero_error_is_exact() -> None:
    """A finite step would make something else of a sine as quick as this."""
    design = linear_lqr(task(chain(f2=sp.sin(100 * x1)))).designed.lqr
    assert design.A[1, 0] == pytest.approx(100.0, rel=1e-12)


def test_linear_design_needs_an_equilibrium_without_input() -> None:
    with pytest.raises(GainError, match=r"no equilibrium without input.*-9\.8"):
        linear_lqr(task(chain(f2=-9.8)))


@pytest.mark.parametrize("degrees", [(3,), (2, 2), (1,)])
def test_a_reference_of_other_degrees_is_refused(degrees: tuple[int, ...]) -> None:
    error = gm.control.ErrorCoordinates(chain().system, gm.control.setpoints(*degrees))
    with pytest.raises(PremiseError, match=r"relative degrees \(2,\), the reference has"):
        gm.Task(chain(), error, gm.control.Setpoint(0.0), np.eye(2), 1.0)


def test_a_setpoint_of_one_output_is_refused_for_two() -> None:
    masses = two_masses()
    error = gm.control.ErrorCoordinates(masses.system, gm.control.setpoints(2, 2))
    with pytest.raises(ArgumentError, match="the reference has no value at t = 0: 'Setpoint'"):
        gm.Task(masses, error, gm.control.Setpoint(0.0), np.eye(4), np.eye(2))


def test_one_number_weighs_every_input_alike() -> None:
    masses = two_masses()
    error = gm.control.ErrorCoordinates(masses.system, gm.control.setpoints(2, 2))
    both = gm.Task(masses, error, gm.control.Setpoints(0.0, 0.0), np.eye(4), 2.0).optimum(
        linearizing=True
    )
    assert both.R.tolist() == [[2.0, 0.0], [0.0, 2.0]]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"scales": {"m": (1.0, 2.0)}}, "unknown parameter of chain 'm': valid: b"),
        ({"wrench": (1.0,) * 6}, "6 wrench components, must have 0"),
        ({"region": (1.0,)}, "1 bounds of the operating region, must have 2"),
    ],
)
def test_an_uncertainty_of_another_plant_is_refused(changes: dict[str, Any], says: str) -> None:
    declared = gm.Uncertainty({"b": (1.0, 2.0)}, NO_WRENCH, (1.0, 1.0), 0.1)
    plant = chain(g2=b, b=1.0)
    assert gm.regulating_grosmc(task(plant), declared).designed.gains["eta"] == pytest.approx(0.1)
    with pytest.raises(GainError, match=says):
        gm.regulating_grosmc(task(plant), replace(declared, **changes))


def test_gains_cover_what_reaches_s_through_the_row_without_an_input() -> None:
    """x1' = a x2 with a unknown is not matched, but G = [5, 1] sees it."""
    plant = chain(f1=a * x2, g2=1, a=1.0)
    declared = gm.Uncertainty({"a": (1.0, 3.0)}, NO_WRENCH, (1.0, 1.0), 0.1)
    law = gm.regulating_grosmc(task(plant), declared, G=[[5.0, 1.0]])
    p, design, random = law.parameters, law.designed.lqr, np.random.default_rng(0)
    S = p.G @ design.closed_loop
    for _ in range(200):
        z = random.uniform(-1, 1, 2)
        x = law.coordinates.place(0.0, z, p)
        true = plant.with_parameters(a=random.uniform(1, 3))
        alpha, E = law.coordinates.dynamics(0.0, x, p)
        u_0 = np.linalg.solve(E, -(p.K @ z) - alpha)
        motion = law.coordinates.error_dynamics([0.0], x[None], p, true)
        found = nominal(law.designed, p, [0.0], x[None], z[None]).reaching(motion)
        drift, gain = motion[0][0], motion[1][0]
        assert found.push[0] == pytest.approx(p.G @ (drift + gain @ u_0) - S @ z, abs=1e-12)
        assert found.R[0] == pytest.approx(p.G @ gain / (p.GB @ E), rel=1e-12)
        rho = p.eta + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * np.linalg.norm(p.GB @ E)
        assert abs(found.push[0, 0]) - rho * found.R[0, 0, 0] <= -0.1 + 1e-9


def test_gains_hold_for_one_switch_for_both_inputs() -> None:
    masses = two_masses()
    error = gm.control.ErrorCoordinates(masses.system, gm.control.setpoints(2, 2))
    start = gm.Task(masses, error, gm.control.Setpoints(0.0, 0.0), np.eye(4), 1.0)
    declared = gm.Uncertainty({"c": (1.0, 1.0)}, NO_WRENCH, (1.0,) * 4, 0.1)
    # Pushed crosswise by as much as it should be straight on: dominance has nothing left.
    crossed = replace(start, plant=masses.with_parameters(c=0.5))
    law = gm.control.realized(
        gm.regulating_grosmc(crossed, replace(declared, scales={"c": (0.2, 1.2)})),
        gm.Realization(gm.control.find_switching("unit-vector")),
    )
    run = gm.simulate(masses.with_parameters(c=0.6), law, [1.0, 0.0, -1.0, 0.0], duration=2.0)
    assert run.sliding is not None
    assert np.linalg.norm(run.sliding, axis=1).max() < 0.05


@pytest.mark.parametrize("epsilon", [0.0, -1.0, np.inf, np.nan])
def test_gains_must_be_finite_and_positive(epsilon: float) -> None:
    with pytest.raises(ArgumentError, match=r"epsilon = .* must be finite and positive"):
        gm.tracking_grosmc(task(chain()), k=1.0, epsilon=epsilon)


def test_a_switching_law_is_no_name() -> None:
    with pytest.raises(ArgumentError, match=r"switching = 'implicit' must be a switching law"):
        gm.Realization("implicit")  # pyright: ignore[reportArgumentType]


# A law that fails


@dataclass(frozen=True)
class Nothing:
    """Numbers of a law that needs one."""

    one: float = 1.0


def _beyond(t: float, x: Any, memory: Any, p: Any) -> float:
    pair = (x[0], x[1])
    return pair[2 + int(0 * x[0])]


@pytest.mark.parametrize("kind", ["analytic", "physics"])
def test_a_law_that_fails_in_compiled_code_does_not_pass_for_a_run(kind: str) -> None:
    physics = gm.MujocoPlant.load("servo")
    plant = physics if kind == "physics" else physics.analytic()
    law = Controller("mine", _beyond, Nothing())
    with pytest.raises(
        ArgumentError, match=r"test_affine.py:\d+: IndexError: .* \(mine at t = 0 s\)"
    ):
        gm.simulate(plant, law, [0.0, 0.0], duration=0.1)
    with pytest.raises(ArgumentError, match="IndexError") as told:
        gm.simulate(plant, law, [0.0, 0.0], duration=0.1, engine="python")
    assert isinstance(told.value.__cause__, IndexError)


# What feedback linearization says of hard cases


def test_a_gain_that_is_small_by_its_numbers_is_no_zero() -> None:
    plant = chain(g2=a * sp.Float("1e-10"), a=5e10)
    assert gm.feedback_linearization(plant.system.equations).relative_degree == (2,)


def test_an_expression_that_only_part_of_the_space_has_is_tried_there() -> None:
    plant = chain(f2=sp.log(x1 - 2) + sp.sqrt(-a), a=-2.0)
    assert gm.feedback_linearization(plant.system.equations).relative_degree == (2,)


def inner(rate: Any, h: Any = x1) -> AnalyticPlant:
    """x1' = u with a state inside, x2' = rate."""
    return gm.affine_plant(
        "inner", states={"x1": "m", "x2": "m"}, inputs={"u": "m/s"}, f=[0, rate], g=[1, 0], h=[h],
        parameters={},
    )  # fmt: skip


def test_zero_dynamics_that_do_not_rest_at_zero_have_no_poles() -> None:
    found = gm.feedback_linearization(inner(-x2).system.equations).zero_dynamics()
    assert found is not None
    assert found.poles(Nothing()).tolist() == [-1.0]
    found = gm.feedback_linearization(inner(-x2 - 2).system.equations).zero_dynamics()
    assert found is not None
    with pytest.raises(PremiseError, match="not at rest at zero"):
        found.poles(Nothing())


def test_zero_dynamics_with_two_branches_are_not_chosen_between() -> None:
    chains = gm.feedback_linearization(inner(-x2, x1**2 - 4).system.equations)
    with pytest.raises(PremiseError, match="2 branches"):
        chains.zero_dynamics()
