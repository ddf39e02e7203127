"""Switching gains from a declared uncertainty, where the chapter prints none."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.error_coordinates import ErrorCoordinates
from grosmc_mj.errors import ArgumentError, GainError

# Points of the grids over which the suprema are taken; both include every corner.
_SCALES, _STATES = 5, 21
# A step from z = 0 at which the mismatch is linear: its square is below rounding of the gains.
_NEAR = 1e-4


@dataclass(frozen=True)
class Uncertainty:
    """What a switching law is asked to withstand.

    Attributes:
        scales: Range of the true value of a parameter over its nominal one, by its name.
        wrench: Largest magnitude of each disturbance component, [force, torque] in N and N m
            of each body of the system.
        region: Largest |z1| and |z2| of the error state.
        reaching_rate: The eta of eqs. (14) and (39) that the true plant shall keep: the rate of
            |s|, in the unit of s per second.
    """

    scales: Mapping[str, tuple[float, float]]
    wrench: tuple[float, ...]
    region: tuple[float, float]
    reaching_rate: float

    def __post_init__(self) -> None:
        for name, (low, high) in self.scales.items():
            if not 0 < low <= high < math.inf:
                raise ArgumentError(
                    f"uncertainty of {name}: the range {low:g} to {high:g} must be positive"
                )
        if not self.reaching_rate > 0:
            raise ArgumentError(f"reaching rate {self.reaching_rate:g} must be positive")
        if not all(0 < bound < math.inf for bound in self.region):
            raise ArgumentError(f"operating region {self.region} must be finite and positive")

    def describe(self, ratio: float) -> str:
        """The declaration in one line, with the input-gain ratio that it leads to."""
        scales = [f"{name} x{low:g} to x{high:g}" for name, (low, high) in self.scales.items()]
        pushes = [f"{size:.3g}" for size in self.wrench if size]
        return (
            f"{', '.join(scales) or 'no variation'}; wrench up to {', '.join(pushes) or '0'} N m; "
            f"|z1| <= {self.region[0]:.3g}, |z2| <= {self.region[1]:.3g}; reaching rate "
            f"{self.reaching_rate:g}; input gain down to {ratio:.3g} of the nominal one"
        )


class SwitchingGains(NamedTuple):
    """Gains of eqs. (12) and (37), and the input-gain ratio that they had to allow for.

    Attributes:
        eta: Reaching gain, in the unit of s per second.
        gamma0: Constant part of the bound, in the unit of the input.
        gamma1: Its slope over the norm of the error state.
        gain_ratio: Smallest r = E_true/E_nominal in the family.
    """

    eta: float
    gamma0: float
    gamma1: float
    gain_ratio: float


def switching_gains(
    error: ErrorCoordinates,
    nominal: Any,
    K: Array,
    uncertainty: Uncertainty,
    *,
    linearizing: bool,
) -> SwitchingGains:
    """Gains that keep s' s <= -eta |s| for every plant of the declared family.

    With z1'' = alpha + E u by the model that the law is designed for (the nominal plant or, for
    a linear law, its linearization), alpha* + E* u + d on the true plant, the continuous law u_0
    and u = u_0 + u_dis,

        s' = G_2 [(alpha* - alpha) + (E* - E) u_0 + d + E* u_dis],   G_2 the second entry of G.

    u_dis meets the true input gain E*, not the nominal one, so the assumptions' bounds are met
    with the gain's own uncertainty counted, which breaks the circle of Assumption 4:

        eta    = reaching_rate / min r,                              r = E*/E
        gamma0 = sup |d / E*|
        gamma1 = sup |(alpha* - alpha) + (E* - E) u_0| / (|E*| |z|).

    The suprema are over a grid of the declared scales and the operating region with all their
    corners, and over all directions next to z = 0.

    Args:
        error: Error coordinates of the law.
        nominal: The law's parameters, with ``plant`` and ``reference``.
        K: Its feedback gain, (2,).
        uncertainty: The declared family.
        linearizing: Whether u_0 is (-K z - alpha)/E, as in eq. (37), or -K z, as in eq. (12).

    Raises:
        GainError: If a plant of the family reverses or loses the input, when no gain helps; or
            if the mismatch has a constant part, for which the formula has no room.
    """
    A, B = error.jacobian(nominal)
    velocity = error.system.output + error.system.degrees_of_freedom
    gamma0, gamma1, ratio = 0.0, 0.0, math.inf
    for plant in _family(nominal.plant, uncertainty.scales):
        true = replace(nominal, plant=plant)
        _refuse_constant_mismatch(error, nominal, true)
        slope = []
        for z in _states(uncertainty.region):
            x = _state(error, nominal, z)
            if linearizing:
                alpha, E = error.dynamics(0.0, x, nominal)
            else:
                alpha, E = float(A[1] @ z), float(B[1, 0])
            alpha_true, E_true = error.dynamics(0.0, x, true)
            r = E_true / E
            if not r > 1e-9:
                raise GainError(
                    f"{error.system.name}: the input gain of a declared plant is {r:g} of the "
                    f"nominal one at z = {z}; no switching gain can make up for that"
                )
            u_0 = (-(K @ z) - alpha) / E if linearizing else -(K @ z)
            mismatch = (alpha_true - alpha) + (E_true - E) * u_0
            share = mismatch / (abs(E_true) * float(np.hypot(*z)))
            if len(slope) < len(z):
                slope.append(share)
            gamma1 = max(gamma1, abs(share))
            pushed = sum(
                abs(error.system.disturbance(x, unit * size, plant)[velocity])
                for unit, size in zip(
                    np.eye(len(uncertainty.wrench)), uncertainty.wrench, strict=True
                )
                if size
            )
            gamma0 = max(gamma0, pushed / abs(E_true))
            ratio = min(ratio, r)
        # Near z = 0 the mismatch is linear in z: its largest share is the norm of its slope.
        gamma1 = max(gamma1, float(np.hypot(*slope)))
    eta = uncertainty.reaching_rate / ratio
    return SwitchingGains(float(eta), float(gamma0), float(gamma1), float(ratio))


def _state(error: ErrorCoordinates, nominal: Any, z: Array) -> Array:
    """The plant's state at an error state, with the reference at t = 0 and all else at rest."""
    position = error.system.output
    y_r, dy_r, _ = error.reference(0.0, nominal.reference)
    x = np.zeros(len(error.system.states))
    x[position] = y_r + error.sign * z[0]
    x[position + error.system.degrees_of_freedom] = dy_r + error.sign * z[1]
    return x


