"""Every law of every system at a point: eqs. (5), (8), (12), (23), (31), (36), (37), (44), (55)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from shipped import REGULATION, error_of, nominal_controller, of_design, reference_of

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.memory import SurfaceMemory
from grosmc_mj.theory.control.references import (
    TIME,
    FourierSeries,
    Setpoint,
    fourier_series,
    reference,
    setpoint,
)
from grosmc_mj.theory.control.surface import surface_rates
from grosmc_mj.theory.control.switching import SWITCHINGS, find_switching
from grosmc_mj.theory.control.task import NoNumbers, Realization
from grosmc_mj.theory.plants import AnalyticPlant

PERIOD = 1e-3
# Of the laws at a point, where the arm's reference moves.
INSTANT = 0.7
# The optimal law that each GROSMC makes robust, and what else is designed for it.
OPTIMAL = {"servo": "lqr", "cart_pendulum": "fl-lqr", "arm": "lqr", REGULATION: "lqr"}
RIVALS = ("lqi", "fl-pid", "adrc", "adaptive")
each_design = pytest.mark.parametrize("design", OPTIMAL)

# Two ways to one acceleration differ by the rounding of its terms, which reach 1e3 at the states
# below: 1e3 times a few units in the last place.
ROUNDING = 1e-12


@cache
def nominal(design: str) -> AnalyticPlant:
    return MujocoPlant.load(design.split()[0]).analytic()


@cache
def controller(design: str, law: str) -> Controller:
    return nominal_controller(design, law).sampled(PERIOD)


def state(design: str) -> Array:
    """A state off the equilibrium, where every law is defined: |angle| < 1.4, [rad/s, m/s]."""
    n = nominal(design).system.degrees_of_freedom
    return np.r_[[0.7, -1.2][:n], [-2.5, 3.5][:n]]


def error_rate(ctl: Controller, design: str, t: float, x: Array, u: Array) -> Array:
    """z' from the plant's own equations; all outputs are states."""
    error: Any = ctl.coordinates
    y_r = np.reshape(error.reference(t, ctl.parameters.reference), (-1, 3))
    reference_rates = y_r[:, 1:].ravel()
    rates = nominal(design).derivative(x, u)[error.linearization.plain]
    return error.sign * (rates - reference_rates)


def memory_at(ctl: Controller, t: float, x: Array, s: Any = 0.0) -> Any:
    """Memory of a run that is off its surface by s when it reaches x at t > 0."""
    memory = ctl.memory()
    if isinstance(memory, SurfaceMemory):
        z = ctl.coordinates.error_state(t, x, ctl.parameters)
        offset = np.broadcast_to(s, memory.s.shape)
        memory.z0[:] = z - np.linalg.pinv(ctl.parameters.G) @ offset
        memory.t = t
        memory.begun = 1.0
    return memory


def surface_rate(ctl: Controller, design: str, t: float, x: Array, u: Array) -> tuple[Array, float]:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52), and its rounding."""
    p = ctl.parameters
    z = ctl.coordinates.error_state(t, x, p)
    rate = p.G @ error_rate(ctl, design, t, x, u) - p.S @ z

    derivative = np.abs(nominal(design).derivative(x, u))
    terms = derivative.max() * np.abs(p.G).max()
    return rate, ROUNDING * max(1.0, terms)


def free_sliding(plant: Any, ctl: Controller, design: str, T: float) -> float:
    """Largest |s| of a nominal run when nothing switches: the surface's own error."""
    no_gains = dict.fromkeys(("eta", "gamma0", "gamma1", "k", "epsilon"), 0.0)
    smooth = replace(ctl, parameters=replace(ctl.parameters, **no_gains))
    run = simulate(
        plant,
        smooth,
        of_design(design).x0,
        duration=1.0,
        control_period=T,
        timestep=T,
        engine="python",
    )
    assert run.sliding is not None
    return float(np.abs(run.sliding).max())


@each_design
def test_surface_stays_at_zero_without_switching_on_the_nominal_plant_as_O_of_T(
    design: str,
) -> None:
    """In continuous time s = 0 is invariant there; hold and Riemann sum leave O(T)."""
    ctl = controller(design, "grosmc")
    coarse = free_sliding(nominal(design), ctl, design, 4e-3)
    fine = free_sliding(nominal(design), ctl, design, 2e-3)
    # The next order changes the ratio by T times the plant's rates, some 10/s.
    assert coarse / fine == pytest.approx(2, rel=0.05)


@pytest.mark.parametrize("engine", ["equations", "MuJoCo"])
def test_discrete_time_surface_is_exact_on_a_linear_plant(engine: str) -> None:
    T = 4e-3
    plant = nominal("servo") if engine == "equations" else MujocoPlant.load("servo", timestep=T)
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=T))
    # A sum of some thousand terms of |S z| T <= 1e-3, each to 1e-16.
    assert free_sliding(plant, law, "servo", T) < 1e-13


