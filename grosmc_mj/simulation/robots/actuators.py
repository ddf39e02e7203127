"""A robot's actuators as torque control: what each can give its joint, or why it cannot."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.simulation.machine.motors import in_units_of, volts_for

_TRANSMISSIONS = {
    mujoco.mjtTrn.mjTRN_JOINTINPARENT: "acts on a joint in its parent's frame",
    mujoco.mjtTrn.mjTRN_SLIDERCRANK: "drives a slider-crank",
    mujoco.mjtTrn.mjTRN_TENDON: "pulls a tendon",
    mujoco.mjtTrn.mjTRN_SITE: "acts on a site",
    mujoco.mjtTrn.mjTRN_BODY: "is an adhesion of a body",
    mujoco.mjtTrn.mjTRN_SO3: "turns a ball joint",
}

_LAGS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
# What an editable actuator is, beside its name and what it acts on.
_KEPT = (
    "gear", "gaintype", "gainprm", "biastype", "biasprm", "dyntype", "dynprm", "actdim",
    "actlimited", "actrange", "actearly", "ctrllimited", "ctrlrange", "forcelimited", "forcerange",
    "delay", "nsample", "interp", "ctrlspec",
)  # fmt: skip


class Drive(NamedTuple):
    """What torque control of one joint has.

    Attributes:
        name: Of the actuator.
        joint: Of the joint.
        low: Least torque or force [N m or N]; -inf for none.
        high: Largest.
        said: How it differs from the model's actuator; empty if it does not.
        built: Whether the plant has the model's actuator, which does more than the laws believe.
        asked: Range of what can be asked for, of a motor at rest [N m or N]; infinite for none.
    """

    name: str
    joint: str
    low: float
    high: float
    said: str
    built: bool = False
    asked: tuple[float, float] = (-math.inf, math.inf)


def torque_drives(spec: mujoco.MjSpec, names: Sequence[str]) -> tuple[Drive, ...]:
    """The named actuators as torque control of their joints.

    A motor's torque is g k c for a command c in its range, gear g and gain k; a servo, whose bias
    depends on its joint, gives any torque in its force range once its own loop is left out.

    Args:
        spec: The model, all of whose actuators and joints have names.
        names: Of the actuators.

    Raises:
        ModelError: If one cannot be replaced, with the reason.
    """
    model = spec.compile()
    drives = tuple(_drive(spec, model, model.actuator(name).id) for name in names)
    for drive in drives:
        same = [each.name for each in drives if each.joint == drive.joint]
        if len(same) > 1:
            raise ModelError(
                f"joint {drive.joint!r} has {len(same)} actuators, {', '.join(same)}: name the one "
                "to use with actuators=..."
            )
    return drives


def _drive(spec: mujoco.MjSpec, model: mujoco.MjModel, index: int) -> Drive:
    """One actuator as torque control."""
    name, reason = model.actuator(index).name, _unfit(spec, model, index)
    if reason:
        raise ModelError(
            f"actuator {name!r} {reason}: torque control of a joint cannot stand for it"
        )
    joint = int(model.actuator_trnid[index, 0])
    beyond = _beyond(spec, model, index)
    gear, gain = float(model.actuator_gear[index, 0]), _gain(model, index)
    servo = _servo(model, index)
    commands = (-math.inf, math.inf)
    if not servo and model.actuator_ctrllimited[index]:
        commands = _scaled(gain, model.actuator_ctrlrange[index])
    asked = _scaled(gear, commands)
    if model.actuator_actlimited[index]:
        commands = _within(commands, _scaled(gain, model.actuator_actrange[index]))
    if model.actuator_forcelimited[index]:
        commands = _within(commands, model.actuator_forcerange[index])
    low, high = _scaled(gear, commands)
    if model.jnt_actfrclimited[joint]:
        low, high = _within((low, high), model.jnt_actfrcrange[joint])
    unit = joint_unit(model, joint)
    limits = f"within [{low:g}, {high:g}] {unit}" if math.isfinite(high - low) else "without limits"
    said = ""
    if beyond:
        said = f"actuator {name!r}: the plant has {beyond}, which no law knows; torque control "
        said += f"{limits} instead of the {servo}" if servo else limits
    elif servo:
        said = f"actuator {name!r}: the {servo} is left out, torque control {limits} instead"
    elif gear * gain != 1:
        said = f"actuator {name!r}: its input is torque at the joint, with its gear {gear:g} and "
        said += f"gain {gain:g} in the limits, {limits}"
    return Drive(name, model.joint(joint).name, low, high, said, bool(beyond), asked)


def _is_dcmotor(model: mujoco.MjModel, index: int) -> bool:
    """Whether it is one of MuJoCo's DC motors."""
    return mujoco.mjtGain(int(model.actuator_gaintype[index])) == mujoco.mjtGain.mjGAIN_DCMOTOR


