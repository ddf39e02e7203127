"""The rivals by what their sources prove: integrators, observers, a Lyapunov function."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from shipped import REGULATION, task_of

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import Constant, Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import computed_torque_pd
from grosmc_mj.theory.control.kinds.adaptive import Adaptive, LinearAdaptive
from grosmc_mj.theory.control.kinds.adrc import Adrc, LinearAdrc, observer
from grosmc_mj.theory.control.kinds.fl_lqr import FlLqr
from grosmc_mj.theory.control.kinds.fl_pid import FlPid, LinearPid
from grosmc_mj.theory.control.kinds.kind import LawKind
from grosmc_mj.theory.control.kinds.lqi import LinearLqi, Lqi
from grosmc_mj.theory.control.kinds.lqr import Lqr
from grosmc_mj.theory.plants import AnalyticPlant, Plant

PERIOD = 1e-3
STARTS = {
    "servo": (0.0, 0.0),
    "arm": (0.5, math.pi),
    REGULATION: (0.5, -2.0, 0.0, 0.0),
}
# Wrenches about the joints, which are along -y.
LOADS = {
    "servo": Disturbance("rotor", (0, 0, 0, 0, 0.3, 0), Constant()),
    "arm": Disturbance("hub", (0, 0, 0, 0, 0.1, 0), Constant()),
    REGULATION: Disturbance("payload", (0, 0, 0, 0, 0.5, 0), Constant()),
}
WEIGHT = 2.0
FREQUENCY = 3.0
BANDWIDTH = 100.0


# By name, the laws on feedback linearization.
LAWS: dict[str, LawKind] = {
    "lqr": FlLqr(),
    "lqi": Lqi(WEIGHT),
    "fl-pid": FlPid(FREQUENCY),
    "adrc": Adrc(BANDWIDTH),
    "adaptive": Adaptive(2.0, 1.0),
}
# Those on the linearization, which the servo has.
LINEAR_LAWS: dict[str, LawKind] = {
    "lqr": Lqr(),
    "lqi": LinearLqi(WEIGHT),
    "fl-pid": LinearPid(FREQUENCY),
    "adrc": LinearAdrc(BANDWIDTH),
    "adaptive": LinearAdaptive(2.0, 1.0),
}
each_design = pytest.mark.parametrize("design", STARTS)


@cache
def nominal(design: str) -> AnalyticPlant:
    return MujocoPlant.load(design.split()[0]).analytic()


@cache
def controller(design: str, name: str) -> Controller:
    kinds = LINEAR_LAWS if design == "servo" else LAWS
    return kinds[name].design(task_of(design))


def run(
    design: str, law: Controller, duration: float, plant: Plant | None = None, **options: Any
) -> Trajectory:
    """In Python, which need not compile a law for a few seconds of it."""
    true = plant or nominal(design)
    return simulate(true, law, STARTS[design], duration=duration, engine="python", **options)


# A constant load on the servo

LOAD = LOADS["servo"].wrench[4]
LOADED_PERIOD = 5e-3


@cache
def loaded_servo(name: str) -> Trajectory:
    """A run to rest: the slowest pole is at -1 /s, and e^-25 is 1e-11."""
    return run(
        "servo",
        controller("servo", name),
        25.0,
        disturbances=[LOADS["servo"]],
        control_period=LOADED_PERIOD,
        timestep=LOADED_PERIOD,
    )


def error_at_rest(name: str) -> Array:
    law = controller("servo", name)
    loaded = loaded_servo(name)
    z = law.coordinates.along(loaded.time, loaded.state, law.parameters)
    return z[-1]


def test_lqr_keeps_the_error_of_a_constant_load() -> None:
    """At rest 0 = Kt u - T_d, so e = -T_d / (Kt K_1), by eq. (15)."""
    Kt = nominal("servo").parameters.Kt
    K = controller("servo", "lqr").parameters.K
    expected = -LOAD / (Kt * K[0, 0])
    assert error_at_rest("lqr")[0] == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("name", ["lqi", "fl-pid", "adrc"])
def test_integrals_reject_a_constant_load(name: str) -> None:
    """The observer of adrc, too."""
    assert np.abs(error_at_rest(name)).max() < 1e-8


def test_observer_estimates_a_constant_load() -> None:
    """d of e'' = ... + d is T_d/J by eqs. (15) and (17), whatever the law does."""
    watching = observer((2,), BANDWIDTH, LOADED_PERIOD)
    q = loaded_servo("adrc").memory["q"][-1]
    estimate = (watching.H @ q + watching.K @ error_at_rest("adrc")).item()
    assert estimate == pytest.approx(LOAD / nominal("servo").parameters.J, rel=1e-6)


# Nominal closed loops


def augmented(law: Controller) -> tuple[Array, Array]:
    """The continuous closed loop of z and its outputs' integrals xi, and [K, H]."""
    p = law.sampled(PERIOD).parameters.dynamics
    optimum = law.designed.lqr
    n, m = optimum.B.shape
    plant = np.zeros((n + m, n + m))
    plant[:n, :n] = optimum.A
    plant[n:, :n] = np.eye(n)[list(law.coordinates.output_rows)]
    B = np.vstack([optimum.B, np.zeros((m, m))])
    gain = np.hstack([p.K, p.H])
    return plant - B @ gain, gain


