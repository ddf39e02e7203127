"""The rivals by what their sources prove: integrators, observers, a Lyapunov function."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
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
from grosmc_mj.control.task import Task
from grosmc_mj.errors import ArgumentError, GainError, PremiseError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Plant
from grosmc_mj.simulation.disturbances import Constant, Disturbance
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory

PERIOD = 1e-3
# For what is seen after a long time.
COARSE: dict[str, Any] = {"control_period": 5e-3, "timestep": 5e-3}
LAWS: dict[str, dict[str, Callable[[Task], Controller]]] = {
    "servo": {
        "lqi": lambda task: lqi(task, 2.0, linearizing=False),
        "pid": lambda task: pid(task, 2.0, linearizing=False),
        "adrc": lambda task: adrc(task, 100.0, linearizing=False),
        "adaptive": lambda task: adaptive(task, 2.0, 1.0, linearizing=False),
    },
    "arm": {
        "lqi": lambda task: lqi(task, 20.0),
        "pid": lambda task: pid(task, 3.0),
        "adrc": lambda task: adrc(task, 100.0),
        "adaptive": lambda task: adaptive(task, 2.0, 1.0),
    },
    REGULATION: {
        "lqi": lambda task: lqi(task, 20.0),
        "pid": lambda task: pid(task, 3.0),
        "adrc": lambda task: adrc(task, 100.0),
        "adaptive": lambda task: adaptive(task, 2.0, 1.0),
    },
}
STARTS = {"servo": (0.0, 0.0), "arm": (0.5, math.pi), REGULATION: (0.5, -2.0, 0.0, 0.0)}
# Wrenches about the joints, which are along -y.
LOADS = {
    "servo": Disturbance("rotor", (0, 0, 0, 0, 0.3, 0), Constant()),
    "arm": Disturbance("hub", (0, 0, 0, 0, 0.1, 0), Constant()),
    REGULATION: Disturbance("payload", (0, 0, 0, 0, 0.5, 0), Constant()),
}
each_law = pytest.mark.parametrize(
    ("design", "name"), [(design, name) for design, laws in LAWS.items() for name in laws]
)
each_design = pytest.mark.parametrize("design", LAWS)


@cache
def physics(design: str) -> MujocoPlant:
    return MujocoPlant.load(design.split()[0])


@cache
def nominal(design: str) -> AnalyticPlant:
    return physics(design).analytic()


@cache
def controller(design: str, name: str) -> Controller:
    if name in LAWS[design]:
        return LAWS[design][name](task_of(design))
    return (linear_lqr if design == "servo" else linearized_lqr)(task_of(design))


def run(
    design: str,
    law: Controller,
    duration: float,
    plant: Plant | None = None,
    engine: Engine = "python",
    **options: Any,
) -> Trajectory:
    """In Python, which need not compile a law for a few seconds of it."""
    true = plant or nominal(design)
    return simulate(true, law, STARTS[design], duration=duration, engine=engine, **options)


def errors(design: str, law: Controller, found: Trajectory) -> Array:
    """z at every sample."""
    return law.coordinates.along(found.time, found.state, law.parameters)


# Both engines, one run and many


@pytest.mark.slow
@each_law
@pytest.mark.parametrize("stride", [1, 5])
def test_engines_agree(design, name, stride):
    """Exactly: both use one libm in one order of operations, over 300 samples of both."""
    runs = [
        run(
            design,
            controller(design, name),
            0.3,
            physics(design),
            control_period=stride * PERIOD,
            disturbances=[LOADS[design]],
            engine=engine,
        )
        for engine in ("native", "python")
    ]
    for field in ("state", "command", "weighed", "memory"):
        np.testing.assert_array_equal(getattr(runs[0], field), getattr(runs[1], field))


@pytest.mark.slow
@each_law
def test_a_batch_is_its_runs(design, name):
    """A run's memory is its own, and the laws' numbers may differ."""
    law, loads = controller(design, name), [[LOADS[design]], []]
    many = simulate([physics(design)] * 2, law, STARTS[design], duration=0.2, disturbances=loads)
    for index, load in enumerate(loads):
        alone = run(design, law, 0.2, physics(design), "native", disturbances=load)
        np.testing.assert_array_equal(many[index].state, alone.state)
    assert not np.array_equal(many[0].state, many[1].state)


# Integrals


@pytest.mark.parametrize("name", ["lqi", "pid", "adrc"])
def test_they_reject_a_constant_load_where_lqr_does_not(name):
    """At rest 0 = Kt u - T_d: LQR keeps e = -T_d / (Kt K_1), by eq. (15); integrals keep none."""
    load, p = LOADS["servo"], nominal("servo").parameters
    law, offset = controller("servo", "lqr"), -load.wrench[4]
    kept = errors("servo", law, run("servo", law, 25.0, disturbances=[load], **COARSE))[-1]
    rejecting = controller("servo", name)
    left = errors("servo", rejecting, run("servo", rejecting, 25.0, disturbances=[load], **COARSE))[
        -1
    ]
    # The slowest pole is at -1 /s: e^-25 is 1e-11.
    assert kept[0] == pytest.approx(offset / (p.Kt * law.parameters.K[0, 0]), rel=1e-8)
    assert abs(kept[0]) > 0.4
    assert np.abs(left).max() < 1e-8


@pytest.mark.parametrize("design", ["servo", "arm", REGULATION])
def test_pid_has_all_poles_at_its_frequency(design):
    """Of z' = A z + B v, xi' = e under v = -(K z + H xi); a triple pole splits by eps^(1/3)."""
    law = controller(design, "pid")
    closed = augmented(law)
    frequency = 2.0 if design == "servo" else 3.0
    np.testing.assert_allclose(np.linalg.eigvals(closed), -frequency, atol=3e-4)


@pytest.mark.parametrize("design", ["servo", "arm", REGULATION])
def test_lqi_s_gain_is_the_least_cost_of_the_augmented_plant(design):
    """Its value function solves Lyapunov's equation and gives the gain back: R K = B'P."""
    law = controller(design, "lqi")
    optimum, weight = law.designed.lqr, 2.0 if design == "servo" else 20.0
    n, m = optimum.B.shape
    K = np.hstack(
        [law.sampled(PERIOD).parameters.dynamics.K, law.sampled(PERIOD).parameters.dynamics.H]
    )
    Q = np.zeros((n + m, n + m))
    Q[:n, :n], Q[n:, n:] = optimum.Q, weight * np.eye(m)
    closed = augmented(law)
    P = scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + K.T @ optimum.R @ K))
    B = np.vstack([optimum.B, np.zeros((m, m))])
    np.testing.assert_allclose(B.T @ P, optimum.R @ K, rtol=1e-9, atol=1e-9)


def augmented(law: Controller) -> Array:
    """The continuous closed loop of z and its outputs' integrals."""
    p, optimum = law.sampled(PERIOD).parameters.dynamics, law.designed.lqr
    rows = law.coordinates.output_rows
    n, m = optimum.B.shape
    closed = np.zeros((n + m, n + m))
    closed[:n] = np.hstack([optimum.A - optimum.B @ p.K, -optimum.B @ p.H])
    closed[n:, :n] = np.eye(n)[list(rows)]
    return closed


