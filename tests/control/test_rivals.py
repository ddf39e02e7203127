"""The rivals by what their sources prove: integrators, observers, a Lyapunov function."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.linalg
from shipped import REGULATION, task_of

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linear_lqr, linearized_lqr
from grosmc_mj.control.rivals.adaptive import adaptive
from grosmc_mj.control.rivals.integral import lqi, pid
from grosmc_mj.control.rivals.observer import adrc, observer
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.disturbances import Constant, Disturbance
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

PERIOD = 1e-3
STARTS = {"servo": (0.0, 0.0), "arm": (0.5, math.pi), REGULATION: (0.5, -2.0, 0.0, 0.0)}
# Wrenches about the joints, which are along -y.
LOADS = {
    "servo": Disturbance("rotor", (0, 0, 0, 0, 0.3, 0), Constant()),
    "arm": Disturbance("hub", (0, 0, 0, 0, 0.1, 0), Constant()),
    REGULATION: Disturbance("payload", (0, 0, 0, 0, 0.5, 0), Constant()),
}
WEIGHT, FREQUENCY, BANDWIDTH = 2.0, 3.0, 100.0

LAWS: dict[str, Callable[..., Controller]] = {
    "lqr": lambda task, linearizing: (linearized_lqr if linearizing else linear_lqr)(task),
    "lqi": partial(lqi, integral_weight=WEIGHT),
    "pid": partial(pid, frequency=FREQUENCY),
    "adrc": partial(adrc, bandwidth=BANDWIDTH),
    "adaptive": partial(adaptive, frequency=2.0, adaptation=1.0),
}
each_design = pytest.mark.parametrize("design", STARTS)


@cache
def nominal(design: str) -> AnalyticPlant:
    return MujocoPlant.load(design.split()[0]).analytic()


@cache
def controller(design: str, name: str) -> Controller:
    return LAWS[name](task_of(design), linearizing=design != "servo")


def run(
    design: str, law: Controller, duration: float, plant: Plant | None = None, **options: Any
) -> Trajectory:
    """In Python, which need not compile a law for a few seconds of it."""
    true = plant or nominal(design)
    return simulate(true, law, STARTS[design], duration=duration, engine="python", **options)


@pytest.mark.parametrize("name", ["lqr", "lqi", "pid", "adrc"])
def test_integrals_and_observer_reject_a_constant_load_and_lqr_does_not(name: str) -> None:
    """At rest 0 = Kt u - T_d: LQR keeps e = -T_d / (Kt K_1), by eq. (15); integrals keep none."""
    load, plant, law = LOADS["servo"], nominal("servo"), controller("servo", name)
    loaded = run("servo", law, 25.0, disturbances=[load], control_period=5e-3, timestep=5e-3)
    z = law.coordinates.along(loaded.time[-1:], loaded.state[-1:], law.parameters)[0]
    # The slowest pole is at -1 /s: e^-25 is 1e-11.
    if name == "lqr":
        expected = -load.wrench[4] / (plant.parameters.Kt * law.parameters.K[0, 0])
        assert z[0] == pytest.approx(expected, rel=1e-8)
    else:
        assert np.abs(z).max() < 1e-8
    if name == "adrc":
        # d of e'' = ... + d is T_d/J by eqs. (15) and (17), whatever the law does.
        watching, J = observer((2,), BANDWIDTH, 5e-3), plant.parameters.J
        estimate = (watching.H @ loaded.memory["q"][-1] + watching.K @ z).item()
        assert estimate == pytest.approx(load.wrench[4] / J, rel=1e-6)


def augmented(law: Controller) -> tuple[Array, Array]:
    """The continuous closed loop of z and its outputs' integrals xi, and [K, H]."""
    p, optimum = law.sampled(PERIOD).parameters.dynamics, law.designed.lqr
    n, m = optimum.B.shape
    gain, plant = np.hstack([p.K, p.H]), np.zeros((n + m, n + m))
    plant[:n, :n], plant[n:, :n] = optimum.A, np.eye(n)[list(law.coordinates.output_rows)]
    return plant - np.vstack([optimum.B, np.zeros((m, m))]) @ gain, gain


@each_design
def test_pid_has_all_poles_at_its_frequency_and_lqi_the_least_cost(design: str) -> None:
    """A triple pole splits by eps^(1/3); a value function gives the gain back: R K = B'P."""
    closed, _ = augmented(controller(design, "pid"))
    np.testing.assert_allclose(np.linalg.eigvals(closed), -FREQUENCY, atol=3e-4)
    law = controller(design, "lqi")
    (closed, K), optimum = augmented(law), law.designed.lqr
    m = len(optimum.R)
    Q: Any = scipy.linalg.block_diag(optimum.Q, WEIGHT * np.eye(m))
    P = scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + K.T @ optimum.R @ K))
    B = np.vstack([optimum.B, np.zeros((m, m))])
    np.testing.assert_allclose(B.T @ P, optimum.R @ K, rtol=1e-9, atol=1e-9)


