"""Expressions of a Python function as C.

Values that are known are computed here; all others become code. A call that changes something, or
that gives several numbers, becomes a line of its own before the statement that it stands in.
"""

from __future__ import annotations

import ast
import builtins
import itertools
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from types import FunctionType
from typing import Any, NoReturn

import numpy as np

from grosmc_mj.export.c_text import (
    AND,
    BINARY,
    CHOICE,
    LIBRARY,
    OR,
    PRODUCT,
    SUM,
    UNARY,
    c_name,
    literal,
)
from grosmc_mj.export.function import Functions
from grosmc_mj.export.lines import Line
from grosmc_mj.export.syntax import ExportError, refusal, tree_of
from grosmc_mj.export.values import Array, Kind, Known, Number, Record
from grosmc_mj.jitable import source_of

# Operands of comparisons have parentheses around all but sums and products.
_COMPARED_OPERAND = SUM - 1
_LEAST = (min, np.minimum)
_MOST = (max, np.maximum)
_TO_WHOLE = {int: "{}", math.floor: "floor{suffix}({})", math.ceil: "ceil{suffix}({})"}
_FOLDED = (int, float, bool, min, max, round, *_TO_WHOLE)


class UnknownIndexError(Exception):
    """A row of records, or of known whole numbers, is looked up at an index that is not known.

    A loop around it is then written out, in this function or in one that calls it.

    Attributes:
        refusal: The error if there is no such loop.
    """

    def __init__(self, refusal: ExportError) -> None:
        super().__init__(str(refusal))
        self.refusal = refusal


