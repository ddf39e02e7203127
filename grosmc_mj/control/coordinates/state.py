"""The whole state as what a law regulates: section 2's x, without feedback linearization."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System
from grosmc_mj.vectors import Vector, each


@dataclass(frozen=True, eq=False)
class StateCoordinates:
    """z = x: all of the state, about the origin.

    Attributes:
        system: The plant's equations.
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
        entries = each(self.size, lambda i, x: x[i])
        return jitable(lambda t, x, p: entries(x))

    def workspace(self, p: Any) -> None:
        """Nothing that a run computes in."""

    def along(self, time: ArrayLike, x: ArrayLike, p: Any) -> Array:
        """z at every sample of a trajectory: x (N, n); returns (N, n)."""
        return np.asarray(x, float)

    def reference_along(self, time: ArrayLike, parameters: Any) -> Array:
        """What z is measured from: zero, (N, n)."""
        return np.zeros((len(np.asarray(time)), self.size))
