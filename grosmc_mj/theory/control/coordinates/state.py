"""Error of the whole state: section 2's x, without feedback linearization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.theory.control.coordinates.base import Coordinates, InputMap
from grosmc_mj.theory.control.coordinates.design_model import DesignModel, midpoint
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.plants import Plant


@jitable
def _state(t: float, x: Any, p: Any, z: Any) -> None:
    """z = x - x_e."""
    for i in range(len(z)):
        z[i] = x[i] - p.reference.x[i]


@jitable
def _applied(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
    """u = u_e + v."""
    for i in range(len(u)):
        u[i] = p.reference.u[i] + v[i]


@jitable
def _virtual(t: float, x: Any, u: Any, memory: Any, p: Any, v: Any) -> None:
    """v = u - u_e."""
    for i in range(len(v)):
        v[i] = u[i] - p.reference.u[i]


@jitable
def _linear_slope(x: Any, u: Any, numbers: Any, p: Any, slope: Any) -> None:
    """x' = A (x - x_e) + B (u - u_e) with the numbers A, B, x_e and u_e."""
    n = len(x)
    m = len(u)
    # Where each of them begins behind A.
    B = n * n
    x_e = B + n * m
    u_e = x_e + n
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += numbers[n * i + j] * (x[j] - numbers[x_e + j])
        for j in range(m):
            total += numbers[B + m * i + j] * (u[j] - numbers[u_e + j])
        slope[i] = total


_LINEAR_MOTION = midpoint(_linear_slope)


@dataclass(frozen=True, eq=False)
class StateCoordinates(Coordinates):
    """z = x - x_e: the whole state about the operating point ``p.reference``."""

    sign = 1
    outputs = None
    state = staticmethod(_state)  # pyright: ignore[reportAssignmentType]

    @property
    def size(self) -> int:
        """Number of entries of z."""
        return len(self.system.states)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each entry of z."""
        return tuple(signal.unit for signal in self.system.states)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(signal.name for signal in self.system.states)

    @property
    def output_rows(self) -> tuple[int, ...]:
        """Entries of z that a run is judged by."""
        return self.system.controlled

    def input_maps(self, *, linearizing: bool) -> tuple[InputMap, InputMap]:
        """u = u_e + v and v = u - u_e, which the index weighs."""
        return _applied, _virtual

    def require_task(self, plant: Plant, p: Any) -> None:
        """Refuse an operating point that is none of the plant's."""
        plant.operating_point(p.reference.x, p.reference.u)

    def linear_model(self, plant: Plant, p: Any) -> tuple[Array, Array]:
        """(A, B) of the plant about the operating point, where it must rest."""
        return plant.linearization(p.reference.x, p.reference.u)

    def design_model(self, optimum: LqrDesign, p: Any) -> DesignModel:
        """The linearization about the operating point, moved by the midpoint rule."""
        scratch = np.zeros(2 * self.size)
        point = p.reference
        numbers = [scratch, np.ravel(optimum.A), np.ravel(optimum.B), point.x, point.u]
        return DesignModel(_LINEAR_MOTION, np.concatenate(numbers))

    def rest(self, p: Any) -> Array:
        """State of the operating point, (n,)."""
        return p.reference.x

    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain (u - u_e) on a true plant, at the inputs u.

        Args:
            t: Times [s], (N,).
            x: States, (N, n).
            p: The law's parameters, with ``reference``.
            plant: The true plant.
            w: Wrenches on it, (N, 6 * bodies); None for none.
            u: Inputs, (N, m); those of the operating point by default.

        Returns:
            drift (N, n) and gain (N, n, m).
        """
        point = p.reference
        drifts = []
        gains = []
        for i, state in enumerate(x):
            applied = point.u if u is None else u[i]
            wrench = None if w is None else w[i]
            _, gain = plant.jacobian(state, applied)
            derivative = plant.derivative(state, applied, wrench)
            drifts.append(derivative - gain @ (applied - point.u))
            gains.append(gain)
        return np.array(drifts), np.array(gains)

    def from_rates(self, x: Array, p: Any, rates: Array) -> Array:
        """The added rates, (N, n), themselves: z = x - x_e."""
        return rates

    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """z = x - x_e at states x, (n,) or (N, n), for x_e there; returns their shape."""
        return np.asarray(x, float) - reference

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """State of the operating point at the instants (N,), (N, n)."""
        count = len(np.asarray(time))
        return np.tile(parameters.x, (count, 1))
