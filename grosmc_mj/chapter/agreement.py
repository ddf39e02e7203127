"""Equations of the systems compared with MuJoCo, for ``validate``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.output.results.tables import Table, numbers, table, words
from grosmc_mj.studies.sweep.agreement import AGREEMENT_BOUND, acceleration_difference


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


def agreement_table(rows: Sequence[Agreement]) -> Table:
    """Largest difference of each variant of the equations from MuJoCo."""
    columns = [
        *words("system", "equations", "model"),
        *numbers("acceleration difference\nover largest term"),
    ]
    cells = [(row.system, row.variant, row.edit, f"{row.acceleration:.1e}") for row in rows]
    return table("", columns, cells)
