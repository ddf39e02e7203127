"""The actuators of a robot's MJCF as torque inputs: ideal for the laws, as built for the plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.ground.errors import ModelError

_DYNAMICS = mujoco.mjtDyn
_GAIN = mujoco.mjtGain
_BIAS = mujoco.mjtBias
_TRANSMISSION = mujoco.mjtTrn
_NOT_ON_A_JOINT = {
    _TRANSMISSION.mjTRN_JOINTINPARENT: "acts on a joint in its parent's frame",
    _TRANSMISSION.mjTRN_SLIDERCRANK: "drives a slider-crank",
    _TRANSMISSION.mjTRN_TENDON: "pulls a tendon",
    _TRANSMISSION.mjTRN_SITE: "acts on a site",
    _TRANSMISSION.mjTRN_BODY: "is an adhesion of a body",
    _TRANSMISSION.mjTRN_SO3: "turns a ball joint",
}
_LAGS = (_DYNAMICS.mjDYN_FILTER, _DYNAMICS.mjDYN_FILTEREXACT)
# Integrals of a servo, which are a part of its own loop.
_INTEGRALS = (_DYNAMICS.mjDYN_INTEGRATOR, _DYNAMICS.mjDYN_PID)
# Fields of delays and of lags that act within a timestep.
_TIMING = ("delay", "nsample", "interp", "actearly")
_ANY = (-math.inf, math.inf)
Limits = tuple[float, float]


class TorqueInput(NamedTuple):
    """Torque control of one joint in the place of an actuator.

    Attributes:
        actuator: Name of the actuator.
        joint: Name of the joint.
        limits: Least and largest torque or force [N m or N]; infinite for none.
        built: Fields of the plant's actuator, where it has a lag or a delay that no law knows; its
            input is the same torque. Empty for an ideal one.
        note: Difference from the model's actuator, in words; empty if there is none.
        gear: Torque for a command of 1 of a motor, its gear times its gain; None of a servo.
    """

    actuator: str
    joint: str
    limits: Limits
    built: dict[str, Any]
    note: str
    gear: float | None

    def add_to(self, spec: mujoco.MjSpec, *, as_built: bool = False) -> None:
        """Add the actuator to a model, ideal or as built."""
        # All fields that a model's own defaults could set otherwise.
        ideal: dict[str, Any] = {
            "dyntype": _DYNAMICS.mjDYN_NONE,
            "gaintype": _GAIN.mjGAIN_FIXED,
            "biastype": _BIAS.mjBIAS_NONE,
            "gear": [1.0, *[0.0] * 5],
            "gainprm": [1.0, *[0.0] * 9],
            "biasprm": [0.0] * 10,
            "dynprm": [1.0, *[0.0] * 9],
            "forcelimited": mujoco.mjtLimited.mjLIMITED_FALSE,
        }
        fields = {**ideal, **_bounded("ctrl", self.limits)}
        if as_built:
            fields |= self.built
        spec.add_actuator(
            name=self.actuator,
            target=self.joint,
            trntype=_TRANSMISSION.mjTRN_JOINT,
            **fields,
        )


def torque_input(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str) -> TorqueInput:
    """Read an actuator as torque control of its joint.

    A motor's torque is g k c for a command c in its range, gear g and gain k; a servo, whose bias
    depends on its joint, gives any torque in its force range once its own loop is left out.

    Args:
        spec: The model, all of whose actuators and joints have names.
        model: The same, compiled.
        name: Name of the actuator.

    Raises:
        ModelError: If torque control cannot stand for it, with the reason.
    """
    actuator = spec.actuator(name)
    compiled = model.actuator(name)
    servo = _servo(actuator, compiled)
    reason = _unfit(actuator, compiled, servo)
    if reason:
        raise ModelError(
            f"actuator {name!r} {reason}: torque control of a joint cannot stand for it; name the "
            "actuators to use with actuators=..., and their joints with joints=..."
        )

    joint = model.joint(int(compiled.trnid[0]))
    gear = float(actuator.gear[0])
    gain = 1.0 if servo else float(compiled.gainprm[0])
    limits = _torque_limits(model, compiled, gear, gain, bool(servo))
    strictest = limits.strictest()
    extras = _extras(actuator, compiled)
    built = _built_fields(actuator, limits) if extras else {}

    within = "without limits"
    if math.isfinite(strictest[1]):
        within = f"within [{strictest[0]:g}, {strictest[1]:g}] {joint_unit(model, joint.id)}"
    note = ""
    if extras:
        instead = f" instead of the {servo}" if servo else ""
        note = (
            f"the plant has {' and '.join(extras)}, which no law knows; torque control "
            f"{within}{instead}"
        )
    elif servo:
        note = f"the {servo} is left out, torque control {within} instead"
    elif gear * gain != 1:
        note = (
            f"its input is torque at the joint, with its gear {gear:g} and gain {gain:g} in the "
            f"limits, {within}"
        )
    if note:
        note = f"actuator {name!r}: {note}"
    torque_of_command = None if servo else gear * gain
    return TorqueInput(name, joint.name, strictest, built, note, torque_of_command)


class _TorqueLimits(NamedTuple):
    """Limits of a joint's torque, by their origin."""

    command: Limits
    activation: Limits
    force: Limits
    joint: Limits

    def strictest(self) -> Limits:
        """Return the range within all limits."""
        low = max(limits[0] for limits in self)
        high = min(limits[1] for limits in self)
        return low, high