@each_design
def test_pid_has_all_poles_at_its_frequency(design: str) -> None:
    """A triple pole splits by eps^(1/3)."""
    closed, _ = augmented(controller(design, "fl-pid"))
    np.testing.assert_allclose(np.linalg.eigvals(closed), -FREQUENCY, atol=3e-4)


def test_pd_has_two_poles_of_its_frequency_and_damping_for_each_output() -> None:
    poles = computed_torque_pd(task_of(REGULATION), 5.0, damping=0.6).designed.lqr.poles
    expected = [-3 - 4j, -3 - 4j, -3 + 4j, -3 + 4j]
    np.testing.assert_allclose(sorted(poles, key=lambda pole: pole.imag), expected, atol=1e-6)


@each_design
def test_lqi_has_the_least_cost(design: str) -> None:
    """Its value function gives the gain back: R K = B'P."""
    law = controller(design, "lqi")
    closed, K = augmented(law)
    optimum = law.designed.lqr
    m = len(optimum.R)
    Q: Any = scipy.linalg.block_diag(optimum.Q, WEIGHT * np.eye(m))
    B = np.vstack([optimum.B, np.zeros((m, m))])
    weight = Q + K.T @ optimum.R @ K
    P = scipy.linalg.solve_continuous_lyapunov(closed.T, -weight)
    np.testing.assert_allclose(B.T @ P, optimum.R @ K, rtol=1e-9, atol=1e-9)


def test_integrals_are_exact_between_samples() -> None:
    """Against a numerical integration of z' = A z over a long period; rtol of the solver."""
    law = controller("servo", "lqi")
    period = 0.4
    z = np.array([0.7, -1.3])
    A = law.designed.lqr.A
    p = law.sampled(period).parameters.dynamics
    solved = scipy.integrate.solve_ivp(
        lambda _, y: [*(A @ y[:2]), y[0]],
        (0, period),
        [*z, 0.25],
        rtol=1e-11,
        atol=1e-12,
    )
    integral = p.F @ [0.25] + p.G @ z
    np.testing.assert_allclose(integral, solved.y[2:, -1], rtol=1e-9)


@pytest.mark.parametrize(
    ("degrees", "bandwidth"),
    [
        ((1,), 1.0),
        ((3,), 200.0),
        ((2, 1), 200.0),
    ],
)
def test_observers_have_their_poles(degrees: tuple[int, ...], bandwidth: float) -> None:
    """r + 1 poles at exp(-w_o T) for a chain of degree r."""
    F = observer(degrees, bandwidth, PERIOD).F
    size = sum(degrees) + len(degrees)
    # Powers of T = 1e-3 up to the third are in F: rounding of its determinants' terms.
    expected = np.poly([math.exp(-bandwidth * PERIOD)] * size)
    np.testing.assert_allclose(np.poly(F), expected, atol=1e-9)


@each_design
def test_adrc_is_nominally_the_optimum(design: str) -> None:
    """The estimate of nothing is nothing, up to what a held input leaves of a nonlinear plant."""
    best = run(design, controller(design, "lqr"), 0.6)
    watched = run(design, controller(design, "adrc"), 0.6)
    # Exactly held, and exact, for the linear servo, but for its friction within a sample.
    bound = 1e-4 if design == "servo" else 5e-3
    assert np.abs(watched.state - best.state).max() < bound


# One sample far out, where the input asked for is beyond the limit

LIMIT = 1.5
each_far_error = pytest.mark.parametrize("far", [6.0, -6.0])


def one_sample(make: Any, number: float, limit: float, far: float) -> tuple[float, Array, Any]:
    """u at an error of the angle, q after the sample, and the law's matrices."""
    law = make(number, limit).design(task_of("servo")).sampled(PERIOD)
    memory: Any = law.memory()
    u = law.input_at(0.0, np.array([1.0 - far, 0.0]), memory).item()
    return u, memory.q, law.parameters.dynamics


