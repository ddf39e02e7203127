"""Torques of a mechanical system, linear in its unknown parameters: Y theta."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.codegen import generate


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

    # Functions are generated on first use, and once: a law is compiled again for each new one.
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
        m = len(q)
        gravity = self._torques_at_rest(q, np.zeros(m), p)
        torques = [self._torques_at_rest(q, unit, p) for unit in np.eye(m)]
        return np.column_stack(torques) - gravity[:, None]

    def _torques_at_rest(self, q: Array, a: Array, p: Any) -> Array:
        """M(q) a + G(q), (m,)."""
        m = len(q)
        zero = np.zeros(m)
        x = np.concatenate([q, zero])
        Y = np.reshape(self.regressor(x, zero, a, p), (m, -1))
        return Y @ np.array(self.nominal(p))

    def _places(self) -> dict[Any, str]:
        """Code by which generated functions read each symbol; p has those of the plant."""
        entries = sp.Matrix(sp.flatten([self.Y, self.theta]))
        places: dict[Any, str] = {symbol: f"p.{symbol}" for symbol in entries.free_symbols}
        for argument, symbols in (("x", self.x), ("r", self.r), ("a", self.a)):
            places |= {symbol: f"{argument}[{i}]" for i, symbol in enumerate(symbols)}
        return places