def test_a_discrete_surface_pays_back_no_input_that_its_limit_cut() -> None:
    """s' = G (x' - A x - B u_0) with the applied u_0: what RK4 leaves is (B T/J)^5, some 1e-12."""
    T = 0.05
    law = nominal_controller("servo", "grosmc", realization=Realization(control_period=T))
    limited = replace(law, parameters=replace(law.parameters, limit=0.2))
    assert free_sliding(nominal("servo"), limited, "servo", T) < 1e-11


def test_a_discrete_surface_of_a_short_period_is_the_printed_one() -> None:
    """S and G B differ by the period times the plant's rates."""
    law = controller("servo", "grosmc")
    optimum = law.designed.lqr
    G = law.parameters.G
    printed = surface_rates(G, optimum, None)
    short = surface_rates(G, optimum, 1e-6)
    for held, exact in zip(short, printed, strict=True):
        np.testing.assert_allclose(held, exact, rtol=1e-4, atol=1e-4)


def test_only_the_arm_has_given_gains() -> None:
    """eta, gamma0 and gamma1 of the other designs come from a declared uncertainty."""
    given = {design for design in OPTIMAL if controller(design, "grosmc").parameters.epsilon > 0}
    assert given == {"arm"}


@each_design
def test_law_is_the_equivalent_control_on_its_surface(design: str) -> None:
    """On s = 0 the law is the optimal one, u_c of (12), u_con of (37) and v_c of (55): s' = 0.

    That is where every run starts: there is no reaching phase.
    """
    ctl = controller(design, "grosmc")
    optimal = controller(design, OPTIMAL[design])
    x = state(design)
    memory: Any = ctl.memory()
    u = ctl.input_at(INSTANT, x, memory)
    assert not memory.s.any()
    np.testing.assert_array_equal(u, optimal.input_at(INSTANT, x, optimal.memory()))

    rate, rounding = surface_rate(ctl, design, INSTANT, x, u)
    np.testing.assert_allclose(rate, 0, rtol=0, atol=rounding)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@each_design
def test_law_drives_s_to_zero_at_the_rate_of_its_proof(design: str, side: float) -> None:
    """s' = -(eta + (g0 + g1 |z|) |ds/dx g|) sgn s on the nominal plant, by proofs 1 and 2.

    By proof 3 it is -(k s + epsilon sgn s).
    """
    ctl = controller(design, "grosmc")
    p = ctl.parameters
    x = state(design)
    # With two inputs on opposite sides.
    sides = side * np.array([1.0, -1.0][: len(p.G)])
    memory = memory_at(ctl, INSTANT, x, 0.4 * sides)
    u = ctl.input_at(INSTANT, x, memory)
    # s is a difference of numbers of the size of z.
    assert memory.s == pytest.approx(0.4 * sides, abs=1e-14)

    z = ctl.coordinates.error_state(INSTANT, x, p)
    _, E = ctl.coordinates.dynamics(INSTANT, x, p)
    input_gain = np.linalg.norm(p.GB if design == "servo" else p.GB @ E)
    rho = p.eta + p.epsilon + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * input_gain
    rate, rounding = surface_rate(ctl, design, INSTANT, x, u)
    np.testing.assert_allclose(rate, -(p.k * memory.s + rho * sides), rtol=0, atol=rounding)


LINEARIZING = [
    (design, law)
    for design in ("cart_pendulum", "arm", REGULATION)
    for law in (OPTIMAL[design], "grosmc", *RIVALS)
    # The cart-pendulum has no torques that are linear in its parameters.
    if (design, law) != ("cart_pendulum", "adaptive")
]


@pytest.mark.parametrize(("design", "law"), LINEARIZING)
def test_feedback_linearization_leaves_a_chain_of_integrators(design: str, law: str) -> None:
    """z_i'' = v_i on the nominal plant, eqs. (24), (45) and (58), with the y_r'' of (44)."""
    ctl = controller(design, law)
    rows = list(ctl.coordinates.linearization.last_rows)
    x = state(design)
    memory = memory_at(ctl, INSTANT, x, 0.3)
    u = ctl.input_at(INSTANT, x, memory)
    accelerations = error_rate(ctl, design, INSTANT, x, u)[rows]

    derivative = nominal(design).derivative(x, u)
    terms = max(np.abs(derivative).max(), np.abs(memory.v).max(), 1.0)
    np.testing.assert_allclose(accelerations, memory.v, rtol=0, atol=ROUNDING * terms)


