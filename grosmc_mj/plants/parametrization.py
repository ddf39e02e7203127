"""A mechanical system's torques as what is linear in its unknown parameters: Y theta."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from grosmc_mj.arrays import Array
from grosmc_mj.codegen import generate


@dataclass(frozen=True, eq=False)
class LinearParametrization:
    """M(q) a + C(q, q') r + G(q) = Y(q, q', r, a) theta, in the unit of the inputs.

    C is the matrix of Christoffel's symbols, so that M' - 2 C is skew-symmetric, and of viscous
    friction. A constant load on each joint is among the parameters, for it is as unknown as they
    are: nominally zero.

    Attributes:
        x: Joint positions, then their rates: 2 m symbols of the equations.
        r: Reference rates, m symbols.
        a: Reference accelerations, m symbols.
        Y: The regressor, m rows of k expressions.
        theta: The parameters, k expressions in those of the plant.
    """

    x: Sequence[sp.Symbol]
    r: Sequence[sp.Symbol]
    a: Sequence[sp.Symbol]
    Y: Sequence[Sequence[Any]]
    theta: Sequence[Any]

    @cached_property
    def regressor(self) -> Callable[[Any, Any, Any, Any], tuple[float, ...]]:
        """Jitable (x, r, a, p) -> Y row by row, m k numbers."""
        return generate("regressor", sp.flatten(self.Y), "x, r, a, p", self._places())

    @cached_property
    def nominal(self) -> Callable[[Any], tuple[float, ...]]:
        """Jitable p -> theta of a plant's parameters, k numbers."""
        return generate("nominal", self.theta, "p", self._places())

    def inertia(self, q: Array, p: Any) -> Array:
        """M(q) of a plant's parameters, (m, m), in the unit of the inputs per that of q''.

        Args:
            q: Positions, (m,).
            p: The plant's parameters.
        """
        m, theta, zero = len(q), np.array(self.nominal(p)), np.zeros(len(q))
        x, accelerations = np.concatenate([q, zero]), (zero, *np.eye(m))
        still, *torques = (
            np.reshape(self.regressor(x, zero, a, p), (m, -1)) @ theta for a in accelerations
        )
        return np.column_stack(torques) - still[:, None]

    def _places(self) -> dict[Any, str]:
        """Where generated functions find each symbol; those of the plant are fields of p."""
        rows = {"x": self.x, "r": self.r, "a": self.a}
        places: dict[Any, str] = {
            s: f"{name}[{i}]" for name, row in rows.items() for i, s in enumerate(row)
        }
        entries = sp.Matrix(sp.flatten([self.Y, self.theta]))
        return {symbol: f"p.{symbol}" for symbol in entries.free_symbols} | places
