"""DC motors in MuJoCo's own ``dcmotor``, whose control is what the law asks for.

MuJoCo's motor has K, R and a voltage V: i' = (V/R - K w/R - i)/t_e and a torque K i. With the unit
of voltage so that V = c u, and that of current so that its torque is the same, K becomes K/c and R
becomes R/c^2, and u is what the law asks for: a motor at rest gives it. A current loop that makes
up for the back-EMF is a winding of so high a resistance that there is none, with a time constant of
its own. With an efficiency the torque constant is a share of that of the back-EMF, and MuJoCo's K
the root of their product.

A current loop on a supply is MuJoCo's own: its ``ff`` input is a torque, for which the driver gives
V = R i + K w within the supply. There the gear, not the unit of voltage, makes u what is asked for:
i' = clip(w_b (clip(R i_u + K w, +-V_s) / R - K w / R - i), +-V_s / L).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, one_line
from grosmc_mj.machine.names import driven_joint
from grosmc_mj.machine.parts import Motor

# A current loop's resistance over its winding's: what the back-EMF does falls by this factor.
_STIFF = 1e9


class _Winding(NamedTuple):
    """A motor in MuJoCo's units.

    Attributes:
        constant: K.
        resistance: R.
        gear: Of the actuator, with the sign of the input's.
        force: MuJoCo's force for one N m at the motor.
    """

    constant: float
    resistance: float
    gear: float
    force: float


def _resistance(motor: Motor) -> float:
    """What stands against the back-EMF [ohm]."""
    return motor.resistance * (_STIFF if motor.bandwidth and not motor.supplied else 1.0)


def volts_for(torque: float, ratio: float, constant: float, resistance: float) -> float:
    """c: the voltage for one unit of an input that asks for a torque at the joint [V].

    Args:
        torque: For one unit of the input [N m or N].
        ratio: Of the gear.
        constant: K [N m/A].
        resistance: R [ohm].
    """
    return torque * resistance / (ratio * constant)


def in_units_of(c: float, constant: float, resistance: float) -> tuple[float, float]:
    """K and R where a voltage is told as c times smaller a number."""
    return constant / c, resistance / c**2


def _constant(motor: Motor) -> float:
    """What MuJoCo has for both constants, of torque and of back-EMF [N m/A]."""
    return math.sqrt(motor.efficiency) * motor.constant


def _scale(motor: Motor, gear: float) -> float:
    """c of a motor in the place of an input whose torque at the joint is the gear."""
    return volts_for(abs(gear), abs(motor.ratio), _constant(motor), _resistance(motor))


def _winding(motor: Motor, gear: float) -> _Winding:
    """A motor in the place of an input whose torque at the joint is the gear.

    One that turns against its joint is the same with its current the other way round.
    """
    ratio = abs(motor.ratio)
    if motor.supplied:
        force = ratio / abs(gear)
        return _Winding(_constant(motor) * force, motor.resistance, gear, force)
    c = _scale(motor, gear)
    constant, resistance = in_units_of(c, _constant(motor), _resistance(motor))
    return _Winding(constant, resistance, ratio * math.copysign(1.0, gear), 1.0)


def amperes(motor: Motor, model: mujoco.MjModel, index: int) -> float:
    """Current for one unit of MuJoCo's, by the torque that either gives at the joint [A].

    Args:
        motor: The motor.
        model: Compiled, with this motor.
        index: Of its actuator.
    """
    torque = model.actuator_gainprm[index, 1] * model.actuator_gear[index, 0]
    return float(torque / (motor.efficiency * motor.constant * motor.ratio))


def write_motor(spec: mujoco.MjSpec, motor: Motor) -> None:
    """Put a motor in the place of an ideal input.

    Raises:
        ModelError: If the input is no ideal motor on a joint, or MuJoCo refuses the numbers.
    """
    actuator = spec.actuator(motor.input)
    ideal = (
        actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
        and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
        and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
    )
    gear = float(actuator.gear[0]) * float(actuator.gainprm[0])
    if not ideal or gear == 0:
        raise ModelError(f"motor: input {motor.input!r} is no ideal motor on a joint")
    winding, root = _winding(motor, gear), math.sqrt(motor.efficiency)
    low, high = _limits(actuator, motor, gear)
    heated = motor.thermal_resistance > 0
    share = motor.resistance / _resistance(motor)
    # Copper's resistance grows by 0.39 % a kelvin; a driver that gives a current makes up for it.
    copper = 0.0 if motor.supplied else 0.0039 * share
    supply = root * motor.voltage if motor.supplied else 0.0
    rate = _rate(motor, supply, spec.option.timestep)
    most = motor.efficiency * motor.constant * motor.current * winding.force
    input_kind = mujoco.mjtCtrlInput.mjINPUT_FF if supply else mujoco.mjtCtrlInput.mjINPUT_VOLTAGE
    try:
        actuator.set_to_dcmotor(
            motorconst=[winding.constant, 0.0],
            resistance=winding.resistance,
            saturation=[most if math.isfinite(most) else 0.0, 0.0, rate],
            inductance=[0.0, motor.time_constant],
            cogging=[motor.cogging * winding.force, motor.cogging_periods * winding.force, 0.0],
            controller=[0.0, 0.0, 0.0, 0.0, 0.0, supply],
            # Heat is that of the winding alone.
            thermal=[
                motor.thermal_resistance * share, motor.heat_capacity / share, 0.0,
                copper, 0.0, 0.0,
            ] if heated else [0.0] * 6,
            ctrlspec=int(input_kind),
        )  # fmt: skip
    except ValueError as error:
        raise ModelError(f"motor of {motor.input!r}: {one_line(str(error))}") from None
    actuator.gear = [winding.gear, *[0.0] * 5]
    if math.isfinite(high):
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.ctrlrange = [low, high]
    _at_joint(spec, actuator.target, motor)


def _rate(motor: Motor, supply: float, timestep: float) -> float:
    """MuJoCo's bound on a current's rate with which it changes by V/L; 0 for none.

    MuJoCo takes what it has bounded over t_e (1 - exp(-h/t_e)) instead of over h.
    """
    if not (supply and motor.inductance):
        return 0.0
    steps = timestep / motor.time_constant
    return supply / motor.inductance * steps / -math.expm1(-steps)


def _at_joint(spec: mujoco.MjSpec, name: str, motor: Motor) -> None:
    """Give a joint its motor's inertia, or take off what the model has of motor and back-EMF."""
    own = driven_joint(spec, name)
    # A transmission's motor has its inertia itself.
    inertia = motor.inertia * motor.ratio**2 if own == name else 0.0
    joint = spec.joint(own)
    if motor.added:
        joint.armature += inertia
        return
    damping = np.array(joint.damping)
    if motor.emf_damping > damping[0] * (1 + 1e-9) or inertia > joint.armature * (1 + 1e-9):
        raise ModelError(
            f"motor of {motor.input!r}: its back-EMF brakes with {motor.emf_damping:.4g} and its "
            f"inertia is {inertia:.4g} at joint {own!r}, which is no part of the model's damping "
            f"of {damping[0]:.4g} and armature of {joint.armature:.4g}: let them be added"
        )
    damping[0] = max(0.0, damping[0] - motor.emf_damping)
    joint.damping = damping
    joint.armature = max(0.0, joint.armature - inertia)


def _limits(actuator: mujoco.MjsActuator, motor: Motor, gear: float) -> tuple[float, float]:
    """Least and largest input: the model's own, and what the voltage of an amplifier allows."""
    low, high = -math.inf, math.inf
    if actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
        actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_AUTO and any(actuator.ctrlrange)
    ):
        low, high = (float(each) for each in actuator.ctrlrange)
    if motor.supplied:
        # A supply limits the current at a speed, not what is asked for.
        return low, high
    # What the winding sees is more by what the efficiency takes.
    most = abs(motor.voltage / (_scale(motor, gear) / math.sqrt(motor.efficiency)))
    return max(low, -most), min(high, most)
