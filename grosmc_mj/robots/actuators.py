"""The actuators of a robot's MJCF as torque inputs: ideal for the laws, as built for the plant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError

_DYNAMICS, _GAIN, _BIAS = mujoco.mjtDyn, mujoco.mjtGain, mujoco.mjtBias
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
        built: Fields of the actuator that the plant has, where it does more than the laws know; its
            input is the same torque. Empty for an ideal one.
        note: How it differs from the model's actuator; empty if it does not.
    """

    actuator: str
    joint: str
    limits: Limits
    built: dict[str, Any]
    note: str

    def add_to(self, spec: mujoco.MjSpec, *, as_built: bool = False) -> None:
        """Add the actuator to a model, ideal or as built."""
        # All that a model's own defaults could say otherwise.
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
        fields = {**ideal, **_bounded("ctrl", self.limits), **(self.built if as_built else {})}
        joint = _TRANSMISSION.mjTRN_JOINT
        spec.add_actuator(name=self.actuator, target=self.joint, trntype=joint, **fields)


def torque_input(spec: mujoco.MjSpec, model: mujoco.MjModel, name: str) -> TorqueInput:
    """An actuator as torque control of its joint.

    A motor's torque is g k c for a command c in its range, gear g and gain k; a servo, whose bias
    depends on its joint, gives any torque in its force range once its own loop is left out.

    Args:
        spec: The model, all of whose actuators and joints have names.
        model: The same, compiled.
        name: Name of the actuator.

    Raises:
        ModelError: If torque control cannot stand for it, with the reason.
    """
    own, view = spec.actuator(name), model.actuator(name)
    servo = _servo(own, view)
    if reason := _unfit(own, view, servo):
        raise ModelError(
            f"actuator {name!r} {reason}: torque control of a joint cannot stand for it"
        )
    gear, joint = float(own.gear[0]), model.joint(int(view.trnid[0]))
    gain = 1.0 if servo else float(view.gainprm[0])
    ranges = (
        # Commands and activations of a servo are positions or velocities.
        (view.ctrllimited[0] and not servo, gear * gain, view.ctrlrange),
        (view.actlimited[0] and not servo, gear * gain, view.actrange),
        (view.forcelimited[0], gear, view.forcerange),
        (model.jnt_actfrclimited[joint.id], 1.0, model.jnt_actfrcrange[joint.id]),
    )
    limits = [_scaled(factor, ends) if limited else _ANY for limited, factor, ends in ranges]
    low, high = max(low for low, _ in limits), min(high for _, high in limits)
    within = f"within [{low:g}, {high:g}] {joint_unit(model, joint.id)}"
    within = within if math.isfinite(high) else "without limits"
    lags, built = own.dyntype in _LAGS, dict[str, Any]()
    extras = [f"a lag of {view.dynprm[0]:g} s"] * lags
    extras += [f"a delay of {own.delay:g} s"] * (own.nsample > 0)
    if extras:
        command, activation, force, _ = limits
        built = {**_bounded("ctrl", command), **_bounded("force", force)}
        built |= {field: getattr(own, field) for field in _TIMING}
        if lags:
            built |= {"dyntype": own.dyntype, "dynprm": own.dynprm, **_bounded("act", activation)}
    instead = f" instead of the {servo}" if servo else ""
    note = first(
        {
            f"the plant has {' and '.join(extras)}, which no law knows; torque control {within}"
            f"{instead}": extras,
            f"the {servo} is left out, torque control {within} instead": servo,
            f"its input is torque at the joint, with its gear {gear:g} and gain {gain:g} in the "
            f"limits, {within}": gear * gain != 1,
        }
    )
    note = note and f"actuator {name!r}: {note}"
    return TorqueInput(name, joint.name, (low, high), built, note)


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a joint's torque or force: N m or N."""
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return "N" if slides else "N m"


def _scaled(factor: float, limits: Sequence[float]) -> Limits:
    """Limits times a factor of either sign."""
    low, high = sorted(factor * float(limit) for limit in limits)
    return low, high


def _bounded(field: str, limits: Limits) -> dict[str, Any]:
    """``ctrl``, ``act`` or ``force`` limited to a range, if it is finite."""
    finite = math.isfinite(limits[1])
    limited = mujoco.mjtLimited(int(finite))
    return {f"{field}limited": limited, f"{field}range": limits if finite else [0.0, 0.0]}


def first(reasons: Mapping[str, Any]) -> str:
    """The first of these words that holds; empty if none does."""
    return next((words for words, holds in reasons.items() if holds), "")


def _servo(own: mujoco.MjsActuator, view: Any) -> str:
    """Kind of the servo with its gains; empty for a motor."""
    if own.biastype != _BIAS.mjBIAS_AFFINE:
        return ""
    constant, stiffness, damping = view.biasprm[:3] * [1.0, -1.0, -1.0] + 0.0
    return first(
        {
            f"position servo (kp {stiffness:g}, kv {damping:g})": stiffness,
            f"velocity servo (kv {damping:g})": damping,
            f"constant bias {constant:g}": constant,
        }
    )


def _unfit(own: mujoco.MjsActuator, view: Any, servo: str) -> str:
    """Why torque control cannot stand for an actuator; empty if it can."""
    dynamics, gain, bias = own.dyntype, own.gaintype, own.biastype
    static = (_DYNAMICS.mjDYN_NONE, *_LAGS, *(_INTEGRALS if servo else ()))
    return first(
        {
            "is a muscle, which pulls by its length and takes no torque": (
                gain == _GAIN.mjGAIN_MUSCLE or dynamics == _DYNAMICS.mjDYN_MUSCLE
            ),
            "is a DC motor: make it a motor here, and give its winding in a [[motor]] table": (
                gain == _GAIN.mjGAIN_DCMOTOR
            ),
            _NOT_ON_A_JOINT.get(own.trntype, ""): own.trntype in _NOT_ON_A_JOINT,
            f"has activation dynamics ({dynamics.name.removeprefix('mjDYN_').lower()})": (
                dynamics not in static
            ),
            "has a gain that depends on the state": (
                gain not in (_GAIN.mjGAIN_FIXED, _GAIN.mjGAIN_PID)
            ),
            "has a lag of 0 s, which nothing can simulate": (
                dynamics == _DYNAMICS.mjDYN_FILTER and view.dynprm[0] <= 0
            ),
            f"has a bias of kind {bias.name.removeprefix('mjBIAS_').lower()}": (
                bias not in (_BIAS.mjBIAS_NONE, _BIAS.mjBIAS_AFFINE)
            ),
            "is a plugin": own.plugin.active,
            "has an armature or damping of its own, which belongs to its joint": (
                own.armature or np.any(own.damping)
            ),
            "has no gear or no gain": own.gear[0] == 0 or (view.gainprm[0] == 0 and not servo),
        }
    )
