"""A number of an experiment under one path: its unit and bounds, its value, and other values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, unit_of
from grosmc_mj.fields import Range, range_of
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.physics.files import body_names, joint_names
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.disturbances import Disturbance, Pulse

# The edits that have the numbers of each owner.
_EDITS: Mapping[str, Any] = {"body": BodyEdit, "joint": JointEdit, **MACHINE_PARTS}
# Bounds and units of numbers that are no fields of a part or an edit.
_BOUNDS = {
    "added_mass": Range(0, unit="kg"),
    "amplitude": Range(),
    "frequency": Range(unit="rad/s"),
    "phase": Range(unit="rad"),
    "onset": Range(unit="s"),
    "value": Range(),
    "scale": Range(0, above=True),
}
# Where a model keeps what a joint edit changes.
_OF_JOINT = {"damping": "dof_damping", "friction": "dof_frictionloss", "armature": "dof_armature"}


@dataclass(frozen=True)
class Parameter:
    """A number of an experiment.

    Attributes:
        owner: ``body``, ``joint``, ``disturbance``, ``start``, ``parameter``, or a part of the loop
            or of the machine, such as ``sensor`` or ``transmission``.
        of: Name of that, such as a joint; ``computing`` of the computer.
        quantity: Which of its numbers.
        at: Of an added mass: where on the body [m].
    """

    owner: str
    of: str
    quantity: str
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def at_path(cls, path: str) -> Parameter:
        """The parameter of a path OWNER.OF.QUANTITY, such as ``sensor.rotor angle.delay``.

        Raises:
            ArgumentError: If it is none.
        """
        owner, _, rest = path.partition(".")
        of, _, quantity = rest.rpartition(".")
        if owner == "computing":
            of = owner
        parameter = cls(owner, of, quantity)
        if not of or owner not in {*_EDITS, *LOOP_PARTS, "disturbance", "start", "parameter"}:
            raise ArgumentError(f"{path!r} must be a path OWNER.OF.QUANTITY: body.rotor.mass_scale")
        return parameter

    @property
    def of_loop(self) -> bool:
        """Whether it is a number of a sensor, an estimator, an actuator or the computer."""
        return self.owner in LOOP_PARTS

    @property
    def of_plant(self) -> bool:
        """Whether it changes the plant, and not what acts on it or where it starts."""
        return self.owner in {*_EDITS, "parameter"}

    @property
    def bounds(self) -> Range:
        """The values that it can have, as its field declares them."""
        kind = {**_EDITS, **LOOP_PARTS}.get(self.owner)
        if kind is None or self.quantity in _BOUNDS:
            return _BOUNDS[self.quantity]
        return range_of(kind, self.quantity) or Range()

    def unit_on(self, system: System) -> str:
        """Unit of its values on a system; empty for a factor.

        Raises:
            ArgumentError: If the system has no such state, input or joint.
        """
        if self.owner == "start":
            return system.states[self.state(system)].unit
        if self.owner in MACHINE_PARTS or self.of_loop:
            return unit_of(self.owner, self.of, self.quantity, system)
        return self.bounds.unit

    def state(self, system: System) -> int:
        """Of a start: which of the states it is."""
        names = [state.name for state in system.states]
        require_known("state", self.of, names)
        return names.index(self.of)

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """The value that a run has: times of a loop are whole timesteps [s]."""
        if self.of_loop and self.quantity in TIMES:
            return time_as_run(self.quantity, value, timestep, control_period)
        return value

    def value(self, case: Case, plant: Any) -> float:
        """The number that a case and its plant have, infinite for no limit.

        Of a disturbance's amplitude it is zero: without uncertainty there is none.

        Raises:
            ArgumentError: If they have no such number.
        """
        if self.owner == "start":
            return case.x0[self.state(plant.system)]
        if self.owner == "parameter":
            if plant.kind == "physics":
                raise ArgumentError("the plant has a model in MuJoCo: name a body or joint instead")
            require_known("parameter", self.of, vars(plant.parameters))
            return 1.0
        if self.owner == "disturbance":
            return self._of_disturbance(case)
        if not self.of_loop:
            value = self._of_model(case, plant)
        elif case.loop is None:
            raise ArgumentError(
                f"the case file has no {self.owner}, of which this is a number: write one"
            )
        else:
            value = getattr(case.loop.part(self.owner, self.of), self.quantity)
        return math.inf if value is None else float(value)

    def _of_model(self, case: Case, plant: Any) -> float | None:
        """A number of a body, a joint or a part of the machine."""
        owner, of, quantity = self.owner, self.of, self.quantity
        if plant.kind != "physics":
            raise ArgumentError(
                f"the plant has no model in MuJoCo, so no {owner}: name a parameter"
            )
        if owner == "joint":
            require_known("joint", of, joint_names(plant.model))
            joint = plant.model.joint(of)
            return getattr(plant.model, _OF_JOINT[quantity])[joint.dofadr[0]]
        own = self._edits(case.edits)
        if owner == "body":
            require_known("body", of, body_names(plant.model))
            nominal = 0.0 if quantity == "added_mass" else 1.0
            return getattr(case.edits[own[0]], quantity, nominal) if own else nominal
        if len(own) != 1:
            count = len(own) or "no"
            raise ArgumentError(f"the file has {count} [[{owner}]] of {of!r}: it must have one")
        return getattr(case.edits[own[0]], quantity)

    def _of_disturbance(self, case: Case) -> float:
        """A number of a disturbance."""
        labels = [disturbance.label for disturbance in case.disturbances]
        require_known("disturbance", self.of, [label for label in labels if label])
        if labels.count(self.of) > 1:
            raise ArgumentError(f"two disturbances have the label {self.of!r}: give each its own")
        profile: Any = case.disturbances[labels.index(self.of)].profile
        if self.quantity == "amplitude":
            return 0.0
        if isinstance(profile, Pulse) and self.quantity == "onset":
            return profile.start
        if not hasattr(profile, self.quantity):
            raise ArgumentError(f"a {type(profile).__name__} profile has no {self.quantity}")
        return float(getattr(profile, self.quantity))

    def _edits(self, edits: Sequence[Edit]) -> list[int]:
        """Which edits have the numbers of its body, joint or part of the machine."""
        name = self.owner if self.owner in ("body", "joint") else "of"
        return [
            index
            for index, edit in enumerate(edits)
            if isinstance(edit, _EDITS[self.owner]) and getattr(edit, name) == self.of
        ]

    def edited(self, edits: Sequence[Edit], value: float) -> list[Edit]:
        """The edits of a model with this value among them."""
        changed, change = list(edits), {self.quantity: value}
        if self.quantity == "added_mass":
            return [*changed, AddedMass(self.of, value, self.at)] if value > 0 else changed
        if own := self._edits(edits):
            changed[own[0]] = replace(changed[own[0]], **change)
            return changed
        return [*changed, _EDITS[self.owner](self.of, **change)]

    def disturbed(self, disturbance: Disturbance, value: float) -> Disturbance:
        """A disturbance with this value; a pulse with another onset keeps its length."""
        if disturbance.label != self.of:
            return disturbance
        if self.quantity == "amplitude":
            fx, fy, fz, tx, ty, tz = (value * part for part in disturbance.wrench)
            return replace(disturbance, wrench=(fx, fy, fz, tx, ty, tz))
        profile: Any = disturbance.profile
        if isinstance(profile, Pulse):
            return replace(
                disturbance, profile=Pulse(value, value + (profile.stop - profile.start))
            )
        return replace(disturbance, profile=replace(profile, **{self.quantity: value}))


class Varied(NamedTuple):
    """A case with other numbers.

    Attributes:
        case: Start, edits, disturbances and loop.
        scales: Factors on parameters of an analytic plant of the user's own.
    """

    case: Case
    scales: tuple[tuple[str, float], ...] = ()

    def plant(self, like: Plant) -> Plant:
        """The plant with these numbers, from one with the file's edits.

        Raises:
            ArgumentError: If the case starts beyond one of its stops.
        """
        plant = like.changed(self.case.edits, dict(self.scales))
        plant.require_start(np.array(self.case.x0))
        return plant


def varied(
    experiment: Experiment, values: Iterable[tuple[Parameter, float]], case: Case | None = None
) -> Varied:
    """A case with other values of some parameters; times of its loop become whole timesteps.

    Args:
        experiment: Of the case.
        values: Parameters and their values.
        case: The case; the experiment's by default.

    Raises:
        ArgumentError: If it has no such part, or a value is out of its bounds.
    """
    case = case or experiment.case
    loop, edits, x0, scales = case.loop, list(case.edits), list(case.x0), []
    disturbances = list(case.disturbances)
    for parameter, value in values:
        if parameter.owner == "start":
            x0[parameter.state(experiment.nominal.system)] = value
        elif parameter.owner == "parameter":
            scales.append((parameter.of, value))
        elif parameter.owner == "disturbance":
            disturbances = [parameter.disturbed(push, value) for push in disturbances]
        elif parameter.of_plant:
            edits = parameter.edited(edits, value)
        elif loop is None:
            raise ArgumentError(f"the case has no loop, so no {parameter.owner} of {parameter.of}")
        else:
            loop = loop.changed(parameter.owner, parameter.of, **{parameter.quantity: value})
    if loop is not None and loop is not case.loop:
        loop = loop.rounded(experiment.settings.timestep, experiment.settings.control_period)
    changed = replace(
        case, x0=tuple(x0), edits=tuple(edits), disturbances=tuple(disturbances), loop=loop
    )
    return Varied(changed, tuple(scales))
