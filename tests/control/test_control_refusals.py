"""Laws, weights, gains, surfaces and outputs that cannot be: one clear line for each."""

from __future__ import annotations

import math
from collections.abc import Callable
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
from grosmc_mj.control.rivals.integral import lqi, pid
from grosmc_mj.control.rivals.observer import adrc
from grosmc_mj.control.surface import surface_matrix
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task, state_task
from grosmc_mj.control.uncertainty import StateUncertainty, Uncertainty
from grosmc_mj.errors import ArgumentError, GainError, ModelError, PremiseError
from grosmc_mj.experiments.runs import Settings
from grosmc_mj.plants import OperatingPoint
from grosmc_mj.plants.equations import Equations

A, B, I2 = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]]), np.eye(2)
a, b, c = sp.symbols("a b c")


def design(A: Any = A, B: Any = B, Q: Any = I2, R: Any = 1.0) -> Any:
    return lqr(A, B, Q, R)


def on_arm(make: Callable[..., Any], *numbers: Any, **options: Any) -> Any:
    return make(task_of("arm"), *numbers, **options)


def pendulum(angle: float = 0.8, torque: float = 0.0) -> Task:
    """A pendulum with a torque, held at an angle."""
    angle_name, rate, m = sp.symbols("angle rate m")
    plant = gm.affine_plant(
        "hanging", states={"angle": "rad", "rate": "rad/s"}, inputs={"torque": "N m"},
        f=[rate, -9.81 * sp.sin(angle_name)], g=[0, 1 / m], h=[angle_name], parameters={"m": 2.0},
    )  # fmt: skip
    return state_task(plant, I2, 1.0, OperatingPoint(np.array([angle, 0.0]), np.array([torque])))


def held(**changes: Any) -> Any:
    options = {name: changes.pop(name) for name in ("limit",) if name in changes}
    return state_grosmc(pendulum(0.0), StateUncertainty(**changes), **options)


def declared(**changes: Any) -> Any:
    return linear_grosmc(task_of("servo"), replace(SERVO_UNCERTAINTY, **changes))


def at_another_period() -> Any:
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=2e-3))
    return gm.simulate(task_of("servo").plant, law, (0.0, 0.0), duration=0.01, control_period=1e-3)


def linearized(f: Any, g: Any, h: Any) -> Any:
    x = (a, b, c)[: len(f)]
    return feedback_linearization(Equations(x=x, f=f, g=g, h=h))


def without_joints() -> Task:
    """The arm's task with an output that is no joint."""
    task = task_of("arm")
    (q,) = ARM_ERROR.system.equations.h
    return replace(task, error=replace(ARM_ERROR, outputs=(sp.sin(q),)))


TWO = ((1, 0), (0, 1))
STABILIZING = "no stabilizing solution"
MOVES = r"arm: the reference moves.*give k and epsilon instead"

