"""A robot's actuators written anew: torque at the joint is the input of all of them."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.machine.motor import in_units_of, volts_for
from grosmc_mj.robots.actuators import Drive, scaled

_INPUT = mujoco.mjtCtrlInput
# What an editable actuator is, beside its name and what it acts on.
_KEPT = (
    "gear", "gaintype", "gainprm", "biastype", "biasprm", "dyntype", "dynprm", "actdim",
    "actlimited", "actrange", "actearly", "ctrllimited", "ctrlrange", "forcelimited", "forcerange",
    "delay", "nsample", "interp", "ctrlspec",
)  # fmt: skip
# Of MuJoCo's DC motors: where the numbers of the inner controller stand, and those of which each
# that is not zero has a state: thermal resistance, stiffness of bristles, time constant.
_CONTROLLER_GAINS, _CONTROLLER_STATES, _STATES = slice(4, 7), slice(7, 9), (2, 5, 0)


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
    if own["gaintype"] == mujoco.mjtGain.mjGAIN_DCMOTOR:
        _at_joint(motor, own)
        _commanded(motor, own)
    else:
        _without_servo(motor, own)
    # Limits of forces stay: a motor on a voltage may be asked for more than it gives at rest.
    motor.ctrllimited = mujoco.mjtLimited(int(math.isfinite(drive.asked[1])))
    motor.ctrlrange = drive.asked if math.isfinite(drive.asked[1]) else [0.0, 0.0]


def _without_servo(motor: mujoco.MjsActuator, own: Mapping[str, Any]) -> None:
    """Leave a servo's own loop out, and make what it remembers a torque."""
    gear, gain = float(own["gear"][0]), np.array(own["gainprm"], float)
    affine = own["biastype"] == mujoco.mjtBias.mjBIAS_AFFINE
    servo = affine and bool(np.any(own["biasprm"][:3]))
    lag = own["dyntype"] in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    if servo:
        # What a servo's activations are limited in is a place or a speed.
        motor.actlimited, motor.actrange = mujoco.mjtLimited.mjLIMITED_FALSE, [0.0, 0.0]
    else:
        motor.actrange = scaled(gear * float(gain[0]), own["actrange"])
    if not lag:
        motor.dyntype, motor.dynprm = mujoco.mjtDyn.mjDYN_NONE, [1.0, *[0.0] * 9]
        motor.actdim, motor.actlimited = -1, mujoco.mjtLimited.mjLIMITED_FALSE
    gain[:] = 0.0
    gain[0] = 1.0 / gear
    motor.gaintype, motor.gainprm = mujoco.mjtGain.mjGAIN_FIXED, gain
    motor.biastype, motor.biasprm = mujoco.mjtBias.mjBIAS_NONE, [0.0] * 10
    motor.ctrlspec = 0


def _at_joint(motor: mujoco.MjsActuator, own: Mapping[str, Any]) -> None:
    """A DC motor without a gear, whose numbers are those at the joint.

    With a gear g its force at the joint is g times as large and its length 1/g times; a negative
    gear is a motor whose current flows the other way.
    """
    signed = float(own["gear"][0])
    gear = abs(signed)
    gain, dynamics, bias = (np.array(own[name], float) for name in ("gainprm", "dynprm", "biasprm"))
    gain[1] *= gear
    # Cogging: amplitude, periods, phase. Bristles: Coulomb and static friction, Stribeck speed.
    bias[:6] *= [gear, gear, math.copysign(1.0, signed), gear, gear, 1 / gear]
    dynamics[5:7] *= gear**2
    motor.gear = [1.0, *[0.0] * 5]
    motor.gainprm, motor.dynprm, motor.biasprm = gain, dynamics, bias
    motor.forcerange = scaled(signed, own["forcerange"])


def _commanded(motor: mujoco.MjsActuator, own: Mapping[str, Any]) -> None:
    """A DC motor at its joint whose input is the torque that it has at rest.

    One on a voltage gets the voltage for it; the driver of one with an inner controller, which is
    left out, makes up for the back-EMF as well.
    """
    gain, dynamics = np.array(motor.gainprm, float), np.array(motor.dynprm, float)
    if own["ctrlspec"] in (0, int(_INPUT.mjINPUT_VOLTAGE)):
        c = volts_for(1.0, 1.0, constant=float(gain[1]), resistance=float(gain[0]))
        gain[1], gain[0] = in_units_of(c, constant=float(gain[1]), resistance=float(gain[0]))
        dynamics[1] *= c
    else:
        motor.ctrlspec = int(_INPUT.mjINPUT_FF)
        gain[_CONTROLLER_GAINS] = 0.0
        dynamics[_CONTROLLER_STATES] = 0.0
        motor.actdim = sum(bool(dynamics[index] > 0) for index in _STATES)
    motor.gainprm, motor.dynprm = gain, dynamics
