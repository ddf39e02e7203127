"""An affine plant in symbols, and the functions that are generated from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from grosmc_mj.codegen import generate, generate_condition
from grosmc_mj.errors import ModelError
from grosmc_mj.jitable import jitable

Column = tuple[float, ...]


def _entries(row: Any) -> Sequence[Any]:
    """The entries of a row, which may be its one entry."""
    if isinstance(row, np.ndarray):
        row = row.tolist()
    return row if isinstance(row, Sequence) and not isinstance(row, str) else [row]


@dataclass(frozen=True, eq=False)
class Equations:
    """x' = f(x) + g(x) u + d(x, w), y = h(x): eqs. (19)-(20) and (41)-(42) in sympy.

    A symbol that is neither a state nor a component of a wrench is a parameter: the field of
    that name in the plant's parameter dataclass.

    Attributes:
        x: States, n symbols.
        f: Drift, n expressions.
        g: Input matrix, n rows of m expressions.
        h: Outputs, as many as inputs.
        w: Components of the wrenches, symbols.
        d: What a wrench does to x', n expressions linear in w; nothing by default.
        breaks_down: Condition on the states under which the plant's own equations fail.
        region: Condition on the states that the outputs' decoupling matrix is relied on in: X_0.
    """

    x: Sequence[sp.Symbol]
    f: Sequence[Any]
    g: Sequence[Any]
    h: Sequence[Any]
    w: Sequence[sp.Symbol] = ()
    d: Sequence[Any] = ()
    breaks_down: Any = sp.false
    region: Any = sp.true
    parameters: tuple[sp.Symbol, ...] = field(init=False)

    def __post_init__(self) -> None:
        n = len(self.x)
        columns = {
            "x": tuple(self.x),
            "f": tuple(sp.sympify(each) for each in self.f),
            "g": tuple(tuple(sp.sympify(each) for each in _entries(row)) for row in self.g),
            "h": tuple(sp.sympify(each) for each in self.h),
            "w": tuple(self.w),
            "d": tuple(sp.sympify(each) for each in self.d) or (sp.Integer(0),) * n,
        }
        for name in ("f", "g", "d"):
            if len(columns[name]) != n:
                raise ModelError(
                    f"{name} has {len(columns[name])} rows, must have one for each of {n} states"
                )
        widths = {len(row) for row in columns["g"]}
        if len(widths) != 1 or 0 in widths:
            raise ModelError(
                f"g has rows of {sorted(widths)} entries, must have one for each input"
            )
        if len(set(columns["x"])) != n or not all(isinstance(s, sp.Symbol) for s in columns["x"]):
            raise ModelError(f"states {list(columns['x'])} must be {n} different symbols")
        for name, value in columns.items():
            object.__setattr__(self, name, value)
        every = [*self.f, *sum(self.g, ()), *self.h, *self.d, self.breaks_down, self.region]
        free = set().union(*(sp.sympify(each).free_symbols for each in every))
        own = free - set(self.x) - set(self.w)
        object.__setattr__(self, "parameters", tuple(sorted(own, key=str)))

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.g[0])

    def places(self) -> Mapping[sp.Symbol, str]:
        """Where generated functions of (x, w, p) find each symbol."""
        return {
            **{symbol: f"p.{symbol}" for symbol in self.parameters},
            **{symbol: f"w[{i}]" for i, symbol in enumerate(self.w)},
            **{symbol: f"x[{i}]" for i, symbol in enumerate(self.x)},
        }

    @cached_property
    def drift(self) -> Callable[[Any, Any], Column]:
        """Jitable (x, p) -> f(x), an n-tuple."""
        return generate("drift", self.f, "x, p", self.places())

    @cached_property
    def input_matrix(self) -> Callable[[Any, Any], Column]:
        """Jitable (x, p) -> g(x) row by row, n m numbers."""
        return generate("input_matrix", sum(self.g, ()), "x, p", self.places())

    @cached_property
    def disturbance(self) -> Callable[[Any, Any, Any], Column]:
        """Jitable (x, w, p) -> d(x, w), an n-tuple."""
        return generate("disturbance", self.d, "x, w, p", self.places())

    @cached_property
    def jacobian(self) -> Callable[[Any, Any, Any], Column]:
        """(x, u, p) -> the Jacobian of f + g u with respect to x, row by row, n n numbers."""
        u = [sp.Dummy(f"u{i}") for i in range(self.inputs)]
        rates = sp.Matrix(self.f) + sp.Matrix(self.g) * sp.Matrix(u)
        places = {**self.places(), **{symbol: f"u[{i}]" for i, symbol in enumerate(u)}}
        return generate("jacobian", tuple(rates.jacobian(self.x)), "x, u, p", places)

    @cached_property
    def singular(self) -> Callable[[Any], bool]:
        """Jitable x -> whether the plant's own equations break down."""
        return generate_condition("singular", self.breaks_down, self.places())

    @cached_property
    def linearizable(self) -> Callable[[Any], bool]:
        """Jitable x -> whether x is in the region X_0 of section 3.2."""
        return generate_condition("linearizable", self.region, self.places())


# What a system without equations is defined by: it breaks down nowhere.
_EVERYWHERE = {"singular": jitable(lambda x: False), "linearizable": jitable(lambda x: True)}


class NoEquations(Equations):
    """For a system without equations in symbols: it is defined everywhere, and asking tells why.

    Attributes:
        owner: Name of the system.
    """

    def __init__(self, owner: str) -> None:
        object.__setattr__(self, "_owner", owner)

    def __getattribute__(self, name: str) -> Any:
        """What holds everywhere, or the reason why there is nothing.

        Raises:
            ModelError: For all that only symbols could give.
        """
        if name.startswith("_"):
            return object.__getattribute__(self, name)
        if name in _EVERYWHERE:
            return _EVERYWHERE[name]
        raise ModelError(
            f"{self._owner} has no equations in symbols ({name}): MuJoCo computes its dynamics"
        )

    def __repr__(self) -> str:
        return f"NoEquations({self._owner!r})"
