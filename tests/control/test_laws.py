"""Every law of every system at a point: eqs. (5), (8), (12), (23), (31), (36), (37), (44), (55)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from shipped import (
    ARM_ERROR,
    ARM_REFERENCE,
    PENDULUM_ERROR,
    REGULATION,
    SERVO_ERROR,
    SERVO_STEP,
    nominal_controller,
    of_design,
)

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.control.references import (
    TIME,
    FourierSeries,
    Setpoint,
    fourier_series,
    reference,
    setpoint,
)
from grosmc_mj.control.surface import integral_surface
from grosmc_mj.control.switching import SWITCHINGS, find_switching
from grosmc_mj.control.task import FeedbackParameters, NoNumbers, Realization
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Variant
from grosmc_mj.simulation.disturbances import Constant, Disturbance
from grosmc_mj.simulation.simulate import simulate

PERIOD = 1e-3
# The optimal law that each GROSMC makes robust, and what else is designed for it.
OPTIMAL = {"servo": "lqr", "cart_pendulum": "fl-lqr", "arm": "lqr", REGULATION: "lqr"}
RIVALS = ("lqi", "pid", "adrc", "adaptive")
LAWS = [
    (design, law)
    for design, optimal in OPTIMAL.items()
    for law in (optimal, "grosmc", *RIVALS)
    if (design, law) != ("cart_pendulum", "adaptive")
]
each_design = pytest.mark.parametrize("design", OPTIMAL)
# Laws that work through the feedback linearization (23) or (44).
linearizing = pytest.mark.parametrize(("design", "law"), [row for row in LAWS if row[0] != "servo"])

# Two ways to one acceleration differ by the rounding of its terms, which reach 1e3 at the states
# below: 1e3 times a few units in the last place.
ROUNDING = 1e-12


@cache
def physics(design: str) -> MujocoPlant:
    return MujocoPlant.load(design.split()[0])


@cache
def nominal(design: str, variant: Variant = "corrected") -> AnalyticPlant:
    return physics(design).analytic(variant)


@cache
def controller(design: str, law: str) -> Controller:
    return nominal_controller(design, law).sampled(PERIOD)


def states(design: str, count: int) -> Array:
    """Random states where every law is defined: |angle| < 1.4, rates of 3 [rad/s, m/s]."""
    n, rng = nominal(design).system.degrees_of_freedom, np.random.default_rng(0)
    return np.hstack([rng.uniform(-1.4, 1.4, (count, n)), rng.normal(0, 3, (count, n))])


def error_rate(ctl: Controller, plant: AnalyticPlant, t: float, x: Array, u: Array) -> Array:
    """z' on a plant, from the plant's own equations; all outputs are states."""
    error: Any = ctl.coordinates
    y_r = np.reshape(error.reference(t, ctl.parameters.reference), (-1, 3))[:, 1:]
    return error.sign * (plant.derivative(x, u)[error.linearization.plain] - y_r.ravel())


def memory_at(ctl: Controller, t: float, x: Array, s: Any = 0.0) -> Any:
    """Memory of a run that is off its surface by s when it reaches x at t > 0."""
    memory, z = ctl.memory(), ctl.coordinates.error_state(t, x, ctl.parameters)
    if isinstance(memory, SurfaceMemory):
        offset = np.broadcast_to(s, memory.s.shape)
        memory.z0[:], memory.t = z - np.linalg.pinv(ctl.parameters.G) @ offset, t
    return memory


def surface_rate(ctl: Controller, design: str, t: float, x: Array, u: Array) -> tuple[Array, float]:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52), and what may be rounded of it."""
    p, plant = ctl.parameters, nominal(design)
    z = ctl.coordinates.error_state(t, x, p)
    terms = np.abs(plant.derivative(x, u)).max() * np.abs(p.G).max()
    return p.G @ error_rate(ctl, plant, t, x, u) - p.S @ z, ROUNDING * max(1.0, terms)


# The surface


@each_design
@given(data=st.data())
@settings(max_examples=25)
def test_surface_is_exactly_zero_at_any_start(design: str, data: st.DataObject) -> None:
    """s(0) = 0: there is no reaching phase, wherever and whenever the run starts."""
    ctl, n = controller(design, "grosmc"), len(nominal(design).system.states)
    x = np.array(data.draw(st.lists(st.floats(-1e6, 1e6), min_size=n, max_size=n)))
    memory: Any = ctl.memory()
    memory.first = data.draw(st.sampled_from([0.0, 0.7]))
    ctl.input_at(memory.first, x, memory)
    assert not memory.s.any()


@dataclass(frozen=True)
class Surface:
    G: Array
    S: Array


