"""An affine plant in symbols, and the functions that are generated from it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any

import sympy as sp
from pydantic import PlainValidator

from grosmc_mj.ground.compilation.codegen import generate, generate_condition
from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.refusals import refusal

Column = tuple[float, ...]


def _expressions(value: Any) -> tuple[Any, ...]:
    """Return expressions of sympy; never read text, which sympy would execute."""
    if isinstance(value, (list, tuple)):
        with suppress(sp.SympifyError):
            rows = tuple(sp.sympify(row, strict=True) for row in value)
            if all(isinstance(row, sp.Expr) for row in rows):
                return rows
    raise refusal("a list of expressions of sympy, or of numbers")


Expressions = Annotated[Sequence[Any], PlainValidator(_expressions)]


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
        if len(set(self.x)) != n or not all(isinstance(s, sp.Symbol) for s in self.x):
            raise ModelError(f"states {list(self.x)} must be {n} different symbols")

        try:
            f = sp.Matrix(self.f)
            g = sp.Matrix(self.g)
            h = sp.Matrix(self.h)
            d = sp.Matrix(self.d or [0] * n)
        except ValueError as error:
            raise ModelError(f"the equations are no columns of expressions: {error}") from error
        _require_rows("f", f, n)
        _require_rows("g", g, n)
        _require_rows("d", d, n)

        conditions = (sp.sympify(self.breaks_down), sp.sympify(self.region))
        symbols = set().union(*(part.free_symbols for part in (f, g, h, d, *conditions)))
        parameters = symbols - {*self.x, *self.w}

        # The class is frozen: its columns become tuples of expressions here, once for all.
        vars(self).update(
            x=tuple(self.x),
            f=tuple(f.flat()),
            g=tuple(map(tuple, g.tolist())),
            h=tuple(h.flat()),
            w=tuple(self.w),
            d=tuple(d.flat()),
            parameters=tuple(sorted(parameters, key=str)),
        )

    @property
    def inputs(self) -> int:
        """m, the number of inputs."""
        return len(self.g[0])

    def places(self) -> Mapping[sp.Symbol, str]:
        """Code by which generated functions of (x, w, p) read each symbol."""
        return {
            **{symbol: f"p.{symbol}" for symbol in self.parameters},
            **{symbol: f"w[{i}]" for i, symbol in enumerate(self.w)},
            **{symbol: f"x[{i}]" for i, symbol in enumerate(self.x)},
        }

    # Functions are generated on first use, and once: a law is compiled again for each new one.
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
        entries = tuple(rates.jacobian(self.x))

        inputs = {symbol: f"u[{i}]" for i, symbol in enumerate(u)}
        return generate("jacobian", entries, "x, u, p", {**self.places(), **inputs})

    @cached_property
    def singular(self) -> Callable[[Any], bool]:
        """Jitable x -> True if the plant's own equations break down."""
        return generate_condition("singular", self.breaks_down, self.places())

    @cached_property
    def linearizable(self) -> Callable[[Any], bool]:
        """Jitable x -> True if x is in the region X_0 of section 3.2."""
        return generate_condition("linearizable", self.region, self.places())


def _require_rows(name: str, matrix: Any, n: int) -> None:
    """Refuse a column or matrix that has not a row for each of n states.

    Raises:
        ModelError: With its shape.
    """
    if matrix.rows != n or not matrix.cols:
        raise ModelError(
            f"{name} has {matrix.rows} rows of {matrix.cols}, must have one for each of {n} states"
        )
