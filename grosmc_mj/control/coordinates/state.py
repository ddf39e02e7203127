"""The whole state as what a law regulates: section 2's x, without feedback linearization."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import Coordinates, InputMap
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant


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


@dataclass(frozen=True, eq=False)
class StateCoordinates(Coordinates):
    """z = x - x_e: all of the state, about the operating point that ``p.reference`` is."""

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

    def error_dynamics(
        self,
        t: Sequence[float],
        x: Array,
        p: Any,
        plant: Plant,
        w: Array | None = None,
        u: Array | None = None,
    ) -> tuple[Array, Array]:
        """As for all coordinates, of z' = drift + gain (u - u_e) next to the inputs u."""
        point, motion = p.reference, []
        for i, state in enumerate(x):
            applied = point.u if u is None else u[i]
            gain = plant.jacobian(state, applied)[1]
            drift = plant.derivative(state, applied, None if w is None else w[i])
            motion.append((drift - gain @ (applied - point.u), gain))
        drifts, gains = zip(*motion, strict=True)
        return np.array(drifts), np.array(gains)

    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """The same where what z is measured from is known, (n,) or (N, n)."""
        return np.asarray(x, float) - reference

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """What z is measured from: the operating point, (N, n)."""
        return np.tile(parameters.x, (len(np.asarray(time)), 1))