def test_surface_is_the_exact_integral_up_to_half_a_sample() -> None:
    """A left Riemann sum is short of the integral by T/2 [f(t) - f(0)] + O(T^2).

    With z = [sin t, cos 2t] every term of eq. (31) is known.
    """
    p, end, remainders = Surface(np.array([[0.7, -1.3]]), np.array([[2.0, 0.5]])), 2.0, []

    def z(t: float) -> Array:
        return np.array([math.sin(t), math.cos(2 * t)])

    integral = np.array([1 - math.cos(end), math.sin(2 * end) / 2])
    exact = (p.G @ (z(end) - z(0)) - p.S @ integral).item()
    for N in (50, 100, 200):
        memory, T = SurfaceMemory(), end / N
        for k in range(N + 1):
            integral_surface(k * T, z(k * T), memory, p)
        half_a_sample = T / 2 * (p.S @ (z(end) - z(0))).item()
        remainders.append(abs(memory.s.item() - exact - half_a_sample))
        assert remainders[-1] < 0.1 * abs(half_a_sample)
    # O(T^2) with a next term in T^4: a quarter up to T^2 = 1.6e-3 times a number of order one.
    np.testing.assert_allclose(np.divide(remainders[:-1], remainders[1:]), 4, rtol=0.01)


def free_sliding(plant: Any, ctl: Controller, design: str, period: float) -> float:
    """Largest |s| of a nominal run when nothing switches: the surface's own error."""
    free = {"eta": 0.0, "gamma0": 0.0, "gamma1": 0.0, "k": 0.0, "epsilon": 0.0}
    smooth, x0 = replace(ctl, parameters=replace(ctl.parameters, **free)), of_design(design).case.x0
    run = simulate(
        plant, smooth, x0, duration=2.0, control_period=period, timestep=period, engine="python"
    )
    assert run.sliding is not None
    return float(np.abs(run.sliding).max())


@each_design
def test_surface_stays_at_zero_without_switching_on_the_nominal_plant_as_O_of_T(
    design: str,
) -> None:
    """In continuous time s = 0 is invariant there; hold and Riemann sum leave O(T)."""
    ctl = controller(design, "grosmc")
    largest = [free_sliding(nominal(design), ctl, design, T) for T in (4e-3, 2e-3)]
    # The next order changes the ratio by T times the plant's rates, some 10/s.
    assert largest[0] / largest[1] == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("T", [4e-3, 2e-3])
def test_discrete_surface_is_zero_at_every_sample_of_the_nominal_linear_plant(T: float) -> None:
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=T))
    for plant in (nominal("servo"), MujocoPlant.load("servo", timestep=T)):
        # A sum of some thousand terms of |S z| T <= 1e-3, each to 1e-16.
        assert free_sliding(plant, law, "servo", T) < 1e-13


# The continuous and the switching part


@each_design
@pytest.mark.parametrize("t", [0.0, 0.7])
def test_continuous_part_is_the_equivalent_control_36(design: str, t: float) -> None:
    """On s = 0 the law is the optimal one, u_c of (12), u_con of (37) and v_c of (55): s' = 0."""
    ctl, optimal = controller(design, "grosmc"), controller(design, OPTIMAL[design])
    for x in states(design, 25):
        memory: Any = ctl.memory()
        memory.first = t
        u = ctl.input_at(t, x, memory)
        np.testing.assert_array_equal(u, optimal.input_at(t, x, optimal.memory()))
        rate, rounding = surface_rate(ctl, design, t, x, u)
        np.testing.assert_allclose(rate, 0, rtol=0, atol=rounding)


@each_design
@pytest.mark.parametrize("size", [0.4, 1e-9])
def test_switching_part_drives_s_at_the_rate_of_the_proofs(design: str, size: float) -> None:
    """Proofs 1 and 2 on the nominal plant: s' = -(eta + (g0 + g1 |z|) |ds/dx g|) sgn s.

    Proof 3: s' = -(k s + epsilon sgn s).
    """
    ctl, t, random = controller(design, "grosmc"), 0.7, np.random.default_rng(1)
    p, error = ctl.parameters, ctl.coordinates
    assert (p.epsilon > 0) is (design == "arm")
    for x in states(design, 30):
        sides = random.choice([-1.0, 1.0], len(p.G))
        memory = memory_at(ctl, t, x, size * sides)
        u = ctl.input_at(t, x, memory)
        # s is a difference of numbers of the size of z.
        assert memory.s == pytest.approx(size * sides, abs=1e-14)
        z, E = error.error_state(t, x, p), error.dynamics(t, x, p)[1]
        gain = np.linalg.norm(p.GB if design == "servo" else p.GB @ E)
        rho = p.eta + p.epsilon + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * gain
        rate, rounding = surface_rate(ctl, design, t, x, u)
        expected = -(p.k * memory.s + rho * sides)
        np.testing.assert_allclose(rate, expected, rtol=0, atol=rounding)