def _gain(model: mujoco.MjModel, index: int) -> float:
    """Force for one unit of control, of a motor at rest."""
    if _is_dcmotor(model, index):
        return float(model.actuator_gainprm[index, 1] / model.actuator_gainprm[index, 0])
    return float(model.actuator_gainprm[index, 0])


def _beyond(spec: mujoco.MjSpec, model: mujoco.MjModel, index: int) -> str:
    """What an actuator does beyond torque control, in words; empty for nothing."""
    own, found = spec.actuator(model.actuator(index).name), []
    dynamics = mujoco.mjtDyn(int(model.actuator_dyntype[index]))
    if dynamics in _LAGS:
        found.append(f"a lag of {model.actuator_dynprm[index, 0]:g} s")
    if _is_dcmotor(model, index):
        found.append("a DC motor with its back-EMF")
    if own.nsample:
        found.append(f"a delay of {own.delay:g} s")
    return " and ".join(found)


def _unfit(spec: mujoco.MjSpec, model: mujoco.MjModel, index: int) -> str:
    """Why torque control cannot stand for an actuator; empty if it can."""
    own = spec.actuator(model.actuator(index).name)
    transmission = mujoco.mjtTrn(int(model.actuator_trntype[index]))
    dynamics = mujoco.mjtDyn(int(model.actuator_dyntype[index]))
    gain = mujoco.mjtGain(int(model.actuator_gaintype[index]))
    bias = mujoco.mjtBias(int(model.actuator_biastype[index]))
    if mujoco.mjtGain.mjGAIN_MUSCLE == gain or dynamics == mujoco.mjtDyn.mjDYN_MUSCLE:
        return "is a muscle"
    if transmission in _TRANSMISSIONS:
        return _TRANSMISSIONS[transmission]
    dcmotor = _is_dcmotor(model, index)
    if dcmotor and model.actuator_ctrlspec[index] != int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE):
        return "is a DC motor with an inner controller"
    if dynamics not in (mujoco.mjtDyn.mjDYN_NONE, *_LAGS) and not dcmotor:
        return f"has activation dynamics ({dynamics.name.removeprefix('mjDYN_').lower()})"
    if gain != mujoco.mjtGain.mjGAIN_FIXED and not dcmotor:
        return "has a gain that depends on the state"
    if dynamics in _LAGS and bias != mujoco.mjtBias.mjBIAS_NONE:
        return "is a servo behind a lag"
    if dynamics == mujoco.mjtDyn.mjDYN_FILTER and model.actuator_dynprm[index, 0] <= 0:
        return "has a lag of 0 s, which nothing can simulate"
    if not dcmotor and bias not in (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE):
        return f"has a bias of kind {bias.name.removeprefix('mjBIAS_').lower()}"
    if own.plugin.active:
        return "is a plugin"
    if own.armature or np.any(own.damping):
        return "has an armature or damping of its own, which belongs to its joint"
    if model.actuator_gear[index, 0] == 0 or _gain(model, index) == 0:
        return "has no gear or no gain"
    return ""


