"""Friction of a drive: Coulomb, viscous, Stribeck and load-dependent, models M1 to M6 of BAM.

M. Duclusaud, G. Passault, V. Padois and O. Ly, "Extended friction models for the physics simulation
of servo actuators", arXiv 2410.08650, 2024, and the project Better Actuator Models, whose source,
github.com/Rhoban/bam, has the signs of the loads and the quadratic term:

    limit(v) = F_c + |k_e tau_e - k_m tau_m|
               + exp(-|v/v_s|^a) (F_s + |s_e tau_e - s_m tau_m| + quadratic)

with the torque tau_m of the motor and the torque tau_e of everything else that acts on the joint. A
joint that moves is braked by the limit and b |v|; one at rest is held by at most the limit. Torques
of opposite signs load the teeth of a gear with their sum. The quadratic term acts while they have
opposite signs: q_e tau_e^2 while the motor is the stronger one, q_m tau_m^2 while it is the weaker.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Any

import mujoco

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Name, Range, checked
from grosmc_mj.mechanics.machine.part import (
    LEAST,
    MOST,
    MachinePart,
    not_negative,
)
from grosmc_mj.mechanics.physics.dry_friction import set_dry_friction
from grosmc_mj.mechanics.physics.hidden_states import motor_joint
from grosmc_mj.theory.plants.owner_units import DAMPING, FORCE, SPEED, JointUnit

# Of published servos the shares of a torque are 2e-6 to 0.26.
_SHARE = Range(0, MOST, usual=(1e-7, 2))
_QUADRATIC = Range(0, MOST, JointUnit("N^-1 m^-1", "N^-1"), usual=(1e-9, 1e3))
# Any power of a speed that is this many times v_s is a float, and exp(-power) is nothing.
_FAST = 1e30
# Friction is off with any of these.
_WITHOUT = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS


@checked(ModelError)
class DriveFriction(MachinePart):
    """Friction of the drive of a joint; behind a transmission that of its motor.

    M1 has ``coulomb`` and ``viscous``; M2 the Stribeck force, speed and exponent, too; M3 and M4
    are M1 and M2 with equal shares of both torques; M5 has a share of each; M6 all.

    Attributes:
        joint: Name of the joint.
        coulomb: F_c [N m or N].
        viscous: b, on top of the joint's damping [N m s/rad or N s/m].
        load_motor: k_m, share of the motor's torque.
        load_external: k_e, share of the external torque.
        stribeck_force: F_s, by which friction at rest is larger [N m or N].
        stribeck_motor: s_m, share of the motor's torque at rest.
        stribeck_external: s_e, share of the external torque at rest.
        quadratic_motor: q_m [1/(N m) or 1/N].
        quadratic_external: q_e [1/(N m) or 1/N].
        stribeck_speed: v_s [rad/s or m/s].
        stribeck_exponent: a.
    """

    joint: Name
    coulomb: Annotated[float, not_negative(FORCE)]
    viscous: Annotated[float, not_negative(DAMPING)] = 0.0
    load_motor: Annotated[float, _SHARE] = 0.0
    load_external: Annotated[float, _SHARE] = 0.0
    stribeck_force: Annotated[float, not_negative(FORCE)] = 0.0
    stribeck_motor: Annotated[float, _SHARE] = 0.0
    stribeck_external: Annotated[float, _SHARE] = 0.0
    quadratic_motor: Annotated[float, _QUADRATIC] = 0.0
    quadratic_external: Annotated[float, _QUADRATIC] = 0.0
    stribeck_speed: Annotated[float, Range(0, MOST, SPEED, usual=(1e-6, 1e3))] = 0.0
    stribeck_exponent: Annotated[float, Range(0.1, 10)] = 2.0

    kind = "drive friction"
    effect = "friction"
    owner = "joint"
    order = 23
    stepped = True

    def __post_init__(self) -> None:
        at_rest = (
            self.stribeck_force
            or self.stribeck_motor
            or self.stribeck_external
            or self.quadratic_motor
            or self.quadratic_external
        )
        if at_rest and self.stribeck_speed < LEAST:
            raise ModelError(
                f"drive friction of {self.joint!r}: its Stribeck terms need a stribeck_speed, at "
                f"least {LEAST:g}"
            )

    def __str__(self) -> str:
        text = f"{self.joint}: drive friction of {self.coulomb + self.stribeck_force:.3g} at rest"
        shares: list[str] = []
        if self.load_motor or self.stribeck_motor:
            shares.append(f"{self.load_motor + self.stribeck_motor:.3g} of the motor's torque")
        if self.load_external or self.stribeck_external:
            shares.append(f"{self.load_external + self.stribeck_external:.3g} of the load's")
        return " and ".join([text, *shares])

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Give the joint dry friction that holds, and note the numbers that each step needs."""
        self._refuse_other_friction(spec)

        driven = spec.joint(motor_joint(self.joint)) or spec.joint(self.joint)
        damping = driven.damping.copy()
        damping[0] += self.viscous
        driven.damping = damping
        # Without dry friction MuJoCo would leave the constraint out.
        set_dry_friction(spec, driven, max(self.coulomb + self.stribeck_force, LEAST))

        numbers = [getattr(self, name) for name in NUMBERS]
        spec.add_numeric(name=f"{driven.name}{_NUMERIC}", data=numbers, size=len(numbers))

    def _refuse_other_friction(self, spec: mujoco.MjSpec) -> None:
        """Refuse a joint with other friction, and a model in which this one is not computed.

        Raises:
            ModelError: With what is in the way.
        """
        mistake = ""
        joints = [spec.joint(self.joint), spec.joint(motor_joint(self.joint))]
        others = [joint.frictionloss for joint in joints if joint and joint.frictionloss]
        if others:
            mistake = f"the joint has a dry friction of {others[0]:g} as well: set that to 0"
        elif spec.actuator(f"{self.joint} friction"):
            mistake = "the joint has a [[lugre]] as well: take one of them"
        elif spec.option.disableflags & int(_WITHOUT):
            mistake = "the model disables constraints or dry friction"
        elif spec.option.noslip_iterations:
            mistake = "it holds without the model's noslip_iterations: set them to 0"
        if mistake:
            raise ModelError(f"drive friction of {self.joint!r}: {mistake}")


