"""Parts of a machine written into a model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, unknown_name
from grosmc_mj.machine.bounces import IMPEDANCE, TEETH, solref
from grosmc_mj.machine.motors import write_motor
from grosmc_mj.machine.names import motor_joint, transmission_of
from grosmc_mj.machine.parts import (
    LuGre,
    MachinePart,
    Motor,
    SlidingLoad,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)
from grosmc_mj.machine.writing import (
    COLOUR,
    ball_radius,
    draw_ball,
    drawn,
    linear,
    write_inertia,
)
from grosmc_mj.physics.files import compile_spec

# How far from an axis a centre is on it [m].
_ON_AXIS = 1e-9
# MuJoCo wants mass and inertia on every body that moves: what is too little to matter.
_TOKEN = 1e-12
# The back-EMF of a motor that is there for its friction only is nothing.
_NO_MOTOR = (1e-12, 0.0)


def build(spec: mujoco.MjSpec, parts: Sequence[MachinePart]) -> None:
    """Write the parts into a model, in an order that does not depend on theirs.

    Raises:
        ModelError: If something is unknown, has two parts of a kind, or cannot have one.
    """
    names = {
        "joint": [joint.name for joint in spec.joints],
        "body": [body.name for body in spec.bodies[1:]],
        "input": [actuator.name for actuator in spec.actuators],
    }
    seen: set[tuple[type, str]] = set()
    for part in parts:
        if part.of not in names[part.owner]:
            raise ModelError(f"{part.kind}: {unknown_name(part.owner, part.of, names[part.owner])}")
        several = isinstance(part, (SwingingLoad, SlidingLoad, Wall))
        if (type(part), part.of) in seen and not several:
            raise ModelError(f"{part.of!r} has two of a {part.kind}: leave one out")
        seen.add((type(part), part.of))
    for kind, write in _WRITERS.items():
        for part in parts:
            if type(part) is kind:
                write(spec, part)


def _transmission(spec: mujoco.MjSpec, part: Transmission) -> None:
    """A coordinate of the motor's own, tied to the joint by a tendon."""
    joint = spec.joint(part.joint)
    driving = [a for a in spec.actuators if a.target == part.joint and _acts_on_joint(a)]
    if not driving:
        raise ModelError(f"transmission: no input drives joint {part.joint!r}: it needs a motor")
    if not part.added:
        _take_off(spec, joint, part)
    name = motor_joint(part.joint)
    # In the world: a motor's speed about its own axis alone counts.
    rotor = spec.worldbody.add_body(
        name=name, explicitinertial=True, mass=_TOKEN, inertia=[_TOKEN] * 3, gravcomp=1.0
    )
    rotor.add_joint(
        name=name,
        type=joint.type,
        axis=[0.0, 1.0, 0.0],
        armature=part.inertia,
        frictionloss=part.friction,
        ref=joint.ref,
    )
    tendon = spec.add_tendon(name=transmission_of(part.joint))
    tendon.wrap_joint(part.joint, -1.0)
    tendon.wrap_joint(name, 1.0)
    half = part.backlash / 2
    tendon.damping = linear(part.damping, tendon.damping)
    tendon.springlength = [-half, half]
    if math.isfinite(part.stiffness):
        tendon.stiffness = linear(part.stiffness, tendon.stiffness)
    else:
        tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        tendon.range = [-half, half]
        tendon.solref_limit, tendon.solimp_limit = solref(*TEETH), IMPEDANCE
    for actuator in driving:
        actuator.target = name


def _take_off(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, part: Transmission) -> None:
    """Take the motor's inertia off what the model has at the joint."""
    if joint.armature >= part.inertia:
        joint.armature -= part.inertia
        return
    model = compile_spec(spec)
    at = model.joint(part.joint).id
    index = int(model.jnt_bodyid[at])
    axis, body = model.jnt_axis[at], spec.body(model.body(index).name)
    turns = model.jnt_type[at] == mujoco.mjtJoint.mjJNT_HINGE
    turn, offset = np.zeros(9), model.body_ipos[index] - model.jnt_pos[at]
    mujoco.mju_quat2Mat(turn, model.body_iquat[index])
    principal = turn.reshape(3, 3).T @ axis
    own = float(model.body_mass[index])
    if turns:
        own = float(principal**2 @ model.body_inertia[index])
    if part.inertia >= own or (turns and np.linalg.norm(np.cross(offset, axis)) > _ON_AXIS):
        raise ModelError(
            f"transmission of {part.joint!r}: its inertia of {part.inertia:g} is no part of what "
            f"the model has there, an armature of {joint.armature:g} or, of a body with its centre "
            f"on the axis, {own:g}: give less, or let it be added"
        )
    kept = 1 - part.inertia / own
    write_inertia(body, kept * float(model.body_mass[index]), model, index)
    body.inertia = kept * model.body_inertia[index]


