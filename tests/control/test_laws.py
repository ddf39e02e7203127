"""The laws at a point: eqs. (5), (8), (12), (23), (31), (36), (37), (44), (51) and (55)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import ARM_ERROR, ARM_REFERENCE, PENDULUM_ERROR, SERVO_ERROR, SERVO_STEP, find_case

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.base import OutputCoordinates
from grosmc_mj.control.matrices import norm
from grosmc_mj.control.memory import Memory, SurfaceMemory
from grosmc_mj.control.references import TIME, Setpoint, reference, setpoint
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.control.switching import sgn
from grosmc_mj.control.task import FeedbackParameters, NoNumbers
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Variant
from grosmc_mj.simulation.simulate import simulate

# The optimal law that each GROSMC makes robust.
OPTIMAL = {"servo": "lqr", "cart_pendulum": "fl-lqr", "arm": "lqr"}
each_system = pytest.mark.parametrize("system", OPTIMAL)
# Laws that work through the feedback linearization (23) or (44).
linearizing = pytest.mark.parametrize(
    ("system", "law"),
    [("cart_pendulum", "fl-lqr"), ("cart_pendulum", "grosmc"), ("arm", "lqr"), ("arm", "grosmc")],
)

# Two ways to one acceleration differ by the rounding of its terms, which reach 1e3 at the states
# below: 1e3 times a few units in the last place.
ROUNDING = 1e-12


@cache
def nominal(system: str, variant: Variant = "corrected") -> AnalyticPlant:
    return MujocoPlant.load(system).analytic(variant)


@cache
def controller(system: str, name: str) -> Controller:
    return chapter_controller(name, nominal(system))


def coordinates(ctl: Controller) -> OutputCoordinates:
    return ctl.coordinates


def states(system: str, count: int, seed: int = 0) -> Array:
    """Random states where every law is defined: |angle| < 1.4, rates of 3 [rad/s, m/s]."""
    n, rng = nominal(system).system.degrees_of_freedom, np.random.default_rng(seed)
    angles, rates = rng.uniform(-1.4, 1.4, (count, n)), rng.normal(0, 3, (count, n))
    return np.concatenate([angles, rates], axis=1)


def error_rate(ctl: Controller, plant: AnalyticPlant, t: float, x: Array, u: float) -> Array:
    """z' on a plant, from the plant's own equations."""
    error, dx = coordinates(ctl), plant.derivative(x, u)
    position = error.system.output
    _, dy_r, ddy_r = error.reference(t, ctl.parameters.reference)
    velocity = dx[position + error.system.degrees_of_freedom]
    return error.sign * np.array([dx[position] - dy_r, velocity - ddy_r])


def off_surface(ctl: Controller, t: float, x: Array, s: float) -> SurfaceMemory:
    """Memory of a run that is off its surface by s when it reaches x at t > 0."""
    z, G = coordinates(ctl).error_state(t, x, ctl.parameters), ctl.parameters.G[0]
    return SurfaceMemory(z0=z - s * G / (G @ G), t=t)


def input_at(ctl: Controller, t: float, x: Array, memory: Memory) -> float:
    """The input of a law of one input."""
    return float(ctl.input_at(t, x, memory).item())


def weighed(memory: Memory) -> float:
    """v of a law of one input."""
    return float(np.asarray(memory.v).item())


def surface_rate(ctl: Controller, plant: AnalyticPlant, t: float, x: Array, u: float) -> float:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52)."""
    p = ctl.parameters
    z = coordinates(ctl).error_state(t, x, p)
    return float((p.G @ error_rate(ctl, plant, t, x, u) - p.S @ z).item())


# The surface


@given(st.floats(allow_nan=False))
def test_sgn_is_the_sign_as_printed(s):
    assert sgn(s) == np.sign(s)


@each_system
@given(data=st.data())
@settings(max_examples=50)
def test_surface_is_exactly_zero_at_any_start(system, data):
    """s(0) = 0: there is no reaching phase, wherever the run starts."""
    ctl = controller(system, "grosmc")
    numbers = st.floats(-1e6, 1e6)
    x = data.draw(st.lists(numbers, min_size=4, max_size=4))[: len(nominal(system).system.states)]
    memory = ctl.memory()
    input_at(ctl, 0.0, np.array(x), memory)
    assert isinstance(memory, SurfaceMemory)
    assert memory.s.tolist() == [0.0]


