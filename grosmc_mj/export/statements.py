"""Statements of a Python function as C."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from grosmc_mj.export.arithmetic import OPERATORS, known_result, truth
from grosmc_mj.export.c_names import c_name
from grosmc_mj.export.c_text import mentions
from grosmc_mj.export.expressions import Expressions
from grosmc_mj.export.program import Program
from grosmc_mj.export.syntax import NoCError
from grosmc_mj.export.values import Array, Number, Record, is_known, items, union

# Assignments that C has, too.
_COMPOUND = (ast.Add, ast.Sub, ast.Mult, ast.Div)
# Modules whose loops run over rows, or indices, of which different numbers are known.
_WRITTEN_OUT = (
    "grosmc_mj.simulation.loop.",
    "grosmc_mj.export.loop",
    "grosmc_mj.theory.control.coordinates.",
)
_ELSEWHERE = "returns another number of values elsewhere"


class Statements(Expressions):
    """Statements of one function for certain arguments.

    ``visit`` writes a statement, and tells whether it always leaves the function.

    Args:
        program: The C that the function is part of.
        function: The Python function.
        variables: Kinds and bounds of the variables, as far as a writing before has told them.

    Attributes:
        returns: See ``Function``.
        returns_nothing: Whether it also returns without a value.
        fixed: Names that keep one value: parameters, and variables of loops around.
        declared: Names of the variables that are declared.
        hoisted: Names of variables that are declared before all lines.
        repeats: Number of loops around that are written pass by pass.
        widening: Whether bounds of whole numbers that still grow are given up.
    """

    def __init__(
        self, program: Program, function: FunctionType, variables: dict[str, Number]
    ) -> None:
        super().__init__(program, function, variables)
        self.widening = bool(variables)
        self.returns: Any = None
        self.returns_nothing = False
        self.fixed: set[str] = set()
        self.declared: set[str] = set()
        self.hoisted: list[str] = []
        self.repeats = 0

    def write(self, statements: Sequence[ast.stmt]) -> bool:
        """Write statements up to one that always leaves the function; return if there is one."""
        return any(self.visit(statement) for statement in statements)

    def _write_block(self, head: str, statements: Sequence[ast.stmt]) -> bool:
        """Write a block after its head; the closing brace is the caller's."""
        self.say(head)
        self.depth += 1
        leaves = self.write(statements)
        self.depth -= 1
        return leaves

    def visit_Expr(self, node: ast.Expr) -> None:
        """Write a call that stands alone; a text in the code is no statement in C."""
        value = self.visit(node.value)
        if not isinstance(value, Number):
            return
        if not value.effect:
            raise NoCError("has no effect: leave it out")
        self.say(value.effect)

    def visit_Pass(self, node: ast.Pass) -> None:
        """Write nothing."""

    def visit_Break(self, node: ast.Break) -> None:
        """Leave a loop."""
        self.say("break;")

    def visit_Continue(self, node: ast.Continue) -> None:
        """Begin the next pass of a loop."""
        self.say("continue;")

    def visit_Return(self, node: ast.Return) -> bool:
        """Return nothing, a number, or several."""
        value = None if node.value is None else self.visit(node.value)
        if value is None:
            self.returns_nothing = True
            self.say("return;")
        elif is_known(value) and not isinstance(value, float) and not self.lines:
            self.returns = value
        elif isinstance(value, (tuple, Array, Record)):
            self._return_several(items(value))
        else:
            self._return_number(self.number(value))
        return True

    def _return_several(self, values: Sequence[Any]) -> None:
        """Return numbers in an array of the caller."""
        array = Array("out", (len(values),))
        if self.returns not in (None, array):
            raise NoCError(_ELSEWHERE)
        self.returns = array
        for k, value in enumerate(values):
            self.say(f"out[{k}] = {self.number(value).code};")
        self.say("return;")

    def _return_number(self, number: Number) -> None:
        """Return a number, and note its kind and bounds."""
        if self.returns is not None and not isinstance(self.returns, Number):
            raise NoCError(_ELSEWHERE)
        self.returns = union(number, self.returns or number)
        self.say(f"return {number.code};")

    # Assignments.

    def visit_Assign(self, node: ast.Assign) -> None:
        """Write a value to a name or place, or several to as many."""
        if len(node.targets) > 1:
            raise NoCError("has no C: write an assignment for each name")
        target = node.targets[0]
        value = self.visit(node.value)
        if not isinstance(target, ast.Tuple):
            self._assign(target, value)
            return

        values = items(value)
        if len(values) != len(target.elts):
            raise NoCError(f"{len(values)} values for {len(target.elts)} names")
        # All of them are computed before any is written.
        values = [self.kept(value) for value in values]
        for name, value in zip(target.elts, values, strict=True):
            self._assign(name, value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Write a value to a name or place with a type."""
        if node.value is not None:
            self._assign(node.target, self.visit(node.value))

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        """Write an assignment such as ``+=``."""
        old = self.visit(node.target)
        added = self.visit(node.value)
        new = self.operation(node.op, old, added)
        how = ""
        if isinstance(node.op, _COMPOUND):
            how = f"{OPERATORS[type(node.op)].sign}= {self.number(added).code}"
        self._assign(node.target, new, how)

    def _assign(self, target: ast.expr, value: Any, how: str = "") -> None:
        """Write a value to a name, an entry, a slice or a field.

        Args:
            target: The target.
            value: The value.
            how: Code after the target, such as ``+= 1``; by default ``= `` and the value.
        """
        if isinstance(target, ast.Name):
            self._assign_to_name(target.id, value, how)
            return
        if not isinstance(target, (ast.Subscript, ast.Attribute)):
            raise NoCError("has no C: assign to a name, an entry or a field of memory")

        place = self.visit(target)
        if isinstance(place, Array) and isinstance(target, ast.Subscript):
            self._fill(place, value)
        elif isinstance(place, Number):
            if isinstance(target, ast.Subscript) and isinstance(value, Number) and value.effect:
                # Python computes the value before the index.
                value = self.kept(value)
            self.say(f"{place.code} {how or '= ' + self.number(value).code};")
            self.note_change(place.code)
        else:
            raise NoCError("assign to numbers, to entries of arrays and to memory")

    def _fill(self, place: Array, value: Any) -> None:
        """Write a number, or as many entries, into an array with one axis."""
        self.note_change(place.code)
        size = place.shape[0]
        if isinstance(value, (tuple, Array, Record)):
            numbers = [self.number(item) for item in items(value)]
        else:
            numbers = [self.kept(self.number(value))] * size
        if any(mentions(number.code, place.code) for number in numbers):
            raise NoCError("moves entries of one array: write a loop")
        if len(numbers) != size:
            raise NoCError(f"has {size} entries, not {len(numbers)}")
        for k, number in enumerate(numbers):
            self.say(f"{place.code}[{place.offset + k}] = {number.code};")

    def _assign_to_name(self, name: str, value: Any, how: str) -> None:
        """Give a name a value: a variable in C, or another name for what is there already."""
        if name in self.fixed:
            raise NoCError(f"{name} has a value already: give this one another name")
        once = self.binding_counts[name] == 1
        if once and not isinstance(value, Number):
            if isinstance(value, tuple):
                value = tuple(self.kept(item) for item in value)
            self.names[name] = value
            return
        if not isinstance(value, Number) and not is_known(value):
            raise NoCError(f"{name} keeps one array or record: give it another name")

        number = self.number(value)
        self._note_bounds(name, number)
        c = c_name(name)
        text = f"{c} {how or '= ' + number.code};"
        if name not in self.declared and not self.depth and not self.repeats:
            text = "const " * once + f"{self.program.type_of(self.variables[name])} {text}"
        elif name not in self.declared:
            self.hoisted.append(name)
        self.declared.add(name)
        self.names[name] = self.variables[name].named(c)
        self.say(text, defines=c, effect=number.effect)

    def _note_bounds(self, name: str, number: Number) -> None:
        """Join kind and bounds of a number to those of the variable that gets it."""
        old = self.variables.get(name)
        new = union(number, old or number)
        if self.widening and old is not None and new != old:
            new = Number("", new.whole)
        self.variables[name] = new

    # Conditions and loops.

    def visit_If(self, node: ast.If) -> bool:
        """Write a condition; of a known one the part that holds."""
        condition = self.visit(node.test)
        if is_known(condition):
            return self.write(node.body if condition else node.orelse)

        leaves = self._write_block(f"if ({truth(self.number(condition)).code}) {{", node.body)
        if node.orelse:
            leaves = self._write_block("} else {", node.orelse) and leaves
        self.say("}")
        return leaves and bool(node.orelse)

    def visit_While(self, node: ast.While) -> bool:
        """Write a loop with a condition."""
        if node.orelse:
            raise NoCError("has no C: write the else part after a condition")
        condition = self.visit_if_needed(node.test)
        self._write_block(f"while ({truth(self.number(condition)).code}) {{", node.body)
        self.say("}")
        breaks = any(isinstance(item, ast.Break) for item in ast.walk(node))
        return is_known(condition) and bool(condition) and not breaks

    def visit_For(self, node: ast.For) -> bool:
        """Write a loop over a range, or over the entries of an array."""
        if node.orelse or not isinstance(node.target, ast.Name):
            raise NoCError("has no C: write a loop over range(...) with one variable")
        name = node.target.id
        if name in self.names:
            raise NoCError(f"{name} has a value already: give the loop another name")

        self.fixed.add(name)
        leaves = False
        call = node.iter
        if isinstance(call, ast.Call) and self.visit(call.func) is range:
            leaves = self._loop_over_range(node, name, [self.visit(end) for end in call.args])
        else:
            self._loop_over_entries(node, name)
        self.fixed.discard(name)
        # C has no such variable after the loop.
        self.names.pop(name, None)
        return leaves

    def _loop_over_range(self, statement: ast.For, name: str, ends: list[Any]) -> bool:
        """Write a loop over range: as one of C, or pass by pass."""
        if is_known(*ends):
            passes = known_result(range, *ends)
            by_passes = self.function.__module__.startswith(_WRITTEN_OUT)
            jumps = any(isinstance(node, (ast.Break, ast.Continue)) for node in ast.walk(statement))
            if not jumps and (by_passes or len(passes) < 2):
                return self._pass_by_pass(statement, name, passes)

        if len(ends) == 1:
            ends = [0, *ends]
        start, stop, step = [*ends, 1][:3]
        if len(ends) > 3 or not is_known(step):
            raise NoCError("the step of range must be known")
        # Python refuses a step of zero, or of no whole number.
        known_result(range, 0, 0, step)
        first = self.number(start)
        # Python computes the end once.
        last = self.number(self.kept(stop))
        if not (first.whole and last.whole):
            raise NoCError("range takes whole numbers: write int(...)")
        c = c_name(name)
        variable = Number(c, True, low=last.low + 1, high=first.high)
        move = f"{c}--" if step == -1 else f"{c} += {step}"
        sign = ">"
        if step > 0:
            variable = Number(c, True, low=first.low, high=last.high - 1)
            move = f"{c}++" if step == 1 else move
            sign = "<"
        self.names[name] = variable
        kind = self.program.type_of(variable)
        head = f"{kind} {c} = {first.code}; {c} {sign} {last.code}; {move}"
        self._write_block(f"for ({head}) {{", statement.body)
        self.say("}")
        return False

    def _pass_by_pass(self, statement: ast.For, name: str, passes: range) -> bool:
        """Write each pass of a loop, with its number known."""
        several = len(passes) > 1
        self.repeats += several
        leaves = False
        for number in passes:
            self.names[name] = number
            leaves = leaves or self.write(statement.body)
        self.repeats -= several
        return leaves

    def _loop_over_entries(self, statement: ast.For, name: str) -> None:
        """Write a loop over the entries of an array."""
        over = self.visit(statement.iter)
        array = over if isinstance(over, Array) else self.program.table(over)
        if array is None or len(array.shape) != 1:
            raise NoCError("a loop is over range(...), or over an array with one axis")
        index = self.temporary("k")
        place = f"{array.offset} + {index}" if array.offset else index
        self.names[name] = Number(f"{array.code}[{place}]")
        head = f"int {index} = 0; {index} < {array.shape[0]}; {index}++"
        before = self.written
        self.written = set()
        self._write_block(f"for ({head}) {{", statement.body)
        self.say("}")
        # C reads an entry where it is used, Python before the pass begins.
        if any(mentions(array.code, place) for place in self.written):
            raise NoCError("writes into the array that it runs over: write a loop over range(...)")
        self.written |= before
