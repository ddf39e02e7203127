"""Laws, weights, gains, surfaces and outputs that cannot be: one clear line for each."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from shipped import ARM_ERROR, SERVO_UNCERTAINTY, nominal_controller, task_of

import grosmc_mj as gm
from grosmc_mj.control.coordinates.feedback_linearization import feedback_linearization
from grosmc_mj.control.design import (
    linear_grosmc,
    linear_lqr,
    regulating_grosmc,
    state_grosmc,
    tracking_grosmc,
)
from grosmc_mj.control.lqr import lqr
from grosmc_mj.control.references import FourierSeries
from grosmc_mj.control.rivals.adaptive import adaptive
from grosmc_mj.control.rivals.integral import lqi
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task, state_task
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import GrosmcError
from grosmc_mj.plants import OperatingPoint
from grosmc_mj.plants.equations import Equations

I2, TWO = np.eye(2), ((1, 0), (0, 1))
a, b, c = sp.symbols("a b c")


def design(A: Any = ((0, 1.0), (0, 0)), B: Any = ((0,), (1.0,)), Q: Any = I2, R: Any = 1.0) -> Any:
    return lqr(A, B, Q, R)


def on_arm(make: Any, *numbers: Any, **options: Any) -> Any:
    return make(task_of("arm"), *numbers, **options)


def pendulum(angle: float) -> Task:
    """A pendulum with a torque, which does not hold it at an angle."""
    q, rate, m = sp.symbols("angle rate m")
    plant = gm.affine_plant(
        "hanging", states={"angle": "rad", "rate": "rad/s"}, inputs={"torque": "N m"},
        f=[rate, -9.81 * sp.sin(q)], g=[0, 1 / m], h=[q], parameters={"m": 2.0},
    )  # fmt: skip
    return state_task(plant, I2, 1.0, OperatingPoint(np.array([angle, 0.0]), np.zeros(1)))


def held(limit: float | None = None, **changes: Any) -> Any:
    return state_grosmc(pendulum(0.0), StateUncertainty(**changes), limit=limit)


def declared(**changes: Any) -> Any:
    return linear_grosmc(task_of("servo"), replace(SERVO_UNCERTAINTY, **changes))


def at_another_period() -> Any:
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=2e-3))
    return gm.simulate(task_of("servo").plant, law, (0.0, 0.0), duration=0.01, control_period=1e-3)


def linearized(f: Any, g: Any, h: Any) -> Any:
    return feedback_linearization(Equations(x=(a, b, c)[: len(f)], f=f, g=g, h=h))


def without_joints() -> Task:
    """The arm's task with an output that is no joint."""
    (q,) = ARM_ERROR.system.equations.h
    return replace(task_of("arm"), error=replace(ARM_ERROR, outputs=(sp.sin(q),)))


REFUSED: list[tuple[Any, str]] = [
    # LQR: the value, and the values that it may have
    (lambda: design(B=[0.0, 1.0]), r"B has shape \(1, 2\), must be \(2, 2\)"),
    (lambda: design(Q=np.diag([1, np.nan])), r"Q = .*nan.* must be a matrix"),
    (lambda: design(Q=np.diag([1, -2.0])), r"Q must be positive semi.*-2\.0"),
    (lambda: design(R=0.0), r"R must be positive definite, is \[\[0\.0\]\]"),
    (lambda: design(Q=[[1.0, 100.0], [0.0, 1.0]]), "symmetric"),
    (lambda: design(A=np.diag([0, -1.0])), "no stabilizing solution"),
    # (A, Q) must be detectable, or the solution of eq. (6) does not stabilize.
    (lambda: design(Q=np.diag([0, 1.0])), r"no stabilizing solution.*\[\[0.*, \[0.*1.*\]\]"),
    (lambda: design().optimal_trajectory([1, 0], np.array([0.1, 0.2, 0.3])), "equally"),
    # Surfaces, and gains of the switching term
    (lambda: on_arm(tracking_grosmc, 18, 6, [[1.0, 0]]), r"G B = \[\[0\.0\]\] is singular"),
    (lambda: on_arm(tracking_grosmc, 18, 6, [[1.0, 2, 3]]), r"G = .* must be 1 x 2 finite numbers"),
    (lambda: find_switching("sign", gain=math.nan), "must be finite and"),
    (lambda: find_switching("signum"), "did you mean 'sign'"),
    (lambda: Realization(control_period=0.0), "finite and positive"),
    (at_another_period, r"for a control period of 0\.002 s, not 0\.001"),
    # Declared families
    (lambda: declared(scales={"J": (0.0, 2.0)}), r"unlike J = \(0\.0, 2\.0\)"),
    (lambda: declared(scales={"J": (2.0, 1.0)}), r"unlike J = \(2\.0, 1\.0\)"),
    (lambda: declared(scales={"m": (1, 2)}), "unknown parameter of servo 'm': valid: J"),
    (lambda: declared(region=(1.0, 0.0)), r"region = .* must be finite and posit"),
    (lambda: declared(region=(1.0,)), "1 bounds of the operating region, must have 2"),
    (lambda: declared(wrench=(1.0,)), "1 wrench components, must have 6"),
    (lambda: held(scales={"m": 2.0}), "unlike m = 2"),
    (lambda: held(mass=2.0), "scale a parameter instead"),
    (lambda: held(push=1.0), "no body '' that could be pushed: valid: none"),
    (lambda: held(limit=0.0), "limit = 0 must be positive"),
    (lambda: linear_lqr(pendulum(0.8)), "is no equilibrium"),
    # y_r'' is a push of its own, which no bound in |z| covers.
    (lambda: on_arm(regulating_grosmc, Uncertainty({}, (0.0,) * 12, (0.5, 1.0), 0.2)),
     r"arm: the reference moves.*give k and epsilon instead"),
    # Rivals
    (lambda: on_arm(lqi, 1.0, limit=0.0), "limit"),
    (lambda: adaptive(task_of("cart_pendulum"), 1.0, 1.0), "cart_pendulum has no torques Y theta"),
    (lambda: adaptive(without_joints(), 1.0, 1.0), "must be its joints, q"),
    # Outputs without a vector relative degree: eq. (21), Assumption 7
    (lambda: linearized((b, 0, 0), ((1, 1), (2, 2), (0, 1)), (a, b)),
     r"singular everywhere.*\(1, 1\).*eq\. \(21\)"),
    # The determinant is zero for a reason that sympy has to see.
    (lambda: linearized((0, 0), ((sp.sin(a) ** 2, sp.cos(a) ** 2 - 1), (-1, 1)), (a, b)),
     r"eq\. \(21\)"),
    (lambda: linearized((b, -a, a), (0, 0, 1), (a,)),
     "output 1, a, has no relative degree.*Assumption 7"),
    (lambda: linearized((b, a), TWO, (a,)), "1 outputs for 2 inputs"),
    (lambda: FourierSeries.through(np.zeros((8, 1)), 1.0, 4), "8 samples cannot give 4 harmonics"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "words"), REFUSED)
def test_it_is_refused_in_one_line(make: Any, words: str) -> None:
    with pytest.raises(GrosmcError, match=words) as raised:
        make()
    assert "\n" not in str(raised.value)
