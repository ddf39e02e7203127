"""Expressions of a Python function as C.

Values that are known are computed here; all others become code. A call that gives several numbers
becomes a line of its own before the statement that it stands in.
"""

from __future__ import annotations

import ast
import builtins
import itertools
import operator
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from types import FunctionType
from typing import Any

from grosmc_mj.export.arithmetic import (
    OPERATORS,
    choice,
    junction,
    known_result,
    negation,
    negative,
    operation_in_c,
)
from grosmc_mj.export.c_text import Line
from grosmc_mj.export.program import Program
from grosmc_mj.export.syntax import NoCError, body_of, nodes_of, refusal
from grosmc_mj.export.values import Array, Number, Record, is_known, items, number_in_c


class Expressions(ast.NodeVisitor):
    """Expressions of one function for certain arguments.

    ``visit`` gives the value of an expression, after it has written the lines that must come
    before.

    Args:
        program: The C that the function is part of.
        function: The Python function.
        variables: Kinds and bounds of the variables, as far as a writing before has told them.

    Attributes:
        names: Values of the names that have one here.
        binding_counts: How often each name is bound.
        lines: The C so far.
        depth: Depth of the block that is written.
        written: Numbers and arrays in C that the function writes into; ``memory`` for any in it.
    """

    def __init__(
        self, program: Program, function: FunctionType, variables: dict[str, Number]
    ) -> None:
        self.program = program
        self.function = function
        self.variables = variables
        self.body = body_of(function)
        self.binding_counts: Counter[str] = Counter()
        for node in nodes_of(self.body):
            if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                self.binding_counts[node.id] += 1
        self.names: dict[str, Any] = {}
        self.lines: list[Line] = []
        self.depth = 0
        self.written: set[str] = set()
        self.numbers_of_temporaries = itertools.count(1)

    def visit(self, node: ast.AST) -> Any:
        """Translate a part of the function.

        Raises:
            ExportError: If it has no C, with its file and line.
        """
        try:
            return super().visit(node)
        except NoCError as reason:
            raise refusal(self.function, node, reason) from None

    def generic_visit(self, node: ast.AST) -> Any:
        """Refuse a part of another kind."""
        parts = "assignments" if isinstance(node, ast.stmt) else "numbers, arrays"
        raise NoCError(f"has no C: use {parts}, loops and conditions")

    def say(self, text: str, *, defines: str = "", effect: str = "") -> None:
        """Write a line; see ``Line``."""
        self.lines.append(Line(self.depth, text, defines, effect))

    def temporary(self, name: str = "t") -> str:
        """Return a new name that begins with another one."""
        return f"{name}{next(self.numbers_of_temporaries)}_"

    def number(self, value: Any) -> Number:
        """Return a value as a number in C."""
        return number_in_c(value, self.program.real)

    def kept(self, value: Any) -> Any:
        """Compute a number in C now, and return its name; any other value is what it is."""
        if not isinstance(value, Number):
            return value
        name = self.temporary()
        self.say(f"const {self.program.type_of(value)} {name} = {value.code};", defines=name)
        return value.named(name)

    def note_change(self, code: str) -> None:
        """Note that a place in C is written."""
        if re.match(r"p\b|table_", code):
            raise NoCError("would change a number of the law: write into memory")
        self.written.add(code.partition("[")[0])

    def visit_if_needed(self, node: ast.expr) -> Any:
        """Value of an expression that is not always computed: no line can come before it."""
        before = len(self.lines)
        value = self.visit(node)
        if len(self.lines) > before:
            reason = "is not always computed: give it a line of its own before"
            raise refusal(self.function, node, reason)
        return value

    # Names and constants.

    def visit_Constant(self, node: ast.Constant) -> Any:
        """Value of a constant."""
        return node.value

    def visit_Name(self, node: ast.Name) -> Any:
        """Value of a parameter, a variable, or a name outside the function."""
        name = node.id
        if name in self.names:
            return self.names[name]
        if self.binding_counts[name]:
            raise NoCError("has no value here: give it one before")

        code = self.function.__code__
        cells = dict(zip(code.co_freevars, self.function.__closure__ or (), strict=True))
        if name in cells:
            return cells[name].cell_contents
        for scope in (self.function.__globals__, vars(builtins)):
            if name in scope:
                return scope[name]
        raise NoCError("is not defined")

    def visit_Attribute(self, node: ast.Attribute) -> Any:
        """Field of a record, shape of an array, or attribute of a known object."""
        owner = self.visit(node.value)
        if isinstance(owner, Record) and node.attr in owner.members:
            return owner.members[node.attr]
        if isinstance(owner, Array) and node.attr == "shape":
            return owner.shape
        if is_known(owner) and hasattr(owner, node.attr):
            return getattr(owner, node.attr)
        raise NoCError(f"there is no {node.attr!r}: name a field of memory or of the numbers")

    def visit_Tuple(self, node: ast.Tuple) -> tuple[Any, ...]:
        """Values of a tuple."""
        return tuple(self.visit(item) for item in node.elts)

    # Operators.

    def visit_UnaryOp(self, node: ast.UnaryOp) -> Any:
        """Value of ``-x`` or ``not x``."""
        value = self.visit(node.operand)
        if not isinstance(node.op, (ast.Not, ast.USub)):
            raise NoCError("has no C: use -x and not")
        is_not = isinstance(node.op, ast.Not)
        if is_known(value):
            return known_result(operator.not_ if is_not else operator.neg, value)
        number = self.number(value)
        return negation(number) if is_not else negative(number)

    def visit_BinOp(self, node: ast.BinOp) -> Any:
        """Value of an operation on two numbers."""
        return self.operation(node.op, self.visit(node.left), self.visit(node.right))

    def operation(self, op: ast.operator | ast.cmpop, left: Any, right: Any) -> Any:
        """Return the value of an operation on two numbers, or of a comparison."""
        if type(op) not in OPERATORS:
            if isinstance(op, ast.cmpop):
                raise NoCError("has no C: write ==, !=, <, <=, > or >=")
            raise NoCError("has no C: write a loop over entries, or use + - * / ** %")
        if is_known(left, right):
            return known_result(OPERATORS[type(op)].compute, left, right)
        return operation_in_c(op, self.number(left), self.number(right), self.program.real)

    def visit_Compare(self, node: ast.Compare) -> Any:
        """Value of comparisons in a row."""
        values = [self.visit(item) for item in (node.left, *node.comparators)]
        conditions = []
        for op, (left, right) in zip(node.ops, itertools.pairwise(values), strict=True):
            conditions.append(self.operation(op, left, right))
        return junction(conditions, suffices=False, real=self.program.real)

    def visit_BoolOp(self, node: ast.BoolOp) -> Any:
        """Value of ``and`` or ``or``: the operand that decides."""
        suffices = isinstance(node.op, ast.Or)
        return junction(self._in_turn(node.values), suffices, self.program.real)

    def _in_turn(self, nodes: Sequence[ast.expr]) -> Iterator[Any]:
        """Values of operands; those after the first are not always computed."""
        for node in nodes:
            value = self.visit(node) if node is nodes[0] else self.visit_if_needed(node)
            yield value if is_known(value) else self.number(value)

    def visit_IfExp(self, node: ast.IfExp) -> Any:
        """Value of ``a if condition else b``."""
        condition = self.visit(node.test)
        if is_known(condition):
            return self.visit(node.body if condition else node.orelse)
        test = self.number(condition)
        a = self.number(self.visit_if_needed(node.body))
        b = self.number(self.visit_if_needed(node.orelse))
        return choice(test, a, b)

    # Entries of arrays.

    def visit_Subscript(self, node: ast.Subscript) -> Any:
        """Value of an entry, or of a part of an array."""
        owner = self.visit(node.value)
        if isinstance(node.slice, ast.Slice):
            return self._part(owner, node.slice)

        index = self.visit(node.slice)
        if is_known(index) and not isinstance(owner, (Number, Array, Record)):
            return known_result(operator.getitem, owner, index)
        array = owner if isinstance(owner, Array) else self.program.table(owner)
        if array is None:
            raise NoCError("the index must be known: write a loop over range(...)")
        indices = items(index) if isinstance(node.slice, ast.Tuple) else [index]
        return array.entry([self.number(index) for index in indices])

    def _part(self, owner: Any, place: ast.Slice) -> Array:
        """Part of an array with one axis."""
        lower = None if place.lower is None else self.visit(place.lower)
        upper = None if place.upper is None else self.visit(place.upper)
        if place.step is not None or not is_known(lower, upper):
            raise NoCError("a slice has ends that are known: write a loop")
        if not isinstance(owner, Array) or len(owner.shape) != 1:
            raise NoCError("a slice is of an array with one axis: write a loop")
        first, last, _ = slice(lower, upper).indices(owner.shape[0])
        return Array(owner.code, (max(0, last - first),), owner.offset + first)