def _refuse_constant_mismatch(error: ErrorCoordinates, nominal: Any, true: Any) -> None:
    """Refuse a mismatch at z = 0, such as a payload's weight or a moving reference.

    Raises:
        GainError: If there is one.
    """
    position, m = error.system.output, error.system.degrees_of_freedom
    y_r, *slopes = error.reference(0.0, nominal.reference)
    x = np.zeros(2 * m)
    x[position] = y_r
    alpha, E = error.dynamics(0.0, x, nominal)
    alpha_true, E_true = error.dynamics(0.0, x, true)
    held = abs(alpha_true - alpha * E_true / E)
    if any(slopes) or held > 1e-9 * max(1.0, abs(alpha)):
        raise GainError(
            f"{error.system.name}: the declared plants differ by {held:g} at rest on the "
            "reference, or the reference moves: a bound in |z| cannot cover that; give k and "
            "epsilon instead"
        )


def _family(nominal: Any, scales: Mapping[str, tuple[float, float]]) -> list[Any]:
    """Parameters of the grid of declared plants."""
    axes = [np.linspace(low, high, _SCALES).tolist() for low, high in scales.values()]
    return [
        replace(nominal, **{n: getattr(nominal, n) * k for n, k in zip(scales, point, strict=True)})
        for point in itertools.product(*axes)
    ]


def _states(region: tuple[float, float]) -> list[Array]:
    """A step along each axis next to the origin, then the grid of error states without it."""
    axes = [np.linspace(-bound, bound, _STATES) for bound in region]
    grid = [np.array(z) for z in itertools.product(*axes) if any(z)]
    return [*(_NEAR * np.eye(2)), *grid]
