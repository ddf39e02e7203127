"""Every law of every system at a point: eqs. (5), (8), (12), (23), (31), (36), (37), (44), (55)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from shipped import (
    ARM_ERROR,
    ARM_REFERENCE,
    REGULATION,
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
from grosmc_mj.control.switching import SWITCHINGS, find_switching
from grosmc_mj.control.task import NoNumbers, Realization
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.simulate import simulate

PERIOD = 1e-3
# The optimal law that each GROSMC makes robust, and what else is designed for it.
OPTIMAL = {"servo": "lqr", "cart_pendulum": "fl-lqr", "arm": "lqr", REGULATION: "lqr"}
RIVALS = ("lqi", "pid", "adrc", "adaptive")
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


def states(design: str, count: int) -> Array:
    """Random states where every law is defined: |angle| < 1.4, rates of 3 [rad/s, m/s]."""
    n, rng = nominal(design).system.degrees_of_freedom, np.random.default_rng(0)
    return np.hstack([rng.uniform(-1.4, 1.4, (count, n)), rng.normal(0, 3, (count, n))])


def error_rate(ctl: Controller, design: str, t: float, x: Array, u: Array) -> Array:
    """z' from the plant's own equations; all outputs are states."""
    error: Any = ctl.coordinates
    y_r = np.reshape(error.reference(t, ctl.parameters.reference), (-1, 3))[:, 1:]
    rates = nominal(design).derivative(x, u)[error.linearization.plain]
    return error.sign * (rates - y_r.ravel())


def memory_at(ctl: Controller, t: float, x: Array, s: Any = 0.0) -> Any:
    """Memory of a run that is off its surface by s when it reaches x at t > 0."""
    memory, z = ctl.memory(), ctl.coordinates.error_state(t, x, ctl.parameters)
    if isinstance(memory, SurfaceMemory):
        offset = np.broadcast_to(s, memory.s.shape)
        memory.z0[:], memory.t = z - np.linalg.pinv(ctl.parameters.G) @ offset, t
    return memory


def surface_rate(ctl: Controller, design: str, t: float, x: Array, u: Array) -> tuple[Array, float]:
    """s' = G z' - G (A - B K) z of eqs. (9), (32) and (52), and what may be rounded of it."""
    p = ctl.parameters
    z = ctl.coordinates.error_state(t, x, p)
    terms = np.abs(nominal(design).derivative(x, u)).max() * np.abs(p.G).max()
    return p.G @ error_rate(ctl, design, t, x, u) - p.S @ z, ROUNDING * max(1.0, terms)


def free_sliding(plant: Any, ctl: Controller, design: str, T: float) -> float:
    """Largest |s| of a nominal run when nothing switches: the surface's own error."""
    free = dict.fromkeys(("eta", "gamma0", "gamma1", "k", "epsilon"), 0.0)
    smooth, x0 = replace(ctl, parameters=replace(ctl.parameters, **free)), of_design(design).case.x0
    options: dict[str, Any] = {"control_period": T, "timestep": T, "engine": "python"}
    return np.abs(simulate(plant, smooth, x0, duration=2.0, **options).sliding).max()  # pyright: ignore


@each_design
def test_surface_stays_at_zero_without_switching_on_the_nominal_plant_as_O_of_T(
    design: str,
) -> None:
    """In continuous time s = 0 is invariant there; hold and Riemann sum leave O(T)."""
    ctl = controller(design, "grosmc")
    largest = [free_sliding(nominal(design), ctl, design, T) for T in (4e-3, 2e-3)]
    # The next order changes the ratio by T times the plant's rates, some 10/s.
    assert largest[0] / largest[1] == pytest.approx(2, rel=0.05)
    if design == "servo":  # the surface in discrete time is exact on a linear plant
        law = nominal_controller(design, "grosmc", realization=Realization(control_period=4e-3))
        for plant in (nominal(design), MujocoPlant.load(design, timestep=4e-3)):
            # A sum of some thousand terms of |S z| T <= 1e-3, each to 1e-16.
            assert free_sliding(plant, law, design, 4e-3) < 1e-13


@each_design
def test_law_is_the_equivalent_control_on_its_surface_and_drives_s_to_it(design: str) -> None:
    """On s = 0 the law is the optimal one, u_c of (12), u_con of (37) and v_c of (55): s' = 0.

    That is where every run starts: there is no reaching phase. Off it s' is, by proofs 1 and 2 on
    the nominal plant, -(eta + (g0 + g1 |z|) |ds/dx g|) sgn s and, by proof 3, -(k s + epsilon
    sgn s).
    """
    ctl, optimal = controller(design, "grosmc"), controller(design, OPTIMAL[design])
    p, error, t, random = ctl.parameters, ctl.coordinates, 0.7, np.random.default_rng(1)
    assert (p.epsilon > 0) is (design == "arm")
    for x in states(design, 30):
        memory: Any = ctl.memory()
        memory.first = t
        u = ctl.input_at(t, x, memory)
        assert not memory.s.any()
        np.testing.assert_array_equal(u, optimal.input_at(t, x, optimal.memory()))
        rate, rounding = surface_rate(ctl, design, t, x, u)
        np.testing.assert_allclose(rate, 0, rtol=0, atol=rounding)

        sides = random.choice([-1.0, 1.0], len(p.G))
        memory = memory_at(ctl, t, x, 0.4 * sides)
        u = ctl.input_at(t, x, memory)
        # s is a difference of numbers of the size of z.
        assert memory.s == pytest.approx(0.4 * sides, abs=1e-14)
        z, E = error.error_state(t, x, p), error.dynamics(t, x, p)[1]
        gain = np.linalg.norm(p.GB if design == "servo" else p.GB @ E)
        rho = p.eta + p.epsilon + (p.gamma0 + p.gamma1 * np.linalg.norm(z)) * gain
        rate, rounding = surface_rate(ctl, design, t, x, u)
        np.testing.assert_allclose(rate, -(p.k * memory.s + rho * sides), rtol=0, atol=rounding)


