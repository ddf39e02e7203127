"""One member of a family: a plant, what acts on it and where it starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.file.parts import LOOP_UNITS, MACHINE_PARTS
from grosmc_mj.physics.edits import AddedMass, BodyEdit, Edit, JointEdit
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import Disturbance, Profile, Pulse

if TYPE_CHECKING:
    from grosmc_mj.campaign.family import Quantity

# The edits that have the numbers of each owner.
EDITS: Mapping[str, Any] = {"body": BodyEdit, "joint": JointEdit, **MACHINE_PARTS}


@dataclass(frozen=True)
class PlantSample:
    """What the uncertain numbers make of a case.

    Attributes:
        case: Start, edits and disturbances.
        scales: Factors on parameters of an analytic plant of the user's own.
        run: Number of the run, for what its loop draws.
    """

    case: Case
    scales: tuple[tuple[str, float], ...] = ()
    run: int = 0

    def plant(self, like: Plant) -> Plant:
        """The plant, from one without uncertainty.

        Raises:
            ArgumentError: If the case starts beyond one of its stops.
        """
        plant = like.changed(self.case.edits, dict(self.scales))
        plant.require_start(np.array(self.case.x0))
        return plant


def plant_sample_of(
    case: Case,
    quantities: Sequence[Quantity],
    values: Sequence[float],
    timestep: float,
    control_period: float,
    run: int = 0,
) -> PlantSample:
    """The member with these values of the uncertain numbers, in the order of the quantities.

    Times of its loop are rounded to whole timesteps [s].
    """
    loop, edits, x0, scales = case.loop, list(case.edits), list(case.x0), []
    disturbances = list(case.disturbances)
    for quantity, value in zip(quantities, values, strict=True):
        if quantity.owner == "start":
            x0[quantity.index] = value
        elif quantity.owner == "parameter":
            scales.append((quantity.of, value))
        elif quantity.owner == "disturbance":
            disturbances = [
                _disturbed(disturbance, quantity.quantity, value)
                if disturbance.label == quantity.of
                else disturbance
                for disturbance in disturbances
            ]
        elif quantity.owner in LOOP_UNITS and loop is not None:
            loop = loop.changed(quantity.owner, quantity.of, **{quantity.quantity: value})
        else:
            _edit(edits, quantity, value)
    if loop is not None and loop is not case.loop:
        loop = loop.rounded(timestep, control_period)
    changed = replace(
        case, x0=tuple(x0), edits=tuple(edits), disturbances=tuple(disturbances), loop=loop
    )
    return PlantSample(changed, tuple(scales), run)


def _disturbed(disturbance: Disturbance, quantity: str, value: float) -> Disturbance:
    """A disturbance with another amplitude, or with another course in time."""
    if quantity == "amplitude":
        fx, fy, fz, tx, ty, tz = (value * part for part in disturbance.wrench)
        return replace(disturbance, wrench=(fx, fy, fz, tx, ty, tz))
    return replace(disturbance, profile=retimed(disturbance.profile, quantity, value))


def retimed(profile: Profile, quantity: str, value: float) -> Profile:
    """A profile with another frequency, phase or onset; a pulse keeps its length."""
    known: Any = profile
    if isinstance(profile, Pulse):
        return Pulse(value, value + (profile.stop - profile.start))
    return replace(known, **{quantity: value})


def _edit(edits: list[Edit], quantity: Quantity, value: float) -> None:
    """Bring one number of a body, joint or part of the machine into the edits."""
    change = {quantity.quantity: value}
    if quantity.quantity == "added_mass":
        if value > 0:
            edits.append(AddedMass(quantity.of, value, quantity.at))
    elif own := edits_of(edits, quantity.owner, quantity.of):
        edits[own[0]] = replace(edits[own[0]], **change)
    else:
        edits.append(EDITS[quantity.owner](quantity.of, **change))


def edits_of(edits: Sequence[Edit], owner: str, of: str) -> list[int]:
    """Which edits have the numbers of a body, a joint or a part of the machine."""
    name = owner if owner in ("body", "joint") else "of"
    return [
        index
        for index, edit in enumerate(edits)
        if isinstance(edit, EDITS[owner]) and getattr(edit, name) == of
    ]