# Feedback linearization


@linearizing
def test_feedback_linearization_leaves_a_chain_of_integrators(design: str, law: str) -> None:
    """z_i'' = v_i on the nominal plant, eqs. (24), (45) and (58), with the y_r'' of (44).

    On the printed equations it isn't so: the printed a = m/(M+m) and C = 0.03 cos q are other
    plants than the corrected ones.
    """
    ctl, misses = controller(design, law), []
    rows = list(ctl.coordinates.linearization.last_rows)
    for t, x in zip(np.linspace(0.1, 2, 40).tolist(), states(design, 40), strict=True):
        memory = memory_at(ctl, t, x, 0.3)
        u = ctl.input_at(t, x, memory)
        terms = max(np.abs(nominal(design).derivative(x, u)).max(), np.abs(memory.v).max(), 1.0)
        chain = error_rate(ctl, nominal(design), t, x, u)[rows]
        np.testing.assert_allclose(chain, memory.v, rtol=0, atol=ROUNDING * terms)
        if "printed" in nominal(design).system.variants:
            printed = error_rate(ctl, nominal(design, "printed"), t, x, u)[rows]
            misses.append(np.abs(printed - memory.v).max())
    # The arm's error is 0.03 cos q |q'| |1 - q'| / M: of order 1 at rates of 3 rad/s.
    assert np.median(misses or 1.0) > 0.1


HALF = math.pi / 2


@pytest.mark.parametrize(
    ("system", "law", "angle", "defined"),
    [
        ("cart_pendulum", "fl-lqr", 1.57, True),
        ("cart_pendulum", "fl-lqr", HALF, False),
        ("cart_pendulum", "grosmc", -1.57, True),
        ("cart_pendulum", "grosmc", -1.6, False),
        ("cart_pendulum", "grosmc", math.pi, False),
        ("cart_pendulum", "lqr", 1.6, True),
        ("arm", "lqr", HALF, False),
        ("arm", "grosmc", -3 * HALF, False),
        ("arm", "grosmc", -4.7, True),
        ("servo", "grosmc", 100.0, True),
    ],
)
def test_law_says_where_it_is_undefined_and_stays_finite(
    system: str, law: str, angle: float, *, defined: bool
) -> None:
    """E(x) is singular at |theta| = pi/2: eq. (23) divides by it."""
    ctl, plant = controller(system, law), nominal(system)
    x, memory = np.zeros(len(plant.system.states)), ctl.memory()
    x[plant.system.output] = angle
    assert np.all(np.isfinite(ctl.input_at(0.0, x, memory)))
    assert memory.undefined == (0.0 if defined else 1.0)


@pytest.mark.parametrize(("design", "law"), LAWS)
def test_law_leaves_its_numbers_alone_and_keeps_no_memory_of_its_own(design: str, law: str) -> None:
    ctl, x = controller(design, law), states(design, 4)
    numbers = [field.name for field in fields(ctl.parameters)]
    before = {name: np.copy(getattr(ctl.parameters, name)) for name in numbers}

    def run() -> list[list[float]]:
        memory = ctl.memory()
        return [ctl.input_at(PERIOD * k, x[k], memory).tolist() for k in range(4)]

    assert run() == run()
    for name, value in before.items():
        np.testing.assert_equal(np.asarray(getattr(ctl.parameters, name)), value)


# Wrenches about the joints, which are along -y.
LOADS = {
    "servo": Disturbance("rotor", (0, 0, 0, 0, 0.3, 0), Constant()),
    "arm": Disturbance("hub", (0, 0, 0, 0, 0.1, 0), Constant()),
    REGULATION: Disturbance("payload", (0, 0, 0, 0, 0.5, 0), Constant()),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "law"),
    [(design, law) for design in LOADS for law in RIVALS]
    + [(design, law) for design in ("servo", REGULATION) for law in SWITCHINGS],
)
def test_both_engines_and_a_batch_run_every_law_alike(design: str, law: str) -> None:
    """Exactly: the engines use one libm in one order of operations, and memory is a run's own."""
    period = 5 * PERIOD if law in ("pid", "implicit") else PERIOD
    if law in RIVALS:
        ctl, plant = nominal_controller(design, law), physics(design)
    else:
        realization = Realization(find_switching(law), period)
        ctl = nominal_controller(design, "grosmc", realization=realization)
        plant = nominal(design) if design == "servo" else physics(design)
    x0, loads = of_design(design).case.x0, [[LOADS[design]], []]
    options: dict[str, Any] = {"duration": 0.1, "control_period": period}
    many = simulate([plant] * 2, ctl, x0, disturbances=loads, engine="native", **options)
    for index, load in enumerate(loads):
        alone = simulate(plant, ctl, x0, disturbances=load, engine="python", **options)
        for field in ("state", "command", "weighed", "memory", "sliding"):
            np.testing.assert_array_equal(getattr(many[index], field), getattr(alone, field))
    assert not np.array_equal(many[0].state, many[1].state)