@pytest.mark.parametrize("design", list(OPTIMAL)[1:])
def test_feedback_linearization_leaves_a_chain_of_integrators(design: str) -> None:
    """z_i'' = v_i on the nominal plant, eqs. (24), (45) and (58), with the y_r'' of (44)."""
    for law in (OPTIMAL[design], "grosmc", *RIVALS[: -1 if design == "cart_pendulum" else None]):
        ctl = controller(design, law)
        rows = list(ctl.coordinates.linearization.last_rows)
        for t, x in zip(np.linspace(0.1, 2, 40).tolist(), states(design, 40), strict=True):
            memory = memory_at(ctl, t, x, 0.3)
            u = ctl.input_at(t, x, memory)
            terms = max(np.abs(nominal(design).derivative(x, u)).max(), np.abs(memory.v).max(), 1.0)
            chain = error_rate(ctl, design, t, x, u)[rows]
            np.testing.assert_allclose(chain, memory.v, rtol=0, atol=ROUNDING * terms)


def test_law_says_where_it_is_undefined_and_stays_finite() -> None:
    """E(x) is singular at |theta| = pi/2: eq. (23) divides by it."""
    for system, law, angle, defined in (
        ("cart_pendulum", "fl-lqr", math.pi / 2, False),
        ("cart_pendulum", "grosmc", -1.57, True),
        ("cart_pendulum", "grosmc", -1.6, False),
        ("cart_pendulum", "lqr", 1.6, True),
        ("arm", "grosmc", -1.5 * math.pi, False),
        ("arm", "grosmc", -4.7, True),
    ):
        ctl, plant = controller(system, law), nominal(system)
        x, memory = np.zeros(len(plant.system.states)), ctl.memory()
        x[plant.system.output] = angle
        assert np.all(np.isfinite(ctl.input_at(0.0, x, memory)))
        assert memory.undefined == (0.0 if defined else 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "law"),
    [(design, law) for design in ("servo", "arm", REGULATION) for law in RIVALS]
    + [(design, law) for design in ("servo", REGULATION) for law in SWITCHINGS],
)
def test_both_engines_and_a_batch_run_every_law_alike(design: str, law: str) -> None:
    """Exactly: the engines use one libm in one order of operations, and memory is a run's own."""
    period = 5 * PERIOD if law in ("pid", "implicit") else PERIOD
    plant: Any = nominal(design) if design == "servo" else MujocoPlant.load(design.split()[0])
    if law in SWITCHINGS:
        realization = Realization(find_switching(law), period)
        ctl = nominal_controller(design, "grosmc", realization=realization)
    else:
        ctl = nominal_controller(design, law)
    starts = np.outer([1.0, 0.9], of_design(design).case.x0) + 0.01
    options: dict[str, Any] = {"duration": 0.1, "control_period": period}
    many = simulate([plant] * 2, ctl, starts, engine="native", **options)
    for index, x0 in enumerate(starts):
        alone = simulate(plant, ctl, x0, engine="python", **options)
        for field in ("state", "command", "weighed", "memory", "sliding"):
            np.testing.assert_array_equal(getattr(many[index], field), getattr(alone, field))


# Error coordinates and references


def test_reference_is_its_formula_with_its_own_derivatives() -> None:
    random, sine, h = np.random.default_rng(5), reference([1.3 * sp.sin(sp.pi * TIME)]), 1e-5
    series = FourierSeries(0.7, random.normal(size=2), *random.normal(size=(2, 2, 4)))
    y_series, n = fourier_series(2, 4), np.arange(1, 5)
    references: list[tuple[Any, Any, Any]] = [
        (setpoint, Setpoint(0.7), lambda _: 0.7),
        (sine, NoNumbers(), lambda t: 1.3 * math.sin(math.pi * t)),
        (ARM_ERROR.reference, ARM_REFERENCE, lambda t: math.sin(math.pi * t)),
        (y_series, series, lambda t: series.mean + series.cosine @ np.cos(0.7 * t * n)
         + series.sine @ np.sin(0.7 * t * n)),
    ]  # fmt: skip
    for y_r, p, value in references:
        for t in (0.0, 0.37, 2.2, 50.0):
            before, now, after = (np.array(y_r(t + d, p)) for d in (-h, 0.0, h))
            # Rounding of sines at some 150 rad.
            np.testing.assert_allclose(now[::3], value(t), rtol=0, atol=1e-13)
            # Central differences: h^2/6 times a third derivative of some 40, and rounding 1e-16/h.
            for order in (0, 1):
                slope = (after - before)[order::3] / (2 * h)
                np.testing.assert_allclose(now[order + 1 :: 3], slope, rtol=0, atol=1e-8)
    samples = [y_series(2 * np.pi / 0.7 * i / 20, series)[::3] for i in range(20)]
    same = FourierSeries.through(samples, 0.7, 4)
    for name in ("mean", "cosine", "sine"):
        np.testing.assert_allclose(getattr(same, name), getattr(series, name), atol=1e-14)