def test_integrals_are_exact_between_samples_and_observers_have_their_poles() -> None:
    """Against a numerical integration of z' = A z over a long period; rtol of the solver.

    An observer has r + 1 poles at exp(-w_o T) for a chain of degree r.
    """
    law, period, z = controller("servo", "lqi"), 0.4, np.array([0.7, -1.3])
    A, p = law.designed.lqr.A, law.sampled(period).parameters.dynamics
    solved = scipy.integrate.solve_ivp(
        lambda _, y: [*(A @ y[:2]), y[0]], (0, period), [*z, 0.25], rtol=1e-11, atol=1e-12
    )
    np.testing.assert_allclose(p.F @ [0.25] + p.G @ z, solved.y[2:, -1], rtol=1e-9)
    for degrees, bandwidth in (((1,), 1.0), ((3,), 200.0), ((2, 1), 200.0)):
        F, size = observer(degrees, bandwidth, PERIOD).F, sum(degrees) + len(degrees)
        # Powers of T = 1e-3 up to the third are in F: rounding of its determinants' terms.
        expected = np.poly([math.exp(-bandwidth * PERIOD)] * size)
        np.testing.assert_allclose(np.poly(F), expected, atol=1e-9)


@each_design
def test_adrc_is_nominally_the_optimum(design: str) -> None:
    """The estimate of nothing is nothing, up to what a held input leaves of a nonlinear plant."""
    best, watched = (run(design, controller(design, name), 0.6) for name in ("lqr", "adrc"))
    # Exactly held, and exact, for the linear servo, but for its friction within a sample.
    assert np.abs(watched.state - best.state).max() < (1e-4 if design == "servo" else 5e-3)


def test_integrals_hold_and_the_observer_is_told_while_an_input_is_cut() -> None:
    """By one sample far out, where the input asked for is beyond the limit."""
    x, z = np.array([-5.0, 0.0]), np.array([6.0, 0.0])

    def sampled(make: Any, number: float, limit: float) -> tuple[float, Array, Any]:
        law = make(task_of("servo"), number, limit=limit, linearizing=False).sampled(PERIOD)
        memory: Any = law.memory()
        return law.input_at(0.0, x, memory).item(), memory.q, law.parameters.dynamics

    for make in (lqi, pid):
        u, q, _ = sampled(make, 2.0, 1.5)
        assert (u > 1.5, q.tolist()) == (True, [0.0])
        assert sampled(make, 2.0, math.inf)[1][0] == pytest.approx(6 * PERIOD, rel=1e-3)
    u, q, p = sampled(adrc, BANDWIDTH, 1.5)
    assert u > 1.5
    np.testing.assert_allclose(q, p.F @ p.start @ z + p.G @ z + p.L @ [1.5], rtol=1e-12)


@pytest.mark.parametrize("limit", [0.01, math.inf])
def test_estimates_hold_while_an_input_is_beyond_its_limit(limit: float) -> None:
    law = adaptive(task_of("arm"), 2.0, 1.0, limit).sampled(PERIOD)
    memory: Any = law.memory()
    u = law.input_at(0.0, np.array([0.5, 0.0]), memory)
    assert abs(u.item()) > 0.01

    parametrization = nominal("arm").system.parametrization
    assert parametrization is not None
    estimates = parametrization.nominal(law.parameters.plant)
    assert np.array_equal(memory.theta, estimates) == (limit == 0.01)


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
    period, plant = 1e-4, nominal(design).changed(scales=wrong)
    law = controller(design, "adaptive").sampled(period)
    linear, m, p = plant.system.parametrization, len(plant.system.inputs), law.parameters
    assert linear is not None
    found = run(design, law, 0.4, plant, timestep=period, disturbances=[LOADS[design]])
    # Nominally both poles are at -Lambda, as long as the inertia stays what it is.
    q_d = law.coordinates.reference(0.0, p.reference)[::3]
    np.testing.assert_allclose(p.damping, 2.0 * linear.inertia(np.array(q_d), p.plant), rtol=1e-12)
    # The body's torque is one on every joint before it; T_d of the servo is in amperes.
    theta = np.array(linear.nominal(plant.parameters))
    theta[-m:] = LOADS[design].wrench[4] / (p.plant.Kt if design == "servo" else 1.0)
    off = np.vstack([linear.nominal(p.plant), found.memory["theta"][:-1]]) - theta
    s, q = found.memory["composite"], found.state[:, :m]
    kinetic = [
        s_k @ linear.inertia(q_k, plant.parameters) @ s_k
        for s_k, q_k in zip(s, q[: len(s)], strict=True)
    ]
    V = np.array(kinetic) / 2 + np.sum(off**2, axis=1) / (2 * p.adaptation)
    # Friction of the servo takes its share, as another K_D.
    friction = theta[1] if design == "servo" else 0.0
    fall = np.einsum("ki,ij,kj->k", s, p.damping + friction * np.eye(m), s)
    assert V[-1] < 0.9 * V[0]
    # First order in the period: V'' T / 2, a percent of what it falls by at most.
    np.testing.assert_allclose(np.diff(V) / period, -fall[:-1], atol=0.02 * fall.max())
    assert (np.diff(V) / period).max() < 0.02 * fall.max()
