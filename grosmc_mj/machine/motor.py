"""DC motors in MuJoCo's own ``dcmotor``, whose input is the torque that the law demands.

MuJoCo's motor has K, R and a voltage V: i' = (V/R - K w/R - i)/t_e and a torque K i. With the unit
of voltage so that V = c u, and that of current so that its torque is the same, K becomes K/c and R
becomes R/c^2, and u is the demand: a motor at rest gives it. A current loop that makes up for the
back-EMF is a winding of so high a resistance that there is none, with a time constant of its own.
With an efficiency the torque constant is a share of that of the back-EMF, and MuJoCo's K the root
of their product.

A current loop on a supply is MuJoCo's own: its ``ff`` input is a torque, for which the driver gives
V = R i + K w within the supply. There the gear, not the unit of voltage, makes u the demand:
i' = clip(w_b (clip(R i_u + K w, +-V_s) / R - K w / R - i), +-V_s / L).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError, one_line
from grosmc_mj.fields import Flag, Name, Range, checked
from grosmc_mj.machine.backlash import driven_joint
from grosmc_mj.machine.part import (
    LEAST,
    MachinePart,
    Oscillation,
    not_negative,
    positive,
    signed,
)
from grosmc_mj.physics.edit import HiddenState

# A current loop's resistance over its winding's: the effect of the back-EMF falls by this factor.
_STIFF = 1e9
# By which copper's resistance grows [1/K].
_COPPER = 0.0039


@checked(ModelError)
class Motor(MachinePart):
    """A DC motor with its gear and amplifier in place of the model's ideal input.

    The law's input is converted so that a motor at rest gives the torque that it demands;
    back-EMF, lag and limits come between.
    A voltage amplifier is ``voltage``; one that follows a current has a ``bandwidth``, and within
    the voltage of its supply if there is a ``voltage``, too.

    Attributes:
        input: Name of the input that it stands for.
        constant: Torque constant, equal to that of the back-EMF [N m/A].
        resistance: [ohm].
        inductance: [H]; behind a current loop it says how fast a supply can change the current.
        ratio: Turns of the motor for one of its joint, or rad/m of a slide; negative for a motor
            that turns against its joint.
        efficiency: Share of the torque that arrives at the joint, of both the current and the
            back-EMF; the amplifier makes up for it.
        voltage: Largest [V], of a voltage amplifier or of the supply of a current loop; infinite
            for none.
        current: Largest [A]; infinite for none.
        bandwidth: Of a current loop that makes up for the back-EMF [rad/s]; 0 for a voltage
            amplifier. Its supply holds at most the current (V - K w)/R at a speed w of the motor,
            and changes it by V/L at most.
        inertia: Of the rotor, at the motor [kg m^2]; at the joint it is an armature of ratio^2
            times that. That of a ``Transmission`` stands there instead.
        cogging: Amplitude of the torque, at the motor [N m].
        cogging_periods: In a turn of the motor.
        thermal_resistance: Winding to surroundings [K/W]; 0 for a motor that stays cold.
        heat_capacity: Of the winding [J/K].
        added: Whether back-EMF and inertia come on top of what the model has; else they are a part
            of the joint's damping and armature.
    """

    input: Name
    constant: Annotated[float, positive("N m/A")]
    resistance: Annotated[float, positive("ohm")]
    inductance: Annotated[float, not_negative("H")] = 0.0
    ratio: Annotated[float, signed()] = 1.0
    efficiency: Annotated[float, Range(LEAST, 1)] = 1.0
    voltage: Annotated[float, positive("V", infinite=True)] = math.inf
    current: Annotated[float, positive("A", infinite=True)] = math.inf
    bandwidth: Annotated[float, not_negative("rad/s")] = 0.0
    inertia: Annotated[float, not_negative("kg m^2")] = 0.0
    cogging: Annotated[float, not_negative("N m")] = 0.0
    cogging_periods: Annotated[float, positive()] = 12.0
    thermal_resistance: Annotated[float, not_negative("K/W")] = 0.0
    heat_capacity: Annotated[float, not_negative("J/K")] = 0.0
    added: Flag = True

    kind, owner, order = "motor", "input", 21
    remedy = "take another integrator, or leave its inductance out"

    def __post_init__(self) -> None:
        heated, tau = bool(self.thermal_resistance), self.time_constant
        mistakes = {
            "heating needs both thermal_resistance and heat_capacity": (
                heated != bool(self.heat_capacity)
            ),
            f"its current follows in {tau:.2g} s: leave that out": 0 < tau < LEAST,
            f"ratio = {self.ratio:g} must be at least {LEAST:g}, or negative": (
                abs(self.ratio) < LEAST
            ),
        }
        if any(mistakes.values()):
            text = "; ".join(mistake for mistake, wrong in mistakes.items() if wrong)
            raise ModelError(f"motor of {self.input!r}: {text}")

    def __str__(self) -> str:
        kind = f"current loop of {self.bandwidth:.4g} rad/s" if self.bandwidth else "voltage"
        bounds = (self.voltage, "V"), (self.current, "A")
        limits = [f"{bound:.3g} {unit}" for bound, unit in bounds if math.isfinite(bound)]
        within = f", within {' and '.join(limits)}" if limits else ""
        return f"{self.input}: DC motor by {kind}{within}"

    @property
    def supplied(self) -> bool:
        """Whether it is a current loop with a supply that has an end."""
        return bool(self.bandwidth) and math.isfinite(self.voltage)

    @property
    def time_constant(self) -> float:
        """Of the current [s]; 0 for one that follows at once."""
        return 1 / self.bandwidth if self.bandwidth else self.inductance / self.resistance

    @property
    def emf_damping(self) -> float:
        """Damping by the back-EMF at the joint [N m s/rad or N s/m]."""
        if self.bandwidth:
            return 0.0
        return self.efficiency * (self.ratio * self.constant) ** 2 / self.resistance

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Replace an ideal input."""
        actuator = spec.actuator(self.input)
        ideal = (
            actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
            and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
            and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
            and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
        )
        gear = float(actuator.gear[0]) * float(actuator.gainprm[0])
        if not ideal or gear == 0:
            raise ModelError(f"motor: input {self.input!r} is no ideal motor on a joint")
        constant, resistance, new_gear, force = self._winding(gear)
        root = math.sqrt(self.efficiency)
        low, high = self._limits(actuator, self._volts(gear) / root)
        supply = root * self.voltage if self.supplied else 0.0
        most = self.efficiency * self.constant * self.current * force
        rate = self._rate(supply, spec.option.timestep)
        kind = "mjINPUT_FF" if supply else "mjINPUT_VOLTAGE"
        try:
            actuator.set_to_dcmotor(
                motorconst=[constant, 0.0],
                resistance=resistance,
                saturation=[most if math.isfinite(most) else 0.0, 0.0, rate],
                inductance=[0.0, self.time_constant],
                cogging=[self.cogging * force, self.cogging_periods * force, 0.0],
                controller=[0.0, 0.0, 0.0, 0.0, 0.0, supply],
                thermal=self._thermal(),
                ctrlspec=int(getattr(mujoco.mjtCtrlInput, kind)),
            )
        except ValueError as error:
            raise ModelError(f"motor of {self.input!r}: {one_line(str(error))}") from None
        actuator.gear = [new_gear, *[0.0] * 5]
        if math.isfinite(high):
            actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.ctrlrange = [low, high]
        self._write_joint(spec, actuator.target)

    @property
    def _resistance(self) -> float:
        """Resistance against the back-EMF [ohm]."""
        return self.resistance * (_STIFF if self.bandwidth and not self.supplied else 1.0)

    @property
    def _constant(self) -> float:
        """MuJoCo's constant of both torque and back-EMF [N m/A]."""
        return math.sqrt(self.efficiency) * self.constant

    def _volts(self, gear: float) -> float:
        """c: the voltage for one unit of an input whose torque at the joint is the gear [V]."""
        return abs(gear) * self._resistance / (abs(self.ratio) * self._constant)

    def _winding(self, gear: float) -> tuple[float, float, float, float]:
        """In the place of such an input: K, R, the actuator's gear, and its force for one N m.

        A motor that turns against its joint is the same with its current the other way round.
        """
        if self.supplied:
            force = abs(self.ratio) / abs(gear)
            return self._constant * force, self.resistance, gear, force
        c = self._volts(gear)
        signed_ratio = abs(self.ratio) * math.copysign(1.0, gear)
        return self._constant / c, self._resistance / c**2, signed_ratio, 1.0

    def _limits(self, actuator: mujoco.MjsActuator, volts: float) -> tuple[float, float]:
        """Least and largest input: the model's own, and those that an amplifier's voltage allows.

        Args:
            actuator: The ideal input.
            volts: At the winding for one unit of the input, with the loss of the efficiency.
        """
        low, high = -math.inf, math.inf
        if actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_TRUE or (
            actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_AUTO and any(actuator.ctrlrange)
        ):
            low, high = (float(limit) for limit in actuator.ctrlrange)
        # A supply limits the current at a speed, not the demand.
        most = math.inf if self.supplied else abs(self.voltage / volts)
        return max(low, -most), min(high, most)

    def _rate(self, supply: float, timestep: float) -> float:
        """MuJoCo's bound on a current's rate with which it changes by V/L; 0 for none.

        MuJoCo takes what it has bounded over t_e (1 - exp(-h/t_e)) instead of over h.
        """
        if not (supply and self.inductance):
            return 0.0
        steps = timestep / self.time_constant
        return supply / self.inductance * steps / -math.expm1(-steps)

    def _thermal(self) -> list[float]:
        """MuJoCo's numbers of heating: that of the winding alone."""
        if not self.thermal_resistance:
            return [0.0] * 6
        share = self.resistance / self._resistance
        # A driver that gives a current makes up for a warm winding's resistance.
        copper = 0.0 if self.supplied else _COPPER * share
        resistance, capacity = self.thermal_resistance * share, self.heat_capacity / share
        return [resistance, capacity, 0.0, copper, 0.0, 0.0]

    def _write_joint(self, spec: mujoco.MjSpec, target: str) -> None:
        """Give the joint the motor's inertia, or take the motor's share off the joint's numbers."""
        own = driven_joint(spec, target)
        # A transmission's motor has its inertia itself.
        inertia = self.inertia * self.ratio**2 if own == target else 0.0
        joint = spec.joint(own)
        if self.added:
            joint.armature += inertia
            return
        damping = np.array(joint.damping)
        if self.emf_damping > damping[0] * (1 + 1e-9) or inertia > joint.armature * (1 + 1e-9):
            raise ModelError(
                f"motor of {self.input!r}: its back-EMF brakes with {self.emf_damping:.4g} and its "
                f"inertia is {inertia:.4g} at joint {own!r}, which is no part of the model's "
                f"damping of {damping[0]:.4g} and armature of {joint.armature:.4g}: let them be "
                "added"
            )
        damping[0] = max(0.0, damping[0] - self.emf_damping)
        joint.damping = damping
        joint.armature = max(0.0, joint.armature - inertia)

    def oscillation(self, model: mujoco.MjModel) -> Oscillation | None:
        """Of its current: MuJoCo's implicit integrators move it exactly, RK4 as any other state."""
        constant = float(model.actuator_dynprm[model.actuator(self.input).id, 0])
        explicit = model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        return Oscillation(0.0, 1 / constant) if explicit and constant > 0 else None

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """Its current in A, by the torque at the joint."""
        if state.name != f"{self.input} current":
            return state
        index = model.actuator(self.input).id
        torque = model.actuator_gainprm[index, 1] * model.actuator_gear[index, 0]
        scale = float(torque / (self.efficiency * self.constant * self.ratio))
        return replace(state, name=f"{self.input} winding", unit="A", kind="winding", scale=scale)