def _servo(model: mujoco.MjModel, index: int) -> str:
    """What kind of servo an actuator is; empty for a motor."""
    if mujoco.mjtBias(int(model.actuator_biastype[index])) == mujoco.mjtBias.mjBIAS_NONE:
        return ""
    constant, of_position, of_velocity = model.actuator_biasprm[index, :3]
    if of_position:
        return f"position servo (kp {0.0 - of_position:g}, kv {0.0 - of_velocity:g})"
    if of_velocity:
        return f"velocity servo (kv {0.0 - of_velocity:g})"
    return f"constant bias {constant:g}" if constant else ""


def _scaled(factor: float, limits: Sequence[float]) -> tuple[float, float]:
    """Limits times a factor of either sign."""
    low, high = sorted((factor * float(limits[0]), factor * float(limits[1])))
    return low, high


def _within(limits: tuple[float, float], others: Sequence[float]) -> tuple[float, float]:
    """What is within both."""
    return max(limits[0], float(others[0])), min(limits[1], float(others[1]))


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """N m or N."""
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return "N" if slides else "N m"


def write_drives(spec: mujoco.MjSpec, drives: Sequence[Drive], *, as_built: bool = False) -> None:
    """Replace all actuators of a model by torque control of these joints, in this order.

    Args:
        spec: The model.
        drives: What takes their places.
        as_built: Whether actuators that do more are kept, with torque at the joint as their input.
    """
    own = {actuator.name: _kept(actuator) for actuator in spec.actuators}
    for actuator in spec.actuators:
        spec.delete(actuator)
    for drive in drives:
        limited = math.isfinite(drive.low) and math.isfinite(drive.high)
        if not limited and (math.isfinite(drive.low) or math.isfinite(drive.high)):
            raise ModelError(f"actuator {drive.name!r} is limited on one side only")
        motor = spec.add_actuator(
            name=drive.name,
            target=drive.joint,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            dyntype=mujoco.mjtDyn.mjDYN_NONE,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_NONE,
            ctrllimited=mujoco.mjtLimited(int(limited)),
            forcelimited=mujoco.mjtLimited.mjLIMITED_FALSE,
            ctrlrange=[drive.low, drive.high] if limited else [0.0, 0.0],
        )
        # A model's own defaults do not count here.
        motor.gear, motor.gainprm = [1.0, *[0.0] * 5], [1.0, *[0.0] * 9]
        motor.biasprm, motor.dynprm = [0.0] * 10, [1.0, *[0.0] * 9]
        if as_built and drive.built:
            _build(motor, own[drive.name], drive)


def _kept(actuator: mujoco.MjsActuator) -> dict[str, Any]:
    """What an actuator is, by value."""
    return {name: copy.copy(getattr(actuator, name)) for name in _KEPT}


def _build(motor: mujoco.MjsActuator, own: Mapping[str, Any], drive: Drive) -> None:
    """Make an actuator what the model has, with torque at the joint as its input."""
    for name, value in own.items():
        setattr(motor, name, value)
    gear, gain = float(own["gear"][0]), np.array(own["gainprm"], float)
    if own["gaintype"] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        c = volts_for(1.0, gear, constant=float(gain[1]), resistance=float(gain[0]))
        constant, gain[0] = in_units_of(c, constant=float(gain[1]), resistance=float(gain[0]))
        gain[1] = abs(constant)
        dynamics = np.array(own["dynprm"], float)
        dynamics[1] *= abs(c)
        motor.dynprm = dynamics
        if c < 0:
            raise ModelError(f"actuator {drive.name!r} is a DC motor with a negative gear")
    else:
        # Activations are torques now, too, and a servo's own loop is left out.
        factor, gain[0] = gear * gain[0], 1.0 / gear
        motor.actrange = _scaled(factor, own["actrange"])
        motor.biastype, motor.biasprm = mujoco.mjtBias.mjBIAS_NONE, [0.0] * 10
    motor.gainprm = gain
    # Limits of forces stay: a motor on a voltage may be asked for more than it gives at rest.
    motor.ctrllimited = mujoco.mjtLimited(int(math.isfinite(drive.asked[1])))
    motor.ctrlrange = drive.asked if math.isfinite(drive.asked[1]) else [0.0, 0.0]
