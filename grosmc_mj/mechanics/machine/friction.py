"""Friction of a joint by bristles: the LuGre model."""

from __future__ import annotations

import math
from typing import Annotated

import mujoco

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError
from grosmc_mj.ground.fields import Name, checked
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.mechanics.machine.part import (
    MachinePart,
    Oscillation,
    not_negative,
    positive,
)
from grosmc_mj.theory.plants import System
from grosmc_mj.theory.plants.owner_units import DAMPING, FORCE, SPEED, STIFFNESS

_IMPLICIT = (mujoco.mjtIntegrator.mjINT_IMPLICITFAST, mujoco.mjtIntegrator.mjINT_IMPLICIT)
# Largest share by which an implicit integrator may slow what slides on bristles.
_SLOWED = 0.02
# h times the rate of a first-order lag, up to which the classical Runge-Kutta method is stable.
_STABLE_LAG = 2.785
# The back-EMF of a motor that is there for its friction only is nothing.
_NO_MOTOR = (1e-12, 0.0)


@checked(ModelError)
class LuGre(MachinePart):
    """Friction of a joint by bristles, as MuJoCo's motors have it.

    C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, "A new model for control of
    systems with friction", IEEE Trans. Automatic Control 40, 1995: z' = v - s0 |v| z / g(v),
    F = s0 z + s1 z', g = F_c + (F_s - F_c) exp(-(v/v_s)^2). Viscous friction is the joint's
    damping.

    Attributes:
        joint: Name of the joint.
        coulomb: F_c [N m or N].
        static: F_s, from which it slides [N m or N]; F_c for 0.
        stiffness: s0 of the bristles [N m/rad or N/m].
        damping: s1 of the bristles [N m s/rad or N s/m].
        stribeck: v_s [rad/s or m/s].
    """

    joint: Name
    coulomb: Annotated[float, positive(FORCE)]
    static: Annotated[float, not_negative(FORCE)] = 0.0
    stiffness: Annotated[float, positive(STIFFNESS)] = 1e3
    damping: Annotated[float, not_negative(DAMPING)] = 0.0
    stribeck: Annotated[float, positive(SPEED)] = 0.01

    kind = "lugre"
    effect = "friction"
    owner = "joint"
    order = 22

    def __post_init__(self) -> None:
        if 0 < self.static < self.coulomb:
            raise ModelError(
                f"lugre of {self.joint!r}: static = {self.static:g} must be at least coulomb = "
                f"{self.coulomb:g}, or 0 for it"
            )

    def __str__(self) -> str:
        return f"{self.joint}: LuGre friction of {max(self.coulomb, self.static):.3g}"

    def write(self, spec: mujoco.MjSpec, nominal: mujoco.MjModel) -> None:
        """Add a motor without input and back-EMF, for the friction that MuJoCo's motors have."""
        friction = spec.add_actuator(
            name=f"{self.joint} friction",
            target=self.joint,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
        )
        static = self.static or self.coulomb
        friction.set_to_dcmotor(
            motorconst=_NO_MOTOR,
            resistance=1.0,
            lugre=[self.stiffness, self.damping, self.coulomb, static, self.stribeck],
            ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
        )

    def oscillation(self, model: mujoco.MjModel) -> Oscillation:
        """Motion of the joint on its bristles."""
        coordinate = model.joint(self.joint).dofadr[0]
        weight = float(model.dof_invweight0[coordinate])
        return Oscillation(self.stiffness * weight, self.damping * weight)

    def require_timestep(self, model: mujoco.MjModel, system: str) -> None:
        """Refuse a timestep with which it is unstable, or an integrator that slows the joint."""
        super().require_timestep(model, system)
        slowed = float(model.opt.timestep) * self.oscillation(model).damping
        if model.opt.integrator in _IMPLICIT and slowed > _SLOWED:
            raise ModelError(
                f"{system}: lugre of {self.joint!r}: implicit integrators divide the acceleration "
                f"of what slides on bristles by 1 + h damping/inertia = {1 + slowed:.3g}: take "
                "integrator RK4 or Euler, or a shorter timestep"
            )

    def require_speeds(self, system: System, x: Array, timestep: float, integrator: str) -> None:
        """Refuse a speed at which the bristles are unstable, as ``Edit`` says.

        They follow the speed at the rate s0 |v|/g(v), which RK4 takes explicitly; MuJoCo's other
        integrators solve it exactly.
        """
        if integrator != "RK4" or self.joint not in system.joints:
            return

        rate = system.degrees_of_freedom + system.joints.index(self.joint)
        speed = abs(float(x[rate]))
        force = self._sliding_force(speed)
        if timestep * self.stiffness * speed <= _STABLE_LAG * force:
            return

        longest = _STABLE_LAG * force / (self.stiffness * speed)
        softest = self.stiffness * longest / timestep
        unit = unit_after(system.states[rate].unit)
        raise ArgumentError(
            f"{system.name}: lugre of {self.joint!r}: at {speed:.3g}{unit}, where its friction is "
            f"{force:.3g}, RK4 with a timestep of {timestep:g} s makes the bristles unstable: take "
            f"a timestep of at most {longest:.2g} s, a stiffness of at most {softest:.2g}, or "
            "integrator Euler"
        )

    def _sliding_force(self, speed: float) -> float:
        """Friction g(v) of a joint that slides at a speed."""
        static = self.static or self.coulomb
        return self.coulomb + (static - self.coulomb) * math.exp(-((speed / self.stribeck) ** 2))
