"""sympy expressions as functions that run as plain Python and inside compiled code."""

from __future__ import annotations

import contextlib
import hashlib
import linecache
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import sympy as sp
from sympy.printing.pycode import PythonCodePrinter

from grosmc_mj.ground.compilation.compiler import cache_folder
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ModelError, SetupError, one_line
from grosmc_mj.ground.files import atomic_write

# Integer powers up to this are written as products: pow() need not round as a product does.
_LARGEST_PRODUCT = 8
# Part of the name of each source on disk: one more where the printer changes.
_FORMAT = 1


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
    name: str,
    expressions: Sequence[Any],
    arguments: str,
    places: Mapping[Any, str],
) -> Callable[..., Any]:
    """Make a jitable function of the arguments that returns the expressions' values as a tuple.

    Its source is kept on disk beside compiled code: sympy takes up to 0.3 s to find it again.

    Args:
        name: Name of the function, as tracebacks show it.
        expressions: sympy expressions or conditions.
        arguments: Names of its arguments, as in ``"x, p"``.
        places: Place of each symbol, such as ``x[0]`` or ``p.m``.

    Raises:
        ModelError: If an expression has another symbol, or what Python's ``math`` cannot compute.
    """
    exact = [sp.sympify(expression) for expression in expressions]
    # A function reaches its own arguments only.
    argument_names = {argument.strip() for argument in arguments.split(",")}
    reachable = {
        symbol: place
        for symbol, place in places.items()
        if re.split(r"[.\[]", place)[0] in argument_names
    }
    unknown = sorted({str(s) for part in exact for s in part.free_symbols - set(reachable)})
    if unknown:
        valid = ", ".join(sorted(map(str, reachable)))
        raise ModelError(f"{name}: unknown symbol {', '.join(unknown)}; known: {valid}")

    file = _cached_source(name, exact, arguments, reachable)
    if file is not None:
        # It may not be there yet, or be damaged.
        with contextlib.suppress(OSError, UnicodeError, SyntaxError, KeyError):
            return jitable(_compile(name, file.read_text(encoding="utf-8")))

    source = _source(name, exact, arguments, reachable)
    if file is not None:
        # On a full disk the source is found anew each time.
        with contextlib.suppress(SetupError), atomic_write(file) as part:
            part.write_text(source, encoding="utf-8")
    return jitable(_compile(name, source))


def _cached_source(
    name: str,
    expressions: Sequence[Any],
    arguments: str,
    places: Mapping[Any, str],
) -> Path | None:
    """File for the source of a function, which its expressions name; None without a cache."""
    folder = cache_folder()
    if folder is None:
        return None
    written = {symbol: sp.Symbol(place) for symbol, place in places.items()}
    # sympy prints a dummy symbol in another way in each process; its place is the same.
    placed = [sp.srepr(expression.xreplace(written)) for expression in expressions]
    # The order of a sum, and so its rounding, depends on the names of its symbols.
    names = sorted(f"{symbol} {place}" for symbol, place in places.items())
    text = f"{_FORMAT} {sp.__version__} {name} {arguments} {names} {placed}"
    key = hashlib.sha256(text.encode()).hexdigest()
    return folder / "generated" / f"{name}-{key[:32]}.py"


def _source(
    name: str,
    expressions: Sequence[Any],
    arguments: str,
    places: Mapping[Any, str],
) -> str:
    """Source of a function in which common parts of the expressions are computed once.

    Raises:
        ModelError: If an expression is one that Python's ``math`` cannot compute.
    """
    # A name of a common part must not be the name of a symbol.
    names = sp.numbered_symbols("c", exclude=list(places))
    common, reduced = cast(Any, sp.cse(expressions, symbols=names))
    printer: Any = _Printer({"fully_qualified_modules": True, "strict": True})
    written = {symbol: sp.Symbol(place) for symbol, place in places.items()}

    lines = [f"def {name}({arguments}):"]
    try:
        for symbol, part in common:
            lines.append(f"    {symbol} = {printer.doprint(part.xreplace(written))}")
        values = [printer.doprint(part.xreplace(written)) for part in reduced]
    except Exception as error:  # sympy has no common class for what it cannot print
        raise ModelError(f"{name}: {one_line(str(error))}") from error
    lines.append(f"    return ({', '.join(values)},)")
    return "\n".join(lines) + "\n"


def generate_condition(
    name: str, condition: Any, places: Mapping[Any, str]
) -> Callable[[Any], bool]:
    """Make a jitable function of the state that says whether a condition of sympy holds.

    Raises:
        ModelError: If the condition has a symbol without a place.
    """
    value = sp.Piecewise((sp.Integer(1), condition), (sp.Integer(0), True))
    indicator = generate(name, [value], "x", places)
    return jitable(lambda x: indicator(x)[0] != 0.0)


def _compile(name: str, source: str) -> Callable[..., Any]:
    """Return the function that the source defines; tracebacks show its lines."""
    file = f"<generated {name} {hashlib.sha256(source.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    # Code that numba has cached asks for the module of every function in it by this name.
    scope: dict[str, Any] = {"math": math, "__name__": __name__}
    exec(compile(source, file, "exec"), scope)
    return scope[name]
