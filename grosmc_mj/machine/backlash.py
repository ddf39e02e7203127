"""Transmissions that give way: backlash and flexibility between a motor and its joint."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.fields import Flag, Name, checked
from grosmc_mj.machine.bounces import IMPEDANCE, TEETH, solref, spring_and_damper
from grosmc_mj.machine.part import (
    ANGLE,
    DAMPING,
    FORCE,
    INERTIA,
    STIFFNESS,
    TOKEN,
    MachinePart,
    Oscillation,
    not_negative,
    positive,
)
from grosmc_mj.physics.edit import HiddenState
from grosmc_mj.physics.edits import linear, write_inertia
from grosmc_mj.physics.files import compile_spec
from grosmc_mj.physics.hidden_states import motor_joint

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
        inertia: Of the motor, at the joint [kg m^2 or kg].
        stiffness: [N m/rad or N/m]; infinite for teeth that do not give way, with a backlash.
        damping: [N m s/rad or N s/m]; it acts within the backlash too.
        backlash: The whole play [rad or m].
        friction: Dry friction of the motor, at the joint [N m or N].
        added: Whether the inertia comes on top of what the model has; else it is a part of that,
            of the joint's armature or of a body whose centre the joint moves along or turns about.
    """

    joint: Name
    inertia: Annotated[float, positive(INERTIA)]
    stiffness: Annotated[float, positive(STIFFNESS, infinite=True)] = math.inf
    damping: Annotated[float, not_negative(DAMPING)] = 0.0
    backlash: Annotated[float, not_negative(ANGLE)] = 0.0
    friction: Annotated[float, not_negative(FORCE)] = 0.0
    added: Flag = True

    kind, owner, order = "transmission", "joint", 20

    def __post_init__(self) -> None:
        if math.isinf(self.stiffness) and not self.backlash:
            raise ModelError(
                f"transmission of {self.joint!r}: it is rigid: give a stiffness, a backlash or both"
            )

    def __str__(self) -> str:
        faults = {
            f"gives way by 1/{self.stiffness:.4g}": math.isfinite(self.stiffness),
            f"has a play of {self.backlash:.4g}": self.backlash > 0,
        }
        words = " and ".join(fault for fault, present in faults.items() if present)
        return f"{self.joint}: transmission that {words}, motor of {self.inertia:.3g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """A coordinate of the motor's own, tied to the joint by a tendon."""
        joint, name = spec.joint(self.joint), motor_joint(self.joint)
        on_joint = [a for a in spec.actuators if a.trntype == mujoco.mjtTrn.mjTRN_JOINT]
        driving = [actuator for actuator in on_joint if actuator.target == self.joint]
        if not driving:
            raise ModelError(
                f"transmission: no input drives joint {self.joint!r}: it needs a motor"
            )
        if not self.added:
            self._take_off(spec, joint)
        # In the world: a motor's speed about its own axis alone counts.
        rotor = spec.worldbody.add_body(
            name=name, explicitinertial=True, mass=TOKEN, inertia=[TOKEN] * 3, gravcomp=1.0
        )
        rotor.add_joint(
            name=name,
            type=joint.type,
            axis=[0.0, 1.0, 0.0],
            armature=self.inertia,
            frictionloss=self.friction,
            ref=joint.ref,
        )
        tendon, half = spec.add_tendon(name=_tendon(self.joint)), self.backlash / 2
        tendon.wrap_joint(self.joint, -1.0)
        tendon.wrap_joint(name, 1.0)
        tendon.damping = linear(self.damping, tendon.damping)
        tendon.springlength = [-half, half]
        if math.isfinite(self.stiffness):
            tendon.stiffness = linear(self.stiffness, tendon.stiffness)
        else:
            tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            tendon.range = [-half, half]
            tendon.solref_limit, tendon.solimp_limit = solref(*TEETH), IMPEDANCE
        for actuator in driving:
            actuator.target = name

    def _take_off(self, spec: mujoco.MjSpec, joint: mujoco.MjsJoint) -> None:
        """Take the motor's inertia off the model's at the joint."""
        if joint.armature >= self.inertia:
            joint.armature -= self.inertia
            return
        model = compile_spec(spec)
        at = model.joint(self.joint).id
        index = int(model.jnt_bodyid[at])
        axis, body = model.jnt_axis[at], spec.body(model.body(index).name)
        turns = model.jnt_type[at] == mujoco.mjtJoint.mjJNT_HINGE
        turn, offset = np.zeros(9), model.body_ipos[index] - model.jnt_pos[at]
        mujoco.mju_quat2Mat(turn, model.body_iquat[index])
        principal = turn.reshape(3, 3).T @ axis
        own = float(model.body_mass[index])
        if turns:
            own = float(principal**2 @ model.body_inertia[index])
        if self.inertia >= own or (turns and np.linalg.norm(np.cross(offset, axis)) > _ON_AXIS):
            raise ModelError(
                f"transmission of {self.joint!r}: its inertia of {self.inertia:g} is no part of "
                f"what the model has there, an armature of {joint.armature:g} or, of a body with "
                f"its centre on the axis, {own:g}: give less, or let it be added"
            )
        kept = 1 - self.inertia / own
        write_inertia(body, kept * float(model.body_mass[index]), model, index)
        body.inertia = kept * model.body_inertia[index]

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Of motor and joint against each other."""
        if math.isinf(self.stiffness):
            return Oscillation(*spring_and_damper(*TEETH), constrained=True)
        weight = float(model.tendon_invweight0[model.tendon(_tendon(self.joint)).id])
        return Oscillation(self.stiffness * weight, self.damping * weight)

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """The motor's coordinate as a twist against the joint."""
        if state.name != motor_joint(self.joint):
            return state
        at, name = 1 + model.joint(self.joint).id, f"{self.joint} twist"
        return replace(state, name=name, kind="twist", minus=at, play=self.backlash)


def _tendon(joint: str) -> str:
    """Name of the tendon that ties a motor to its joint."""
    return f"{joint} transmission"


def driven_joint(spec: mujoco.MjSpec, target: str) -> str:
    """The joint behind a transmission whose motor is a target, or the target itself."""
    tied = (joint.name for joint in spec.joints if motor_joint(joint.name) == target)
    return next((joint for joint in tied if spec.tendon(_tendon(joint)) is not None), target)
