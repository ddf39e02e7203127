"""Uncertain numbers of an experiment: how each kind of them is read, changed and written.

A class for each kind: starts, disturbances, parameters of equations, edits of a model, parts of the
loop. A case with other numbers is made from values alone, in a tenth of the time that it takes to
read a changed file.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.parts import LOOP_PARTS, MACHINE_PARTS
from grosmc_mj.experiments.file.paths import place_of
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.fields import Range, range_of
from grosmc_mj.mechanics.machine.part import MOST
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit, JointEdit
from grosmc_mj.mechanics.physics.files import body_names, joint_names
from grosmc_mj.output.results.tables import shown_unit
from grosmc_mj.simulation.disturbances import AnyDisturbance, Pulse, SineFrom
from grosmc_mj.simulation.loop.timing import TIMES, time_as_run
from grosmc_mj.studies.sweep.distributions import Distribution
from grosmc_mj.theory.plants import System

# Text of a value in a unit, as a case file has it.
Written = Callable[[float, str], float | str]


def written(value: float, unit: str) -> float | str:
    """Return a number as a case file has it, with all its digits."""
    return value if unit in {"", "1", "%"} else f"{value!r} {unit}"


@dataclass(frozen=True, kw_only=True)
class Quantity(ABC):
    """One uncertain number.

    Attributes:
        owner: ``body``, ``joint``, ``disturbance``, ``start``, ``parameter``, or a part of the loop
            or of the machine, such as ``sensor`` or ``transmission``.
        of: Name of the owner, such as a joint; ``computing`` of the computer.
        quantity: Name of the number.
        at: Place of an added mass on the body [m].
        name: Its name in results.
        unit: Unit of its values; empty for a factor.
        distribution: Distribution of its values.
        nominal: Value without uncertainty.
    """

    owner: str
    of: str
    quantity: str
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str
    unit: str
    distribution: Distribution
    nominal: float = 0.0

    # Whether it changes the plant, or a sensor, an estimator, an actuator or the computer.
    of_plant: ClassVar[bool] = False
    of_loop: ClassVar[bool] = False

    @property
    def bounds(self) -> Range:
        """The values that it can have."""
        return Range(unit=self.unit)

    @abstractmethod
    def value(self, case: Experiment, plant: Any) -> float:
        """Return the number that a case and its plant have, infinite for no limit.

        Raises:
            ArgumentError: If they have no such number.
        """

    @abstractmethod
    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return a case with this value in its plant, start, disturbances, edits or loop.

        Raises:
            ArgumentError: If the case has no such part, or the value is out of its bounds.
        """

    @abstractmethod
    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Give the content of a case file this number, which may have a table of its own.

        Args:
            content: Values of the file, which are changed.
            value: The number, as run.
            case: The case with this number.
            text: Returns a value with its unit as the file has it.
        """

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """Return the value that a run has: times of a loop are whole timesteps [s]."""
        return value

    @property
    def place_words(self) -> str:
        """The number as messages name it."""
        return f"{self.of} {self.quantity}"

    @property
    def shown_unit(self) -> tuple[str, float]:
        """The unit that people read, and the factor to it; frequencies stay in rad/s."""
        if self.quantity in ("frequency", "bandwidth"):
            return self.unit, 1.0
        return shown_unit(self.unit)

    def words(self, value: float) -> str:
        """Return a value with its name, in the unit that people read."""
        unit, factor = self.shown_unit
        return f"{self.name} {value * factor:.4g} {unit}".rstrip()

    def physical(self, value: float) -> bool:
        """Whether a plant can have this value; of a range without an end, one that is far out."""
        return self.bounds.holds(max(-MOST, min(value, MOST)))

    def ends(self, scale: float) -> tuple[float, float]:
        """Smallest and largest value at a scale of the uncertainty; infinite where it has none."""
        low, high = self.distribution.support
        smallest = self.nominal + scale * (low - self.nominal)
        largest = self.nominal + scale * (high - self.nominal)
        return smallest, largest

    @property
    def largest_scale(self) -> float:
        """The factor on distances from the nominal value up to which all values are physical."""
        low, high = self.distribution.support
        down = up = math.inf
        if low < self.nominal:
            down = (self.nominal - self.bounds.low) / (self.nominal - low)
        if high > self.nominal:
            # A share of samples stays below all of them.
            up = (self.bounds.high - self.nominal) / (high - self.nominal) * (1 - 1e-9)
        return min(down, up)


class StartQuantity(Quantity):
    """Start of a state."""

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the start of the case."""
        return case.x0[state_index(self.of, plant.system)]

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with another start."""
        x0 = list(case.x0)
        x0[state_index(self.of, case.nominal.system)] = value
        return case.changed(x0=tuple(x0))

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write the start of the state into ``[run]``."""
        content["run"].setdefault("start", {})[self.of] = text(value, self.unit)