@dataclass(frozen=True)
class Surface:
    G: Array
    S: Array


def test_surface_is_the_exact_integral_up_to_half_a_sample():
    """A left Riemann sum is short of the integral by T/2 [f(t) - f(0)] + O(T^2).

    With z = [sin t, cos 2t] every term of eq. (31) is known.
    """
    p, end, remainders = Surface(np.array([[0.7, -1.3]]), np.array([[2.0, 0.5]])), 2.0, []

    def z(t: float) -> Array:
        return np.array([math.sin(t), math.cos(2 * t)])

    integral = np.array([1 - math.cos(end), math.sin(2 * end) / 2])
    exact = (p.G @ (z(end) - z(0)) - p.S @ integral).item()
    for N in (50, 100, 200):
        memory, T, s = SurfaceMemory(), end / N, math.nan
        for k in range(N + 1):
            integral_surface(k * T, z(k * T), memory, p)
            (s,) = memory.s
        half_a_sample = T / 2 * (p.S @ (z(end) - z(0))).item()
        assert abs(s - exact) < 1.1 * abs(half_a_sample)
        remainders.append(abs(s - exact - half_a_sample))
    # O(T^2) with a next term in T^4: a quarter up to T^2 = 1.6e-3 times a number of order one.
    np.testing.assert_allclose(np.divide(remainders[:-1], remainders[1:]), 4, rtol=0.01)


@each_system
def test_surface_stays_at_zero_without_switching_on_the_nominal_plant_as_O_of_T(system):
    """In continuous time s = 0 is invariant there; hold and Riemann sum leave O(T)."""
    ctl, case = controller(system, "grosmc"), find_case(system, "nominal")
    names = ("k", "epsilon") if system == "arm" else ("eta", "gamma0", "gamma1")
    smooth = replace(ctl, parameters=replace(ctl.parameters, **dict.fromkeys(names, 0.0)))
    largest = []
    for T in (8e-3, 4e-3, 2e-3):
        run = simulate(nominal(system), smooth, case.x0, duration=2.0, control_period=T)
        assert run.sliding is not None
        largest.append(np.abs(run.sliding).max())
    # The next order changes the ratio by T times the plant's rates, some 10/s.
    np.testing.assert_allclose(np.divide(largest[:-1], largest[1:]), 2, rtol=0.1)


@each_system
def test_switching_term_meets_the_input_gain_GB_times_E(system):
    """(ds/dx) g, which (37) divides by, is G B E(x); for a linear plant E = 1 in (12)."""
    ctl, plant, t, step = controller(system, "grosmc"), nominal(system), 0.3, 1e-6
    p, error = ctl.parameters, coordinates(ctl)
    for x in states(system, 20):

        def s(x: Array, x0: Array = x) -> float:
            memory = off_surface(ctl, t, x0, 0.0)
            input_at(ctl, t, x, memory)
            return float(memory.s.item())

        n = len(x)
        gradient = [(s(x + d) - s(x - d)) / (2 * step) for d in step * np.eye(n)]
        g = np.array(plant.system.equations.input_matrix(x, plant.parameters))
        E = np.eye(1) if system == "servo" else error.dynamics(t, x, p)[1]
        # s is linear in x, so the difference only rounds: 1e-16 * |s| / step.
        assert gradient @ g == pytest.approx((p.GB @ E).item(), rel=1e-7)


# The continuous and the switching part


@each_system
def test_law_on_the_surface_is_the_optimal_law(system):
    """sgn(0) = 0: what remains is u_c of (12), u_con of (37) and v_c of (55)."""
    robust, optimal = controller(system, "grosmc"), controller(system, OPTIMAL[system])
    for x in states(system, 50):
        memory = robust.memory()
        u = input_at(robust, 0.0, x, memory)
        assert isinstance(memory, SurfaceMemory)
        assert memory.s.tolist() == [0]
        assert u == input_at(optimal, 0.0, x, optimal.memory())


@each_system
def test_continuous_part_is_the_equivalent_control_36(system):
    """s' = 0 on the nominal plant under the optimal law, whatever s is."""
    ctl, plant = controller(system, OPTIMAL[system]), nominal(system)
    robust = controller(system, "grosmc")
    for x in states(system, 50):
        u = input_at(ctl, 0.7, x, ctl.memory())
        terms = np.abs(plant.derivative(x, u)).max() * np.abs(robust.parameters.G).max()
        assert abs(surface_rate(robust, plant, 0.7, x, u)) < ROUNDING * max(1, terms)


