"""Transmissions that give way: backlash and flexibility between a motor and its joint."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import mujoco
import numpy as np

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import Flag, Name, Range, checked
from grosmc_mj.mechanics.machine.bounces import solref, spring_and_damper
from grosmc_mj.mechanics.machine.part import (
    TOKEN,
    MachinePart,
    Oscillation,
    not_negative,
    positive,
)
from grosmc_mj.mechanics.physics.dry_friction import STIFFEST, set_dry_friction
from grosmc_mj.mechanics.physics.edit import HiddenState
from grosmc_mj.mechanics.physics.edits import linear_polynomial, write_inertia
from grosmc_mj.mechanics.physics.files import compile_spec
from grosmc_mj.mechanics.physics.hidden_states import motor_joint
from grosmc_mj.theory.plants.owner_units import ANGLE, DAMPING, FORCE, INERTIA, STIFFNESS

# How far from an axis a centre is on it [m].
_ON_AXIS = 1e-9


@checked(ModelError)
class Transmission(MachinePart):
    """A gear, belt or shaft that gives way between a motor and its joint.

    The motor has a coordinate of its own, seen at the joint, with its kinetic energy about its own
    axis only: M. W. Spong, "Modeling and control of elastic joint robots", J. Dyn. Sys., Meas.,
    Control 109, 1987. As the stiffness grows and the backlash shrinks, the joint becomes a rigid
    one with the motor's inertia as its armature.

    Attributes:
        joint: Name of the joint, which an input drives.
        inertia: Inertia of the motor, at the joint [kg m^2 or kg].
        stiffness: Stiffness [N m/rad or N/m]; infinite for teeth that do not give way, with a
            backlash.
        damping: Damping [N m s/rad or N s/m]; it acts within the backlash too.
        backlash: The whole play [rad or m].
        friction: Dry friction of the motor, at the joint [N m or N].
        restitution: Speed after a bounce of rigid teeth over that before it, from 0 to below 1.
        duration: Duration of a bounce of rigid teeth [s]: the shorter, the harder.
        added: True if the inertia comes on top of the model's; else it is a part of that, of the
            joint's armature or of a body whose centre the joint moves along or turns about.
    """

    joint: Name
    inertia: Annotated[float, positive(INERTIA)]
    stiffness: Annotated[float, positive(STIFFNESS, infinite=True)] = math.inf
    damping: Annotated[float, not_negative(DAMPING)] = 0.0
    backlash: Annotated[float, not_negative(ANGLE)] = 0.0
    friction: Annotated[float, not_negative(FORCE)] = 0.0
    restitution: Annotated[float, Range(0, 1, below=True)] = 0.1
    duration: Annotated[float, positive("s")] = 4e-3
    added: Flag = True

    kind = "transmission"
    owner = "joint"
    order = 20

    def __post_init__(self) -> None:
        if math.isinf(self.stiffness) and not self.backlash:
            raise ModelError(
                f"transmission of {self.joint!r}: it is rigid: give a stiffness, a backlash or both"
            )

    def __str__(self) -> str:
        faults: list[str] = []
        if math.isfinite(self.stiffness):
            faults.append(f"gives way by 1/{self.stiffness:.4g}")
        if self.backlash > 0:
            faults.append(f"has a play of {self.backlash:.4g}")
        words = " and ".join(faults)
        return f"{self.joint}: transmission that {words}, motor of {self.inertia:.3g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Add a coordinate of the motor's own, tied to the joint by a tendon."""
        on_joint = [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT]
        driving = [actuator for actuator in on_joint if actuator.target == self.joint]
        if not driving:
            raise ModelError(
                f"transmission: no input drives joint {self.joint!r}: it needs a motor"
            )

        joint = spec.joint(self.joint)
        if not self.added:
            self._take_off(spec, joint)
        self._add_rotor(spec, joint)
        self._add_tendon(spec)
        for actuator in driving:
            actuator.target = motor_joint(self.joint)

    def _add_rotor(self, spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
        """Add the motor, whose coordinate is seen at the joint."""
        name = motor_joint(self.joint)
        # In the world: a motor's speed about its own axis alone counts.
        rotor = spec.worldbody.add_body(
            name=name,
            explicitinertial=True,
            mass=TOKEN,
            inertia=[TOKEN] * 3,
            gravcomp=1.0,
        )
        motor = rotor.add_joint(
            name=name,
            type=joint.type,
            axis=[0.0, 1.0, 0.0],
            armature=self.inertia,
            ref=joint.ref,
        )
        set_dry_friction(spec, motor, self.friction)

    def _add_tendon(self, spec: mujoco.MjSpec) -> None:
        """Tie motor and joint; the tendon's length is the twist between them."""
        half = self.backlash / 2
        tendon = spec.add_tendon(name=_tendon(self.joint))
        tendon.wrap_joint(self.joint, -1.0)
        tendon.wrap_joint(motor_joint(self.joint), 1.0)
        tendon.damping = linear_polynomial(self.damping, tendon.damping)
        tendon.springlength = [-half, half]
        if math.isfinite(self.stiffness):
            tendon.stiffness = linear_polynomial(self.stiffness, tendon.stiffness)
        else:
            tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            tendon.range = [-half, half]
            tendon.solref_limit = solref(self.restitution, self.duration)
            tendon.solimp_limit = STIFFEST

    def _take_off(self, spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
        """Take the motor's inertia off the model's at the joint."""
        if joint.armature >= self.inertia:
            joint.armature -= self.inertia
            return

        model = compile_spec(spec)
        joint_index = model.joint(self.joint).id
        index = int(model.jnt_bodyid[joint_index])
        axis = model.jnt_axis[joint_index]

        # Inertia of the body along the joint's coordinate.
        body_inertia = float(model.body_mass[index])
        centred = True
        if model.jnt_type[joint_index] == mujoco.mjtJoint.mjJNT_HINGE:
            rotation = np.zeros(9)
            mujoco.mju_quat2Mat(rotation, model.body_iquat[index])
            principal = rotation.reshape(3, 3).T @ axis
            body_inertia = float(principal**2 @ model.body_inertia[index])
            offset = model.body_ipos[index] - model.jnt_pos[joint_index]
            centred = bool(np.linalg.norm(np.cross(offset, axis)) <= _ON_AXIS)

        if self.inertia >= body_inertia or not centred:
            raise ModelError(
                f"transmission of {self.joint!r}: its inertia of {self.inertia:g} is no part of "
                f"what the model has there, an armature of {joint.armature:g} or, of a body with "
                f"its centre on the axis, {body_inertia:g}: give less, or let it be added"
            )

        kept = 1 - self.inertia / body_inertia
        body = spec.body(model.body(index).name)
        write_inertia(body, kept * float(model.body_mass[index]), model, index)
        body.inertia = kept * model.body_inertia[index]

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Motion of motor and joint against each other."""
        if math.isinf(self.stiffness):
            return Oscillation(
                *spring_and_damper(self.restitution, self.duration), constrained=True
            )
        weight = float(model.tendon_invweight0[model.tendon(_tendon(self.joint)).id])
        return Oscillation(self.stiffness * weight, self.damping * weight)

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """Rename the motor's coordinate to a twist against the joint."""
        if state.name != motor_joint(self.joint):
            return state
        return replace(
            state,
            name=f"{self.joint} twist",
            kind="twist",
            minus=1 + model.joint(self.joint).id,
            play=self.backlash,
        )


def _tendon(joint: str) -> str:
    """Name of the tendon that ties a motor to its joint."""
    return f"{joint} transmission"


def driven_joint(spec: mujoco.MjSpec, target: str) -> str:
    """Name of the joint behind a transmission whose motor is a target, or the target itself."""
    for joint in spec.joints:
        is_motor = motor_joint(joint.name) == target
        if is_motor and spec.tendon(_tendon(joint.name)) is not None:
            return joint.name
    return target