def _acts_on_joint(actuator: mujoco.MjsActuator) -> bool:
    return actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT


def _lugre(spec: mujoco.MjSpec, part: LuGre) -> None:
    """A motor without an input or a back-EMF, for the friction that MuJoCo's motors have."""
    friction = spec.add_actuator(
        name=f"{part.joint} friction", target=part.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    static = part.static or part.coulomb
    friction.set_to_dcmotor(
        motorconst=_NO_MOTOR,
        resistance=1.0,
        lugre=[part.stiffness, part.damping, part.coulomb, static, part.stribeck],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )


def _stop(spec: mujoco.MjSpec, part: Stop) -> None:
    """A range of the joint."""
    joint = spec.joint(part.joint)
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    joint.range, joint.margin = [part.low, part.high], 0.0
    joint.solref_limit = solref(part.restitution, part.duration)
    joint.solimp_limit = IMPEDANCE


def _load(spec: mujoco.MjSpec, part: SwingingLoad | SlidingLoad, kind: str) -> mujoco.MjsBody:
    """A body on a body, whose mass is not yet there."""
    parent = spec.body(part.body)
    taken = {body.name for body in spec.bodies}
    names = (f"{part.body} {kind}{i}" for i in ("", *range(2, len(taken) + 3)))
    return parent.add_body(
        name=next(name for name in names if name not in taken),
        pos=part.at, explicitinertial=True, mass=part.mass, inertia=[_TOKEN] * 3,
    )  # fmt: skip


def _swinging(spec: mujoco.MjSpec, part: SwingingLoad) -> None:
    load = _load(spec, part, "swing")
    load.ipos = [0.0, 0.0, -part.length]
    hinge = load.add_joint(name=load.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0.0, -1.0, 0.0])
    hinge.damping = linear(part.damping, hinge.damping)
    draw_ball(load, part.mass, pos=load.ipos)
    rod = [ball_radius(part.mass) / 4, 0.0, 0.0]
    drawn(load, mujoco.mjtGeom.mjGEOM_CAPSULE, rod, fromto=[0, 0, 0, *load.ipos])


def _sliding(spec: mujoco.MjSpec, part: SlidingLoad) -> None:
    load = _load(spec, part, "slide")
    slide = load.add_joint(name=load.name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1.0, 0.0, 0.0])
    slide.stiffness = linear(part.stiffness, slide.stiffness)
    slide.damping = linear(part.damping, slide.damping)
    draw_ball(load, part.mass)


def _wall(spec: mujoco.MjSpec, part: Wall) -> None:
    """A plane and a ball that touch each other and nothing else."""
    without = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    if spec.option.disableflags & without:
        spec.option.disableflags &= ~without
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
    number = sum(geom.name.startswith("wall ") for geom in spec.geoms) + 1
    plane = spec.worldbody.add_geom(
        name=f"wall {number}", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.3, 0.3, 0.1],
        pos=part.point, rgba=(0.23, 0.27, 0.32, 0.5), contype=0, conaffinity=0,
    )  # fmt: skip
    turn = np.zeros(4)
    mujoco.mju_quatZ2Vec(turn, np.array(part.normal, float) / np.linalg.norm(part.normal))
    plane.quat = turn
    ball = spec.body(part.body).add_geom(
        name=f"bumper {number}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[part.radius, 0, 0],
        pos=part.at, rgba=COLOUR, contype=0, conaffinity=0, mass=0,
    )  # fmt: skip
    pair = spec.add_pair(geomname1=plane.name, geomname2=ball.name, condim=1)
    pair.solref, pair.solimp = solref(part.restitution, part.duration), IMPEDANCE


# In this order: motors drive what transmissions leave to them, and come before those without input.
_WRITERS: dict[type, Callable[[mujoco.MjSpec, Any], None]] = {
    Stop: _stop,
    SwingingLoad: _swinging,
    SlidingLoad: _sliding,
    Wall: _wall,
    Transmission: _transmission,
    Motor: write_motor,
    LuGre: _lugre,
}