class Expressions:
    """Expressions of one function for certain arguments.

    Args:
        program: The C that the function is part of.
        function: The Python function.

    Attributes:
        names: Values of parameters, of loops' variables, and of names that are bound once to
            something else than a number.
        variables: Kinds and bounds of the variables, as far as assignments have told them.
        bound: How often each name is bound.
        lines: The C so far.
        fixed: Names that keep one value: parameters, and variables of loops around.
        depth: Depth of the block that is written.
        wanted: Name that the next array shall have.
        written: Names of the parameters that the function writes into.
        changes: Whether it changes anything at all.
    """

    def __init__(self, program: Functions, function: FunctionType) -> None:
        self.program = program
        self.function = function
        self.tree = tree_of(function)
        stored = [
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load)
        ]
        self.bound = Counter(stored)
        self.variables: dict[str, Number] = {}
        self.begin()

    def begin(self) -> None:
        """Begin to write, once more with what is known of the variables."""
        self.names: dict[str, Any] = {}
        self.fixed: set[str] = set()
        self.lines: list[Line] = []
        self.depth = 0
        self.temporaries = 0
        self.wanted = ""
        self.written: set[str] = set()
        self.changes = False

    def refusal(self, node: Any, reason: str) -> ExportError:
        """Return the error of a part without C, with file, line and what to write instead."""
        return refusal(self.function, node, reason)

    def refuse(self, node: Any, reason: str) -> NoReturn:
        """Refuse a part of the function."""
        raise self.refusal(node, reason)

    def say(
        self,
        text: str,
        *,
        defines: str = "",
        declares: bool = False,
        effect: str = "",
    ) -> None:
        """Write a line; see ``Line``."""
        self.lines.append(Line(self.depth, text, defines, declares, effect))

    @property
    def suffix(self) -> str:
        """Suffix of numbers and functions in this precision."""
        return self.program.suffix

    def type_of(self, number: Number) -> str:
        """Return the type in C of a number."""
        if number.kind == "double":
            return self.program.real
        small = number.low > -(2**31) and number.high < 2**31
        return "int" if small else "int64_t"

    def temporary(self) -> str:
        """Return a new name, or the one that is wanted."""
        if self.wanted:
            name = c_name(self.wanted)
            self.wanted = ""
            return name
        self.temporaries += 1
        return f"t{self.temporaries}_"

    def number(self, value: Any, node: Any) -> Number:
        """Return a value as a number in C.

        Raises:
            ExportError: If it is none.
        """
        if isinstance(value, Number):
            return value
        known = value.value if isinstance(value, Known) else None
        if isinstance(known, (bool, np.bool_)):
            return Number(str(int(known)), "bool", low=0, high=1)
        if isinstance(known, (int, np.integer)):
            level = UNARY if known < 0 else Number("").level
            return Number(str(int(known)), "int", level, int(known), int(known))
        if isinstance(known, (float, np.floating)):
            text = literal(float(known), self.suffix)
            return Number(text, level=UNARY if text.startswith("-") else Number("").level)
        raise self.refusal(node, "must be one number: write a loop over entries")

    def kept(self, number: Number, *, changes: bool = False) -> Number:
        """Compute a number now, and return its name.

        Args:
            number: The number.
            changes: Whether computing it changes something else.
        """
        name = self.temporary()
        text = f"const {self.type_of(number)} {name} = {number.code};"
        effect = f"{number.code};" if changes else ""
        self.say(text, defines=name, declares=True, effect=effect)
        return Number(name, number.kind, low=number.low, high=number.high)

    def items(self, value: Any, node: Any) -> list[Any]:
        """Return the entries of a tuple or of an array with one axis."""
        if isinstance(value, tuple):
            return list(value)
        if isinstance(value, Known) and isinstance(value.value, (tuple, list, np.ndarray)):
            return [Known(item) for item in value.value]
        if isinstance(value, Array) and len(value.shape) == 1:
            return [self._entry(value, [Known(k)], node) for k in range(value.shape[0])]
        raise self.refusal(node, "must be a tuple or an array with one axis: write its entries")

    # Expressions, by the kinds of their nodes.

    def value(self, node: ast.expr) -> Any:
        """Return the value of an expression; lines that must come before it are written."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            self.refuse(node, "has no C: use numbers, arrays, loops and conditions")
        return method(node)

    def pure(self, node: ast.expr) -> Any:
        """Return the value of an expression that is not always computed: no line comes before."""
        before = len(self.lines)
        value = self.value(node)
        if len(self.lines) > before:
            self.refuse(node, "is not always computed: give it a line of its own before")
        return value

    def _constant(self, node: ast.Constant) -> Known:
        return Known(node.value)

    def _name(self, node: ast.Name) -> Any:
        name = node.id
        if name in self.names:
            return self.names[name]
        if name in self.variables:
            known = self.variables[name]
            return Number(c_name(name), known.kind, low=known.low, high=known.high)
        if not self.bound[name]:
            code = self.function.__code__
            cells = dict(zip(code.co_freevars, self.function.__closure__ or (), strict=True))
            if name in cells:
                content = cells[name].cell_contents
                return content if isinstance(content, (Record, Array)) else Known(content)
            for scope in (self.function.__globals__, vars(builtins)):
                if name in scope:
                    return Known(scope[name])
        raise self.refusal(node, "has no value here: give it one before")

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
        if values and all(isinstance(value, Known) for value in values):
            return Known(tuple(value.value for value in values))
        return values

    def _unaryop(self, node: ast.UnaryOp) -> Any:
        value = self.value(node.operand)
        if isinstance(node.op, ast.UAdd):
            return value
        if isinstance(node.op, ast.Invert):
            self.refuse(node, "has no C: write -x - 1")
        negates = isinstance(node.op, ast.USub)
        if isinstance(value, Known):
            return Known(-value.value if negates else not value.value)

        number = self.number(value, node)
        operand = number.within(UNARY + 1)
        if not negates:
            return Number(f"!{operand}", "bool", UNARY, 0, 1)
        kind: Kind = "int" if number.whole else "double"
        return Number(f"-{operand}", kind, UNARY, -number.high, -number.low)

    def _binop(self, node: ast.BinOp) -> Any:
        return self.operation(node, node.op, self.value(node.left), self.value(node.right))

    def operation(self, node: Any, op: ast.operator, left: Any, right: Any) -> Any:
        """Return the value of an arithmetic operation.

        Args:
            node: Its node, for a refusal.
            op: The operator.
            left: Value of the left operand.
            right: Value of the right operand.
        """
        if type(op) not in BINARY:
            self.refuse(node, "has no C: write a loop over entries")
        sign, level, fold = BINARY[type(op)]
        if isinstance(left, Known) and isinstance(right, Known):
            return self._folded(node, fold, left.value, right.value)
        if isinstance(op, ast.Pow):
            return self._power(node, left, right)

        a = self.number(left, node)
        b = self.number(right, node)
        whole = a.whole and b.whole
        if isinstance(op, (ast.Mod, ast.FloorDiv)):
            return self._division(node, op, a, b)
        if isinstance(op, ast.Div):
            whole = False
            if a.whole and b.whole:
                a = Number(f"({self.program.real}){a.within(UNARY)}", level=UNARY)
        if level < SUM and not whole:
            self.refuse(node, "is for whole numbers: write int(...)")
        if isinstance(op, ast.Add) and whole and a.code == "0":
            return b

        # Bit operators bind in an order that compilers warn of.
        least = level if level >= SUM else UNARY
        code = f"{a.within(least)} {sign} {b.within(least + 1)}"
        if not whole:
            return Number(code, level=level)
        low, high = _bounds(op, a, b)
        return Number(code, "int", level, low, high)

    def _folded(self, node: Any, fold: Any, *arguments: Any) -> Known:
        """Value of a function of known arguments."""
        try:
            return Known(fold(*arguments))
        except (ArithmeticError, TypeError, ValueError) as error:
            self.refuse(node, f"{error}: change the numbers that it has")

    def _power(self, node: Any, left: Any, right: Any) -> Number:
        """Value of left ** right, by the C library as in Python."""
        base = self.number(left, node)
        return Number(f"pow_({base.code}, {self.number(right, node).code})")

    def _division(self, node: Any, op: ast.operator, a: Number, b: Number) -> Number:
        """Value of a % b or a // b of whole numbers, rounded down as in Python."""
        if not (a.whole and b.whole):
            self.refuse(node, "is for whole numbers: write math.fmod or math.floor")
        if b.low <= 0:
            self.refuse(node, "the divisor must be known to be positive")
        bounds = (0.0, b.high - 1)
        if isinstance(op, ast.FloorDiv):
            ends = [math.floor(end / b.low) for end in (a.low, a.high) if math.isfinite(end)]
            bounds = (min(ends), max(ends)) if len(ends) == 2 else (-math.inf, math.inf)
        if a.low >= 0:
            sign = BINARY[type(op)].sign
            code = f"{a.within(PRODUCT)} {sign} {b.within(UNARY)}"
            return Number(code, "int", PRODUCT, *bounds)
        helper = "mod_" if isinstance(op, ast.Mod) else "div_"
        return Number(f"{helper}({a.code}, {b.code})", "int", Number("").level, *bounds)

    def _compare(self, node: ast.Compare) -> Any:
        values = [self.value(item) for item in (node.left, *node.comparators)]
        pairs = itertools.pairwise(values)
        conditions = []
        for op, (left, right) in zip(node.ops, pairs, strict=True):
            conditions.append(self._comparison(node, op, left, right))
        return self._joined(node, conditions, stops=False)

    def _comparison(self, node: ast.Compare, op: ast.cmpop, left: Any, right: Any) -> Any:
        """Value of one comparison."""
        if isinstance(left, Known) and isinstance(right, Known):
            if isinstance(op, ast.Is):
                return Known(left.value is right.value)
            if isinstance(op, ast.IsNot):
                return Known(left.value is not right.value)
        if type(op) not in BINARY:
            self.refuse(node, "has no C: write ==, !=, <, <=, > or >=")
        sign, level, fold = BINARY[type(op)]
        if isinstance(left, Known) and isinstance(right, Known):
            return self._folded(node, fold, left.value, right.value)
        a = self.number(left, node).within(_COMPARED_OPERAND)
        b = self.number(right, node).within(_COMPARED_OPERAND)
        return Number(f"{a} {sign} {b}", "bool", level, 0, 1)

    def _boolop(self, node: ast.BoolOp) -> Any:
        values = [self.value(node.values[0])]
        values += [self.pure(item) for item in node.values[1:]]
        return self._joined(node, values, stops=isinstance(node.op, ast.Or))

    def _joined(self, node: Any, values: Sequence[Any], *, stops: bool) -> Any:
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
                # Those before it change nothing: a call that does has a line of its own.
                return Known(stops)
        if not operands:
            return Known(not stops)
        if len(operands) == 1:
            return operands[0]
        if any(number.kind != "bool" for number in operands):
            self.refuse(node, "and, or are for conditions: write a comparison")
        sign = " || " if stops else " && "
        # Compilers warn of && beside || without parentheses.
        code = sign.join(number.within(AND + 1) for number in operands)
        return Number(code, "bool", OR if stops else AND, 0, 1)

    def _ifexp(self, node: ast.IfExp) -> Any:
        condition = self.value(node.test)
        if isinstance(condition, Known):
            return self.value(node.body if condition.value else node.orelse)
        test = self.number(condition, node)
        a = self.number(self.pure(node.body), node)
        b = self.number(self.pure(node.orelse), node)
        joined = union(a, b)
        code = f"{test.within(OR)} ? {a.within(OR)} : {b.within(CHOICE)}"
        return Number(code, joined.kind, CHOICE, joined.low, joined.high)

    # Entries of arrays.

    def _subscript(self, node: ast.Subscript) -> Any:
        owner = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self._slice(node, owner, node.slice)
        index = node.slice
        nodes = index.elts if isinstance(index, ast.Tuple) else [index]
        indices = [self.value(item) for item in nodes]
        known = all(isinstance(item, Known) for item in indices)

        if known and isinstance(owner, Known):
            places = tuple(item.value for item in indices)
            place = places[0] if len(places) == 1 else places
            return self._folded(node, lambda: owner.value[place])
        if known and isinstance(owner, tuple):
            return self._folded_entry(node, owner, indices[0].value)
        if isinstance(owner, Known):
            owner = self.program.table(owner.value)
        if not isinstance(owner, Array):
            reason = "the index must be known: write a loop over range(...)"
            raise UnknownIndexError(self.refusal(node, reason))
        return self._entry(owner, indices, node)

    def _folded_entry(self, node: ast.Subscript, owner: tuple[Any, ...], index: Any) -> Any:
        """Entry of a tuple at a known index."""
        if not isinstance(index, int) or not -len(owner) <= index < len(owner):
            self.refuse(node, f"has no entry {index}")
        return owner[index]

    def _slice(self, node: ast.Subscript, owner: Any, place: ast.Slice) -> Any:
        """Part of an array with one axis."""
        lower = Known(None) if place.lower is None else self.value(place.lower)
        upper = Known(None) if place.upper is None else self.value(place.upper)
        ends = lower, upper
        known = all(isinstance(end, Known) for end in ends)
        if not known or place.step is not None:
            self.refuse(node, "a slice has ends that are known: write a loop")
        if isinstance(owner, Known):
            return Known(owner.value[ends[0].value : ends[1].value])
        if not isinstance(owner, Array) or len(owner.shape) != 1:
            self.refuse(node, "a slice is of an array with one axis: write a loop")
        first, last, _ = slice(ends[0].value, ends[1].value).indices(owner.shape[0])
        shape = (max(0, last - first),)
        return Array(owner.code, shape, owner.offset + first, owner.parameter, owner.constant)

    def _entry(self, owner: Array, indices: Sequence[Any], node: Any) -> Number:
        """Entry of an array, at indices that are proven to lie in it."""
        if len(indices) != len(owner.shape):
            self.refuse(node, f"has {len(owner.shape)} axes: give an index for each")
        place = owner.offset
        terms: list[str] = []
        stride = math.prod(owner.shape)
        for index, size in zip(indices, owner.shape, strict=True):
            stride //= size
            number = self.number(index, node)
            low = number.low
            # Python counts a known negative index from the end.
            if low == number.high and -size <= low < 0:
                number = Number("", "int", low=low + size, high=low + size)
            if not number.whole or not 0 <= number.low <= number.high < size:
                self.refuse(
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
            self.refuse(node, "is no function")
        function = target.value
        wanted = self.wanted
        self.wanted = ""
        arguments = [self.value(item) for item in node.args]
        self.wanted = wanted
        if isinstance(source_of(function), FunctionType) and not _in_library(function):
            named = {item.arg or "": self.value(item.value) for item in node.keywords}
            return self._python_call(node, source_of(function), arguments, named)
        if node.keywords:
            self.refuse(node, "has no C with named arguments")
        return self._builtin_call(node, function, arguments)

    def _builtin_call(self, node: ast.Call, function: Any, arguments: list[Any]) -> Any:
        """Value of a call of a function of Python's, math's or numpy's."""
        if function is len:
            return Known(self._length(node, arguments[0]))
        if function in (np.zeros, np.empty):
            return self._new_array(node, arguments)
        library = LIBRARY.get(function) if callable(function) else None
        known = all(isinstance(item, Known) for item in arguments)
        if known and (function in _FOLDED or library):
            return self._folded(node, function, *(item.value for item in arguments))

        numbers = [self.number(item, node) for item in arguments]
        if function in _LEAST or function in _MOST:
            return self._extreme(numbers, largest=function in _MOST)
        if function is float:
            code = f"({self.program.real}){numbers[0].within(UNARY)}"
            return Number(code, level=UNARY) if numbers[0].whole else numbers[0]
        if function in _TO_WHOLE:
            if numbers[0].whole:
                return numbers[0]
            form = _TO_WHOLE[function]
            inner = numbers[0].within(UNARY) if function is int else numbers[0].code
            return Number(f"(int64_t){form.format(inner, suffix=self.suffix)}", "int", UNARY)
        if function is np.sign:
            return Number(f"sign_({numbers[0].code})")
        if library is None:
            name = getattr(function, "__name__", function)
            self.refuse(node, f"{name} has no C: write a loop, or use functions of math")
        code = ", ".join(number.code for number in numbers)
        if library.startswith("is"):
            return Number(f"({library}({code}) != 0)", "bool", low=0, high=1)
        suffix = "" if library.endswith("_") else self.suffix
        return Number(f"{library}{suffix}({code})")

    def _length(self, node: Any, value: Any) -> int:
        if isinstance(value, Array):
            return value.shape[0]
        return len(self.items(value, node))

    def _new_array(self, node: ast.Call, arguments: Sequence[Any]) -> Array:
        """An array of a known size, which begins with zeros."""
        if len(arguments) != 1 or not isinstance(arguments[0], Known):
            self.refuse(node, "an array has a known size: begin it in memory")
        shape = tuple(np.atleast_1d(arguments[0].value).tolist())
        name = self.temporary()
        size = math.prod(shape)
        self.say(f"{self.program.real} {name}[{size}] = {{0}};", defines=name, declares=True)
        return Array(name, shape)

    def _extreme(self, numbers: Sequence[Number], *, largest: bool) -> Number:
        """The least or the largest of some numbers, as Python picks it."""
        result = numbers[0]
        for number in numbers[1:]:
            pick = max if largest else min
            if result.whole and number.whole:
                low = pick(result.low, number.low)
                high = pick(result.high, number.high)
                helper = "most_" if largest else "least_"
                code = f"{helper}({result.code}, {number.code})"
                result = Number(code, "int", low=low, high=high)
            else:
                helper = "max_" if largest else "min_"
                result = Number(f"{helper}({result.code}, {number.code})")
        return result

    def _python_call(
        self,
        node: ast.Call,
        function: FunctionType,
        arguments: Sequence[Any],
        named: Mapping[str, Any],
    ) -> Any:
        """Value of a call of a Python function, which becomes one of C."""
        wanted = self.wanted
        self.wanted = ""
        called = self.program.function(function, arguments, named)
        if isinstance(called.returns, Known):
            return called.returns

        codes = []
        for parameter in called.parameters:
            value = parameter.argument(arguments, named)
            if isinstance(value, tuple):
                self.refuse(node, "a tuple cannot be handed over: give its entries")
            if isinstance(value, Known) and isinstance(value.value, (tuple, np.ndarray)):
                value = self.program.table(value.value)
            if isinstance(value, Array):
                self._note_writing(node, value, parameter.name in called.written)
                codes.append(value.pointer)
            else:
                codes.append(self.number(value, node).code)
        if called.needs_memory:
            codes.append(self.program.memory)
        self.changes = self.changes or called.changes

        self.wanted = wanted
        if isinstance(called.returns, int):
            name = self.temporary()
            text = f"{self.program.real} {name}[{called.returns}];"
            self.say(text, defines=name, declares=True)
            code = f"{called.name}({', '.join([*codes, name])});"
            self.say(code, defines="" if called.changes else name)
            return Array(name, (called.returns,))
        code = f"{called.name}({', '.join(codes)})"
        if called.returns is None:
            self.say(f"{code};")
            return Known(None)
        number = Number(code, called.returns.kind, low=called.returns.low, high=called.returns.high)
        if not called.changes:
            return number
        # It is called once, and before what stands after it.
        self.wanted = ""
        return self.kept(number, changes=True)

    def _note_writing(self, node: Any, array: Array, writes: bool) -> None:
        """Note that a function writes into an array."""
        if not writes:
            return
        if array.constant:
            self.refuse(node, "would change a number of the law: write into memory")
        if array.parameter:
            self.written.add(array.parameter)


def _in_library(function: Any) -> bool:
    """Whether a function has a name in C's library."""
    return function.__hash__ is not None and function in LIBRARY


def _bounds(op: ast.operator, a: Number, b: Number) -> tuple[float, float]:
    """Bounds of the result of an operation on whole numbers."""
    if isinstance(op, ast.BitAnd):
        masks = [number.low for number in (a, b) if number.low == number.high >= 0]
        return (0, min(masks)) if masks else (-math.inf, math.inf)
    if not isinstance(op, (ast.Add, ast.Sub, ast.Mult)):
        return -math.inf, math.inf
    fold = BINARY[type(op)].fold
    ends = [fold(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    if any(math.isnan(end) for end in ends):
        return -math.inf, math.inf
    return min(ends), max(ends)


def union(a: Number, b: Number) -> Number:
    """Return a number without code, with the kind and bounds of either."""
    kind: Kind = a.kind if a.kind == b.kind else "int"
    if "double" in (a.kind, b.kind):
        kind = "double"
    return Number("", kind, low=min(a.low, b.low), high=max(a.high, b.high))