# Names of the part's numbers, in their order in a model.
NUMBERS = tuple(item.name for item in fields(DriveFriction) if item.name != "joint")
# End of the name of a model's ``numeric`` that has the numbers of a joint.
_NUMERIC = " drive friction"


def has_drive_friction(model: mujoco.MjModel) -> bool:
    """True if a joint of a compiled model has friction of its drive."""
    return any(drive_frictions(model))


def drive_frictions(model: mujoco.MjModel) -> Iterator[tuple[int, list[float]]]:
    """Yield the degree of freedom and the numbers, in the order of ``NUMBERS``, of each part."""
    for index in range(model.nnumeric):
        numeric = model.numeric(index)
        if numeric.name.endswith(_NUMERIC):
            joint = model.joint(numeric.name.removesuffix(_NUMERIC))
            yield int(joint.dofadr[0]), numeric.data.tolist()


@jitable
def friction_limit(v: float, motor: float, external: float, p: Any) -> float:
    """Largest dry friction at a speed v, see the module.

    Args:
        v: Speed [rad/s or m/s].
        motor: tau_m [N m or N].
        external: tau_e [N m or N].
        p: Numbers of a ``DriveFriction``.
    """
    limit = p.coulomb + abs(p.load_external * external - p.load_motor * motor)
    if p.stribeck_speed == 0.0:
        return limit

    at_rest = p.stribeck_force + abs(p.stribeck_external * external - p.stribeck_motor * motor)
    if motor * external < 0.0:
        if abs(external) < abs(motor):
            at_rest += p.quadratic_external * external * external
        else:
            at_rest += p.quadratic_motor * motor * motor

    speed = min(abs(v) / p.stribeck_speed, _FAST)
    return limit + math.exp(-math.pow(speed, p.stribeck_exponent)) * at_rest
