"""Operators and functions of numbers in C, as Python means them."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from grosmc_mj.export.c_text import LIBRARY, suffix_of
from grosmc_mj.export.syntax import NoCError
from grosmc_mj.export.values import (
    AND,
    ATOM,
    CHOICE,
    COMPARED,
    OR,
    PRODUCT,
    SUM,
    UNARY,
    Number,
    is_known,
    union,
)


class Operator(NamedTuple):
    """An operator of Python with two sides.

    Attributes:
        sign: Its sign in C.
        level: How tightly it binds there.
        compute: The same as a function of Python.
    """

    sign: str
    level: int
    compute: Callable[[Any, Any], Any]


OPERATORS: Mapping[type, Operator] = {
    ast.Add: Operator("+", SUM, operator.add),
    ast.Sub: Operator("-", SUM, operator.sub),
    ast.Mult: Operator("*", PRODUCT, operator.mul),
    ast.Div: Operator("/", PRODUCT, operator.truediv),
    ast.Mod: Operator("%", PRODUCT, operator.mod),
    ast.Pow: Operator("", ATOM, operator.pow),
    ast.BitAnd: Operator("&", 8, operator.and_),
    ast.Lt: Operator("<", COMPARED, operator.lt),
    ast.LtE: Operator("<=", COMPARED, operator.le),
    ast.Gt: Operator(">", COMPARED, operator.gt),
    ast.GtE: Operator(">=", COMPARED, operator.ge),
    ast.Eq: Operator("==", COMPARED - 1, operator.eq),
    ast.NotEq: Operator("!=", COMPARED - 1, operator.ne),
}
# Operands of comparisons have parentheses around all but sums and products.
_COMPARED_OPERAND = SUM - 1
_TO_WHOLE = {int: "{}", math.floor: "floor{suffix}({})", math.ceil: "ceil{suffix}({})"}
# Functions of known arguments that are computed now, beside those of the C library.
_COMPUTED = (float, bool, min, max, *_TO_WHOLE)
# Smallest or largest of numbers: of Python, of floats and of whole numbers in C.
_EXTREMES = {min: ("min_", "least_"), max: ("max_", "most_")}


def known_result(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the value of a function of known arguments.

    Raises:
        NoCError: If it has none.
    """
    try:
        return function(*arguments)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise NoCError(f"{error}: change the numbers that it has") from None


def negative(number: Number) -> Number:
    """Return -x."""
    effect = number.effect
    code = f"-{number.within(UNARY + 1)}"
    return Number(code, number.whole, UNARY, -number.high, -number.low, effect)


def negation(number: Number) -> Number:
    """Return ``not x``."""
    return Number(f"!{number.within(UNARY)}", True, UNARY, 0, 1, number.effect)


def operation_in_c(op: ast.operator | ast.cmpop, a: Number, b: Number, real: str) -> Number:
    """Return the result of an operator on two numbers, or of a comparison.

    Args:
        op: The operator, one of ``OPERATORS``.
        a: Its left side.
        b: Its right side.
        real: ``double`` or ``float``.

    Raises:
        NoCError: If C has no such operator for these numbers.
    """
    if isinstance(op, ast.cmpop):
        return _comparison(op, a, b)
    whole = a.whole and b.whole
    if isinstance(op, ast.Pow):
        return Number(f"pow_({a.code}, {b.code})")
    if isinstance(op, (ast.Mod, ast.BitAnd)) and not whole:
        raise NoCError("is for whole numbers: write math.fmod or math.floor")
    if isinstance(op, ast.Mod):
        if b.low <= 0:
            raise NoCError("the divisor must be known to be positive")
        return Number(f"mod_({a.code}, {b.code})", True, low=0, high=b.high - 1)
    if isinstance(op, ast.Div) and whole:
        a = _as_real(a, real)
        whole = False

    sign, level, _ = OPERATORS[type(op)]
    # Bit operators bind in an order that compilers warn of.
    least = level if level >= SUM else UNARY
    code = f"{a.within(least)} {sign} {b.within(least + 1)}"
    if not whole:
        return Number(code, level=level)
    return Number(code, True, level, *_bounds(op, a, b))