def _torque_limits(
    model: mujoco.MjModel,
    compiled: Any,
    gear: float,
    gain: float,
    is_servo: bool,
) -> _TorqueLimits:
    """Limits of the torque at an actuator's joint."""
    command = _ANY
    activation = _ANY
    force = _ANY
    joint_limits = _ANY

    # Commands and activations of a servo are positions or velocities.
    if compiled.ctrllimited[0] and not is_servo:
        command = _scaled(gear * gain, compiled.ctrlrange)
    if compiled.actlimited[0] and not is_servo:
        activation = _scaled(gear * gain, compiled.actrange)
    if compiled.forcelimited[0]:
        force = _scaled(gear, compiled.forcerange)
    joint = int(compiled.trnid[0])
    if model.jnt_actfrclimited[joint]:
        joint_limits = _scaled(1.0, model.jnt_actfrcrange[joint])
    return _TorqueLimits(command, activation, force, joint_limits)


def _extras(actuator: mujoco.MjsActuator, compiled: Any) -> list[str]:
    """Lag and delay of an actuator, in words."""
    extras: list[str] = []
    if actuator.dyntype in _LAGS:
        extras.append(f"a lag of {compiled.dynprm[0]:g} s")
    if actuator.nsample > 0:
        extras.append(f"a delay of {actuator.delay:g} s")
    return extras


def _built_fields(actuator: mujoco.MjsActuator, limits: _TorqueLimits) -> dict[str, Any]:
    """Fields of torque control with the lag and the delay of an actuator."""
    fields = {**_bounded("ctrl", limits.command), **_bounded("force", limits.force)}
    fields |= {name: getattr(actuator, name) for name in _TIMING}
    if actuator.dyntype in _LAGS:
        fields |= {"dyntype": actuator.dyntype, "dynprm": actuator.dynprm}
        fields |= _bounded("act", limits.activation)
    return fields


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a joint's torque or force: N m or N."""
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return "N" if slides else "N m"


def _scaled(factor: float, limits: Sequence[float]) -> Limits:
    """Limits times a factor of either sign."""
    low, high = sorted(factor * float(limit) for limit in limits)
    return low, high


def _bounded(field: str, limits: Limits) -> dict[str, Any]:
    """Fields that limit ``ctrl``, ``act`` or ``force`` to a range, if it is finite."""
    if math.isfinite(limits[1]):
        limited = mujoco.mjtLimited.mjLIMITED_TRUE
    else:
        limited = mujoco.mjtLimited.mjLIMITED_FALSE
        limits = (0.0, 0.0)
    return {f"{field}limited": limited, f"{field}range": limits}


def _servo(actuator: mujoco.MjsActuator, compiled: Any) -> str:
    """Kind of the servo with its gains; empty for a motor."""
    if actuator.biastype != _BIAS.mjBIAS_AFFINE:
        return ""

    # Zero is added, for -0.0 would be printed as -0.
    constant, stiffness, damping = compiled.biasprm[:3] * [1.0, -1.0, -1.0] + 0.0
    if stiffness:
        return f"position servo (kp {stiffness:g}, kv {damping:g})"
    if damping:
        return f"velocity servo (kv {damping:g})"
    if constant:
        return f"constant bias {constant:g}"
    return ""


def _unfit(actuator: mujoco.MjsActuator, compiled: Any, servo: str) -> str:
    """Reason why torque control cannot stand for an actuator; empty if it can."""
    dynamics = actuator.dyntype
    gain = actuator.gaintype
    bias = actuator.biastype
    if gain == _GAIN.mjGAIN_MUSCLE or dynamics == _DYNAMICS.mjDYN_MUSCLE:
        return "is a muscle, which pulls by its length and takes no torque"
    if gain == _GAIN.mjGAIN_DCMOTOR:
        return "is a DC motor: make it a motor here, and give its winding in a [[motor]] table"
    if actuator.trntype in _NOT_ON_A_JOINT:
        return _NOT_ON_A_JOINT[actuator.trntype]

    is_integral = bool(servo) and dynamics in _INTEGRALS
    if dynamics not in (_DYNAMICS.mjDYN_NONE, *_LAGS) and not is_integral:
        return f"has activation dynamics ({dynamics.name.removeprefix('mjDYN_').lower()})"
    if gain not in (_GAIN.mjGAIN_FIXED, _GAIN.mjGAIN_PID):
        return "has a gain that depends on the state"
    if dynamics == _DYNAMICS.mjDYN_FILTER and compiled.dynprm[0] <= 0:
        return "has a lag of 0 s, which nothing can simulate"
    if bias not in (_BIAS.mjBIAS_NONE, _BIAS.mjBIAS_AFFINE):
        return f"has a bias of kind {bias.name.removeprefix('mjBIAS_').lower()}"

    if actuator.plugin.active:
        return "is a plugin"
    if actuator.armature or np.any(actuator.damping):
        return "has an armature or damping of its own, which belongs to its joint"
    if actuator.gear[0] == 0 or (compiled.gainprm[0] == 0 and not servo):
        return "has no gear or no gain"
    return ""
