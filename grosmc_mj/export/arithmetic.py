"""Operators and functions of numbers in C, as Python means them."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from grosmc_mj.export.c_names import LIBRARY
from grosmc_mj.export.c_text import suffix_of
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
    number_in_c,
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
# Bounds of int64_t.
_LEAST = -(2.0**63)
_MOST = 2.0**63 - 1
# Functions of known arguments that are computed now, beside those of the C library.
_COMPUTED = (float, bool, min, max, *_TO_WHOLE)
# Smallest or largest of numbers: of Python, of floats and of whole numbers in C.
_EXTREMES = {min: ("min_", "least_"), max: ("max_", "most_")}


def known_result(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return the value of a function of known arguments.

    What Python raises here it would raise at each sample.

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
    # As an operand of an operator it has parentheses, or compilers warn.
    return Number(f"!{truth(number).within(UNARY)}", True, AND + 1, 0, 1, number.effect)


def truth(number: Number) -> Number:
    """Return whether a number counts as true; compilers warn of sums and products as conditions."""
    if number.is_condition or (number.level == ATOM and not number.whole):
        return number
    return replace(not_zero(number), effect=number.effect)


def not_zero(number: Number) -> Number:
    """Return ``x != 0``."""
    return Number(f"{number.within(_COMPARED_OPERAND)} != 0", True, COMPARED - 1, 0, 1)


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
    bounds = (-math.inf, math.inf)
    if whole:
        bounds = _bounds(op, a, b)
        # The sum of two int is an int in C.
        if a.is_small and b.is_small and not Number("", True, 0, *bounds).is_small:
            a = replace(a, code=f"(int64_t){a.within(UNARY)}", level=UNARY)
    # Bit operators bind in an order that compilers warn of.
    least = level if level >= SUM else UNARY
    code = f"{a.within(least)} {sign} {b.within(least + 1)}"
    return Number(code, whole, level, *bounds)


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


def junction(values: Iterable[Any], suffices: bool, real: str) -> Any:
    """Return the operand of ``or`` or ``and`` that decides, as Python gives it.

    Args:
        values: The operands, known ones and numbers in C, each taken if those before do not decide.
        suffices: Truth value of an operand that decides: true for ``or``.
        real: ``double`` or ``float``.

    Raises:
        NoCError: If an operand is no number, and the result is not known.
    """
    operands: list[Any] = []
    for value in values:
        # One that does not decide counts if it is the last one.
        while operands and is_known(operands[-1]):
            operands.pop()
        operands.append(value)
        if is_known(value) and known_result(bool, value) is suffices:
            break
    if len(operands) == 1:
        return operands[0]

    numbers = [number_in_c(operand, real) for operand in operands]
    if all(number.is_condition for number in numbers):
        # Of conditions it is the last one that decides whatever those before are.
        if is_known(operands[-1]) and bool(operands[-1]) is suffices:
            return suffices
        sign = " || " if suffices else " && "
        # Compilers warn of && beside || without parentheses.
        code = sign.join(number.within(AND + 1) for number in numbers)
        return Number(code, True, OR if suffices else AND, 0, 1)

    result = numbers.pop()
    while numbers:
        first = numbers.pop()
        result = choice(first, first, result) if suffices else choice(first, result, first)
    return result


def choice(test: Number, a: Number, b: Number) -> Number:
    """Return ``a if test else b``."""
    either = union(a, b)
    code = f"{truth(test).within(OR)} ? {a.within(OR)} : {b.within(CHOICE)}"
    return Number(code, either.whole, CHOICE, either.low, either.high)


def is_known_call(function: Any, arguments: Sequence[Any]) -> bool:
    """Whether a call of a function of Python, math or numpy is computed now."""
    return is_known(*arguments) and (function in _COMPUTED or function in LIBRARY)


def library_call(
    function: Any, numbers: Sequence[Number], real: str, undefined: str = ""
) -> Number:
    """Return a call of a function of Python, math or numpy.

    Args:
        function: The function.
        numbers: Its arguments.
        real: ``double`` or ``float``.
        undefined: Place in memory that is 1 after a sample for which the law is not defined.

    Raises:
        NoCError: If C has no such function.
    """
    suffix = suffix_of(real)
    code = ", ".join(number.code for number in numbers)
    if function in _EXTREMES:
        return _extreme(function, numbers)
    if function is float:
        return _as_real(numbers[0], real)
    if function is bool:
        return not_zero(numbers[0])
    if function in _TO_WHOLE:
        if numbers[0].whole:
            return numbers[0]
        inner = _TO_WHOLE[function].format(code, suffix=suffix)
        # The memory says that there is no such number, an error in Python.
        return Number(f"whole_({inner}, &{undefined})", True, low=_LEAST, high=_MOST)
    if function not in LIBRARY:
        name = getattr(function, "__name__", function)
        raise NoCError(f"{name} has no C: write a loop, or use functions of math")

    name = LIBRARY[function]
    if name == "fabs" and numbers[0].whole:
        return _extreme(max, [numbers[0], negative(numbers[0])])
    code = ", ".join(_as_real(item, real).code if item.whole else item.code for item in numbers)
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
