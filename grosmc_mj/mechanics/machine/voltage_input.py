"""The voltage of a motor as the input of a law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.mechanics.physics.edit import Edit
from grosmc_mj.mechanics.physics.edits import linear_polynomial
from grosmc_mj.theory.plants import System


@dataclass(frozen=True)
class VoltageInput(Edit):
    """A voltage in the place of a torque at a joint, for the nominal model of a law.

    The law knows the torque that a motor at rest gives for a voltage, the back-EMF and the rotor's
    inertia; it knows no inductance, limit, cogging or heat.

    Attributes:
        motor: The motor, as the law knows it.
        numbers: Names of the numbers of it that the law knows.
    """

    motor: Motor

    numbers: ClassVar[tuple[str, ...]] = (
        "constant",
        "resistance",
        "ratio",
        "efficiency",
        "inertia",
    )

    kind = "voltage input"
    owner = "input"
    order = 4

    @property
    def input(self) -> str:
        """Name of the actuator."""
        return self.motor.input

    def __str__(self) -> str:
        return f"{self.input}: a torque or force of {self.motor.torque_of_volt:.4g} for 1 V"

    def known_numbers(self, part: Edit) -> list[str]:
        """Return names of the numbers of a true motor that the law knows; none of another part."""
        if not isinstance(part, Motor) or part.of != self.of:
            return []
        return [name for name in self.numbers if getattr(part, name) == getattr(self.motor, name)]

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Give the input of torques a gain, and limits in volts."""
        actuator = spec.actuator(self.input)
        if actuator.gear[0] != 1 or actuator.gainprm[0] != 1:
            raise ModelError(
                f"motor of {self.input!r}: law_input = 'voltage' takes the place of its gear: "
                "leave out the edit of the gear"
            )
        volt = self.motor.torque_of_volt
        actuator.gainprm = [volt, *actuator.gainprm[1:]]
        actuator.ctrlrange = sorted(limit / volt for limit in actuator.ctrlrange)
        actuator.actrange = sorted(limit / volt for limit in actuator.actrange)
        if self.motor.added:
            actuator.damping = linear_polynomial(self.motor.emf_damping, actuator.damping)
            actuator.armature = self.motor.inertia * self.motor.ratio**2


def in_volts(system: System, inputs: Sequence[VoltageInput]) -> System:
    """Return a system with these inputs in volts."""
    names = [voltage.input for voltage in inputs]
    signals = [
        replace(signal, symbol=signal.symbol.replace("τ", "V"), unit="V")
        if actuator in names
        else signal
        for actuator, signal in zip(system.actuators, system.inputs, strict=True)
    ]
    return replace(system, inputs=tuple(signals))
