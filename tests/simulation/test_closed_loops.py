"""Loops closed on physics: orders of convergence, the optimal cost, and what GROSMC promises."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from shipped import find_case

from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.control.controller import Controller

pytestmark = pytest.mark.slow

OPTIMAL = {"servo": "lqr", "cart_pendulum": "fl-lqr", "arm": "lqr"}


@cache
def controller(system: str, law: str) -> Controller:
    return chapter_controller(law, MujocoPlant.load(system).analytic())


def close_loop(system: str, law: str, case: str, h: float, **options: Any) -> Trajectory:
    """A case on physics, sampled at every timestep."""
    spec = find_case(system, case)
    plant = MujocoPlant.load(system, edits=spec.edits, timestep=h)
    options = {
        "duration": spec.duration,
        "disturbances": spec.disturbances,
        **options,
    }
    return simulate(plant, controller(system, law), spec.x0, **options)


def transformed_states(system: str, run: Trajectory) -> Array:
    """z of a run, by the coordinates of the optimal law."""
    law = controller(system, OPTIMAL[system])
    return law.coordinates.along(run.time, run.state, law.parameters)


@pytest.mark.parametrize(
    # The arm's held torque lags behind a reference that never rests: its cost is O(T) from J*,
    # where the others' is O(T^2), and 1 kHz is not enough for a thousandth.
    ("system", "T", "duration"),
    [("servo", 1e-3, 12.0), ("cart_pendulum", 1e-3, 8.0), ("arm", 1e-4, 6.0)],
)
def test_nominal_cost_on_physics_is_half_x_P_x(system: str, T: float, duration: float) -> None:
    """J of the optimal law is x0' P x0 / 2; the horizons leave exp(-12) of it or less.

    The index (4), (27) or (48): trapezoids in z, exact in v, which is held.
    """
    run = close_loop(system, OPTIMAL[system], "nominal", T, duration=duration)
    design = controller(system, OPTIMAL[system]).designed.lqr
    z = transformed_states(system, run)
    weighted_states = np.einsum("ti,ij,tj->t", z, design.Q, z)
    state_integral = np.trapezoid(weighted_states, run.time)
    input_integral = design.R.item() * run.weighed**2 @ np.diff(run.time)
    cost = 0.5 * (state_integral + input_integral)
    assert cost == pytest.approx(design.optimal_cost(z[0]), rel=1e-3)


def largest_deviation(system: str, case: str, control_period: float) -> float:
    """Largest deviation of the first output from its optimum under GROSMC."""
    run = close_loop(system, "grosmc", case, control_period)
    z = transformed_states(system, run)
    design = controller(system, OPTIMAL[system]).designed.lqr
    optimum = design.optimal_trajectory(z[0], run.time)
    return np.abs(z - optimum)[:, 0].max()


@pytest.mark.parametrize(("system", "case"), [("servo", "case2"), ("cart_pendulum", "case1")])
def test_deviation_from_the_optimum_shrinks_with_the_control_period(system: str, case: str) -> None:
    """On the surface the motion is the optimum's, eqs. (11) and (34): what is left is O(T)."""
    fine = largest_deviation(system, case, 2.5e-4)
    coarse = largest_deviation(system, case, 2e-3)
    assert fine < coarse / 4
