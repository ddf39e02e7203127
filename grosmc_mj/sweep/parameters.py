"""Numbers of an experiment by path: their units, bounds and values, and cases with other values."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.arguments import require_known
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS, unit_of
from grosmc_mj.experiments.file.paths import Place, edited_by, place_of, set_in_tables
from grosmc_mj.experiments.file.schema import EDITED
from grosmc_mj.fields import Range, range_of
from grosmc_mj.loop.timing import TIMES, time_as_run
from grosmc_mj.physics.edit import Edit
from grosmc_mj.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.physics.files import body_names, joint_names
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant, System
from grosmc_mj.simulation.disturbances import AnyDisturbance, Pulse

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
# Field of a model by the number of a joint edit.
_JOINT_FIELDS = {
    "damping": "dof_damping",
    "friction": "dof_frictionloss",
    "armature": "dof_armature",
}
_OWNERS = {*_EDITS, *LOOP_PARTS, "disturbance", "parameter"}
# Beginnings of paths to numbers that have no table of a name.
_START = "run.start."
_COMPUTING = "computing."


@dataclass(frozen=True)
class Parameter:
    """A number of an experiment.

    Attributes:
        owner: ``body``, ``joint``, ``disturbance``, ``start``, ``parameter``, or a part of the loop
            or of the machine, such as ``sensor`` or ``transmission``.
        of: Name of the owner, such as a joint; ``computing`` of the computer.
        quantity: Name of the number.
        at: Place of an added mass on the body [m].
    """

    owner: str
    of: str
    quantity: str
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @classmethod
    def at_path(cls, path: str) -> Parameter:
        """Return the parameter of a path in a case file, such as ``sensor.rotor angle.delay``.

        Raises:
            ArgumentError: If the path has another form, or leads to no such number.
        """
        start = path.removeprefix(_START)
        if start != path:
            return cls("start", start, "value")
        computing = path.removeprefix(_COMPUTING)
        if computing != path:
            return cls("computing", "computing", computing)

        place = place_of(path)
        owner = edited_by(place) if place.owner == "edit" else place.owner
        require_known("owner", owner, _OWNERS, f"{path!r}: ")
        return cls(owner, place.name, place.field)

    def set_in(self, content: Content, number: float | str, system: System) -> None:
        """Give a case file this number, which may have a table of its own.

        Args:
            content: Values of the file, which are changed.
            number: The number as written, of no disturbance.
            system: System of the plant.
        """
        if self.owner == "start":
            content["run"].setdefault("start", {})[self.of] = number
            return
        if self.owner == "computing":
            content.setdefault("computing", {})[self.quantity] = number
            return

        owner = "edit" if self.owner in EDITED else self.owner
        name = self.of
        if self.owner in MACHINE_PARTS and MACHINE_PARTS[self.owner].owner == "input":
            # A model has the name of the actuator, a file that of the input.
            name = system.inputs[system.actuators.index(name)].name
        set_in_tables(content, Place(owner, name, None, self.quantity), number, add=True)

    @property
    def of_loop(self) -> bool:
        """Whether it is a number of a sensor, an estimator, an actuator or the computer."""
        return self.owner in LOOP_PARTS

    @property
    def of_plant(self) -> bool:
        """Whether it changes the plant, and not a disturbance, the start or the loop."""
        return self.owner in {*_EDITS, "parameter"}

    @property
    def bounds(self) -> Range:
        """The values that it can have, as its field declares them."""
        kind = {**_EDITS, **LOOP_PARTS}.get(self.owner)
        if kind is None or self.quantity in _BOUNDS:
            return _BOUNDS[self.quantity]
        return range_of(kind, self.quantity) or Range()

    def unit_on(self, system: System) -> str:
        """Return the unit of its values on a system; empty for a factor.

        Raises:
            ArgumentError: If the system has no such state, input or joint.
        """
        if self.owner == "start":
            return system.states[self.state(system)].unit
        if self.owner in MACHINE_PARTS or self.of_loop:
            return unit_of(self.owner, self.of, self.quantity, system)
        return self.bounds.unit

    def state(self, system: System) -> int:
        """Return the index of the state whose start it is."""
        names = [state.name for state in system.states]
        require_known("state", self.of, names)
        return names.index(self.of)

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """Return the value that a run has: times of a loop are whole timesteps [s]."""
        if self.of_loop and self.quantity in TIMES:
            return time_as_run(self.quantity, value, timestep, control_period)
        return value

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the number that a case and its plant have, infinite for no limit.

        A disturbance's amplitude is zero: without uncertainty there is none.

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

        value = self._of_loop(case) if self.of_loop else self._of_model(case, plant)
        if value is None:
            return math.inf
        return float(value)

    def _of_loop(self, case: Experiment) -> float | None:
        """The number of a sensor, an estimator, an actuator or the computer; None for no limit."""
        if case.loop is None:
            raise ArgumentError(
                f"the case file has no {self.owner}, of which this is a number: write one"
            )
        return getattr(case.loop.part(self.owner, self.of), self.quantity)

    def _of_model(self, case: Experiment, plant: Any) -> float | None:
        """The number of a body, a joint or a part of the machine; None for no limit."""
        if plant.kind != "physics":
            raise ArgumentError(
                f"the plant has no model in MuJoCo, so no {self.owner}: name a parameter"
            )
        if self.owner == "joint":
            return self._of_joint(plant)

        edits = [case.edits[index] for index in self._indices(case.edits)]
        if self.owner == "body":
            require_known("body", self.of, body_names(plant.model))
            nominal = 0.0 if self.quantity == "added_mass" else 1.0
            return getattr(edits[0], self.quantity, nominal) if edits else nominal
        if len(edits) != 1:
            raise ArgumentError(
                f"the file has {len(edits) or 'no'} [[{self.owner}]] of {self.of!r}: it must have "
                "one"
            )
        return getattr(edits[0], self.quantity)

    def _of_joint(self, plant: Any) -> float:
        """The number of a joint in the compiled model."""
        require_known("joint", self.of, joint_names(plant.model))
        joint = plant.model.joint(self.of)
        return getattr(plant.model, _JOINT_FIELDS[self.quantity])[joint.dofadr[0]]

    def _of_disturbance(self, case: Experiment) -> float:
        """The number of a disturbance."""
        labels = [disturbance.label for disturbance in case.disturbances]
        require_known("disturbance", self.of, [label for label in labels if label])
        if labels.count(self.of) > 1:
            raise ArgumentError(f"two disturbances have the label {self.of!r}: give each its own")
        if self.quantity == "amplitude":
            return 0.0

        profile: Any = case.disturbances[labels.index(self.of)].profile
        if isinstance(profile, Pulse) and self.quantity == "onset":
            return profile.start
        if not hasattr(profile, self.quantity):
            raise ArgumentError(f"a {type(profile).__name__} profile has no {self.quantity}")
        return float(getattr(profile, self.quantity))

    def _indices(self, edits: Sequence[Edit]) -> list[int]:
        """Indices of the edits that have the numbers of its body, joint or part of the machine."""
        kind = _EDITS[self.owner]
        name = self.owner if self.owner in ("body", "joint") else "of"
        return [
            index
            for index, edit in enumerate(edits)
            if isinstance(edit, kind) and getattr(edit, name) == self.of
        ]

    def edited(self, edits: Sequence[Edit], value: float) -> list[Edit]:
        """Return the edits of a model with this value among them."""
        changed = list(edits)
        if self.quantity == "added_mass":
            # No mass is no edit.
            if value > 0:
                changed.append(AddedMass(self.of, value, self.at))
            return changed

        change = {self.quantity: value}
        indices = self._indices(edits)
        if indices:
            first = indices[0]
            changed[first] = replace(changed[first], **change)
        else:
            changed.append(_EDITS[self.owner](self.of, **change))
        return changed

    def disturbed(self, disturbance: AnyDisturbance, value: float) -> AnyDisturbance:
        """Return a disturbance with this value; a pulse with another onset keeps its length."""
        if disturbance.label != self.of:
            return disturbance
        if self.quantity == "amplitude":
            return disturbance.scaled(value)

        profile: Any = disturbance.profile
        if isinstance(profile, Pulse):
            changed = Pulse(value, value + (profile.stop - profile.start))
        else:
            changed = replace(profile, **{self.quantity: value})
        of_disturbance: Any = disturbance
        return replace(of_disturbance, profile=changed)

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return a case with this value in its plant, start, disturbances, edits or loop.

        Raises:
            ArgumentError: If the case has no such part, or the value is out of its bounds.
        """
        if self.owner == "start":
            x0 = list(case.x0)
            x0[self.state(case.nominal.system)] = value
            return case.varied(x0=tuple(x0))
        if self.owner == "disturbance":
            disturbances = [self.disturbed(disturbance, value) for disturbance in case.disturbances]
            return case.varied(disturbances=tuple(disturbances))
        if self.owner == "parameter":
            # On top of an edit that the file has.
            scales = (*case.nominal.scales, (self.of, value))
            return case.varied(nominal=replace(case.nominal, scales=scales))
        if self.of_plant:
            return case.varied(edits=tuple(self.edited(case.edits, value)))
        if case.loop is None:
            raise ArgumentError(f"the case has no loop, so no {self.owner} of {self.of}")
        loop = case.loop.changed(self.owner, self.of, **{self.quantity: value})
        return case.varied(loop=loop)


def with_values(case: Experiment, values: Iterable[tuple[Parameter, float]]) -> Experiment:
    """Return a case with other values of some parameters; times become whole timesteps.

    Args:
        case: The case.
        values: Parameters and their values.

    Raises:
        ArgumentError: If it has no such part, or a value is out of its bounds.
    """
    changed = case
    for parameter, value in values:
        changed = parameter.changed_case(changed, value)

    if changed.loop is not None and changed.loop is not case.loop:
        settings = case.settings
        loop = changed.loop.rounded(settings.timestep, settings.control_period)
        changed = changed.varied(loop=loop)
    return changed


def plant_of(case: Experiment, like: Plant) -> Plant:
    """Return the plant of a case whose parameters have other values.

    Args:
        case: The case.
        like: Plant of the case before its parameters had other values.

    Raises:
        ArgumentError: If the case starts beyond one of its stops.
    """
    if not isinstance(like, MujocoPlant):
        return case.plant(like.kind)
    plant = like.changed(*case.edits)
    plant.require_start(np.array(case.x0))
    return plant
