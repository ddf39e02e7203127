"""The actuators of a robot's MJCF as torque inputs: ideal for the laws, as built for the plant."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError

_DYNAMICS, _GAIN, _BIAS = mujoco.mjtDyn, mujoco.mjtGain, mujoco.mjtBias
_INPUT, _TRANSMISSION = mujoco.mjtCtrlInput, mujoco.mjtTrn
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
    depends on its joint, gives any torque in its force range once its own loop is left out, and so
    does a DC motor with an inner controller.

    Args:
        spec: The model, all of whose actuators and joints have names.
        model: The same, compiled.
        name: Name of the actuator.

    Raises:
        ModelError: If torque control cannot stand for it, with the reason.
    """
    own, view = spec.actuator(name), model.actuator(name)
    is_dc = own.gaintype == _GAIN.mjGAIN_DCMOTOR
    # The driver of a DC motor's current makes up for its back-EMF; one on a voltage has none.
    driver = is_dc and model.actuator_ctrlspec[view.id] != _INPUT.mjINPUT_VOLTAGE
    servo = _servo(own, view, driver=driver)
    if reason := _unfit(own, view, servo):
        raise ModelError(
            f"actuator {name!r} {reason}: torque control of a joint cannot stand for it"
        )
    gear, joint = float(own.gear[0]), model.joint(int(view.trnid[0]))
    resistance, constant = (float(number) for number in view.gainprm[:2])
    gain = 1.0 if servo or driver else constant / resistance if is_dc else resistance
    supplied = gear * float(view.gainprm[7]) * constant / resistance if driver else 0.0
    ranges = (
        # Commands and activations of a servo are positions or velocities.
        (view.ctrllimited[0] and not servo, gear * gain, view.ctrlrange),
        (view.actlimited[0] and not servo, gear * gain, view.actrange),
        (view.forcelimited[0], gear, view.forcerange),
        (supplied, supplied, (-1.0, 1.0)),
        (model.jnt_actfrclimited[joint.id], 1.0, model.jnt_actfrcrange[joint.id]),
    )
    limits = [_scaled(factor, ends) if limited else _ANY for limited, factor, ends in ranges]
    low, high = max(low for low, _ in limits), min(high for _, high in limits)
    within = f"within [{low:g}, {high:g}] {joint_unit(model, joint.id)}"
    within = within if math.isfinite(high) else "without limits"
    extras = _extras(own, view, driver=driver)
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
    built = dict[str, Any]()
    if extras:
        command, activation, force = limits[:3]
        built = {**_bounded("ctrl", command), **_bounded("force", force)}
        built |= {field: getattr(own, field) for field in _TIMING}
        if own.dyntype in _LAGS:
            built |= {"dyntype": own.dyntype, "dynprm": own.dynprm, **_bounded("act", activation)}
        if is_dc:
            built |= _motor_at_joint(view, gear, driver=driver)
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


def _servo(own: mujoco.MjsActuator, view: Any, *, driver: bool) -> str:
    """Kind of the servo with its gains; empty for a motor."""
    kp, ki, kd = view.gainprm[4:7]
    constant, stiffness, damping = view.biasprm[:3] * [1.0, -1.0, -1.0] + 0.0
    affine = own.biastype == _BIAS.mjBIAS_AFFINE
    return first(
        {
            f"inner position controller (kp {kp:g}, ki {ki:g}, kd {kd:g})": (
                driver and own.ctrlspec & _INPUT.mjINPUT_POS
            ),
            f"inner velocity controller (kd {kd:g})": driver and own.ctrlspec & _INPUT.mjINPUT_VEL,
            f"position servo (kp {stiffness:g}, kv {damping:g})": affine and stiffness,
            f"velocity servo (kv {damping:g})": affine and damping,
            f"constant bias {constant:g}": affine and constant,
        }
    )


