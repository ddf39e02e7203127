"""sympy expressions as functions that run as plain Python and inside compiled code."""

from __future__ import annotations

import hashlib
import linecache
import math
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from grosmc_mj.errors import ModelError, one_line
from grosmc_mj.jitable import jitable

# Integer powers up to this are written as products: pow() need not round as a product does.
_LARGEST_PRODUCT = 8


class _Printer(PythonCodePrinter):
    """Python source in floats only, so that both engines round alike."""

    def _print_Integer(self, expr: Any) -> str:
        return f"{int(expr)}.0"

    def _print_Rational(self, expr: Any) -> str:
        return f"({expr.p}.0/{expr.q}.0)"

    def _print_Half(self, expr: Any) -> str:
        return "0.5"

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        base, power = expr.args
        if power.is_Integer and 1 <= abs(int(power)) <= _LARGEST_PRODUCT:
            product = "*".join([f"({self._print(base)})"] * abs(int(power)))
            return f"({product})" if power > 0 else f"(1.0/({product}))"
        if abs(power) == sp.Rational(1, 2):
            root = f"math.sqrt({self._print(base)})"
            return root if power > 0 else f"(1.0/{root})"
        return f"math.pow({self._print(base)}, {self._print(power)})"


def generate(
    name: str, expressions: Sequence[Any], arguments: str, places: Mapping[Any, str]
) -> Callable[..., Any]:
    """A jitable function of the arguments that returns the expressions' values as a tuple.

    Args:
        name: Name of the function, as tracebacks show it.
        expressions: sympy expressions or conditions.
        arguments: Names of its arguments, as in ``"x, p"``.
        places: Where each symbol is found, such as ``x[0]`` or ``p.m``.

    Raises:
        ModelError: If an expression has another symbol, or what Python's ``math`` cannot compute.
    """
    exact = [sp.sympify(expression) for expression in expressions]
    # A function reaches its own arguments only.
    own = {name.strip() for name in arguments.split(",")}
    places = {s: place for s, place in places.items() if re.split(r"[.\[]", place)[0] in own}
    unknown = sorted({str(s) for part in exact for s in part.free_symbols - set(places)})
    if unknown:
        known = ", ".join(sorted(map(str, places)))
        raise ModelError(f"{name}: unknown symbol {', '.join(unknown)}; known: {known}")
    # No name of a part that occurs often may be a name of the expressions' own.
    names = sp.numbered_symbols("c", exclude=list(places))
    shared, reduced = cast(Any, sp.cse(exact, symbols=names))
    printer: Any = _Printer({"fully_qualified_modules": True, "strict": True})
    written = {symbol: sp.Symbol(place) for symbol, place in places.items()}
    try:
        lines = [
            f"    {symbol} = {printer.doprint(part.xreplace(written))}" for symbol, part in shared
        ]
        values = [printer.doprint(part.xreplace(written)) for part in reduced]
    except Exception as error:  # sympy has no common class for what it cannot print
        raise ModelError(f"{name}: {one_line(str(error))}") from error
    source = "\n".join(
        [f"def {name}({arguments}):", *lines, f"    return ({', '.join(values)},)", ""]
    )
    return jitable(_compile(name, source))


def generate_condition(
    name: str, condition: Any, places: Mapping[Any, str]
) -> Callable[[Any], bool]:
    """A jitable function of the state that says whether a condition of sympy holds.

    Raises:
        ModelError: If the condition has a symbol without a place.
    """
    value = sp.Piecewise((sp.Integer(1), condition), (sp.Integer(0), True))
    indicator = generate(name, [value], "x", places)
    return jitable(lambda x: indicator(x)[0] != 0.0)


def _compile(name: str, source: str) -> Callable[..., Any]:
    """The function that the source defines; tracebacks show its lines."""
    file = f"<generated {name} {hashlib.sha256(source.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    # Code that numba has cached asks for the module of every function in it by this name.
    scope: dict[str, Any] = {"math": math, "__name__": __name__}
    exec(compile(source, file, "exec"), scope)
    return scope[name]