REFUSED: list[tuple[Callable[[], Any], type[Exception], str]] = [
    # LQR: the value, and what it must be
    (lambda: design(B=[0.0, 1.0]), GainError, r"B has shape \(1, 2\), must be \(2, 2\)"),
    (lambda: design(A=[[0.0, 1.0]]), GainError, r"A has shape \(1, 2\)"),
    (lambda: design(Q=np.eye(3)), GainError, r"Q has shape \(3, 3\), must be \(2, 2\)"),
    (lambda: design(R=I2), GainError, r"R has shape \(2, 2\), must be \(1, 1\)"),
    (lambda: design(Q=np.diag([1, np.nan])), GainError, r"Q = .*nan.* must be a matrix"),
    (lambda: design(Q="Q"), GainError, r"Q = 'Q' must be a matrix of finite numbers"),
    (lambda: design(Q=np.diag([1, -2.0])), GainError, r"Q must be positive semi.*-2\.0"),
    (lambda: design(R=0.0), GainError, r"R must be positive definite, is \[\[0\.0\]\]"),
    (lambda: design(R=-3.0), GainError, r"R must be positive definite, is \[\[-3\.0\]\]"),
    (lambda: design(Q=[[1.0, 100.0], [0.0, 1.0]]), GainError, "symmetric"),
    (lambda: design(A=np.diag([1, -1.0])), GainError, rf"{STABILIZING}.*\[\[0.*, \[1.*\]\]"),
    (lambda: design(A=np.diag([0, -1.0])), GainError, STABILIZING),
    # (A, Q) must be detectable, or the solution of eq. (6) does not stabilize.
    (lambda: design(Q=np.zeros((2, 2))), GainError, STABILIZING),
    (lambda: design(Q=np.diag([0, 1.0])), GainError, STABILIZING),
    *(
        (lambda t=t: design().optimal_trajectory([1, 0], np.array(t)), ArgumentError, "equally")
        for t in ([0.0, 0.1, 0.3], [0.1, 0.2, 0.3])
    ),
    # Surfaces, and gains of the switching term
    (lambda: surface_matrix([1.0, 0.0], B), GainError, r"G B = \[\[0\.0\]\] is singular"),
    (lambda: surface_matrix([[1.0, 2, 3]], B), GainError, r"G = .* must be 1 x 2 finite numbers"),
    (lambda: on_arm(tracking_grosmc, 18, 6, [[1.0, 0]]), GainError, "G B .* is singular"),
    (lambda: on_arm(tracking_grosmc, 0.0, 6.0), ArgumentError, "k = 0 must be finite and posi"),
    (lambda: on_arm(tracking_grosmc, 18, -6.0), ArgumentError, "epsilon = -6 must be finite and"),
    (lambda: on_arm(tracking_grosmc, np.nan, 6), ArgumentError, "k = nan must be finite and posi"),
    *(
        (lambda name=name, n=n: find_switching(name, **n), GainError, "must be finite and")
        for name, n in (
            ("sign", {"gain": -1.0}),
            ("sign", {"gain": math.nan}),
            ("boundary-layer", {"width": 0.0}),
            ("super-twisting", {"slope": math.inf}),
            ("adaptive", {"share": -1.0}),
            ("adaptive", {"least": 0.0}),
        )
    ),
    (lambda: find_switching("signum"), GainError, "did you mean 'sign'"),
    (lambda: Settings(switching="implict-estimate"), ArgumentError, "mean 'implicit-estimate'"),
    *(
        (lambda T=T: Realization(control_period=T), ArgumentError, "finite and positive")
        for T in (0.0, -1e-3, math.nan)
    ),
    (at_another_period, ArgumentError, r"for a control period of 0\.002 s, not 0\.001"),
    # Declared families
    (lambda: declared(scales={"J": (0.0, 2.0)}), ArgumentError, r"unlike J = \(0\.0, 2\.0\)"),
    (lambda: declared(scales={"J": (2.0, 1.0)}), ArgumentError, r"unlike J = \(2\.0, 1\.0\)"),
    (lambda: declared(scales={"J": (1, math.inf)}), ArgumentError, r"unlike J = \(1, inf\)"),
    (lambda: declared(reaching_rate=0.0), ArgumentError, "reaching_rate = 0 must be finite and"),
    (lambda: declared(region=(1.0, 0.0)), ArgumentError, r"region = .* must be finite and posit"),
    (lambda: declared(region=(1.0,)), GainError, "1 bounds of the operating region, must have 2"),
    (lambda: held(mass=0.5), GainError, "mass = 0.5 must be finite and 1 or more"),
    (lambda: held(length="two"), GainError, "length = 'two' must be finite and 1 or more"),
    (lambda: held(push=-1.0), GainError, "push = -1 must be finite and not negative"),
    (lambda: held(reaching_rate=0.0), GainError, "reaching_rate = 0 must be finite and positive"),
    (lambda: held(scales={"m": (2.0, 1.0)}), GainError, r"unlike m = \(2\.0, 1\.0\)"),
    (lambda: held(scales={"m": 2.0}), GainError, "unlike m = 2"),
    (lambda: held(mass=2.0), ModelError, "scale a parameter instead"),
    (lambda: held(scales={"M": (1.0, 2.0)}), ModelError, "unknown parameter"),
    (lambda: held(push=1.0), GainError, "no body '' that could be pushed: valid: none"),
    (lambda: held(limit=0.0), ArgumentError, "limit = 0 must be positive"),
    (lambda: linear_lqr(pendulum(0.8)), ArgumentError, "is no equilibrium"),
    (lambda: state_task("hanging", I2, 1.0), ArgumentError, "must be a plant"),
    # y_r'' is a push of its own, which no bound in |z| covers.
    (
        lambda: on_arm(regulating_grosmc, Uncertainty({}, (0.0,) * 12, (0.5, 1.0), 0.2)),
        GainError,
        MOVES,
    ),
    # Rivals
    (lambda: on_arm(lqi, 0.0), ArgumentError, "integral_weight"),
    (lambda: on_arm(pid, math.nan), ArgumentError, "frequency"),
    (lambda: on_arm(adrc, -1.0), ArgumentError, "bandwidth"),
    (lambda: on_arm(adaptive, 1.0, math.inf), ArgumentError, "adaptation"),
    (lambda: on_arm(adaptive, 0.0, 1.0), ArgumentError, "frequency"),
    (lambda: on_arm(lqi, 1.0, limit=0.0), ArgumentError, "limit"),
    (lambda: lqi(None, 1.0), ArgumentError, "task"),
    (
        lambda: adaptive(task_of("cart_pendulum"), 1.0, 1.0),
        PremiseError,
        "cart_pendulum has no torques Y theta",
    ),
    (lambda: adaptive(without_joints(), 1.0, 1.0), PremiseError, "must be its joints, q"),
    # Outputs without a vector relative degree: eq. (21), Assumption 7
    (
        lambda: linearized((b, 0, 0), ((1, 1), (2, 2), (0, 1)), (a, b)),
        PremiseError,
        r"singular everywhere.*\(1, 1\).*eq\. \(21\)",
    ),
    # The determinant is zero for a reason that sympy has to see.
    (
        lambda: linearized((0, 0), ((sp.sin(a) ** 2, sp.cos(a) ** 2 - 1), (-1, 1)), (a, b)),
        PremiseError,
        r"eq\. \(21\)",
    ),
    (
        lambda: linearized((b, -a, a), (0, 0, 1), (a,)),
        PremiseError,
        "output 1, a, has no relative degree.*Assumption 7",
    ),
    *(
        (lambda h=h: linearized((b, a), TWO, h), PremiseError, rf"{len(h)} outputs for 2 inputs")
        for h in ((a,), (a, b, a + b), ())
    ),
    (
        lambda: FourierSeries.through(np.zeros((8, 1)), 1.0, 4),
        ArgumentError,
        "8 samples cannot give 4 harmonics",
    ),
]


@pytest.mark.parametrize(("make", "error", "words"), REFUSED)
def test_it_is_refused_in_one_line(
    make: Callable[[], Any], error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words) as raised:
        make()
    assert "\n" not in str(raised.value)