def _extras(own: mujoco.MjsActuator, view: Any, *, driver: bool) -> list[str]:
    """Behaviour of an actuator beyond torque control, in words."""
    supply = f" within {view.gainprm[7]:g} V" if view.gainprm[7] else ""
    motor = f"a DC motor with a driver of its current{supply}"
    extras = {
        f"a lag of {view.dynprm[0]:g} s": own.dyntype in _LAGS,
        motor if driver else "a DC motor with its back-EMF": (own.gaintype == _GAIN.mjGAIN_DCMOTOR),
        f"a delay of {own.delay:g} s": own.nsample > 0,
    }
    return [words for words, there in extras.items() if there]


def _unfit(own: mujoco.MjsActuator, view: Any, servo: str) -> str:
    """Why torque control cannot stand for an actuator; empty if it can."""
    transmission, dynamics, lag = own.trntype, own.dyntype, view.dynprm[0]
    gain, bias = own.gaintype, own.biastype
    is_dc = gain == _GAIN.mjGAIN_DCMOTOR
    static = (_DYNAMICS.mjDYN_NONE, *_LAGS, *(_INTEGRALS if servo else ()))
    return first(
        {
            "is a muscle, which pulls by its length and takes no torque": (
                gain == _GAIN.mjGAIN_MUSCLE or dynamics == _DYNAMICS.mjDYN_MUSCLE
            ),
            _NOT_ON_A_JOINT.get(transmission, ""): transmission in _NOT_ON_A_JOINT,
            "is a DC motor without an input, which actuators=... can leave out": (
                own.ctrlspec == _INPUT.mjINPUT_NONE
            ),
            f"has activation dynamics ({dynamics.name.removeprefix('mjDYN_').lower()})": (
                dynamics not in static and not is_dc
            ),
            "has a gain that depends on the state": (
                gain not in (_GAIN.mjGAIN_FIXED, _GAIN.mjGAIN_PID) and not is_dc
            ),
            "has a lag of 0 s, which nothing can simulate": (
                dynamics == _DYNAMICS.mjDYN_FILTER and lag <= 0
            ),
            f"has a bias of kind {bias.name.removeprefix('mjBIAS_').lower()}": (
                bias not in (_BIAS.mjBIAS_NONE, _BIAS.mjBIAS_AFFINE) and not is_dc
            ),
            "is a plugin": own.plugin.active,
            "has an armature or damping of its own, which belongs to its joint": (
                own.armature or np.any(own.damping)
            ),
            "has no gear or no gain": (
                own.gear[0] == 0 or (view.gainprm[int(is_dc)] == 0 and not servo)
            ),
        }
    )


def _motor_at_joint(view: Any, gear: float, *, driver: bool) -> dict[str, Any]:
    """Fields of a DC motor without a gear whose input is the torque that it has at rest.

    With a gear g its force at the joint is g times as large and its length 1/g times; a negative
    gear is a motor whose current flows the other way. On a voltage it has K = R = K^2/R where the
    unit of voltage gives it 1 N m at rest; a driver's inner controller is left out.
    """
    gain, dynamics, bias = (
        getattr(view, field).copy() for field in ("gainprm", "dynprm", "biasprm")
    )
    size = abs(gear)
    gain[1] *= size
    # Cogging: amplitude, periods, phase. Bristles: Coulomb and static friction, Stribeck speed.
    bias[:6] *= [size, size, math.copysign(1.0, gear), size, size, 1 / size]
    dynamics[5:7] *= size**2
    # The inner controller: its gains, then slew rate and clamp of its integral.
    gain[4:7], dynamics[7:9] = 0.0, 0.0
    if not driver:
        dynamics[1] *= gain[0] / gain[1]
        gain[:2] = gain[1] ** 2 / gain[0]
    return {
        "gaintype": _GAIN.mjGAIN_DCMOTOR,
        "dyntype": _DYNAMICS.mjDYN_DCMOTOR,
        "biastype": _BIAS.mjBIAS_DCMOTOR,
        "gainprm": gain,
        "dynprm": dynamics,
        "biasprm": bias,
        "ctrlspec": int(_INPUT.mjINPUT_FF if driver else _INPUT.mjINPUT_VOLTAGE),
        # Temperature, deflection of the bristles, and current of the winding.
        "actdim": sum(dynamics[index] > 0 for index in (2, 5, 0)),
    }
