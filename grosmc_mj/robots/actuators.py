"""A robot's actuators as torque control: what each can give its joint, or why it cannot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError

_TRANSMISSIONS = {
    mujoco.mjtTrn.mjTRN_JOINTINPARENT: "acts on a joint in its parent's frame",
    mujoco.mjtTrn.mjTRN_SLIDERCRANK: "drives a slider-crank",
    mujoco.mjtTrn.mjTRN_TENDON: "pulls a tendon",
    mujoco.mjtTrn.mjTRN_SITE: "acts on a site",
    mujoco.mjtTrn.mjTRN_BODY: "is an adhesion of a body",
    mujoco.mjtTrn.mjTRN_SO3: "turns a ball joint",
}

_LAGS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
# Integrals of a servo, which are a part of its own loop.
_INTEGRALS = (mujoco.mjtDyn.mjDYN_INTEGRATOR, mujoco.mjtDyn.mjDYN_PID)
_INPUT = mujoco.mjtCtrlInput


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
    depends on its joint, gives any torque in its force range once its own loop is left out, and so
    does a DC motor with an inner controller.

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
    gear, gain = _gear(model, index), _gain(model, index)
    servo, control = _servo(model, index), int(model.actuator_ctrladr[index])
    commands = (-math.inf, math.inf)
    if not servo and model.actuator_ctrllimited[control]:
        commands = scaled(gain, model.actuator_ctrlrange[control])
    asked = scaled(gear, commands)
    if not servo and model.actuator_actlimited[index]:
        commands = _within(commands, scaled(gain, model.actuator_actrange[index]))
    if supply := _supply(model, index):
        most = supply * float(model.actuator_gainprm[index, 1] / model.actuator_gainprm[index, 0])
        commands = _within(commands, (-most, most))
    if model.actuator_forcelimited[index]:
        commands = _within(commands, model.actuator_forcerange[index])
    low, high = scaled(gear, commands)
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


def _driven(model: mujoco.MjModel, index: int) -> bool:
    """Whether it is a DC motor whose driver makes up for its back-EMF: all but one on a voltage."""
    on_voltage = model.actuator_ctrlspec[index] == int(_INPUT.mjINPUT_VOLTAGE)
    return _is_dcmotor(model, index) and not on_voltage


def _supply(model: mujoco.MjModel, index: int) -> float:
    """Largest voltage of a DC motor's driver [V]; 0 for none, as for an input in volts."""
    return float(model.actuator_gainprm[index, 7]) if _driven(model, index) else 0.0


def _gear(model: mujoco.MjModel, index: int) -> float:
    """Torque at the joint for one unit of force."""
    return float(model.actuator_gear[model.actuator_outadr[index], 0])


def _gain(model: mujoco.MjModel, index: int) -> float:
    """Force for one unit of control, of a motor at rest; 1 of a servo, which has another unit."""
    if _servo(model, index) or _driven(model, index):
        return 1.0
    if _is_dcmotor(model, index):
        return float(model.actuator_gainprm[index, 1] / model.actuator_gainprm[index, 0])
    return float(model.actuator_gainprm[index, 0])


def _beyond(spec: mujoco.MjSpec, model: mujoco.MjModel, index: int) -> str:
    """What an actuator does beyond torque control, in words; empty for nothing."""
    own, found = spec.actuator(model.actuator(index).name), []
    dynamics = mujoco.mjtDyn(int(model.actuator_dyntype[index]))
    if dynamics in _LAGS:
        found.append(f"a lag of {model.actuator_dynprm[index, 0]:g} s")
    if _driven(model, index):
        supply = _supply(model, index)
        within = f" within {supply:g} V" if supply else ""
        found.append(f"a DC motor with a driver of its current{within}")
    elif _is_dcmotor(model, index):
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
        return "is a muscle, which pulls by its length and takes no torque"
    if transmission in _TRANSMISSIONS:
        return _TRANSMISSIONS[transmission]
    dcmotor = _is_dcmotor(model, index)
    if dcmotor and model.actuator_ctrlspec[index] == int(_INPUT.mjINPUT_NONE):
        return "is a DC motor without an input, which actuators=... can leave out"
    known = (mujoco.mjtDyn.mjDYN_NONE, *_LAGS, *(_INTEGRALS if _servo(model, index) else ()))
    if dynamics not in known and not dcmotor:
        return f"has activation dynamics ({dynamics.name.removeprefix('mjDYN_').lower()})"
    if gain not in (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_PID) and not dcmotor:
        return "has a gain that depends on the state"
    if dynamics == mujoco.mjtDyn.mjDYN_FILTER and model.actuator_dynprm[index, 0] <= 0:
        return "has a lag of 0 s, which nothing can simulate"
    if not dcmotor and bias not in (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE):
        return f"has a bias of kind {bias.name.removeprefix('mjBIAS_').lower()}"
    if own.plugin.active:
        return "is a plugin"
    if own.armature or np.any(own.damping):
        return "has an armature or damping of its own, which belongs to its joint"
    if _gear(model, index) == 0 or _gain(model, index) == 0:
        return "has no gear or no gain"
    return ""


def _servo(model: mujoco.MjModel, index: int) -> str:
    """What kind of servo an actuator is; empty for a motor."""
    if _driven(model, index):
        kp, ki, kd = (float(each) for each in model.actuator_gainprm[index, 4:7])
        inputs = int(model.actuator_ctrlspec[index])
        if inputs & int(_INPUT.mjINPUT_POS):
            return f"inner position controller (kp {kp:g}, ki {ki:g}, kd {kd:g})"
        velocity = inputs & int(_INPUT.mjINPUT_VEL)
        return f"inner velocity controller (kd {kd:g})" if velocity else ""
    if mujoco.mjtBias(int(model.actuator_biastype[index])) != mujoco.mjtBias.mjBIAS_AFFINE:
        return ""
    constant, of_position, of_velocity = model.actuator_biasprm[index, :3]
    if of_position:
        return f"position servo (kp {0.0 - of_position:g}, kv {0.0 - of_velocity:g})"
    if of_velocity:
        return f"velocity servo (kv {0.0 - of_velocity:g})"
    return f"constant bias {constant:g}" if constant else ""


def scaled(factor: float, limits: Sequence[float]) -> tuple[float, float]:
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
