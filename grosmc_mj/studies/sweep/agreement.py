"""Comparison of equations with MuJoCo; where they agree, equations can stand for MuJoCo."""

from __future__ import annotations

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.plants import AnalyticPlant, Plant, System

# Random states, inputs and wrenches are drawn up to these, in SI units.
_RATE_BOUND = 5.0
_INPUT_BOUND = 5.0
_WRENCH_BOUND = 2.0
# Largest difference of accelerations, over the largest term, that counts as agreement: rounding
# of terms that cancel, with room for other machines.
AGREEMENT_BOUND = 1e-10
# Random states, inputs and wrenches in which accelerations are compared.
_MISMATCH_STATES = 32


def acceleration_difference(
    physics: MujocoPlant, plant: AnalyticPlant, random: np.random.Generator, states: int
) -> float:
    """Largest difference of the accelerations, over the largest of their terms in each state.

    The terms are drift, g(x) u and the wrenches' share, of all coordinates.

    Args:
        physics: Gives qacc.
        plant: Gives x'.
        random: Draws states, inputs and wrenches.
        states: Number of states.
    """
    system = plant.system
    p = plant.parameters
    n = system.degrees_of_freedom
    low, high = _input_range(physics)

    worst = 0.0
    for _ in range(states):
        x = _random_state(system, random)
        u = random.uniform(low, high)
        w = random.uniform(-_WRENCH_BOUND, _WRENCH_BOUND, 6 * len(system.bodies))

        equations = system.symbolic_equations
        drift = equations.drift(x, p)
        input_matrix = np.reshape(equations.input_matrix(x, p), (2 * n, -1))
        disturbance = equations.disturbance(x, w, p)

        terms = np.array([drift, input_matrix @ u, disturbance])[:, n:]
        acceleration = physics.derivative(x, u, w)[n:]
        difference = np.abs(terms.sum(axis=0) - acceleration).max()
        worst = max(worst, float(difference / np.abs(terms).max()))
    return worst


def _input_range(physics: MujocoPlant) -> tuple[Array, Array]:
    """Smallest and largest input that is tried, (m,) each.

    Beyond its range MuJoCo would apply another input than the equations are given.
    """
    limited = physics.model.actuator_ctrllimited.astype(bool)[:, None]
    ranges = np.where(limited, physics.model.actuator_ctrlrange, (-_INPUT_BOUND, _INPUT_BOUND))
    return ranges[:, 0], ranges[:, 1]


def _random_state(system: System, random: np.random.Generator) -> Array:
    """Coordinates within the system's bound, then their rates, (2 n,)."""
    n = system.degrees_of_freedom
    bound = system.position_bound
    positions = random.uniform(-bound, bound, n)
    rates = random.uniform(-1, 1, n)
    return np.concatenate([positions, _RATE_BOUND * rates])


def model_mismatch(plant: Plant) -> str:
    """Reason why the equations of a plant in MuJoCo differ from MuJoCo; empty if they agree.

    Its machine, limits of its inputs and numbers without a term are named; anything else shows in
    accelerations at random states.
    """
    if not isinstance(plant, MujocoPlant):
        return f"{plant.system.name} has no model in MuJoCo"
    if plant.parts:
        return "equations lack the machine as built"
    if plant.system.read_parameters is None or not plant.system.symbolic:
        return f"{plant.system.name} has no equations in symbols"
    if np.isfinite(plant.input_limits).any():
        return f"equations lack the limits of {plant.system.name}'s inputs"
    try:
        equations = plant.analytic()
    except ModelError as error:
        return str(error)

    random = np.random.default_rng(0)
    difference = acceleration_difference(plant, equations, random, _MISMATCH_STATES)
    if difference <= AGREEMENT_BOUND:
        return ""
    return (
        f"accelerations differ from MuJoCo's by {difference:.1e} of the largest term, more than "
        f"{AGREEMENT_BOUND:.0e}, so that equations lack something"
    )