@pytest.mark.parametrize(
    ("system", "law", "angle", "defined"),
    [
        ("cart_pendulum", "fl-lqr", math.pi / 2, False),
        ("cart_pendulum", "grosmc", -1.57, True),
        ("cart_pendulum", "grosmc", -1.6, False),
        ("cart_pendulum", "lqr", 1.6, True),
        ("arm", "grosmc", -1.5 * math.pi, False),
        ("arm", "grosmc", -4.7, True),
    ],
)
def test_law_says_where_it_is_undefined(system: str, law: str, angle: float, defined: bool) -> None:
    """E(x) is singular at |theta| = pi/2: eq. (23) divides by it. The input stays finite."""
    ctl = controller(system, law)
    plant = nominal(system)
    x = np.zeros(len(plant.system.states))
    x[plant.system.output] = angle
    memory = ctl.memory()
    assert np.all(np.isfinite(ctl.input_at(0.0, x, memory)))
    assert memory.undefined == (0.0 if defined else 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "switching"),
    [*((law, None) for law in RIVALS), *(("grosmc", switching) for switching in SWITCHINGS)],
)
@pytest.mark.parametrize("design", ["servo", REGULATION])
def test_both_engines_run_every_law_alike(design: str, law: str, switching: str | None) -> None:
    """Exactly, in a batch too: one libm, one order of operations; memory is a run's own."""
    period = 5 * PERIOD if switching == "implicit" or law == "fl-pid" else PERIOD
    plant: Any = nominal(design) if design == "servo" else MujocoPlant.load(design.split()[0])
    if switching:
        realization = Realization(find_switching(switching), period)
        ctl = nominal_controller(design, law, realization=realization)
    else:
        ctl = nominal_controller(design, law)

    starts = np.outer([1.0, 0.9], of_design(design).x0) + 0.01
    options: dict[str, Any] = {"duration": 0.1, "control_period": period}
    native: Any = simulate([plant] * 2, ctl, starts, engine="native", **options)
    for together, x0 in zip(native, starts, strict=True):
        alone = simulate(plant, ctl, x0, engine="python", **options)
        for field in ("state", "command", "weighed", "memory", "sliding"):
            np.testing.assert_array_equal(getattr(together, field), getattr(alone, field))


# References

RANDOM = np.random.default_rng(5)
SERIES = FourierSeries(
    0.7,
    mean=RANDOM.normal(size=2),
    cosine=RANDOM.normal(size=(2, 4)),
    sine=RANDOM.normal(size=(2, 4)),
)
SERIES_REFERENCE = fourier_series(2, 4)


def series_value(t: float) -> Array:
    phases = SERIES.frequency * t * np.arange(1, 5)
    return SERIES.mean + SERIES.cosine @ np.cos(phases) + SERIES.sine @ np.sin(phases)


REFERENCES: dict[str, tuple[Any, Any, Callable[[float], Any]]] = {
    "setpoint": (setpoint, Setpoint(0.7), lambda _: 0.7),
    "sine": (
        reference([1.3 * sp.sin(sp.pi * TIME)]),
        NoNumbers(),
        lambda t: 1.3 * math.sin(math.pi * t),
    ),
    "arm": (error_of("arm").reference, reference_of("arm"), lambda t: math.sin(math.pi * t)),
    "series": (SERIES_REFERENCE, SERIES, series_value),
}
each_reference = pytest.mark.parametrize("name", REFERENCES)
each_instant = pytest.mark.parametrize("t", [0.0, 0.37, 2.2, 50.0])


@each_instant
@each_reference
def test_reference_is_its_formula(name: str, t: float) -> None:
    y_r, p, value = REFERENCES[name]
    # Rounding of sines at some 150 rad.
    outputs = np.array(y_r(t, p))[::3]
    np.testing.assert_allclose(outputs, value(t), rtol=0, atol=1e-13)


@each_instant
@each_reference
@pytest.mark.parametrize("order", [0, 1])
def test_derivatives_of_a_reference_are_its_own(name: str, t: float, order: int) -> None:
    y_r, p, _ = REFERENCES[name]
    h = 1e-5
    after = np.array(y_r(t + h, p))
    before = np.array(y_r(t - h, p))
    difference = after - before
    slope = difference[order::3] / (2 * h)
    # Central differences: h^2/6 times a third derivative of some 40, and rounding 1e-16/h.
    derivative = np.array(y_r(t, p))[order + 1 :: 3]
    np.testing.assert_allclose(derivative, slope, rtol=0, atol=1e-8)


@pytest.mark.parametrize("field", ["mean", "cosine", "sine"])
def test_a_fourier_series_is_found_from_its_samples(field: str) -> None:
    period = 2 * np.pi / SERIES.frequency
    samples = [SERIES_REFERENCE(period * i / 20, SERIES)[::3] for i in range(20)]
    series = FourierSeries.through(samples, SERIES.frequency, 4)
    np.testing.assert_allclose(getattr(series, field), getattr(SERIES, field), atol=1e-14)
