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

Where the law's input is the voltage itself, c is 1 but for the efficiency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal, get_args

import mujoco
import numpy as np

from grosmc_mj.ground.errors import ModelError, one_line
from grosmc_mj.ground.fields import Flag, Known, Name, Range, checked
from grosmc_mj.mechanics.machine.backlash import driven_joint
from grosmc_mj.mechanics.machine.part import (
    LEAST,
    MachinePart,
    Oscillation,
    not_negative,
    positive,
    signed,
)
from grosmc_mj.mechanics.physics.edit import HiddenState

LawInput = Literal["torque", "voltage"]

# A current loop's resistance over its winding's: the effect of the back-EMF falls by this factor.
_STIFF = 1e9
# By which copper's resistance grows [1/K].
_COPPER = 0.0039
# Share by which numbers that are equal may differ by rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class _Winding:
    """MuJoCo's winding in the place of an ideal input.

    Attributes:
        constant: K, in the units that make u the demand.
        resistance: R, in these units.
        gear: Gear of the actuator.
        force: Force of the actuator for a torque of 1 N m of the motor.
    """

    constant: float
    resistance: float
    gear: float
    force: float


@checked(ModelError)
class Motor(MachinePart):
    """A DC motor with its gear and amplifier in place of the model's ideal input.

    The law's input is converted so that a motor at rest gives the torque that it demands, or is
    the voltage itself; back-EMF, lag and limits come between.
    A voltage amplifier is ``voltage``; one that follows a current has a ``bandwidth``, and within
    the voltage of its supply if there is a ``voltage``, too.

    Attributes:
        input: Name of the input that it stands for.
        constant: Torque constant, equal to that of the back-EMF [N m/A].
        resistance: Resistance of the winding [ohm].
        inductance: Inductance of the winding [H]; behind a current loop it says how fast a supply
            can change the current.
        ratio: Turns of the motor for one of its joint, or rad/m of a slide; negative for a motor
            that turns against its joint.
        efficiency: Share of the torque that arrives at the joint, of both the current and the
            back-EMF; the amplifier makes up for it.
        voltage: Largest voltage [V], of a voltage amplifier or of the supply of a current loop;
            infinite for none.
        current: Largest current [A]; infinite for none.
        bandwidth: Bandwidth of a current loop that makes up for the back-EMF [rad/s]; 0 for a
            voltage amplifier. Its supply holds at most the current (V - K w)/R at a speed w of the
            motor, and changes it by V/L at most.
        inertia: Inertia of the rotor, at the motor [kg m^2]; at the joint it is an armature of
            ratio^2 times that. The inertia of a ``Transmission`` takes its place.
        cogging: Amplitude of the torque, at the motor [N m].
        cogging_periods: Periods of that torque in a turn of the motor.
        thermal_resistance: Winding to surroundings [K/W]; 0 for a motor that stays cold.
        heat_capacity: Heat capacity of the winding [J/K].
        added: True if back-EMF and inertia come on top of the model's; else they are a part of the
            joint's damping and armature.
        law_input: Input of the law: ``torque`` at the joint, or ``voltage`` [V] at the winding, for
            a nominal model with a ``VoltageInput``.
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
    law_input: Annotated[LawInput, Known("law_input", get_args(LawInput))] = "torque"

    kind = "motor"
    owner = "input"
    order = 21
    remedy = "take another integrator, or leave its inductance out"

    def __post_init__(self) -> None:
        mistakes: list[str] = []
        if bool(self.thermal_resistance) != bool(self.heat_capacity):
            mistakes.append("heating needs both thermal_resistance and heat_capacity")
        tau = self.time_constant
        if 0 < tau < LEAST:
            mistakes.append(f"its current follows in {tau:.2g} s: leave that out")
        if abs(self.ratio) < LEAST:
            mistakes.append(f"ratio = {self.ratio:g} must be at least {LEAST:g}, or negative")
        if self.bandwidth and self.law_input == "voltage":
            mistakes.append("law_input = 'voltage' is for a voltage amplifier: leave bandwidth out")
        if mistakes:
            raise ModelError(f"motor of {self.input!r}: {'; '.join(mistakes)}")

    def __str__(self) -> str:
        text = f"{self.input}: DC motor by voltage"
        if self.bandwidth:
            text = f"{self.input}: DC motor by current loop of {self.bandwidth:.4g} rad/s"

        limits: list[str] = []
        if math.isfinite(self.voltage):
            limits.append(f"{self.voltage:.3g} V")
        if math.isfinite(self.current):
            limits.append(f"{self.current:.3g} A")
        if limits:
            text += f", within {' and '.join(limits)}"
        return text

    @property
    def supplied(self) -> bool:
        """True if it is a current loop with a supply of finite voltage."""
        return bool(self.bandwidth) and math.isfinite(self.voltage)

    @property
    def stronger(self) -> bool:
        """True if it may give more than it is asked for: braked by its back-EMF, or by cogging."""
        braked = not self.bandwidth and math.isinf(self.current)
        return braked or self.cogging > 0

    @property
    def time_constant(self) -> float:
        """Time constant of the current [s]; 0 for one that follows at once."""
        if self.bandwidth:
            return 1 / self.bandwidth
        return self.inductance / self.resistance

    @property
    def emf_damping(self) -> float:
        """Damping by the back-EMF at the joint [N m s/rad or N s/m]."""
        if self.bandwidth:
            return 0.0
        return self.efficiency * (self.ratio * self.constant) ** 2 / self.resistance

    @property
    def torque_of_volt(self) -> float:
        """Torque at the joint of a motor at rest for 1 V [N m/V or N/V]."""
        return self.efficiency * self.constant * self.ratio / self.resistance

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Replace an ideal input."""
        actuator = spec.actuator(self.input)
        gear = float(actuator.gear[0]) * float(actuator.gainprm[0])
        if not _is_ideal(actuator) or gear == 0:
            raise ModelError(f"motor: input {self.input!r} is no ideal motor on a joint")
        if self.law_input == "voltage":
            self._refuse_gear(gear, nominal)
            gear = self.torque_of_volt

        low, high = self._limits(actuator, self._volts(gear) / math.sqrt(self.efficiency))
        winding = self._winding(gear)
        self._write_motor(actuator, winding, spec.option.timestep)
        actuator.gear = [winding.gear, *[0.0] * 5]
        # The ideal input of a nominal model in volts has the motor's inertia and back-EMF itself.
        actuator.armature = 0.0
        actuator.damping = np.zeros_like(actuator.damping)
        if math.isfinite(high):
            actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.ctrlrange = [low, high]
        self._write_joint(spec, actuator.target)

    def _refuse_gear(self, gear: float, nominal: mujoco.MjModel) -> None:
        """Refuse a gear of the input that is not the nominal model's.

        Raises:
            ModelError: With the numbers to edit in its place.
        """
        index = nominal.actuator(self.input).id
        if gear != nominal.actuator_gear[index, 0] * nominal.actuator_gainprm[index, 0]:
            raise ModelError(
                f"motor of {self.input!r}: law_input = 'voltage' takes the place of its gear: "
                "edit constant, resistance or ratio of the motor"
            )

    def _write_motor(
        self, actuator: mujoco.MjsActuator, winding: _Winding, timestep: float
    ) -> None:
        """Make an actuator MuJoCo's motor.

        Raises:
            ModelError: If MuJoCo refuses its numbers.
        """
        if self.supplied:
            supply = math.sqrt(self.efficiency) * self.voltage
            control = mujoco.mjtCtrlInput.mjINPUT_FF
        else:
            supply = 0.0
            control = mujoco.mjtCtrlInput.mjINPUT_VOLTAGE

        # MuJoCo has 0 for a force without limit.
        force = winding.force
        most = self.efficiency * self.constant * self.current * force
        if math.isinf(most):
            most = 0.0

        try:
            actuator.set_to_dcmotor(
                motorconst=[winding.constant, 0.0],
                resistance=winding.resistance,
                saturation=[most, 0.0, self._rate(supply, timestep)],
                inductance=[0.0, self.time_constant],
                cogging=[self.cogging * force, self.cogging_periods * force, 0.0],
                controller=[0.0, 0.0, 0.0, 0.0, 0.0, supply],
                thermal=self._thermal(),
                ctrlspec=int(control),
            )
        except ValueError as error:
            raise ModelError(f"motor of {self.input!r}: {one_line(str(error))}") from None

    @property
    def _resistance(self) -> float:
        """Resistance against the back-EMF [ohm]."""
        if self.bandwidth and not self.supplied:
            return self.resistance * _STIFF
        return self.resistance

    @property
    def _constant(self) -> float:
        """MuJoCo's constant of both torque and back-EMF [N m/A]."""
        return math.sqrt(self.efficiency) * self.constant

    def _volts(self, gear: float) -> float:
        """c: the voltage for one unit of an input whose torque at the joint is the gear [V]."""
        return abs(gear) * self._resistance / (abs(self.ratio) * self._constant)

    def _winding(self, gear: float) -> _Winding:
        """Winding in the place of an input whose torque at the joint is the gear.

        A motor that turns against its joint is the same with its current the other way round.
        """
        if self.supplied:
            force = abs(self.ratio) / abs(gear)
            return _Winding(self._constant * force, self.resistance, gear, force)

        c = self._volts(gear)
        signed_ratio = abs(self.ratio) * math.copysign(1.0, gear)
        return _Winding(self._constant / c, self._resistance / c**2, signed_ratio, 1.0)

    def _limits(self, actuator: mujoco.MjsActuator, volts: float) -> tuple[float, float]:
        """Least and largest input: the model's own, and those that an amplifier's voltage allows.

        Args:
            actuator: The ideal input.
            volts: Voltage at the winding for one unit of the input, with the efficiency's loss.
        """
        low = -math.inf
        high = math.inf
        if _has_range(actuator):
            low = float(actuator.ctrlrange[0])
            high = float(actuator.ctrlrange[1])

        # A supply limits the current at a speed, not the demand.
        if self.supplied:
            return low, high
        most = abs(self.voltage / volts)
        return max(low, -most), min(high, most)

    def _rate(self, supply: float, timestep: float) -> float:
        """MuJoCo's bound on a current's rate with which it changes by V/L; 0 for none.

        MuJoCo takes what it has bounded over t_e (1 - exp(-h/t_e)) instead of over h.
        """
        if not supply or not self.inductance:
            return 0.0
        steps = timestep / self.time_constant
        return supply / self.inductance * steps / -math.expm1(-steps)

    def _thermal(self) -> list[float]:
        """MuJoCo's numbers of heating, which is that of the winding alone."""
        if not self.thermal_resistance:
            return [0.0] * 6
        share = self.resistance / self._resistance
        # A driver that gives a current makes up for a warm winding's resistance.
        copper = 0.0 if self.supplied else _COPPER * share
        resistance = self.thermal_resistance * share
        capacity = self.heat_capacity / share
        return [resistance, capacity, 0.0, copper, 0.0, 0.0]

    def _write_joint(self, spec: mujoco.MjSpec, target: str) -> None:
        """Give the joint the motor's inertia, or take the back-EMF off the joint's damping."""
        name = driven_joint(spec, target)
        joint = spec.joint(name)
        # A transmission's motor has its inertia itself.
        inertia = self.inertia * self.ratio**2 if name == target else 0.0
        if self.added:
            joint.armature += inertia
            return

        damping = np.array(joint.damping)
        too_much_damping = self.emf_damping > damping[0] * (1 + _ROUNDING)
        too_much_inertia = inertia > joint.armature * (1 + _ROUNDING)
        if too_much_damping or too_much_inertia:
            raise ModelError(
                f"motor of {self.input!r}: its back-EMF brakes with {self.emf_damping:.4g} and its "
                f"inertia is {inertia:.4g} at joint {name!r}, which is no part of the model's "
                f"damping of {damping[0]:.4g} and armature of {joint.armature:.4g}: let them be "
                "added"
            )

        damping[0] = max(0.0, damping[0] - self.emf_damping)
        joint.damping = damping

    def oscillation(self, model: mujoco.MjModel) -> Oscillation | None:
        """Lag of its current, which RK4 moves as any other state; other integrators are exact."""
        if model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            return None
        time_constant = float(model.actuator_dynprm[model.actuator(self.input).id, 0])
        if time_constant <= 0:
            return None
        return Oscillation(0.0, 1 / time_constant)

    def input_of_force(self, ideal: mujoco.MjModel) -> float:
        """Return the ideal input with the torque at the joint of a unit of MuJoCo's force.

        Args:
            ideal: Model with the ideal input in its place.
        """
        index = ideal.actuator(self.input).id
        gear = float(ideal.actuator_gear[index, 0] * ideal.actuator_gainprm[index, 0])
        return self._winding(gear).gear / gear

    def hidden(self, state: HiddenState, model: mujoco.MjModel) -> HiddenState:
        """Scale its current to A, by the torque at the joint."""
        if state.name != f"{self.input} current":
            return state
        index = model.actuator(self.input).id
        torque = model.actuator_gainprm[index, 1] * model.actuator_gear[index, 0]
        scale = float(torque / (self.efficiency * self.constant * self.ratio))
        return replace(state, name=f"{self.input} winding", unit="A", kind="winding", scale=scale)


def _is_ideal(actuator: mujoco.MjsActuator) -> bool:
    """True if the force of an actuator on a joint is its control times a number."""
    return (
        actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
        and actuator.dyntype == mujoco.mjtDyn.mjDYN_NONE
        and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
    )


def _has_range(actuator: mujoco.MjsActuator) -> bool:
    """True if the control of an actuator is limited."""
    if actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_AUTO:
        return any(actuator.ctrlrange)
    return actuator.ctrllimited == mujoco.mjtLimited.mjLIMITED_TRUE
