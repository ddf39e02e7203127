"""Common ground of a machine's parts: bounds of their numbers, and the timestep they need."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.fields import OwnerUnit, Range
from grosmc_mj.mechanics.physics.edit import Edit

# Sizes of numbers, in any unit: beyond them is a slip, and squares leave what floats hold.
LEAST = 1e-15
MOST = 1e15
# MuJoCo wants mass and inertia on every body that moves: too little to matter.
TOKEN = 1e-12
# Growth of an oscillation in a timestep that is none, but for rounding.
STABLE = 1 + 1e-9
# A timestep that is short enough for anything [s].
_SHORTEST = 1e-30
# Share of the largest stable timestep: the rest is for the other motions.
_SAFE = 0.9


def positive(unit: str | OwnerUnit = "", *, infinite: bool = False) -> Range:
    """Range of a number above zero, or of a limit that may be infinite."""
    return Range(LEAST, MOST, unit, infinite=infinite)


def not_negative(unit: str | OwnerUnit = "") -> Range:
    """Range of a number from zero on."""
    return Range(0, MOST, unit)


def signed(unit: str | OwnerUnit = "") -> Range:
    """Range of a number of either sign."""
    return Range(-MOST, MOST, unit)


@dataclass(frozen=True)
class Oscillation:
    """q'' + d q' + w^2 q = 0: the motion of a part alone, against the rest of the machine.

    Attributes:
        square: w^2 [1/s^2]; zero of a first-order lag.
        damping: d [1/s].
        constrained: True of a constraint's, whose damping no integrator makes implicit.
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
        if integrator == mujoco.mjtIntegrator.mjINT_RK4:
            step = self._runge_kutta_step(h)
        else:
            implicit = integrator != mujoco.mjtIntegrator.mjINT_EULER and not self.constrained
            step = self._euler_step(h, implicit)
        return float(np.abs(np.linalg.eigvals(step)).max())

    def _runge_kutta_step(self, h: float) -> Array:
        """Matrix of a step of [q, q'] by the classical Runge-Kutta method, (2, 2)."""
        identity = np.eye(2)
        z = h * np.array([[0.0, 1.0], [-self.square, -self.damping]])
        return identity + z @ (identity + z @ (identity / 2 + z @ (identity / 6 + z / 24)))

    def _euler_step(self, h: float, implicit: bool) -> Array:
        """Matrix of a step of [q, q'] by semi-implicit Euler, (2, 2).

        Args:
            h: Timestep [s].
            implicit: True if it is implicit in the damping.
        """
        if implicit:
            divided = 1.0 / (1.0 + h * self.damping)
            kept = divided
        else:
            divided = 1.0
            kept = 1.0 - h * self.damping
        push = -h * self.square * divided
        return np.array([[1.0 + h * push, h * kept], [push, kept]])

    def longest_timestep(self, unstable: float, integrator: mujoco.mjtIntegrator) -> float:
        """Longest stable timestep below one that is not stable [s]."""
        # Imported in the function, for few runs need this part of scipy.
        from scipy.optimize import bisect

        def excess(logarithm: float) -> float:
            return self.growth(math.exp(logarithm), integrator) - STABLE

        root: Any = bisect(excess, math.log(_SHORTEST), math.log(unstable), xtol=1e-6)
        return math.exp(root)


class MachinePart(Edit):
    """A part of the machine as built; numbers of a joint are at the joint, whatever the gear.

    A part that has an ``oscillation`` needs a timestep with which it is stable. A stiff part is so
    by far, so each is looked at alone.

    Attributes:
        remedy: Another way to make an unstable one stable, for the message.
        effect: Name of the effect that parts of several kinds add, such as ``friction``; empty for
            the kind itself.
    """

    rigid = False
    remedy: ClassVar[str] = "make it softer"
    effect: ClassVar[str] = ""

    def oscillation(self, model: mujoco.MjModel) -> Oscillation | None:
        """Motion of the part alone in a compiled model; None without a spring or lag."""

    def require_timestep(self, model: mujoco.MjModel, system: str) -> None:
        """Refuse a timestep with which it is unstable, as ``Edit`` says."""
        h = float(model.opt.timestep)
        integrator = mujoco.mjtIntegrator(model.opt.integrator)
        oscillation = self.oscillation(model)
        if oscillation is None or oscillation.growth(h, integrator) <= STABLE:
            return

        longest = _SAFE * oscillation.longest_timestep(h, integrator)
        raise ModelError(
            f"{system}: {self.kind} of {self.of!r} {oscillation}, which {integrator.name[6:]} with "
            f"a timestep of {h:g} s makes unstable: take at most {longest:.2g} s, or {self.remedy}"
        )
