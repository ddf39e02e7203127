"""Expressions of a Python function as C.

Values that are known are computed here; all others become code. A call that gives several numbers
becomes a line of its own before the statement that it stands in.
"""

from __future__ import annotations

import ast
import builtins
import itertools
import math
import operator
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import FunctionType
from typing import Any

import numpy as np

from grosmc_mj.export.c_text import AND, BINARY, CHOICE, LIBRARY, OR, SUM, UNARY, c_name, literal
from grosmc_mj.export.lines import Line
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.syntax import ExportError, refusal, tree_of
from grosmc_mj.export.values import Array, Known, Number, Record, union
from grosmc_mj.jitable import source_of

# Operands of comparisons have parentheses around all but sums and products.
_COMPARED_OPERAND = SUM - 1
_TO_WHOLE = {int: "{}", math.floor: "floor{suffix}({})", math.ceil: "ceil{suffix}({})"}
# Functions of known arguments that are computed here, beside those of the C library.
_FOLDED = (float, bool, min, max, *_TO_WHOLE)
# Smallest or largest of numbers: of Python, of floats and of whole numbers in C.
_EXTREMES = {min: ("min_", "least_"), max: ("max_", "most_")}


class Expressions(ABC):
    """Expressions of one function for certain arguments.

    Args:
        program: The C that the function is part of.
        function: The Python function.

    Attributes:
        names: Values of parameters, of loops' variables, and of names that are bound once to
            something else than a number.
        variables: Kinds and bounds of the variables, as far as assignments have told them.
        declared: Names of the variables that have a value.
        bound: How often each name is bound.
        lines: The C so far.
        depth: Depth of the block that is written.
        written: Names of the arrays, and ``memory``, that the function writes into.
        alone: Expression that is all that the statement computes; a call there may change things.
        effect: That call in C, if it does.
    """

    def __init__(self, program: Program, function: FunctionType) -> None:
        self.program = program
        self.function = function
        self.tree = tree_of(function)
        self.bound: Counter[str] = Counter()
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                self.bound[node.id] += 1
        self.variables: dict[str, Number] = {}
        self.begin()

    def begin(self) -> None:
        """Begin to write, once more with what is known of the variables."""
        self.names: dict[str, Any] = {}
        self.declared: set[str] = set()
        self.lines: list[Line] = []
        self.depth = 0
        self.temporaries = 0
        self.written: set[str] = set()
        self.alone: ast.expr | None = None
        self.effect = ""

    @abstractmethod
    def called(self, function: FunctionType, values: Mapping[str, Any]) -> Function:
        """Return the C function of a Python one for such arguments."""

    def refusal(self, node: Any, reason: str) -> ExportError:
        """Return the error of a part without C, with file, line and what to write instead."""
        return refusal(self.function, node, reason)

    def say(self, text: str, *, defines: str = "", effect: str = "") -> None:
        """Write a line; see ``Line``."""
        self.lines.append(Line(self.depth, text, defines, effect))

    def temporary(self, name: str = "t") -> str:
        """Return a new name that begins with another one."""
        self.temporaries += 1
        return f"{name}{self.temporaries}_"

    def number(self, value: Any, node: Any) -> Number:
        """Return a value as a number in C.

        Raises:
            ExportError: If it is none.
        """
        if isinstance(value, Number):
            return value
        known = value.value if isinstance(value, Known) else None
        if isinstance(known, (bool, int, np.bool_, np.integer)):
            whole = int(known)
            text = str(whole)
            number = Number(text, whole=True, low=whole, high=whole)
        elif isinstance(known, (float, np.floating)):
            text = literal(float(known), self.program.suffix)
            number = Number(text)
        else:
            raise self.refusal(node, "must be one number: write a loop over entries")
        if text.startswith("-"):
            return Number(text, number.whole, UNARY, number.low, number.high)
        return number

    def kept(self, number: Number) -> Number:
        """Compute a number now, and return its name."""
        name = self.temporary()
        self.say(f"const {self.program.type_of(number)} {name} = {number.code};", defines=name)
        return Number(name, number.whole, low=number.low, high=number.high)

    def items(self, value: Any, node: Any) -> list[Any]:
        """Return the entries of a tuple or of an array with one axis."""
        if isinstance(value, tuple):
            return list(value)
        if isinstance(value, Known) and isinstance(value.value, (tuple, list, np.ndarray)):
            return [Known(item) for item in value.value]
        if isinstance(value, Array) and len(value.shape) == 1:
            return [self._entry(value, [Known(k)], node) for k in range(value.shape[0])]
        raise self.refusal(node, "must be a tuple or an array with one axis: write its entries")

    def note_change(self, code: str, node: Any) -> None:
        """Note that a place in C is written."""
        base = re.split(r"\W", code)[0]
        if base == "p" or base.startswith("table_"):
            raise self.refusal(node, "would change a number of the law: write into memory")
        self.written.add(base)

    # Expressions, by the kinds of their nodes.

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression; lines that must come before it are written."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refusal(node, "has no C: use numbers, arrays, loops and conditions")
        return method(node)

    def pure(self, node: ast.expr) -> Any:
        """Return the value of an expression that is not always computed: no line comes before."""
        before = len(self.lines)
        value = self.value(node)
        if len(self.lines) > before:
            raise self.refusal(node, "is not always computed: give it a line of its own before")
        return value

    def _constant(self, node: ast.Constant) -> Known:
        return Known(node.value)

    def _name(self, node: ast.Name) -> Any:
        name = node.id
        if name in self.names:
            return self.names[name]
        if name in self.declared:
            known = self.variables[name]
            return Number(c_name(name), known.whole, low=known.low, high=known.high)
        if self.bound[name]:
            raise self.refusal(node, "has no value here: give it one before")

        code = self.function.__code__
        cells = dict(zip(code.co_freevars, self.function.__closure__ or (), strict=True))
        if name in cells:
            content = cells[name].cell_contents
            return content if isinstance(content, (Record, Array)) else Known(content)
        for scope in (self.function.__globals__, vars(builtins)):
            if name in scope:
                return Known(scope[name])
        raise self.refusal(node, "is not defined")

    def _attribute(self, node: ast.Attribute) -> Any:
        owner = self.value(node.value)
        if isinstance(owner, Record) and node.attr in owner.members:
            return owner.members[node.attr]
        if isinstance(owner, Array) and node.attr == "shape":
            return Known(owner.shape)
        if isinstance(owner, Known) and hasattr(owner.value, node.attr):
            return Known(getattr(owner.value, node.attr))
        raise self.refusal(
            node, f"there is no {node.attr!r}: name a field of memory or of the numbers"
        )

    def _tuple(self, node: ast.Tuple) -> Any:
        values = tuple(self.value(item) for item in node.elts)
        if all(isinstance(value, Known) for value in values):
            return Known(tuple(value.value for value in values))
        return values

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        value = self.value(node.operand)
        is_not = isinstance(node.op, ast.Not)
        if not is_not and not isinstance(node.op, ast.USub):
            raise self.refusal(node, "has no C: use -x and not")
        if isinstance(value, Known):
            return self._folded(node, operator.not_ if is_not else operator.neg, value.value)

        number = self.number(value, node)
        if is_not:
            return Number(f"!{number.within(UNARY)}", True, UNARY, 0, 1)
        code = f"-{number.within(UNARY + 1)}"
        return Number(code, number.whole, UNARY, -number.high, -number.low)

    def _binop(self, node: ast.BinOp) -> Any:
        return self.operation(node, node.op, self.value(node.left), self.value(node.right))

    def operation(self, node: Any, op: ast.operator, left: Any, right: Any) -> Any:
        """Return the value of an operation.

        Args:
            node: Its node, for a refusal.
            op: The operator.
            left: Value of its left side.
            right: Value of its right side.
        """
        if type(op) not in BINARY:
            raise self.refusal(node, "has no C: write a loop over entries, or use + - * / ** %")
        sign, level, fold = BINARY[type(op)]
        if isinstance(left, Known) and isinstance(right, Known):
            return self._folded(node, fold, left.value, right.value)

        a = self.number(left, node)
        b = self.number(right, node)
        whole = a.whole and b.whole
        if isinstance(op, ast.Pow):
            return Number(f"pow_({a.code}, {b.code})")
        if isinstance(op, (ast.Mod, ast.BitAnd)) and not whole:
            raise self.refusal(node, "is for whole numbers: write math.fmod or math.floor")
        if isinstance(op, ast.Mod):
            if b.low <= 0:
                raise self.refusal(node, "the divisor must be known to be positive")
            return Number(f"mod_({a.code}, {b.code})", True, low=0, high=b.high - 1)
        if isinstance(op, ast.Div) and whole:
            a = Number(f"({self.program.real}){a.within(UNARY)}", level=UNARY)
            whole = False

        # Bit operators bind in an order that compilers warn of.
        least = level if level >= SUM else UNARY
        code = f"{a.within(least)} {sign} {b.within(least + 1)}"
        if not whole:
            return Number(code, level=level)
        return Number(code, True, level, *_bounds(op, a, b))

    def _folded(self, node: Any, fold: Any, *arguments: Any) -> Known:
        """Value of a function of known arguments."""
        try:
            return Known(fold(*arguments))
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            reason = f"{error}: change the numbers that it has"
            raise self.refusal(node, reason) from None

    def _compare(self, node: ast.Compare) -> Any:
        values = [self.value(item) for item in (node.left, *node.comparators)]
        conditions = []
        for op, (left, right) in zip(node.ops, itertools.pairwise(values), strict=True):
            conditions.append(self._comparison(node, op, left, right))
        return self._joined(node, conditions, stops=False)

    def _comparison(self, node: ast.Compare, op: ast.cmpop, left: Any, right: Any) -> Any:
        """Value of one comparison."""
        if type(op) not in BINARY:
            raise self.refusal(node, "has no C: write ==, !=, <, <=, > or >=")
        sign, level, fold = BINARY[type(op)]
        if isinstance(left, Known) and isinstance(right, Known):
            return self._folded(node, fold, left.value, right.value)
        a = self.number(left, node).within(_COMPARED_OPERAND)
        b = self.number(right, node).within(_COMPARED_OPERAND)
        return Number(f"{a} {sign} {b}", True, level, 0, 1)

    def _boolop(self, node: ast.BoolOp) -> Any:
        conditions = self._in_turn(node.values)
        return self._joined(node, conditions, stops=isinstance(node.op, ast.Or))

    def _in_turn(self, nodes: Sequence[ast.expr]) -> Iterator[Any]:
        """Values of conditions; those after the first are not always computed."""
        yield self.value(nodes[0])
        for node in nodes[1:]:
            yield self.pure(node)

    def _joined(self, node: Any, values: Iterable[Any], *, stops: bool) -> Any:
        """Value of conditions with ``or``, which a true one decides, or ``and``.

        Args:
            node: Their node, for a refusal.
            values: The conditions.
            stops: Truth value that decides.
        """
        operands: list[Number] = []
        for value in values:
            if not isinstance(value, Known):
                operands.append(self.number(value, node))
            elif bool(value.value) is stops:
                return Known(stops)
        if not operands:
            return Known(not stops)
        if len(operands) == 1:
            return operands[0]
        if not all(number.is_condition for number in operands):
            raise self.refusal(node, "and, or are for conditions: write a comparison")
        sign = " || " if stops else " && "
        # Compilers warn of && beside || without parentheses.
        code = sign.join(number.within(AND + 1) for number in operands)
        return Number(code, True, OR if stops else AND, 0, 1)

    def _ifexp(self, node: ast.IfExp) -> Any:
        condition = self.value(node.test)
        if isinstance(condition, Known):
            return self.value(node.body if condition.value else node.orelse)
        test = self.number(condition, node)
        a = self.number(self.pure(node.body), node)
        b = self.number(self.pure(node.orelse), node)
        either = union(a, b)
        code = f"{test.within(OR)} ? {a.within(OR)} : {b.within(CHOICE)}"
        return Number(code, either.whole, CHOICE, either.low, either.high)

    # Entries of arrays.

    def _subscript(self, node: ast.Subscript) -> Any:
        owner = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self._slice(node, owner, node.slice)

        index = self.value(node.slice)
        if isinstance(index, Known) and isinstance(owner, Known):
            return self._folded(node, lambda: owner.value[index.value])
        if isinstance(index, Known) and isinstance(owner, tuple):
            return self._folded(node, lambda: owner[index.value]).value
        if isinstance(owner, Known):
            owner = self.program.table(owner.value)
        if not isinstance(owner, Array):
            raise self.refusal(node, "the index must be known: write a loop over range(...)")
        several = isinstance(node.slice, ast.Tuple)
        return self._entry(owner, self.items(index, node) if several else [index], node)

    def _slice(self, node: ast.Subscript, owner: Any, place: ast.Slice) -> Any:
        """Part of an array with one axis."""
        lower = Known(None) if place.lower is None else self.value(place.lower)
        upper = Known(None) if place.upper is None else self.value(place.upper)
        if not isinstance(lower, Known) or not isinstance(upper, Known) or place.step is not None:
            raise self.refusal(node, "a slice has ends that are known: write a loop")
        if not isinstance(owner, Array) or len(owner.shape) != 1:
            raise self.refusal(node, "a slice is of an array with one axis: write a loop")
        first, last, _ = slice(lower.value, upper.value).indices(owner.shape[0])
        return Array(owner.code, (max(0, last - first),), owner.offset + first)

    def _entry(self, owner: Array, indices: Sequence[Any], node: Any) -> Number:
        """Entry of an array, at indices that are proven to lie in it."""
        if len(indices) != len(owner.shape):
            raise self.refusal(node, f"has {len(owner.shape)} axes: give an index for each")
        place = owner.offset
        terms: list[str] = []
        stride = math.prod(owner.shape)
        for index, size in zip(indices, owner.shape, strict=True):
            stride //= size
            number = self.number(index, node)
            low = number.low
            # Python counts a known negative index from the end.
            if low == number.high and -size <= low < 0:
                number = Number("", True, low=low + size, high=low + size)
            if not number.whole or not 0 <= number.low <= number.high < size:
                raise self.refusal(
                    node,
                    f"index {number.code} is not known to lie in 0 ... {size - 1}: write a loop "
                    f"over range({size}), or k % {size}",
                )
            if number.low == number.high:
                place += int(number.low) * stride
            else:
                terms.append(number.code if stride == 1 else f"{number.within(UNARY)} * {stride}")
        if place or not terms:
            terms.append(str(place))
        return Number(f"{owner.code}[{' + '.join(terms)}]")

    # Calls.

    def _call(self, node: ast.Call) -> Any:
        target = self.value(node.func)
        if not isinstance(target, Known):
            raise self.refusal(node, "is no function")
        function = source_of(target.value)
        arguments = [self.value(item) for item in node.args]
        if isinstance(function, FunctionType) and function not in LIBRARY:
            named = {item.arg or "": self.value(item.value) for item in node.keywords}
            return self._python_call(node, function, arguments, named)
        if node.keywords:
            raise self.refusal(node, "has no C with named arguments")
        return self._builtin_call(node, function, arguments)

    def _builtin_call(self, node: ast.Call, function: Any, arguments: list[Any]) -> Any:
        """Value of a call of a function of Python's, math's or numpy's."""
        if function is len:
            value = arguments[0]
            whole = value.shape[0] if isinstance(value, Array) else len(self.items(value, node))
            return Known(whole)
        if function is np.zeros:
            return self._new_array(node, arguments)
        library = LIBRARY.get(function) if callable(function) else None
        known = all(isinstance(item, Known) for item in arguments)
        if known and (function in _FOLDED or library):
            return self._folded(node, function, *(item.value for item in arguments))

        numbers = [self.number(item, node) for item in arguments]
        code = ", ".join(number.code for number in numbers)
        if function in _EXTREMES:
            return self._extreme(function, numbers)
        if function is float:
            return Number(f"({self.program.real}){numbers[0].within(UNARY)}", level=UNARY)
        if function in _TO_WHOLE:
            inner = numbers[0].within(UNARY) if function is int else code
            text = _TO_WHOLE[function].format(inner, suffix=self.program.suffix)
            return numbers[0] if numbers[0].whole else Number(f"(int64_t){text}", True, UNARY)
        if library is None:
            name = getattr(function, "__name__", function)
            raise self.refusal(node, f"{name} has no C: write a loop, or use functions of math")
        if library.startswith("is"):
            return Number(f"({library}({code}) != 0)", True, low=0, high=1)
        suffix = "" if library.endswith("_") else self.program.suffix
        return Number(f"{library}{suffix}({code})")

    def _new_array(self, node: ast.Call, arguments: Sequence[Any]) -> Array:
        """An array of a known size, which begins with zeros."""
        if len(arguments) != 1 or not isinstance(arguments[0], Known):
            raise self.refusal(node, "an array has a known size: begin it in memory")
        shape = tuple(np.atleast_1d(arguments[0].value).tolist())
        name = self.temporary()
        size = math.prod(shape)
        self.say(f"{self.program.real} {name}[{size}] = {{0}};", defines=name)
        return Array(name, shape)

    def _extreme(self, function: Any, numbers: Sequence[Number]) -> Number:
        """The least or the largest of some numbers, as Python picks it."""
        result = numbers[0]
        for number in numbers[1:]:
            whole = result.whole and number.whole
            helper = _EXTREMES[function][whole]
            code = f"{helper}({result.code}, {number.code})"
            low = function(result.low, number.low)
            high = function(result.high, number.high)
            result = Number(code, True, low=low, high=high) if whole else Number(code)
        return result

    def _python_call(
        self,
        node: ast.Call,
        function: FunctionType,
        arguments: Sequence[Any],
        named: Mapping[str, Any],
    ) -> Any:
        """Value of a call of a Python function, which becomes one of C."""
        function, values = self.program.bound(function, arguments, named)
        called = self.called(function, values)
        if isinstance(called.returns, Known):
            return called.returns

        codes = []
        for name in called.parameters:
            value = values[name]
            if isinstance(value, Array):
                if name in called.written:
                    self.note_change(value.code, node)
                codes.append(value.pointer)
            else:
                codes.append(self.number(value, node).code)
        if called.needs_memory:
            codes.append(self.program.memory)
        if called.written and node is not self.alone:
            raise self.refusal(node, "changes something: give it a line of its own before")
        if self.program.memory in called.written:
            self.written.add(self.program.memory)

        if isinstance(called.returns, int):
            name = self.temporary(called.name)
            self.say(f"{self.program.real} {name}[{called.returns}];", defines=name)
            code = f"{called.name}({', '.join([*codes, name])});"
            self.say(code, defines="" if called.written else name)
            return Array(name, (called.returns,))
        code = f"{called.name}({', '.join(codes)})"
        if called.returns is None:
            self.say(f"{code};")
            return Known(None)
        if called.written:
            self.effect = f"{code};"
        returns = called.returns
        return Number(code, returns.whole, low=returns.low, high=returns.high)


def _bounds(op: ast.operator, a: Number, b: Number) -> tuple[float, float]:
    """Bounds of the result of an operation on whole numbers."""
    fold = BINARY[type(op)][2]
    if isinstance(op, ast.BitAnd):
        masks = [number.low for number in (a, b) if number.low == number.high >= 0]
        return (0, min(masks)) if masks else (-math.inf, math.inf)
    ends = [fold(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    if any(math.isnan(end) for end in ends):
        return -math.inf, math.inf
    return min(ends), max(ends)