# Error coordinates and references

RANDOM = np.random.default_rng(5)
SERIES = FourierSeries(0.7, RANDOM.normal(size=2), *RANDOM.normal(size=(2, 2, 4)))
SERIES_REFERENCE = fourier_series(2, 4)


@pytest.mark.parametrize(
    ("y_r", "p", "value"),
    [
        (setpoint, Setpoint(0.7), lambda _: 0.7),
        (
            reference([1.3 * sp.sin(sp.pi * TIME)]),
            NoNumbers(),
            lambda t: 1.3 * math.sin(math.pi * t),
        ),
        (ARM_ERROR.reference, ARM_REFERENCE, lambda t: math.sin(math.pi * t)),
        (
            SERIES_REFERENCE,
            SERIES,
            lambda t: (
                SERIES.mean
                + SERIES.cosine @ np.cos(0.7 * t * np.arange(1, 5))
                + SERIES.sine @ np.sin(0.7 * t * np.arange(1, 5))
            ),
        ),
    ],
)
@pytest.mark.parametrize("t", [0.0, 0.37, 2.2, 50.0])
def test_reference_is_its_formula_with_its_own_derivatives(
    y_r: Any, p: Any, value: Any, t: float
) -> None:
    h = 1e-5
    before, now, after = (np.array(y_r(t + d, p)) for d in (-h, 0.0, h))
    # Rounding of sines at some 150 rad.
    np.testing.assert_allclose(now[::3], value(t), rtol=0, atol=1e-13)
    # Central differences: h^2/6 times a third derivative of some 40, and rounding 1e-16/h.
    for order in (0, 1):
        slope = (after - before)[order::3] / (2 * h)
        np.testing.assert_allclose(now[order + 1 :: 3], slope, rtol=0, atol=1e-8)


def test_samples_of_a_series_give_it_back() -> None:
    period = 2 * np.pi / 0.7
    samples = [SERIES_REFERENCE(period * i / 20, SERIES)[::3] for i in range(20)]
    series = FourierSeries.through(samples, 0.7, 4)
    for name in ("mean", "cosine", "sine"):
        np.testing.assert_allclose(getattr(series, name), getattr(SERIES, name), atol=1e-14)


def pendulum_inertia(p: Any) -> float:
    return p.L * (4 / 3 - p.m / (p.M + p.m))


@pytest.mark.parametrize(
    ("system", "error", "reference", "last_row_of_A", "B"),
    [
        ("servo", SERVO_ERROR, SERVO_STEP, lambda p: (0, -p.B / p.J), lambda p: -p.Kt / p.J),
        # Upright: theta'' = (g theta + u/(M+m)) / (L (4/3 - m/(M+m))).
        (
            "cart_pendulum",
            PENDULUM_ERROR,
            Setpoint(0.0),
            lambda p: (p.g / pendulum_inertia(p), 0),
            lambda p: 1 / (p.M + p.m) / pendulum_inertia(p),
        ),
    ],
)
def test_jacobian_is_the_linear_model_by_hand(
    system: str, error: Any, reference: Any, last_row_of_A: Any, B: Any
) -> None:
    """Eq. (18) of the servo, and the linearized Lagrangian of the pendulum."""
    plant, p = nominal(system), nominal(system).parameters
    model = error.linear_model(plant, FeedbackParameters(p, reference, np.zeros((1, 2))))
    np.testing.assert_allclose(model[0], [[0, 1], last_row_of_A(p)], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(model[1], [[0], [B(p)]], rtol=1e-9)


def test_errors_along_a_trajectory_are_those_that_the_law_sees() -> None:
    time, x = np.linspace(0, 1, 11), states("arm", 11)
    p, servo = controller("arm", "lqr").parameters, controller("servo", "lqr").parameters
    for row, t, state in zip(ARM_ERROR.along(time, x, p), time.tolist(), x, strict=True):
        np.testing.assert_array_equal(row, ARM_ERROR.error_state(t, state, p))
    by_hand = np.stack([1 - x[:, 0], -x[:, 1]], axis=1)
    np.testing.assert_array_equal(SERVO_ERROR.along(time, x, servo), by_hand)
