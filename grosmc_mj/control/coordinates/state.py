"""The whole state as what a law regulates: section 2's x, without feedback linearization."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import Coordinates, InputMap
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant


@dataclass(frozen=True, eq=False)
class StateCoordinates(Coordinates):
    """z = x - x_e: all of the state, about the operating point that ``p.reference`` is."""

    sign = 1
    outputs = None

    @property
    def size(self) -> int:
        """Number of entries of z."""
        return len(self.system.states)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each entry of z."""
        return tuple(signal.unit for signal in self.system.states)

    @property
    def output_rows(self) -> tuple[int, ...]:
        """Entries of z that a run is judged by."""
        return self.system.controlled

    @cached_property
    def state(self) -> Any:
        """Jitable (t, x, p, z): z = x - x_e."""
        return _state

    def input_maps(self, *, linearizing: bool) -> tuple[InputMap, InputMap]:
        """u = u_e + v and v = u - u_e, which the index weighs."""
        return _applied, _virtual

    def moved(
        self,
        t: float,
        x: Array,
        p: Any,
        plant: Plant,
        w: ArrayLike | None = None,
        u: ArrayLike | None = None,
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain (u - u_e) on a true plant, next to the input u."""
        point = p.reference
        applied = point.u if u is None else np.atleast_1d(np.asarray(u, float))
        gain = plant.jacobian(x, applied)[1]
        return plant.derivative(x, applied, w) - gain @ (applied - point.u), gain

    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """The same where what z is measured from is known, (n,) or (N, n)."""
        return np.asarray(x, float) - reference

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """What z is measured from: the operating point, (N, n)."""
        return np.tile(parameters.x, (len(np.asarray(time)), 1))


@jitable
def _state(t: float, x: Any, p: Any, z: Any) -> None:
    for i in range(len(z)):
        z[i] = x[i] - p.reference.x[i]


@jitable
def _applied(t: float, x: Any, v: Any, memory: Any, p: Any, u: Any) -> None:
    for i in range(len(u)):
        u[i] = p.reference.u[i] + v[i]


@jitable
def _virtual(t: float, x: Any, u: Any, memory: Any, p: Any, v: Any) -> None:
    for i in range(len(v)):
        v[i] = u[i] - p.reference.u[i]