class DisturbanceQuantity(Quantity):
    """Amplitude of a disturbance, as a factor, or a number of its profile."""

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the number of the profile; without uncertainty there is no amplitude."""
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

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with another disturbance."""
        disturbances = [
            self._changed(disturbance, value) if disturbance.label == self.of else disturbance
            for disturbance in case.disturbances
        ]
        return case.changed(disturbances=tuple(disturbances))

    def _changed(self, disturbance: AnyDisturbance, value: float) -> AnyDisturbance:
        """The disturbance with a value; a pulse with another onset keeps its length."""
        if self.quantity == "amplitude":
            return disturbance.scaled(value)

        profile: Any = disturbance.profile
        if isinstance(profile, Pulse):
            changed = Pulse(value, value + (profile.stop - profile.start))
        else:
            changed = replace(profile, **{self.quantity: value})
        of_disturbance: Any = disturbance
        return replace(of_disturbance, profile=changed)

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write the wrench or amplitude of the case's disturbance, and its profile."""
        labels = [disturbance.label for disturbance in case.disturbances]
        index = labels.index(self.of)
        disturbance = case.disturbances[index]
        table = content["disturbance"][index]

        amplitudes = disturbance.amplitudes
        if "force" in table:
            table["force"] = [text(part, "N") for part in amplitudes[:3]]
        if "torque" in table:
            table["torque"] = [text(part, "N m") for part in amplitudes[3:]]
        if "amplitude" in table:
            table["amplitude"] = text(amplitudes[0], disturbance.unit(case.nominal.system))

        profile = disturbance.profile
        if isinstance(profile, Pulse):
            table["start"] = text(profile.start, "s")
            table["stop"] = text(profile.stop, "s")
        if isinstance(profile, SineFrom):
            table["frequency"] = text(profile.frequency, "rad/s")
            table["phase"] = text(profile.phase, "rad")
            table["onset"] = text(profile.onset, "s")


class EquationQuantity(Quantity):
    """Factor on a parameter of equations without a model, on top of an edit that the file has."""

    of_plant = True

    @property
    def bounds(self) -> Range:
        """Positive factors."""
        return Range(0, above=True)

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the factor without uncertainty: 1."""
        if plant.kind == "physics":
            raise ArgumentError("the plant has a model in MuJoCo: name a body or joint instead")
        require_known("parameter", self.of, vars(plant.parameters))
        return 1.0

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with a further factor on the parameter."""
        scales = (*case.nominal.scales, (self.of, value))
        return case.changed(nominal=replace(case.nominal, scales=scales))

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write a further edit."""
        edit = {"parameter": self.of, "scale": text(value, self.unit)}
        content.setdefault("edit", []).append(edit)


class ModelQuantity(Quantity):
    """Number of a body, a joint or a part of the machine, by an edit of the model."""

    of_plant = True

    @property
    def _kind(self) -> Any:
        """The edits that have such numbers."""
        return _EDITS[self.owner]

    @property
    def bounds(self) -> Range:
        """The values that the edit can have."""
        return range_of(self._kind, self.quantity) or Range()

    @property
    def place_words(self) -> str:
        """The number with its part of the machine, which its name alone does not tell."""
        words = f"{self.of} {self.quantity}"
        return f"{self.owner} {words}" if self.owner in MACHINE_PARTS else words

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the number of the file's edit, or of the compiled model."""
        _require_model(plant, self.owner)
        if self.owner == "joint":
            require_known("joint", self.of, joint_names(plant.model))
            joint = plant.model.joint(self.of)
            return float(getattr(plant.model, _JOINT_FIELDS[self.quantity])[joint.dofadr[0]])

        edits = [case.edits[index] for index in self._indices(case.edits)]
        if self.owner == "body":
            require_known("body", self.of, body_names(plant.model))
            return float(getattr(edits[0], self.quantity)) if edits else 1.0
        if len(edits) != 1:
            raise ArgumentError(
                f"the file has {len(edits) or 'no'} [[{self.owner}]] of {self.of!r}: it must have "
                "one"
            )
        return _finite_or_no_limit(getattr(edits[0], self.quantity))

    def _indices(self, edits: Sequence[Edit]) -> list[int]:
        """Indices of the edits that have the numbers of its body, joint or part of the machine."""
        return [
            index
            for index, edit in enumerate(edits)
            if isinstance(edit, self._kind) and edit.of == self.of
        ]

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with the number in the file's edit, or in an edit of its own."""
        edits = list(case.edits)
        change = {self.quantity: value}
        indices = self._indices(edits)
        if indices:
            first = indices[0]
            edits[first] = replace(edits[first], **change)
        else:
            edits.append(self._kind(self.of, **change))
        return case.changed(edits=tuple(edits))

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write the number into the file's table, or into one of its own."""
        owner = self.owner
        name = self.of
        if owner not in MACHINE_PARTS:
            owner = "edit"
        elif MACHINE_PARTS[owner].owner == "input":
            # A model has the name of the actuator, a file that of the input.
            system = case.nominal.system
            name = system.inputs[system.actuators.index(name)].name
        place = place_of(content, f"{owner}.{name}.{self.quantity}")
        place.write(content, text(value, self.unit))