def _bounds(op: ast.operator, a: Number, b: Number) -> tuple[float, float]:
    """Bounds of the result of an operator on whole numbers."""
    if isinstance(op, ast.BitAnd):
        masks = [number.low for number in (a, b) if number.low == number.high >= 0]
        return (0, min(masks)) if masks else (-math.inf, math.inf)
    compute = OPERATORS[type(op)].compute
    ends = [compute(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    if any(math.isnan(end) for end in ends):
        return -math.inf, math.inf
    return min(ends), max(ends)


def _comparison(op: ast.cmpop, a: Number, b: Number) -> Number:
    """A comparison."""
    sign, level, _ = OPERATORS[type(op)]
    code = f"{a.within(_COMPARED_OPERAND)} {sign} {b.within(_COMPARED_OPERAND)}"
    return Number(code, True, level, 0, 1)


def junction(values: Iterable[Any], suffices: bool) -> Any:
    """Return conditions with ``or``, which a true one decides, or ``and``.

    Args:
        values: The conditions, known ones and numbers in C.
        suffices: Truth value that decides.

    Raises:
        NoCError: If several are not known, and one of them is no condition.
    """
    operands: list[Number] = []
    for value in values:
        if isinstance(value, Number):
            operands.append(value)
        elif bool(value) is suffices:
            return suffices
    if not operands:
        return not suffices
    if len(operands) == 1:
        return operands[0]

    if not all(number.is_condition for number in operands):
        raise NoCError("and, or are for conditions: write a comparison")
    sign = " || " if suffices else " && "
    # Compilers warn of && beside || without parentheses.
    code = sign.join(number.within(AND + 1) for number in operands)
    return Number(code, True, OR if suffices else AND, 0, 1)


def choice(test: Number, a: Number, b: Number) -> Number:
    """Return ``a if test else b``."""
    either = union(a, b)
    code = f"{test.within(OR)} ? {a.within(OR)} : {b.within(CHOICE)}"
    return Number(code, either.whole, CHOICE, either.low, either.high)


def is_known_call(function: Any, arguments: Sequence[Any]) -> bool:
    """Whether a call of a function of Python, math or numpy is computed now."""
    return is_known(*arguments) and (function in _COMPUTED or function in LIBRARY)


def library_call(function: Any, numbers: Sequence[Number], real: str) -> Number:
    """Return a call of a function of Python, math or numpy.

    Args:
        function: The function.
        numbers: Its arguments.
        real: ``double`` or ``float``.

    Raises:
        NoCError: If C has no such function.
    """
    suffix = suffix_of(real)
    code = ", ".join(number.code for number in numbers)
    if function in _EXTREMES:
        return _extreme(function, numbers)
    if function is float:
        return _as_real(numbers[0], real)
    if function in _TO_WHOLE:
        if numbers[0].whole:
            return numbers[0]
        inner = numbers[0].within(UNARY) if function is int else code
        return Number(f"(int64_t){_TO_WHOLE[function].format(inner, suffix=suffix)}", True, UNARY)
    if function not in LIBRARY:
        name = getattr(function, "__name__", function)
        raise NoCError(f"{name} has no C: write a loop, or use functions of math")

    name = LIBRARY[function]
    if name.startswith("is"):
        return Number(f"({name}({code}) != 0)", True, low=0, high=1)
    if name.endswith("_"):
        # A helper, which has no suffix.
        return Number(f"{name}({code})")
    return Number(f"{name}{suffix}({code})")


def _extreme(function: Any, numbers: Sequence[Number]) -> Number:
    """The least or the largest of some numbers, as Python picks it."""
    result = numbers[0]
    for number in numbers[1:]:
        whole = result.whole and number.whole
        code = f"{_EXTREMES[function][whole]}({result.code}, {number.code})"
        low = function(result.low, number.low)
        high = function(result.high, number.high)
        result = Number(code, True, low=low, high=high) if whole else Number(code)
    return result


def _as_real(number: Number, real: str) -> Number:
    """A number as ``double`` or ``float``."""
    return Number(f"({real}){number.within(UNARY)}", level=UNARY)