@each_far_error
@pytest.mark.parametrize("make", [LinearLqi, LinearPid])
def test_integrals_hold_while_an_input_is_cut(make: Any, far: float) -> None:
    u, q, _ = one_sample(make, 2.0, LIMIT, far)
    assert abs(u) > LIMIT
    assert q.tolist() == [0.0]


@pytest.mark.parametrize("make", [LinearLqi, LinearPid])
def test_integrals_go_on_without_a_limit(make: Any) -> None:
    _, q, _ = one_sample(make, 2.0, math.inf, 6.0)
    assert q[0] == pytest.approx(6 * PERIOD, rel=1e-3)


@each_far_error
def test_observer_gets_the_input_that_is_cut(far: float) -> None:
    u, q, p = one_sample(LinearAdrc, BANDWIDTH, LIMIT, far)
    assert abs(u) > LIMIT
    z = np.array([far, 0.0])
    expected = p.F @ p.start @ z + p.G @ z + p.L @ [math.copysign(LIMIT, far)]
    np.testing.assert_allclose(q, expected, rtol=1e-12)


# The adaptive law


@pytest.mark.parametrize(
    ("design", "limit", "beyond"),
    [
        ("arm", 0.01, [True]),
        ("arm", math.inf, [False]),
        (REGULATION, 1.0, [True, False]),
        (REGULATION, 20.0, [False, False]),
    ],
)
def test_estimates_hold_while_an_input_is_beyond_its_limit(
    design: str, limit: float, beyond: list[bool]
) -> None:
    law = Adaptive(2.0, 1.0, limit).design(task_of(design)).sampled(PERIOD)
    memory: Any = law.memory()
    u = law.input_at(0.0, np.array(STARTS[design]), memory)
    assert (np.abs(u) > limit).tolist() == beyond

    parametrization = nominal(design).system.parametrization
    assert parametrization is not None
    estimates = parametrization.nominal(law.parameters.plant)
    assert np.array_equal(memory.theta, estimates) == any(beyond)


@pytest.mark.parametrize(
    ("design", "wrong"),
    [
        ("servo", {"J": 3.0}),
        ("arm", {"m": 2.0, "l": 1.25, "M_c": 0.5}),
        (REGULATION, {"mp": 3.0, "m1": 0.7}),
    ],
)
def test_lyapunov_function_falls_as_s_K_D_s(design: str, wrong: dict[str, float]) -> None:
    """V' = -s'K_D s with wrong parameters and a constant load, to the first order in the period.

    V = s'M s/2 + |theta - theta*|^2/(2 gamma), all of the true plant. It asks for M' - 2 C to be
    skew-symmetric, and for theta* to have the load: with either wrong it does not hold.
    """
    period = 1e-4
    plant = nominal(design).changed(scales=wrong)
    law = controller(design, "adaptive").sampled(period)
    linear = plant.system.parametrization
    assert linear is not None
    m = len(plant.system.inputs)
    p = law.parameters
    adapted = run(design, law, 0.25, plant, timestep=period, disturbances=[LOADS[design]])

    # The body's torque is one on every joint before it; T_d of the servo is in amperes.
    theta = np.array(linear.nominal(plant.parameters))
    theta[-m:] = LOADS[design].wrench[4] / (p.plant.Kt if design == "servo" else 1.0)
    estimates = np.vstack([linear.nominal(p.plant), adapted.memory["theta"][:-1]])

    s = adapted.memory["composite"]
    q = adapted.state[: len(s), :m]
    inertias = np.array([linear.inertia(position, plant.parameters) for position in q])
    kinetic = np.einsum("ki,kij,kj->k", s, inertias, s)
    misfit = np.sum((estimates - theta) ** 2, axis=1)
    V = kinetic / 2 + misfit / (2 * p.adaptation)

    # Friction of the servo takes its share, as another K_D.
    friction = theta[1] if design == "servo" else 0.0
    fall = np.einsum("ki,ij,kj->k", s, p.damping + friction * np.eye(m), s)
    slope = np.diff(V) / period
    assert V[-1] < 0.9 * V[0]
    # First order in the period: V'' T / 2, a percent of what it falls by at most.
    allowed = 0.02 * fall.max()
    np.testing.assert_allclose(slope, -fall[:-1], atol=allowed)
    assert slope.max() < allowed


@each_design
def test_damping_of_the_adaptive_law_puts_both_poles_at_its_frequency(design: str) -> None:
    """K_D = Lambda M(q_d(0)): nominally, as long as the inertia stays what it is."""
    law = controller(design, "adaptive")
    linear = nominal(design).system.parametrization
    assert linear is not None
    p = law.parameters
    q_d = np.array(law.coordinates.reference(0.0, p.reference)[::3])
    np.testing.assert_allclose(p.damping, 2.0 * linear.inertia(q_d, p.plant), rtol=1e-12)