@pytest.mark.parametrize("s", [0.4, -0.4, 1e-9])
@each_system
def test_switching_part_drives_s_at_the_rate_of_the_proofs(system, s):
    """Proofs 1 and 2 on the nominal plant: s' = -(eta + (g0 + g1 |z|) |ds/dx g|) sgn s.

    Proof 3: s' = -(k s + epsilon sgn s).
    """
    ctl, plant, t = controller(system, "grosmc"), nominal(system), 0.7
    p, error = ctl.parameters, coordinates(ctl)
    for x in states(system, 30):
        memory = off_surface(ctl, t, x, s)
        u = input_at(ctl, t, x, memory)
        # s is a difference of numbers of the size of z.
        assert memory.s.item() == pytest.approx(s, abs=1e-14)
        z, E = error.error_state(t, x, p), error.dynamics(t, x, p)[1].item()
        if system == "arm":
            expected = -(p.k * memory.s.item() + p.epsilon * np.sign(s))
        else:
            gain = abs(p.GB.item() * (1.0 if system == "servo" else E))
            expected = -(p.eta + (p.gamma0 + p.gamma1 * math.hypot(*z)) * gain) * np.sign(s)
        terms = np.abs(plant.derivative(x, u)).max() * np.abs(p.G).max()
        rate = surface_rate(ctl, plant, t, x, u)
        assert rate == pytest.approx(expected, rel=0, abs=ROUNDING * max(1, terms))


@given(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)))
def test_norm_is_euclidean(z):
    # Squares below 1e-308 vanish, which hypot avoids and no law needs.
    assert norm(z) == pytest.approx(math.hypot(*z), rel=1e-15, abs=1e-150)


# Feedback linearization


@linearizing
def test_feedback_linearization_leaves_a_chain_of_integrators(system, law):
    """z1'' = v on the nominal plant, eqs. (24) and (45), on and off the surface."""
    ctl, plant, t = controller(system, law), nominal(system), 0.7
    for x in states(system, 100):
        memory = off_surface(ctl, t, x, 0.3) if law == "grosmc" else ctl.memory()
        u = input_at(ctl, t, x, memory)
        v = weighed(memory)
        terms = max(np.abs(plant.derivative(x, u)).max(), abs(v))
        rate = error_rate(ctl, plant, t, x, u)
        assert rate[1] == pytest.approx(v, rel=0, abs=ROUNDING * max(1, terms))


@linearizing
def test_feedback_linearization_misses_on_the_printed_equations(system, law):
    """The printed a = m/(M+m) and C = 0.03 cos q are other plants than the corrected ones."""
    ctl, plant = controller(system, law), nominal(system, "printed")
    misses = []
    for x in states(system, 100):
        memory = ctl.memory()
        u = input_at(ctl, 0.0, x, memory)
        misses.append(abs(error_rate(ctl, plant, 0.0, x, u)[1] - weighed(memory)))
    # The arm's error is 0.03 cos q |q'| |1 - q'| / M: of order 1 at rates of 3 rad/s.
    assert np.median(misses) > 0.1, f"median miss {np.median(misses):g} rad/s^2"


@pytest.mark.parametrize("t", [0.0, 0.3, 1.7])
def test_tracking_law_leaves_e_as_a_chain_of_integrators_along_a_moving_reference(t):
    """e'' = v of eq. (58) without d, with the y_r'' that eq. (44) needs."""
    ctl, plant = controller("arm", "grosmc"), nominal("arm")
    for x in states("arm", 20):
        memory = off_surface(ctl, t, x, -0.2) if t else ctl.memory()
        u = input_at(ctl, t, x, memory)
        ddq = plant.derivative(x, u)[1]
        e2_rate = ddq + math.pi**2 * math.sin(math.pi * t)
        assert e2_rate == pytest.approx(weighed(memory), rel=0, abs=ROUNDING * max(1, abs(ddq)))