@pytest.mark.parametrize("design", ["servo", "arm"])
def test_integrals_are_exact_between_samples(design):
    """Against a numerical integration of z' = A z over a long period; rtol of the solver."""
    law, period, z = controller(design, "lqi"), 0.4, np.array([0.7, -1.3])
    A, p = law.designed.lqr.A, law.sampled(period).parameters.dynamics

    def moved(t: float, y: Array) -> Array:
        return np.concatenate([A @ y[:2], y[:1]])

    solved = scipy.integrate.solve_ivp(moved, (0, period), [*z, 0.25], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(p.F @ [0.25] + p.G @ z, solved.y[2:, -1], rtol=1e-9)


# The observer


@pytest.mark.parametrize("degrees", [(1,), (2,), (3,), (2, 1)])
@pytest.mark.parametrize("bandwidth", [1.0, 200.0])
def test_observer_s_poles_are_at_its_bandwidth(degrees, bandwidth):
    """exp(-w_o T), r + 1 of them for a chain of degree r: by the characteristic polynomial."""
    found = observer(degrees, bandwidth, PERIOD)
    pole, size = math.exp(-bandwidth * PERIOD), sum(degrees) + len(degrees)
    assert len(found.F) == size
    # Powers of T = 1e-3 up to the third are in F: rounding of its determinants' terms.
    np.testing.assert_allclose(np.poly(found.F), np.poly([pole] * size), atol=1e-9)


@each_design
def test_adrc_is_nominally_the_optimum(design):
    """The estimate of nothing is nothing, up to what a held input leaves of a nonlinear plant."""
    best, law = controller(design, "lqr"), controller(design, "adrc")
    there, here = run(design, best, 2.0), run(design, law, 2.0)
    # Exactly held, and exact, for the linear servo, but for its friction within a sample.
    assert np.abs(here.state - there.state).max() < (1e-4 if design == "servo" else 5e-3)


def test_observer_converges_to_a_constant_disturbance():
    """On the servo d of e'' = ... + d is T_d/J by eqs. (15) and (17), whatever the law does."""
    law, load = controller("servo", "adrc"), LOADS["servo"]
    found = run("servo", law, 20.0, disturbances=[load])
    p = law.sampled(PERIOD).parameters.dynamics
    z, seen = errors("servo", law, found)[-1], observer((2,), 100.0, PERIOD)
    J = nominal("servo").parameters.J
    estimate = float((seen.H @ found.memory["q"][-1] + seen.K @ z).item())
    assert estimate == pytest.approx(load.wrench[4] / J, rel=1e-6)
    # And before it acted, nothing: so it is the load that is seen.
    assert p.start[-1].tolist() == [0.0, 0.0]
    free = run("servo", law, 20.0)
    assert abs(float((seen.H @ free.memory["q"][-1]).item())) < 1e-6 * abs(estimate)


# Actuators' limits


def test_integrals_hold_and_the_observer_is_told_while_an_input_is_cut():
    """By one sample far out, where the input asked for is beyond the limit."""
    x, z = np.array([-5.0, 0.0]), np.array([6.0, 0.0])
    for make in (lqi, pid):
        law = make(task_of("servo"), 2.0, limit=1.5, linearizing=False).sampled(PERIOD)
        memory: Any = law.memory()
        assert law.input_at(0.0, x, memory) > 1.5
        assert memory.q.tolist() == [0.0]
        memory = law.memory()
        free = replace(law, parameters=replace(law.parameters, limit=math.inf))
        free.input_at(0.0, x, memory)
        assert memory.q[0] == pytest.approx(6 * PERIOD, rel=1e-3)
    law = adrc(task_of("servo"), 100.0, limit=1.5, linearizing=False).sampled(PERIOD)
    memory, p = law.memory(), law.parameters.dynamics
    assert law.input_at(0.0, x, memory) > 1.5
    np.testing.assert_allclose(memory.q, p.F @ p.start @ z + p.G @ z + p.L @ [1.5], rtol=1e-12)


# The adaptive law


@each_design
@pytest.mark.parametrize("variant", ["printed", "corrected"])
def test_torques_are_linear_in_the_parameters(design, variant):
    """Y(q, q', q', q'') theta is the input that the plant's own equations moved under."""
    plant = physics(design).analytic(variant if design == "arm" else "corrected")
    found, m, rng = plant.system.parametrization, len(plant.system.inputs), np.random.default_rng(0)
    assert found is not None
    for _ in range(20):
        x, u = rng.uniform(-1.4, 1.4, 2 * m), rng.normal(0, 3, m)
        acceleration = plant.derivative(x, u)[m:]
        Y = np.reshape(found.regressor(x, x[m:], acceleration, plant.parameters), (m, -1))
        torque = Y @ np.array(found.nominal(plant.parameters))
        np.testing.assert_allclose(torque, u, rtol=0, atol=1e-12)  # sums of terms of up to 1e2


@pytest.mark.parametrize(
    ("design", "wrong"),
    [
        ("servo", {"J": 3.0}),
        ("arm", {"m": 2.0, "l": 1.25, "M_c": 0.5}),
        (REGULATION, {"mp": 3.0, "m1": 0.7}),
    ],
)
def test_lyapunov_function_falls_as_s_K_D_s(design, wrong):
    """V' = -s'K_D s with wrong parameters and a constant load, to the first order in the period.

    V = s'M s/2 + |theta - theta*|^2/(2 gamma), all of the true plant. It asks for M' - 2 C to be
    skew-symmetric, and for theta* to have the load: with either wrong it does not hold.
    """
    period, duration = 1e-4, 1.0
    law, plant = (
        controller(design, "adaptive").sampled(period),
        nominal(design).changed(scales=wrong),
    )
    found, m, p = plant.system.parametrization, len(plant.system.inputs), law.parameters
    assert found is not None
    result = simulate(
        plant,
        law,
        STARTS[design],
        duration=duration,
        timestep=period,
        disturbances=[LOADS[design]],
        engine="python",
    )
    # The body's torque is one on every joint before it; T_d of the servo is in amperes.
    torque = LOADS[design].wrench[4] / (p.plant.Kt if design == "servo" else 1.0)
    theta = np.array(found.nominal(plant.parameters))
    theta[-m:] = torque
    off = np.vstack([found.nominal(p.plant), result.memory["theta"][:-1]]) - theta
    s, count = result.memory["composite"], len(result.memory["theta"])
    kinetic = [
        s[k] @ found.inertia(result.state[k, :m], plant.parameters) @ s[k] for k in range(count)
    ]
    V = np.array(kinetic) / 2 + np.sum(off**2, axis=1) / (2 * p.adaptation)
    # Friction of the servo takes its share, as another K_D.
    friction = theta[1] if design == "servo" else 0.0
    fall = np.einsum("ki,ij,kj->k", s, p.damping + friction * np.eye(m), s)
    slope = np.diff(V) / period
    assert V[-1] < 0.9 * V[0]
    # First order in the period: V'' T / 2, a percent of what it falls by at most.
    np.testing.assert_allclose(slope, -fall[:-1], atol=0.02 * fall.max())
    assert slope.max() < 0.02 * fall.max()


def test_adaptive_law_rejects_a_constant_load():
    law = controller("servo", "adaptive")
    found = run("servo", law, 60.0, disturbances=[LOADS["servo"]], **COARSE)
    assert np.abs(errors("servo", law, found)[-1]).max() < 1e-5


# What cannot be


def test_numbers_that_do_not_fit_are_refused():
    task = task_of("arm")
    for make, said in (
        (lambda: lqi(task, 0.0), "integral_weight"),
        (lambda: pid(task, math.nan), "frequency"),
        (lambda: adrc(task, -1.0), "bandwidth"),
        (lambda: adaptive(task, 1.0, math.inf), "adaptation"),
        (lambda: adaptive(task, 0.0, 1.0), "frequency"),
        (lambda: lqi(task, 1.0, limit=0.0), "limit"),
        (lambda: adaptive(task, 1.0, 1.0, limit=-1.0), "limit"),
    ):
        with pytest.raises((ArgumentError, GainError), match=said):
            make()
    with pytest.raises(ArgumentError, match="task"):
        lqi(None, 1.0)


def test_adaptive_law_needs_joints_whose_torques_are_linear_in_parameters():
    with pytest.raises(PremiseError, match="cart_pendulum has no torques Y theta"):
        adaptive(task_of("cart_pendulum"), 1.0, 1.0)
    with pytest.raises(PremiseError, match="must be its joints, q1, q2"):
        adaptive(task_of("two_link_arm"), 1.0, 1.0)
