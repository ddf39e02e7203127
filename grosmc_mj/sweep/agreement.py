"""Comparison of equations with MuJoCo; where they agree, equations can stand for MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import AnalyticPlant, Plant, System
from grosmc_mj.results.tables import Table, numbers, table, words

# Random states, inputs and wrenches are drawn up to these, in SI units.
_RATE_BOUND = 5.0
_INPUT_BOUND = 5.0
_WRENCH_BOUND = 2.0
# Largest difference of accelerations, over the largest term, that counts as agreement: rounding
# of terms that cancel, with room for other machines.
AGREEMENT_BOUND = 1e-10
# How near to a limit a margin by the equations is not believed, in parts of the limit: it is
# confirmed in MuJoCo within this many times the largest difference found...
FACTOR = 10.0
# ...and within what rounding may come to on another machine.
LEAST_BAND = 1e-9
# Random states, inputs and wrenches in which accelerations are compared.
_MISMATCH_STATES = 32


class Agreement(NamedTuple):
    """Largest differences between an analytic plant and MuJoCo.

    Attributes:
        system: Name of the system.
        variant: ``printed`` or ``corrected``.
        edit: What was changed in the model, for people.
        acceleration: Largest difference over the largest term, at random states, inputs and
            wrenches [1].
        states: Number of random states.
    """

    system: str
    variant: str
    edit: str
    acceleration: float
    states: int


def agreements(
    nominal: MujocoPlant,
    *,
    seed: int = 0,
    states: int = 1000,
    edits: int = 3,
) -> list[Agreement]:
    """Compare every variant of a plant's equations with MuJoCo, nominal and under random edits.

    Args:
        nominal: The plant, with equations.
        seed: Seed of the random states, inputs, wrenches and edits.
        states: Random states of each comparison.
        edits: Number of random edits (mass x0.25 to x4, length x0.5 to x4).
    """
    seeds = np.random.SeedSequence(seed).spawn(edits + 1)
    body = nominal.system.uncertain_body or nominal.system.bodies[-1]
    changes = [(), *_random_edits(body, np.random.default_rng(seeds[0]), edits)]

    rows: list[Agreement] = []
    for change, sample in zip(changes, seeds, strict=True):
        physics = nominal.changed(*change)
        name = "; ".join(map(str, physics.edits)) or "nominal"
        for variant in nominal.system.variants:
            # Every variant meets the same states.
            random = np.random.default_rng(sample)
            difference = acceleration_difference(physics, physics.analytic(variant), random, states)
            rows.append(Agreement(nominal.system.name, variant, name, difference, states))
    return rows


def _random_edits(
    body: str, random: np.random.Generator, count: int
) -> Iterator[tuple[BodyEdit, ...]]:
    """Edits of a body: its mass times 0.25 to 4, its length times 0.5 to 4."""
    for _ in range(count):
        mass = 2 ** random.uniform(-2, 2)
        length = 2 ** random.uniform(-1, 2)
        yield (BodyEdit(body, mass, length),)


def disagreements(rows: Sequence[Agreement]) -> list[str]:
    """One line for each comparison of the corrected equations that is beyond the bound."""
    return [
        f"{row.system}, {row.edit}: accelerations of MuJoCo and the corrected equations differ by "
        f"{row.acceleration:.1e} of the largest term, must be {AGREEMENT_BOUND:.0e} at most"
        for row in rows
        if row.variant == "corrected" and row.acceleration > AGREEMENT_BOUND
    ]


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


def agreement_table(rows: Sequence[Agreement]) -> Table:
    """Largest difference of each variant of the equations from MuJoCo."""
    columns = [
        *words("system", "equations", "model"),
        *numbers("acceleration difference\nover largest term"),
    ]
    cells = [(row.system, row.variant, row.edit, f"{row.acceleration:.1e}") for row in rows]
    return table("", columns, cells)
