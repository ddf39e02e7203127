"""Units of numbers that depend on their owner: a state, an input or a joint of a system.

A field that has such a unit is declared as ``Annotated[float, Range(unit=STATE_RATE)]``.
``Range.unit_in`` returns the unit of a number as a text.
"""

from __future__ import annotations

from dataclasses import dataclass

from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.fields import OwnerUnit
from grosmc_mj.theory.plants.system import Signal, System


def _state(system: System, name: str) -> Signal:
    """Return the state of a name.

    Raises:
        ArgumentError: If there is none.
    """
    states = {state.name: state for state in system.states}
    require_known("state", name, states)
    return states[name]


def _input(system: System, name: str) -> Signal:
    """Return the input of a name, or that of the actuator of a name in the model.

    Raises:
        ArgumentError: If there is none.
    """
    if name in system.actuators:
        return system.inputs[system.actuators.index(name)]
    inputs = {signal.name: signal for signal in system.inputs}
    require_known("input", name, inputs)
    return inputs[name]


@dataclass(frozen=True)
class StateUnit(OwnerUnit):
    """Unit of a state, or of its rate.

    Attributes:
        rate: Whether it is that of the rate.
    """

    rate: bool = False

    def in_system(self, system: System, of: str) -> str:
        """Return the unit of the state of a name, or of its rate."""
        state = _state(system, of)
        return state.rate_unit if self.rate else state.unit

    def __str__(self) -> str:
        return "the unit of the state per second" if self.rate else "the unit of the state"


@dataclass(frozen=True)
class InputUnit(OwnerUnit):
    """Unit of an input, or of its rate.

    Attributes:
        rate: Whether it is that of the rate.
    """

    rate: bool = False

    def in_system(self, system: System, of: str) -> str:
        """Return the unit of the input of a name, or of its rate."""
        signal = _input(system, of)
        return signal.rate_unit if self.rate else signal.unit

    def __str__(self) -> str:
        return "the unit of the input per second" if self.rate else "the unit of the input"


@dataclass(frozen=True)
class FirstInputUnit(OwnerUnit):
    """Unit of the first input of a system, for a number that belongs to a state."""

    def in_system(self, system: System, of: str) -> str:
        """Return the unit of the input."""
        return system.input.unit

    def __str__(self) -> str:
        return "the unit of the first input"


@dataclass(frozen=True)
class JointUnit(OwnerUnit):
    """Unit of a number of a joint, which may be a hinge or a slide.

    Attributes:
        hinge: Unit for a hinge.
        slide: Unit for a slide.
    """

    hinge: str
    slide: str

    def in_system(self, system: System, of: str) -> str:
        """Return the unit for the joint of a name."""
        require_known("joint", of, system.joints)
        if system.states[system.joints.index(of)].unit == "m":
            return self.slide
        return self.hinge

    def __str__(self) -> str:
        return f"{self.hinge}, of a slide {self.slide}"


@dataclass(frozen=True)
class GearUnit(OwnerUnit):
    """Unit of a gear: force or torque of a joint for one unit of an input."""

    def in_system(self, system: System, of: str) -> str:
        """Return the unit for the input of a name; of two that it may have the first."""
        return self.choices(system, of)[0]

    def choices(self, system: System, of: str) -> list[str]:
        """Return the units that it may have.

        A system does not say which joint an input drives: where it has slides and hinges, either.
        """
        unit = _input(system, of).unit
        forces = {"N" if position.unit == "m" else "N m": None for position in system.positions}
        if unit in forces:
            return ["1"]
        return [_per(force, unit) for force in forces]

    def __str__(self) -> str:
        return "N m, of a slide N, for one unit of the input"


def _per(unit: str, of: str) -> str:
    """Write a unit for one of another unit."""
    if of in {"", "1"}:
        return unit
    return f"{unit}/({of})" if " " in of or "/" in of else f"{unit}/{of}"


STATE = StateUnit()
STATE_RATE = StateUnit(rate=True)
INPUT = InputUnit()
INPUT_RATE = InputUnit(rate=True)
FIRST_INPUT = FirstInputUnit()
GEAR = GearUnit()
# Numbers of a joint, at the joint.
ANGLE = JointUnit("rad", "m")
SPEED = JointUnit("rad/s", "m/s")
FORCE = JointUnit("N m", "N")
INERTIA = JointUnit("kg m^2", "kg")
STIFFNESS = JointUnit("N m/rad", "N/m")
DAMPING = JointUnit("N m s/rad", "N s/m")
