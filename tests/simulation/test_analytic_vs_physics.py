"""The equations against MuJoCo: accelerations at a point, and convergence of trajectories."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SYSTEMS, AnalyticPlant
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.sweep.agreement import (
    AGREEMENT_BOUND,
    Agreement,
    acceleration_difference,
    disagreements,
)

OpenLoop = Callable[[float | tuple[float, float]], Controller]

# Accelerations at random states

# Two ways to one number differ by rounding of the terms that they add up: some hundred units in
# the last place where the terms are of one size. Measured, with edits: 7e-16 (servo), 2e-14
# (pendulum) and 5e-14 (arm, whose cable loses digits near pi/2).
AGREEMENT = 1e-10


def random_state(name: str, rng: np.random.Generator) -> Array:
    """Any angle and rates of 5 [m/s, rad/s]; for the arm angles below the singular one."""
    n = SYSTEMS[name].degrees_of_freedom
    bound = 1.5 if name == "arm" else math.pi
    return np.concatenate([rng.uniform(-bound, bound, n), rng.normal(0, 5, n)])


def disagreement(plant: MujocoPlant, states: int, seed: int) -> Array:
    """Largest difference of an acceleration in each sample, over its largest term, (states,).

    The terms are the accelerations in f(x), g(x) u and d(x, w), the largest of all coordinates
    and of the three; every moving body has a wrench with six components.
    """
    model, twin, system = plant.model, plant.analytic(), plant.system
    data, p, n = mujoco.MjData(model), twin.parameters, system.degrees_of_freedom
    rng, ratios = np.random.default_rng(seed), np.empty(states)
    for i in range(states):
        x, u = random_state(system.name, rng), rng.normal(0, 5, len(system.inputs))
        w = rng.normal(0, 5, (model.nbody - 1, 6))
        data.qpos[:], data.qvel[:], data.ctrl[:], data.xfrc_applied[1:] = x[:n], x[n:], u, w
        mujoco.mj_forward(model, data)
        terms = [
            system.equations.drift(x, p),
            np.reshape(system.equations.input_matrix(x, p), (2 * n, -1)) @ u,
            system.equations.disturbance(x, w.ravel(), p),
        ]
        difference = twin.derivative(x, u, w.ravel())[n:] - data.qacc
        ratios[i] = np.max(np.abs(difference)) / np.max(np.abs(np.array(terms)[:, n:]))
    return ratios


def random_edits(name: str, rng: np.random.Generator) -> tuple[BodyEdit, ...]:
    """Mass 0.25 to 4 and length 0.5 to 4 times the nominal, as likely smaller as larger."""

    def scale(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    body = {"servo": "rotor", "cart_pendulum": "pole", "arm": "link", "two_link_arm": "lower"}[name]
    edits = (BodyEdit(body, scale(0.25, 4), scale(0.5, 4)),)
    if name == "cart_pendulum":
        edits += (BodyEdit("cart", scale(0.25, 4)),)
    if name == "two_link_arm":
        edits += (BodyEdit("upper", scale(0.25, 4), scale(0.5, 4)),)
        edits += (BodyEdit("payload", scale(0.25, 4)),)
    return edits


def test_mujoco_has_the_accelerations_of_the_corrected_equations(plant: MujocoPlant) -> None:
    assert disagreement(plant, states=10_000, seed=1).max() < AGREEMENT


def test_they_agree_under_every_edit(plant: MujocoPlant) -> None:
    rng = np.random.default_rng(2)
    for seed in range(100):
        edits = random_edits(plant.system.name, rng)
        worst = disagreement(plant.edited(*edits), states=25, seed=seed).max()
        assert worst < AGREEMENT, edits


# The printed equations are others


def test_the_report_s_comparison_is_the_worst_state_s_and_sees_every_term() -> None:
    physics = MujocoPlant.load("servo")
    right = physics.analytic()

    def found(plant: AnalyticPlant, states: int, calls: int = 1) -> list[float]:
        random = np.random.default_rng(3)
        return [acceleration_difference(physics, plant, random, states) for _ in range(calls)]

    equations = right.system.equations
    for term in ("f", "g", "d"):
        scaled = (sp.Matrix(getattr(equations, term)) * (1 + sp.Rational(1, 10**6))).tolist()
        rows = scaled if term == "g" else [row[0] for row in scaled]
        system = replace(right.system, equations=replace(equations, **{term: rows}))
        wrong = replace(right, system=system)
        assert found(right, 20)[0] < AGREEMENT_BOUND < found(wrong, 20)[0]
        assert found(wrong, 20) == [max(found(wrong, 1, calls=20))]


def test_only_corrected_equations_beyond_the_bound_disagree() -> None:
    rows = [
        Agreement("arm", variant, "nominal", size * AGREEMENT_BOUND, 1)
        for variant, size in (("printed", 9.0), ("corrected", 1.0), ("corrected", 2.0))
    ]
    (said,) = disagreements(rows)
    assert "differ by 2.0e-10 of the largest term, must be 1e-10 at most" in said


def test_printed_pendulum_answers_its_input_with_a_fifth_of_the_true_acceleration() -> None:
    """Upright, the printed a = m/(M+m) makes 0.18 of the acceleration that MuJoCo shows."""
    plant = MujocoPlant.load("cart_pendulum")
    data = mujoco.MjData(plant.model)
    data.ctrl[0] = 1.0
    mujoco.mj_forward(plant.model, data)
    printed = plant.analytic("printed").derivative([0.0, 0.0, 0.0, 0.0], 1.0)[3]
    assert printed / data.qacc[1] == pytest.approx(0.2 * 35 / 39, rel=1e-12)


def test_printed_arm_is_off_by_the_missing_rate() -> None:
    """M (q'' - printed q'') = 0.03 cos(q) q' (1 - q'): nothing at rest and at 1 rad/s only."""
    plant = MujocoPlant.load("arm")
    printed, data = plant.analytic("printed"), mujoco.MjData(plant.model)
    rng = np.random.default_rng(5)
    rates = np.concatenate([[0.0, 1.0], rng.normal(0, 5, 500)])
    for q, rate in zip(rng.uniform(-1.5, 1.5, len(rates)), rates, strict=True):
        data.qpos[0], data.qvel[0] = q, rate
        mujoco.mj_forward(plant.model, data)
        difference = data.qacc[0] - printed.derivative([q, rate])[1]
        inertia = 0.1 + 0.06 * math.sin(q)
        expected = 0.03 * math.cos(q) * rate * (1 - rate)
        # Rounding of M q'', at most some 10 N m, and of the cable near pi/2.
        assert inertia * difference == pytest.approx(expected, abs=1e-11)


# Trajectories under a constant input and a constant wrench

DURATION = 1.0
# Starts, inputs and timesteps [s] at which the error of RK4 is above rounding: the servo is so
# slow (J/B = 6.6 s) that its steps must be long.
START = {
    "servo": (0.2, -1.0),
    "cart_pendulum": (0.0, 0.4, 0.0, 0.0),
    "arm": (-0.5, 1.0),
    "two_link_arm": (-1.3, 0.3, 0.5, 0.5),
}
INPUT = {"servo": 1.5, "cart_pendulum": 2.0, "arm": 0.1, "two_link_arm": (1.0, -0.5)}
FOURTH = {
    "servo": (0.2, 0.1, 0.05, 0.025),
    "cart_pendulum": (0.02, 0.01, 0.005, 0.0025),
    "arm": (0.1, 0.05, 0.025, 0.0125),
    "two_link_arm": (0.02, 0.01, 0.005, 0.0025),
}
WRENCHES = (
    (0.1, 0.2, 0.3, 0.4, -0.05, 0.6),
    (-0.4, 0.3, 0.2, 0.1, 0.06, -0.2),
    (0.3, -0.1, -0.2, 0.5, 0.04, 0.1),
)


def constant_wrenches(name: str) -> list[Disturbance]:
    return [Disturbance(body, w) for body, w in zip(SYSTEMS[name].bodies, WRENCHES, strict=False)]


@cache
def end_state(name: str) -> Array:
    """x after one second by an eighth-order method at a tolerance of 1e-12."""
    twin = MujocoPlant.load(name).analytic()
    w = np.concatenate([disturbance.wrench for disturbance in constant_wrenches(name)])
    run = solve_ivp(
        lambda t, x: twin.derivative(x, INPUT[name], w),
        (0.0, DURATION),
        START[name],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    return run.y[:, -1]


def order(timesteps: Sequence[float], error: Array) -> float:
    """Slope of the error over the timestep, both logarithmic."""
    # Below this the error of the reference and rounding would be part of the slope.
    assert error.min() > 5e-11
    assert error.max() < 0.5
    return float(np.polyfit(np.log(timesteps), np.log(error), 1)[0])


@pytest.mark.parametrize("engine", ["python", "native"])
def test_equations_and_mujoco_with_rk4_converge_at_order_4_by_the_same_steps(
    name: str, engine: Engine, open_loop: OpenLoop
) -> None:
    """Both use the classical fourth-order rule, so they agree far below its error."""
    options: dict[str, Any] = {
        "duration": DURATION, "disturbances": constant_wrenches(name), "engine": engine,
    }  # fmt: skip
    errors = []
    for h in FOURTH[name]:
        plant = MujocoPlant.load(name, timestep=h, integrator="RK4")
        ends = [
            simulate(one, open_loop(INPUT[name]), START[name], timestep=h, **options).state[-1]
            for one in (plant, plant.analytic())
        ]
        errors.append([np.abs(end - end_state(name)).max() for end in ends])
    physics, equations = np.transpose(errors)
    assert 3.7 < order(FOURTH[name], physics) < 4.3
    assert physics == pytest.approx(equations, abs=1e-12)