class AddedMassQuantity(Quantity):
    """Mass that is added to a body at a place; no mass is no edit."""

    of_plant = True

    @property
    def bounds(self) -> Range:
        """Masses that are not negative."""
        return Range(0, unit="kg")

    def value(self, case: Experiment, plant: Any) -> float:
        """Return no mass, whatever masses the file adds."""
        _require_model(plant, self.owner)
        require_known("body", self.of, body_names(plant.model))
        return 0.0

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with a further edit."""
        if not value > 0:
            return case
        return case.changed(edits=(*case.edits, AddedMass(self.of, value, self.at)))

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write a further edit."""
        if value > 0:
            at = [text(place, "m") for place in self.at]
            edit = {"body": self.of, "added_mass": text(value, self.unit), "at": at}
            content.setdefault("edit", []).append(edit)


class LoopQuantity(Quantity):
    """Number of a sensor, an estimator, an actuator or the computer."""

    of_loop = True

    @property
    def bounds(self) -> Range:
        """The values that the part can have."""
        if self.quantity == "scale":
            # A sensor that measures nothing, or with another sign, is no uncertain one.
            return Range(0, above=True)
        return range_of(LOOP_PARTS[self.owner], self.quantity) or Range()

    @property
    def place_words(self) -> str:
        """The number with its part of the loop, which its name alone does not tell."""
        return f"{self.owner} {self.of} {self.quantity}"

    def as_run(self, value: float, timestep: float, control_period: float) -> float:
        """Return a time as whole timesteps [s], other numbers as they are."""
        if self.quantity in TIMES:
            return time_as_run(self.quantity, value, timestep, control_period)
        return value

    def value(self, case: Experiment, plant: Any) -> float:
        """Return the number of the case's loop."""
        if case.loop is None:
            raise ArgumentError(
                f"the case file has no {self.owner}, of which this is a number: write one"
            )
        return _finite_or_no_limit(getattr(case.loop.part(self.owner, self.of), self.quantity))

    def changed_case(self, case: Experiment, value: float) -> Experiment:
        """Return the case with another loop, whose times may be no whole timesteps."""
        if case.loop is None:
            raise ArgumentError(f"the case has no loop, so no {self.owner} of {self.of}")
        loop = case.loop.changed(self.owner, self.of, **{self.quantity: value})
        return case.changed(loop=loop)

    def write(
        self, content: Content, value: float, case: Experiment, text: Written = written
    ) -> None:
        """Write the number into the table of the part."""
        if self.owner == "computing":
            content.setdefault("computing", {})[self.quantity] = text(value, self.unit)
            return
        place = place_of(content, f"{self.owner}.{self.of}.{self.quantity}")
        place.write(content, text(value, self.unit))


# The edits that have the numbers of each owner.
_EDITS: Mapping[str, Any] = {"body": BodyEdit, "joint": JointEdit, **MACHINE_PARTS}
# Field of a model by the number of a joint edit.
_JOINT_FIELDS = {
    "damping": "dof_damping",
    "friction": "dof_frictionloss",
    "armature": "dof_armature",
}
QUANTITY_KINDS: Mapping[str, type[Quantity]] = {
    "start": StartQuantity,
    "disturbance": DisturbanceQuantity,
    "parameter": EquationQuantity,
    **dict.fromkeys(_EDITS, ModelQuantity),
    **dict.fromkeys(LOOP_PARTS, LoopQuantity),
}


def state_index(name: str, system: System) -> int:
    """Index of a state of a system."""
    names = [state.name for state in system.states]
    require_known("state", name, names)
    return names.index(name)


def _require_model(plant: Any, owner: str) -> None:
    """Refuse equations, which have no bodies, joints and parts of a machine."""
    if plant.kind != "physics":
        raise ArgumentError(f"the plant has no model in MuJoCo, so no {owner}: name a parameter")


def _finite_or_no_limit(value: float | None) -> float:
    """A number of a part, infinite where it has no limit."""
    return math.inf if value is None else float(value)


def with_values(case: Experiment, values: Iterable[tuple[Quantity, float]]) -> Experiment:
    """Return a case with other values of some quantities; times become whole timesteps.

    Args:
        case: The case.
        values: Quantities and their values.

    Raises:
        ArgumentError: If it has no such part, or a value is out of its bounds.
    """
    changed = case
    for quantity, value in values:
        changed = quantity.changed_case(changed, value)

    if changed.loop is not None and changed.loop is not case.loop:
        settings = case.settings
        loop = changed.loop.rounded(settings.timestep, settings.control_period)
        changed = changed.changed(loop=loop)
    return changed