@pytest.mark.parametrize(
    ("system", "law", "x", "defined"),
    [
        ("cart_pendulum", "fl-lqr", [0, 1.57, 0, 0], True),
        ("cart_pendulum", "fl-lqr", [0, math.pi / 2, 0, 0], False),
        ("cart_pendulum", "fl-lqr", [0, -1.6, 0, 0], False),
        ("cart_pendulum", "grosmc", [0, -1.57, 0, 0], True),
        ("cart_pendulum", "grosmc", [0, 1.6, 0, 0], False),
        ("cart_pendulum", "grosmc", [0, math.pi, 0, 0], False),
        ("cart_pendulum", "lqr", [0, 1.6, 0, 0], True),
        ("arm", "lqr", [1.57, 0], True),
        ("arm", "lqr", [math.pi / 2, 0], False),
        ("arm", "grosmc", [-1.5 * math.pi, 0], False),
        ("arm", "grosmc", [-4.7, 0], True),
        ("servo", "grosmc", [100.0, 0], True),
    ],
)
def test_law_says_where_it_is_undefined_and_stays_finite(system, law, x, defined):
    """E(x) is singular at |theta| = pi/2: eq. (23) divides by it."""
    ctl = controller(system, law)
    memory = ctl.memory()
    u = input_at(ctl, 0.0, np.array(x, float), memory)
    assert math.isfinite(u)
    assert memory.undefined == (0.0 if defined else 1.0)


def test_laws_leave_their_numbers_alone_and_keep_no_memory_of_their_own():
    ctl, x = controller("cart_pendulum", "grosmc"), np.array([0.0, 0.2, 0.0, -0.4])
    p, names = ctl.parameters, ("G", "S", "K", "GB", "GB_inverse")
    before = {name: getattr(p, name).copy() for name in names}

    def run() -> list[float]:
        memory = ctl.memory()
        return [input_at(ctl, 1e-3 * k, x * k, memory) for k in range(4)]

    assert run() == run()
    for name, old in before.items():
        np.testing.assert_array_equal(old, getattr(p, name))


# Error coordinates and references


@pytest.mark.parametrize(
    ("y_r", "p"),
    [(setpoint, Setpoint(0.7)), (reference([1.3 * sp.sin(sp.pi * TIME)]), NoNumbers())],
)
@pytest.mark.parametrize("t", [0.0, 0.37, 2.2])
def test_reference_gives_its_own_derivatives(y_r, p, t):
    h = 1e-5
    _, dy, ddy = y_r(t, p)
    before, after = y_r(t - h, p), y_r(t + h, p)
    # Central differences: h^2/6 times a third derivative of some 40, and rounding 1e-16/h.
    np.testing.assert_allclose(
        [dy, ddy], np.subtract(after, before)[:2] / (2 * h), rtol=0, atol=1e-8
    )


def test_jacobian_of_the_servo_is_its_linear_equation_18():
    plant = nominal("servo")
    p: Any = plant.parameters
    A, B = SERVO_ERROR.linear_model(plant, FeedbackParameters(p, SERVO_STEP, np.zeros((1, 2))))
    np.testing.assert_allclose(A, [[0, 1], [0, -p.B / p.J]], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(B, [[0], [-p.Kt / p.J]], rtol=1e-9)


def test_jacobian_of_the_pendulum_is_the_linearized_lagrangian():
    """Upright: theta'' = (g theta + u/(M+m)) / (L (4/3 - m/(M+m)))."""
    plant = nominal("cart_pendulum")
    p: Any = plant.parameters
    numbers = FeedbackParameters(p, Setpoint(0.0), np.zeros((1, 2)))
    A, B = PENDULUM_ERROR.linear_model(plant, numbers)
    inertia = p.L * (4 / 3 - p.m / (p.M + p.m))
    np.testing.assert_allclose(A, [[0, 1], [p.g / inertia, 0]], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(B, [[0], [1 / (p.M + p.m) / inertia]], rtol=1e-7)


def test_errors_along_a_trajectory_are_those_that_the_law_sees():
    time, p = np.linspace(0, 1, 11), controller("arm", "lqr").parameters
    x = states("arm", 11)
    assert p.reference == ARM_REFERENCE
    z = ARM_ERROR.along(time, x, p)
    for row, t, state in zip(z, time, x, strict=True):
        np.testing.assert_array_equal(row, ARM_ERROR.error_state(float(t), state, p))
    numbers = controller("servo", "lqr").parameters
    assert numbers.reference == SERVO_STEP
    servo = SERVO_ERROR.along(time, x, numbers)
    np.testing.assert_array_equal(servo, np.stack([1 - x[:, 0], -x[:, 1]], axis=1))
