"""Laws, weights, gains, surfaces and outputs that cannot be: one clear line for each."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from shipped import error_of, nominal_controller, task_of, uncertainty_of

import grosmc_mj as gm
from grosmc_mj.ground.errors import GrosmcError
from grosmc_mj.theory.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.theory.control.design import (
    linear_grosmc,
    linear_lqr,
    regulating_grosmc,
    state_grosmc,
    tracking_grosmc,
)
from grosmc_mj.theory.control.kinds.adaptive import Adaptive
from grosmc_mj.theory.control.kinds.lqi import Lqi
from grosmc_mj.theory.control.lqr import lqr
from grosmc_mj.theory.control.references import FourierSeries
from grosmc_mj.theory.control.switching import find_switching
from grosmc_mj.theory.control.task import Realization, Task, state_task
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.control.uncertainty.states import StateUncertainty
from grosmc_mj.theory.plants import OperatingPoint
from grosmc_mj.theory.plants.equations import Equations

CHAIN_A = ((0, 1.0), (0, 0))
CHAIN_B = ((0,), (1.0,))
IDENTITY = np.eye(2)
A, B, C = sp.symbols("a b c")


def require_refused(words: str, make: Callable[..., Any], *arguments: Any, **options: Any) -> None:
    """The call raises an error of the package whose one line has these words."""
    with pytest.raises(GrosmcError, match=words) as raised:
        make(*arguments, **options)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"B": [0.0, 1.0]}, r"B has shape \(1, 2\), must be \(2, 2\)"),
        ({"Q": np.diag([1, np.nan])}, r"Q = .*nan.* must be a matrix"),
        ({"Q": np.diag([1, -2.0])}, r"Q must be positive semi.*-2"),
        ({"R": 0.0}, r"R must be positive definite, is \[\[0\]\]"),
        ({"Q": [[1.0, 100.0], [0.0, 1.0]]}, "symmetric"),
        ({"A": np.diag([0, -1.0])}, "no stabilizing solution"),
        # (A, Q) must be detectable, or the solution of eq. (6) does not stabilize.
        ({"Q": np.diag([0, 1.0])}, r"no stabilizing solution.*\[\[0.*, \[0.*1.*\]\]"),
    ],
)
def test_lqr_refuses(changes: dict[str, Any], words: str) -> None:
    """The line has the value, and the values that it may have."""
    matrices: dict[str, Any] = {"A": CHAIN_A, "B": CHAIN_B, "Q": IDENTITY, "R": 1.0}
    require_refused(words, lqr, **(matrices | changes))


def test_an_optimal_trajectory_needs_equally_spaced_instants_from_zero() -> None:
    design = lqr(CHAIN_A, CHAIN_B, IDENTITY, 1.0)
    time = np.array([0.1, 0.2, 0.3])
    require_refused("equally", design.optimal_trajectory, [1, 0], time)


@pytest.mark.parametrize(
    ("G", "words"),
    [
        ([[1.0, 0]], r"G B = \[\[0\]\] is singular"),
        ([[1.0, 2, 3]], r"G = .* must be 1 x 2 finite numbers"),
    ],
)
def test_a_surface_refuses(G: Any, words: str) -> None:
    require_refused(words, tracking_grosmc, task_of("arm"), 18, 6, G)


@pytest.mark.parametrize(
    ("name", "numbers", "words"),
    [
        ("sign", {"gain": math.nan}, "must be finite and"),
        ("signum", {}, "did you mean 'sign'"),
    ],
)
def test_a_switching_law_refuses(name: str, numbers: dict[str, float], words: str) -> None:
    require_refused(words, find_switching, name, **numbers)


def test_a_realization_refuses_a_control_period_of_zero() -> None:
    require_refused("finite and positive", Realization, control_period=0.0)


def test_a_discrete_time_surface_refuses_another_control_period() -> None:
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=2e-3))
    plant = task_of("servo").plant
    require_refused(
        r"for a control period of 0\.002 s, not 0\.001",
        gm.simulate,
        plant,
        law,
        (0.0, 0.0),
        duration=0.01,
        control_period=1e-3,
    )


# Declared families


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scales": {"J": (0.0, 2.0)}}, r"unlike J = \(0\.0, 2\.0\)"),
        ({"scales": {"J": (2.0, 1.0)}}, r"unlike J = \(2\.0, 1\.0\)"),
        ({"scales": {"m": (1, 2)}}, "unknown parameter of servo 'm': valid: J"),
        ({"region": (1.0, 0.0)}, r"region = .* must be finite and posit"),
        ({"region": (1.0,)}, "1 bounds of the operating region, must have 2"),
        ({"wrench": (1.0,)}, "1 wrench components, must have 6"),
    ],
)
def test_a_family_of_outputs_refuses(changes: dict[str, Any], words: str) -> None:
    def design() -> Any:
        return linear_grosmc(task_of("servo"), replace(uncertainty_of("servo"), **changes))

    require_refused(words, design)


def test_a_family_refuses_a_reference_that_moves() -> None:
    """y_r'' is a push of its own, which no bound in |z| covers."""
    declared = Uncertainty({}, (0.0,) * 12, (0.5, 1.0), 0.2)
    words = r"arm: the reference moves.*give k and epsilon instead"
    require_refused(words, regulating_grosmc, task_of("arm"), declared)


def pendulum(angle: float) -> Task:
    """A pendulum with a torque, which does not hold it at an angle."""
    q, rate, m = sp.symbols("angle rate m")
    plant = gm.affine_plant(
        "hanging",
        states={"angle": "rad", "rate": "rad/s"},
        inputs={"torque": "N m"},
        f=[rate, -9.81 * sp.sin(q)],
        g=[0, 1 / m],
        h=[q],
        parameters={"m": 2.0},
    )
    point = OperatingPoint(np.array([angle, 0.0]), np.zeros(1))
    return state_task(plant, IDENTITY, 1.0, point)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scales": {"m": 2.0}}, "unlike m = 2"),
        ({"mass": 2.0}, "scale a parameter instead"),
        ({"push": 1.0}, "no body '' that could be pushed: valid: none"),
    ],
)
def test_a_family_of_all_states_refuses(changes: dict[str, Any], words: str) -> None:
    def design() -> Any:
        return state_grosmc(pendulum(0.0), StateUncertainty(**changes))

    require_refused(words, design)


def test_a_law_of_all_states_refuses_a_limit_of_zero() -> None:
    require_refused("limit = 0 must be positive", state_grosmc, pendulum(0.0), limit=0.0)


def test_a_law_refuses_a_point_where_the_plant_does_not_rest() -> None:
    require_refused("is no equilibrium", linear_lqr, pendulum(0.8))


# Rivals


def test_integral_action_refuses_a_limit_of_zero() -> None:
    require_refused("limit", Lqi, 1.0, limit=0.0)


def test_adaptive_law_refuses_a_system_without_linear_torques() -> None:
    words = "cart_pendulum has no torques Y theta"
    require_refused(words, Adaptive(1.0, 1.0).design, task_of("cart_pendulum"))


def test_adaptive_law_refuses_outputs_that_are_no_joints() -> None:
    (q,) = error_of("arm").system.symbolic_equations.h
    error = replace(error_of("arm"), outputs=(sp.sin(q),))
    task = replace(task_of("arm"), error=error)
    require_refused("must be its joints, q", Adaptive(1.0, 1.0).design, task)


# Outputs without a vector relative degree: eq. (21), Assumption 7

TWO_INPUTS = ((1, 0), (0, 1))
# The determinant is zero for a reason that sympy has to see.
HIDDEN_ZERO = (
    (sp.sin(A) ** 2, sp.cos(A) ** 2 - 1),
    (-1, 1),
)


@pytest.mark.parametrize(
    ("f", "g", "h", "words"),
    [
        (
            (B, 0, 0),
            ((1, 1), (2, 2), (0, 1)),
            (A, B),
            r"singular everywhere.*\(1, 1\).*eq\. \(21\)",
        ),
        ((0, 0), HIDDEN_ZERO, (A, B), r"eq\. \(21\)"),
        (
            (B, -A, A),
            (0, 0, 1),
            (A,),
            "output 1, a, has no relative degree.*Assumption 7",
        ),
        ((B, A), TWO_INPUTS, (A,), "1 outputs for 2 inputs"),
    ],
)
def test_feedback_linearization_refuses(f: Any, g: Any, h: Any, words: str) -> None:
    states = (A, B, C)[: len(f)]
    equations = Equations(x=states, f=f, g=g, h=h)
    require_refused(words, feedback_linearization, equations)


def test_a_fourier_series_needs_twice_as_many_samples_as_harmonics() -> None:
    words = "8 samples cannot give 4 harmonics"
    require_refused(words, FourierSeries.through, np.zeros((8, 1)), 1.0, 4)
