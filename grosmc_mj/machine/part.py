"""Common ground of a machine's parts: bounds of their numbers, and the timestep they need."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from grosmc_mj.errors import ModelError
from grosmc_mj.fields import Range
from grosmc_mj.physics.edit import Edit

# Sizes of numbers, in any unit: beyond them is a slip, and squares leave what floats hold.
LEAST, MOST = 1e-15, 1e15
# MuJoCo wants mass and inertia on every body that moves: too little to matter.
TOKEN = 1e-12
# Growth of an oscillation in a timestep that is none, but for rounding.
STABLE = 1 + 1e-9
# A timestep that is short enough for anything [s].
_SHORTEST = 1e-30
# Share of the largest stable timestep: the rest is for the other motions.
_SAFE = 0.9

# Units of a joint's numbers: of a hinge, or of a slide.
ANGLE, FORCE, INERTIA = "rad or m", "N m or N", "kg m^2 or kg"
SPEED, STIFFNESS, DAMPING = "rad/s or m/s", "N m/rad or N/m", "N m s/rad or N s/m"


def positive(unit: str = "", *, infinite: bool = False) -> Range:
    """Of a number above zero, or of a limit that may be infinite."""
    return Range(LEAST, MOST, unit, infinite=infinite)


def not_negative(unit: str = "") -> Range:
    """Of a number from zero on."""
    return Range(0, MOST, unit)


def signed(unit: str = "") -> Range:
    """Of a number of either sign."""
    return Range(-MOST, MOST, unit)


@dataclass(frozen=True)
class Oscillation:
    """q'' + d q' + w^2 q = 0: the motion of a part alone, against the rest of the machine.

    Attributes:
        square: w^2 [1/s^2]; zero of a first-order lag.
        damping: d [1/s].
        constrained: Whether it is a constraint's, whose damping no integrator makes implicit.
    """

    square: float
    damping: float
    constrained: bool = False

    def __str__(self) -> str:
        if not self.square:
            return f"follows its input in {1 / self.damping:.2g} s"
        return f"moves at {math.sqrt(self.square):.4g} rad/s"

    def growth(self, h: float, integrator: mujoco.mjtIntegrator) -> float:
        """Factor by which it grows in a timestep h [s]; it is stable up to ``STABLE``."""
        square, d = self.square, self.damping
        if integrator == mujoco.mjtIntegrator.mjINT_RK4:
            z = h * np.array([[0.0, 1.0], [-square, -d]])
            step = np.eye(2) + z @ (np.eye(2) + z @ (np.eye(2) / 2 + z @ (np.eye(2) / 6 + z / 24)))
        else:
            implicit = integrator != mujoco.mjtIntegrator.mjINT_EULER and not self.constrained
            divided = 1.0 / (1.0 + h * d) if implicit else 1.0
            kept, push = divided if implicit else 1.0 - h * d, -h * square * divided
            step = np.array([[1.0 + h * push, h * kept], [push, kept]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    def longest_timestep(self, unstable: float, integrator: mujoco.mjtIntegrator) -> float:
        """The longest stable timestep below one that is not stable [s]."""
        # Here, for it is a part of scipy that little needs.
        from scipy.optimize import bisect

        ends = math.log(_SHORTEST), math.log(unstable)
        root: Any = bisect(
            lambda e: self.growth(math.exp(e), integrator) - STABLE, *ends, xtol=1e-6
        )
        return math.exp(root)


class MachinePart(Edit):
    """A part of the machine as built; numbers of a joint are at the joint, whatever the gear.

    A part that has an ``oscillation`` needs a timestep with which it is stable. A stiff part is so
    by far, so each is looked at alone.

    Attributes:
        remedy: Another way to make an unstable one stable, for the message.
    """

    rigid = False
    remedy: ClassVar[str] = "make it softer"

    def oscillation(self, model: mujoco.MjModel) -> Oscillation | None:
        """Its motion alone in a compiled model; None of a part without a spring or lag."""

    def require_timestep(self, model: mujoco.MjModel, system: str) -> None:
        """Refuse a timestep with which it is unstable, as ``Edit`` says."""
        h, integrator = float(model.opt.timestep), mujoco.mjtIntegrator(model.opt.integrator)
        oscillation = self.oscillation(model)
        if oscillation is None or oscillation.growth(h, integrator) <= STABLE:
            return
        longest = _SAFE * oscillation.longest_timestep(h, integrator)
        raise ModelError(
            f"{system}: {self.kind} of {self.of!r} {oscillation}, which {integrator.name[6:]} with "
            f"a timestep of {h:g} s makes unstable: take at most {longest:.2g} s, or {self.remedy}"
        )
