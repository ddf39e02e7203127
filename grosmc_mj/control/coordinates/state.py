"""The whole state as what a law regulates: section 2's x, without feedback linearization."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import Feedback
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import Plant, System
from grosmc_mj.vectors import Vector, each


@dataclass(frozen=True, eq=False)
class StateCoordinates:
    """z = x - x_e: all of the state, about the operating point that ``p.reference`` is.

    Attributes:
        system: The plant's signals and names.
    """

    system: System

    sign = 1
    outputs = None

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.system.inputs)

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
    def state(self) -> Callable[[float, Any, Any], Vector]:
        """(t, x, p) -> z, jitable."""
        entries = each(self.size, lambda i, x, x_e: x[i] - x_e[i])
        return jitable(lambda t, x, p: entries(x, p.reference.x))

    @cached_property
    def applied(self) -> Callable[[Any, Any], Vector]:
        """Jitable (v, p) -> u = u_e + v: what a law of the linear model comes to."""
        entries = each(self.inputs, lambda i, v, u_e: u_e[i] + v[i])
        return jitable(lambda v, p: entries(v, p.reference.u))

    @cached_property
    def driven(self) -> Feedback:
        """Jitable (t, x, u, memory, p) -> v = u - u_e, which the index weighs."""
        entries = each(self.inputs, lambda i, u, u_e: u[i] - u_e[i])
        return jitable(lambda t, x, u, memory, p: entries(u, p.reference.u))

    def moved(
        self,
        t: float,
        x: Array,
        p: Any,
        plant: Plant,
        w: ArrayLike | None = None,
        u: ArrayLike | None = None,
    ) -> tuple[Array, Array]:
        """(drift, gain) of z' = drift + gain (u - u_e) on a true plant, next to the input u.

        Arguments and results are as those of ``OutputCoordinates.moved``.
        """
        point = p.reference
        applied = point.u if u is None else np.atleast_1d(np.asarray(u, float))
        gain = plant.jacobian(x, applied)[1]
        return plant.derivative(x, applied, w) - gain @ (applied - point.u), gain

    def workspace(self, p: Any) -> None:
        """Nothing that a run computes in."""

    def along(self, time: ArrayLike, x: ArrayLike, p: Any) -> Array:
        """z at every sample of a trajectory: x (N, n); returns (N, n)."""
        return self.beside(p.reference.x, x, p)

    def beside(self, reference: Array, x: ArrayLike, p: Any) -> Array:
        """The same where what z is measured from is known, (n,) or (N, n)."""
        return np.asarray(x, float) - reference

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """What z is measured from: the operating point, (N, n)."""
        return np.tile(parameters.x, (len(np.asarray(time)), 1))
