"""Statements of a Python function as C."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Sequence
from types import FunctionType
from typing import Any

from grosmc_mj.export.c_text import BINARY, c_name
from grosmc_mj.export.expressions import Expressions, UnknownIndexError, union
from grosmc_mj.export.function import Functions
from grosmc_mj.export.lines import Line
from grosmc_mj.export.values import Array, Known, Number, Record

# Most passes of a loop that is written out.
_MOST_PASSES = 64
# Assignments that C has, too.
_COMPOUND = (ast.Add, ast.Sub, ast.Mult, ast.Div)


class Statements(Expressions):
    """Statements of one function for certain arguments.

    Args:
        program: The C that the function is part of.
        function: The Python function.

    Attributes:
        returns: What the function returns: None for nothing, a number without code, the length of
            an array, or a known value.
        changed: Whether this writing told more of a variable than the one before.
        widening: Whether bounds that still grow are given up.
    """

    def __init__(self, program: Functions, function: FunctionType) -> None:
        super().__init__(program, function)
        self.changed = False
        self.widening = False

    def begin(self) -> None:
        """Begin to write, once more with what is known of the variables."""
        super().begin()
        self.returns: Any = None
        self.changed = False
        self.hoisted: dict[str, str] = {}
        self._declared: set[str] = set()
        self._blocks: list[Sequence[ast.stmt]] = []

    def block(self, statements: Sequence[ast.stmt]) -> bool:
        """Write statements.

        Returns:
            Whether they always leave the function.
        """
        declared = set(self._declared)
        self._blocks.append(statements)
        left = False
        for statement in statements:
            left = self._statement(statement)
            if left:
                break
        self._blocks.pop()
        self._declared = declared | set(self.hoisted)
        return left

    def _inner(self, head: str, statements: Sequence[ast.stmt]) -> bool:
        """Write a block after its head; the closing brace is the caller's."""
        self.say(head)
        self.depth += 1
        left = self.block(statements)
        self.depth -= 1
        return left

    def _statement(self, statement: ast.stmt) -> bool:
        """Write a statement; True if it always leaves the function."""
        method = getattr(self, f"_{type(statement).__name__.lower()}", None)
        if method is None:
            self.refuse(statement, "has no C: use assignments, loops and conditions")
        return bool(method(statement))

    def _expr(self, statement: ast.Expr) -> None:
        value = self.value(statement.value)
        if isinstance(value, Number) and not isinstance(statement.value, ast.Call):
            self.refuse(statement, "has no effect: leave it out")

    def _pass(self, statement: ast.Pass) -> None:
        pass

    def _break(self, statement: ast.Break) -> None:
        self.say("break;")

    def _continue(self, statement: ast.Continue) -> None:
        self.say("continue;")

    # Returning.

    def _return(self, statement: ast.Return) -> bool:
        value: Any = Known(None)
        if statement.value is not None:
            value = self.value(statement.value)
        if isinstance(value, Known) and value.value is None:
            if self.depth or len(self._blocks) > 1:
                self.say("return;")
            return True

        if isinstance(value, Known) and not isinstance(value.value, float) and not self.lines:
            self.returns = value
            return True
        scalar = isinstance(value, Number)
        if isinstance(value, Known) and not isinstance(value.value, tuple):
            scalar = True
        if scalar:
            number = self.number(value, statement)
            self._returns_number(statement, number)
            self.say(f"return {number.code};")
            return True

        items = self.items(value, statement)
        if self.returns not in (None, len(items)):
            self.refuse(statement, "returns another number of values elsewhere")
        self.returns = len(items)
        for k, item in enumerate(items):
            self.say(f"out[{k}] = {self.number(item, statement).code};")
        if self.depth:
            self.say("return;")
        return True

    def _returns_number(self, statement: ast.Return, number: Number) -> None:
        """Note the kind and bounds of a returned number."""
        returns = self.returns
        if isinstance(returns, Known):
            returns = self.number(returns, statement)
        if isinstance(returns, int):
            self.refuse(statement, "returns several values elsewhere")
        self.returns = union(number, returns if returns is not None else number)

    # Assignments.

    def _assign(self, statement: ast.Assign) -> None:
        for target in statement.targets:
            self._assign_to(target, statement.value, statement)

    def _annassign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._assign_to(statement.target, statement.value, statement)

    def _assign_to(self, target: ast.expr, expression: ast.expr, statement: ast.stmt) -> None:
        """Assign the value of an expression to one target."""
        if not isinstance(target, ast.Tuple):
            if isinstance(target, ast.Name) and self.bound[target.id] == 1:
                self.wanted = target.id
            value = self.value(expression)
            self.wanted = ""
            self._put(target, value, statement)
            return

        values = self.items(self.value(expression), statement)
        if len(values) != len(target.elts):
            self.refuse(statement, f"{len(values)} values for {len(target.elts)} names")
        # All of them are computed before any is written.
        values = [self.kept(value) if isinstance(value, Number) else value for value in values]
        for name, value in zip(target.elts, values, strict=True):
            self._put(name, value, statement)

    def _augassign(self, statement: ast.AugAssign) -> None:
        target = statement.target
        old = self.value(target)
        added = self.value(statement.value)
        new = self.operation(statement, statement.op, old, added)
        if isinstance(statement.op, _COMPOUND) and isinstance(old, Number):
            number = self.number(added, statement)
            if old.whole == number.whole or not old.whole:
                sign = BINARY[type(statement.op)].sign
                self._put(target, new, statement, f"{sign}= {number.code}")
                return
        self._put(target, new, statement)

    def _put(self, target: ast.expr, value: Any, statement: ast.stmt, how: str = "") -> None:
        """Write a value to a name, an entry, a slice or a field.

        Args:
            target: The target.
            value: The value.
            statement: The assignment, for a refusal.
            how: Code after the target, such as ``+= 1``; by default ``= `` and the value.
        """
        if isinstance(target, ast.Name):
            self._put_in_name(target, value, statement, how)
            return
        if not isinstance(target, (ast.Subscript, ast.Attribute)):
            self.refuse(statement, "has no C: assign to a name, an entry or a field of memory")

        owner = self.value(target.value)
        place = self.value(target)
        if isinstance(place, Array) and isinstance(target, ast.Subscript):
            self._fill(place, value, statement)
        elif isinstance(place, Number) and isinstance(owner, (Array, Record)):
            code = how or f"= {self.number(value, statement).code}"
            self.say(f"{place.code} {code};")
            place_of = owner if isinstance(owner, Array) else place
            self._note_change(place_of, statement)
        else:
            self.refuse(statement, "assign to numbers, to entries of arrays and to memory")

    def _note_change(self, place: Any, statement: ast.stmt) -> None:
        """Note that a place in an array or in memory changes."""
        constant = isinstance(place, Number) and place.code.startswith("p->")
        if constant or (isinstance(place, Array) and place.constant):
            self.refuse(statement, "would change a number of the law: write into memory")
        if isinstance(place, Array) and place.parameter:
            self.written.add(place.parameter)
        self.changes = True

    def _fill(self, place: Array, value: Any, statement: ast.stmt) -> None:
        """Write a number, or as many entries, into an array with one axis."""
        self._note_change(place, statement)
        size = place.shape[0]
        if isinstance(value, Array) and value.shape == place.shape:
            # The two may overlap.
            bytes_ = f"{size} * sizeof({self.program.real})"
            self.say(f"memmove({place.pointer}, {value.pointer}, {bytes_});")
            return
        known = isinstance(value, Known) and not isinstance(value.value, tuple)
        if isinstance(value, Number) or known:
            items = [self.kept(self.number(value, statement))] * size
        else:
            items = self.items(value, statement)
        if len(items) != size:
            self.refuse(statement, f"has {size} entries, not {len(items)}")
        for k, item in enumerate(items):
            code = self.number(item, statement).code
            self.say(f"{place.code}[{place.offset + k}] = {code};")

    def _put_in_name(
        self,
        target: ast.Name,
        value: Any,
        statement: ast.stmt,
        how: str,
    ) -> None:
        """Give a name a value: a variable in C, or another name for what is there already."""
        name = target.id
        if name in self.fixed:
            self.refuse(statement, f"{name} has a value already: give this one another name")
        once = self.bound[name] == 1
        if once and not isinstance(value, Number):
            if isinstance(value, tuple):
                value = tuple(self.kept(v) if isinstance(v, Number) else v for v in value)
            self.names[name] = value
            return
        if not isinstance(value, (Number, Known)):
            self.refuse(statement, f"{name} keeps one array or record: give it another name")

        number = self.number(value, statement)
        variable = self._joined_variable(name, number)
        c = c_name(name)
        code = how or f"= {number.code}"
        if name in self._declared:
            self.say(f"{c} {code};", defines=c)
        elif not how and self._confined(name):
            const = "const " if once else ""
            text = f"{const}{self.type_of(variable)} {c} {code};"
            self.say(text, defines=c, declares=True)
            self._declared.add(name)
        else:
            self.hoisted[name] = c
            self._declared.add(name)
            self.say(f"{c} {code};", defines=c)

    def assume(self, name: str, number: Number) -> None:
        """Let a parameter that the function changes begin with the kind of a number."""
        self._joined_variable(name, number)
        self._declared.add(name)

    def _joined_variable(self, name: str, number: Number) -> Number:
        """Join kind and bounds of a number to those of the variable that gets it."""
        old = self.variables.get(name)
        if old is None:
            self.variables[name] = union(number, number)
            return self.variables[name]
        new = union(old, number)
        if new.kind == "double":
            new = Number("")
        elif self.widening and new != old:
            low = old.low if new.low == old.low else float("-inf")
            high = old.high if new.high == old.high else float("inf")
            new = Number("", new.kind, low=low, high=high)
        if new != union(old, old):
            self.changed = True
        self.variables[name] = new
        return new

    def _confined(self, name: str) -> bool:
        """Whether a name occurs in the present block only, so that it may be declared there."""
        return _occurrences(name, self._blocks[-1]) == _occurrences(name, [self.tree])

    # Conditions and loops.

    def _if(self, statement: ast.If) -> bool:
        condition = self.value(statement.test)
        if isinstance(condition, Known):
            return self._same_block(statement.body if condition.value else statement.orelse)

        code = self.number(condition, statement).code
        left = self._inner(f"if ({code}) {{", statement.body)
        if statement.orelse:
            left = self._inner("} else {", statement.orelse) and left
        self.say("}")
        return left and bool(statement.orelse)

    def _same_block(self, statements: Sequence[ast.stmt]) -> bool:
        """Write the branch that is known to be taken, as part of the present block."""
        return any(self._statement(statement) for statement in statements)

    def _while(self, statement: ast.While) -> None:
        if statement.orelse:
            self.refuse(statement, "has no C: write the else part after a condition")
        condition = self.pure(statement.test)
        self._inner(f"while ({self.number(condition, statement).code}) {{", statement.body)
        self.say("}")

    def _for(self, statement: ast.For) -> bool:
        if statement.orelse or not isinstance(statement.target, ast.Name):
            self.refuse(statement, "has no C: write a loop over range(...) with one variable")
        name = statement.target.id
        ends = self._range_of(statement)
        if name in self.fixed:
            self.refuse(statement, f"{name} has a value already: give the loop another name")
        fixed = set(self.fixed)
        self.fixed.add(name)
        try:
            if ends is None:
                self._loop_over_entries(statement, name)
                return False
            return self._loop_over_range(statement, name, *ends)
        finally:
            self.fixed = fixed

    def _loop_over_range(
        self, statement: ast.For, name: str, start: Any, stop: Any, step: int
    ) -> bool:
        """Write a loop over range: as one of C, or pass by pass if its rows must be known."""
        passes: range | None = None
        if isinstance(start, Known) and isinstance(stop, Known):
            passes = range(start.value, stop.value, step)
        jumps = any(isinstance(node, (ast.Break, ast.Continue)) for node in ast.walk(statement))
        if passes is not None and len(passes) <= 1 and not jumps:
            return self._written_out(statement, name, passes)

        before = list(self.lines), dict(self.names), dict(self.hoisted), set(self._declared)
        depth, blocks = self.depth, list(self._blocks)
        fixed = set(self.fixed)
        try:
            self._c_loop(statement, name, start, stop, step)
        except UnknownIndexError:
            # Rows of records differ in what is known of them.
            if passes is None or jumps or len(passes) > _MOST_PASSES:
                raise
            self.lines, self.names, self.hoisted, self._declared = before
            self.depth, self._blocks = depth, blocks
            self.fixed = fixed
            return self._written_out(statement, name, passes)
        return False

    def _range_of(self, statement: ast.For) -> tuple[Any, Any, int] | None:
        """Start, stop and step of a loop over range; None for any other loop."""
        call = statement.iter
        if not isinstance(call, ast.Call) or self.value(call.func) != Known(range):
            return None
        ends = [self.value(item) for item in call.args]
        if len(ends) == 1:
            return Known(0), ends[0], 1
        if len(ends) == 2:
            return ends[0], ends[1], 1
        if not isinstance(ends[2], Known):
            self.refuse(statement, "the step of range must be known")
        return ends[0], ends[1], ends[2].value

    def _c_loop(self, statement: ast.For, name: str, start: Any, stop: Any, step: int) -> None:
        """Write a loop as one of C."""
        first = self.number(start, statement)
        last = self.number(stop, statement)
        low, high = (first.low, last.high - 1) if step > 0 else (last.low + 1, first.high)
        c = c_name(name)
        variable = Number(c, "int", low=low, high=high)
        if last.code != str(last.low) and _changed_in(statement):
            # Python computes the end once.
            last = self.kept(last)

        self.names[name] = variable
        sign = "<" if step > 0 else ">"
        move = {1: f"{c}++", -1: f"{c}--"}.get(step, f"{c} += {step}")
        head = f"{self.type_of(variable)} {c} = {first.code}; {c} {sign} {last.within(11)}; {move}"
        self._inner(f"for ({head}) {{", statement.body)
        self.say("}")
        # C has no such variable after the loop.
        self.names.pop(name, None)

    def _written_out(self, statement: ast.For, name: str, passes: range) -> bool:
        """Write a loop pass by pass; True if a pass always leaves the function."""
        left = False
        for number in passes:
            self.names[name] = Known(number)
            first = len(self.lines)
            if len(passes) == 1:
                left = self._same_block_in(statement.body)
                break

            self.depth += 1
            left = self.block(statement.body)
            self.depth -= 1
            written = self.lines[first:]
            if any(line.declares for line in written):
                opening = Line(self.depth, "{")
                self.lines[first:] = [opening, *written, Line(self.depth, "}")]
            else:
                self.lines[first:] = [
                    Line(line.depth - 1, line.text, line.defines, effect=line.effect)
                    for line in written
                ]
            if left:
                break
        self.names.pop(name, None)
        return left

    def _same_block_in(self, statements: Sequence[ast.stmt]) -> bool:
        """Write the only pass of a loop; its variables stay declared."""
        self._blocks.append(self._blocks[-1])
        left = any(self._statement(statement) for statement in statements)
        self._blocks.pop()
        return left

    def _loop_over_entries(self, statement: ast.For, name: str) -> None:
        """Write a loop over the entries of an array."""
        over = self.value(statement.iter)
        if isinstance(over, Known):
            over = self.program.table(over.value)
        if not isinstance(over, Array) or len(over.shape) != 1:
            self.refuse(statement, "a loop is over range(...), or over an array with one axis")
        self.temporaries += 1
        index = f"k{self.temporaries}_"
        place = f"{over.offset} + {index}" if over.offset else index
        self.names[name] = Number(f"{over.code}[{place}]")
        self._inner(
            f"for (int {index} = 0; {index} < {over.shape[0]}; {index}++) {{", statement.body
        )
        self.say("}")
        self.names.pop(name, None)


def _occurrences(name: str, nodes: Sequence[ast.AST]) -> int:
    """Number of times that a name occurs in some nodes."""
    found: Counter[str] = Counter()
    for node in nodes:
        found.update(item.id for item in ast.walk(node) if isinstance(item, ast.Name))
    return found[name]


def _changed_in(statement: ast.For) -> bool:
    """Whether a loop changes a variable that its end is computed from."""
    used = {node.id for node in ast.walk(statement.iter) if isinstance(node, ast.Name)}
    for part in statement.body:
        for node in ast.walk(part):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in used:
                return True
    return False
