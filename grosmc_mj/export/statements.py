"""Statements of a Python function as C, and the function around them."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from types import FunctionType
from typing import Any

from grosmc_mj.export.c_text import BINARY, c_name, comment, mentions, wrapped
from grosmc_mj.export.expressions import Expressions
from grosmc_mj.export.lines import Line, without_hidden_functions, without_unused
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.syntax import ExportError, where
from grosmc_mj.export.values import Array, Known, Number, signature, union

# Assignments that C has, too.
_COMPOUND = (ast.Add, ast.Sub, ast.Mult, ast.Div)
# Modules whose loops run over rows, or indices, of which different numbers are known.
_WRITTEN_OUT = ("grosmc_mj.loop.", "grosmc_mj.export.loop", "grosmc_mj.control.coordinates.")


def function_in_c(program: Program, function: FunctionType, values: Mapping[str, Any]) -> Function:
    """Return the C of a Python function, which the program keeps.

    Args:
        program: The C that it is part of.
        function: The Python function.
        values: Values of its parameters.

    Raises:
        ExportError: If it has no C.
    """
    key = function, tuple(signature(value) for value in values.values())
    if key not in program.functions:
        program.functions[key] = None
        program.functions[key] = Statements(program, function).translated(values)
    written = program.functions[key]
    if written is None:
        raise ExportError(f"{where(function)}: {function.__name__} calls itself: write a loop")
    return written


class Statements(Expressions):
    """Statements of one function for certain arguments.

    Attributes:
        returns: What the function returns: None for nothing, a number without code, the length of
            an array, or a known value.
        fixed: Names that keep one value: parameters, and variables of loops around.
        parameters: Declarations in C of the parameters, without ``const``, by their names.
        hoisted: Names of variables that are declared before all lines.
        changed: Whether this writing told more of a variable than the one before.
        repeats: Number of loops around that are written pass by pass.
    """

    # Whether bounds of whole numbers that still grow are given up.
    widening = False

    def begin(self) -> None:
        """Begin to write, once more with what is known of the variables."""
        super().begin()
        self.returns: Any = None
        self.fixed: set[str] = set()
        self.parameters: dict[str, str] = {}
        self.hoisted: list[str] = []
        self.changed = False
        self.repeats = 0

    def called(self, function: FunctionType, values: Mapping[str, Any]) -> Function:
        """Return the C function of a Python one for such arguments."""
        return function_in_c(self.program, function, values)

    def translated(self, values: Mapping[str, Any]) -> Function:
        """Write the function, again and again until its variables keep their kinds and bounds."""
        body: Any = self.tree.body
        if isinstance(self.tree, ast.Lambda):
            body = [ast.copy_location(ast.Return(self.tree.body), self.tree)]
        while True:
            self.begin()
            for name, value in values.items():
                self._parameter(name, value)
            self._block(body)
            if not self.changed:
                return self._finished()
            # Bounds that still grow are given up.
            self.widening = True

    def _parameter(self, name: str, value: Any) -> None:
        """Give a parameter its value: an argument in C, or what is known."""
        c = c_name(name)
        self.fixed.add(name)
        self.names[name] = value
        if isinstance(value, Known) and isinstance(value.value, float):
            value = Number("")
        if isinstance(value, Array):
            self.names[name] = Array(c, value.shape)
            self.parameters[name] = f"{self.program.real} *{c}"
        if isinstance(value, Number):
            self.names[name] = Number(c, value.whole, low=value.low, high=value.high)
            self.parameters[name] = f"{self.program.type_of(value)} {c}"

    def _finished(self) -> Function:
        """Put head, variables and lines of the function together."""
        program = self.program
        variables = []
        for name in self.hoisted:
            c = c_name(name)
            kind = program.type_of(self.variables[name])
            variables.append(Line(0, f"{kind} {c} = 0;", c))
        lines = without_hidden_functions(without_unused([*variables, *self.lines]))
        if lines and lines[-1] == Line(0, "return;"):
            lines.pop()
        text = "\n".join(line.text for line in lines)

        parameters = [name for name in self.parameters if mentions(c_name(name), text)]
        written = {name for name in parameters if c_name(name) in self.written}
        declarations = []
        for name in parameters:
            const = "*" in self.parameters[name] and name not in written
            declarations.append("const " * const + self.parameters[name])
        needs_memory = mentions(program.memory, text)
        if needs_memory:
            declarations.append(f"{program.memory_type} *{program.memory}")
        if isinstance(self.returns, int):
            declarations.append(f"{program.real} out[{self.returns}]")

        kind = program.type_of(self.returns) if isinstance(self.returns, Number) else "void"
        name = program.new_name(self.function)
        head = f"static {kind} {name}({', '.join(declarations) or 'void'})"
        doc = (self.function.__doc__ or "").strip().partition("\n\n")[0]
        body = [part for line in lines for part in line.written()]
        about = comment(f"{doc} [{where(self.function)}]")
        finished = Function(
            name=name,
            parameters=parameters,
            returns=self.returns,
            written=written | ({program.memory} & self.written),
            needs_memory=needs_memory,
            lines=[about, *wrapped(head, 0), "{", *body, "}", ""],
        )
        program.finished.append(finished)
        return finished

    # Blocks. Each method returns whether the statements always leave the function.

    def _block(self, statements: Sequence[ast.stmt]) -> bool:
        """Write statements."""
        return any(self._statement(statement) for statement in statements)

    def _inner(self, head: str, statements: Sequence[ast.stmt]) -> bool:
        """Write a block after its head; the closing brace is the caller's."""
        self.say(head)
        self.depth += 1
        left = self._block(statements)
        self.depth -= 1
        return left

    def _statement(self, statement: ast.stmt) -> bool:
        """Write a statement."""
        method = getattr(self, f"_{type(statement).__name__.lower()}", None)
        if method is None:
            raise self.refusal(statement, "has no C: use assignments, loops and conditions")
        self.alone = None
        self.effect = ""
        return bool(method(statement))

    def _only(self, expression: ast.expr) -> Any:
        """Value of an expression that is all that a statement computes."""
        self.alone = expression
        if isinstance(expression, ast.UnaryOp):
            self.alone = expression.operand
        return self.value(expression)

    def _expr(self, statement: ast.Expr) -> None:
        value = self._only(statement.value)
        if not isinstance(value, Number):
            return
        if not self.effect:
            raise self.refusal(statement, "has no effect: leave it out")
        self.say(self.effect)

    def _pass(self, statement: ast.Pass) -> None:
        pass

    def _break(self, statement: ast.Break) -> None:
        self.say("break;")

    def _continue(self, statement: ast.Continue) -> None:
        self.say("continue;")

    def _return(self, statement: ast.Return) -> bool:
        value = Known(None) if statement.value is None else self._only(statement.value)
        known = value.value if isinstance(value, Known) else 0.0
        if known is None:
            self.say("return;")
            return True
        if not isinstance(known, float) and not self.lines:
            self.returns = value
            return True
        if isinstance(value, (Known, Number)) and not isinstance(known, tuple):
            self._return_number(statement, self.number(value, statement))
            return True

        items = self.items(value, statement)
        if self.returns not in (None, len(items)):
            raise self.refusal(statement, "returns another number of values elsewhere")
        self.returns = len(items)
        for k, item in enumerate(items):
            self.say(f"out[{k}] = {self.number(item, statement).code};")
        self.say("return;")
        return True

    def _return_number(self, statement: ast.Return, number: Number) -> None:
        """Return a number, and note its kind and bounds."""
        if self.returns is not None and not isinstance(self.returns, Number):
            raise self.refusal(statement, "returns another number of values elsewhere")
        self.returns = union(number, self.returns or number)
        self.say(f"return {number.code};")

    # Assignments.

    def _assign(self, statement: ast.Assign) -> None:
        if len(statement.targets) > 1:
            raise self.refusal(statement, "has no C: write an assignment for each name")
        target = statement.targets[0]
        value = self._only(statement.value)
        if not isinstance(target, ast.Tuple):
            self._put(target, value, statement)
            return

        values = self.items(value, statement)
        if len(values) != len(target.elts):
            raise self.refusal(statement, f"{len(values)} values for {len(target.elts)} names")
        # All of them are computed before any is written.
        values = [self.kept(value) if isinstance(value, Number) else value for value in values]
        for name, value in zip(target.elts, values, strict=True):
            self._put(name, value, statement)

    def _annassign(self, statement: ast.AnnAssign) -> None:
        if statement.value is not None:
            self._put(statement.target, self._only(statement.value), statement)

    def _augassign(self, statement: ast.AugAssign) -> None:
        old = self.value(statement.target)
        added = self.value(statement.value)
        new = self.operation(statement, statement.op, old, added)
        how = ""
        if isinstance(statement.op, _COMPOUND):
            sign = BINARY[type(statement.op)][0]
            how = f"{sign}= {self.number(added, statement).code}"
        self._put(statement.target, new, statement, how)

    def _put(self, target: ast.expr, value: Any, statement: ast.stmt, how: str = "") -> None:
        """Write a value to a name, an entry, a slice or a field.

        Args:
            target: The target.
            value: The value.
            statement: The assignment, for a refusal.
            how: Code after the target, such as ``+= 1``; by default ``= `` and the value.
        """
        if isinstance(target, ast.Name):
            self._put_in_name(target.id, value, statement, how)
            return
        if not isinstance(target, (ast.Subscript, ast.Attribute)):
            raise self.refusal(
                statement, "has no C: assign to a name, an entry or a field of memory"
            )

        place = self.value(target)
        if isinstance(place, Array) and isinstance(target, ast.Subscript):
            self._fill(place, value, statement)
        elif isinstance(place, Number):
            code = how or f"= {self.number(value, statement).code}"
            self.say(f"{place.code} {code};")
            self.note_change(place.code, statement)
        else:
            raise self.refusal(statement, "assign to numbers, to entries of arrays and to memory")

    def _fill(self, place: Array, value: Any, statement: ast.stmt) -> None:
        """Write a number, or as many entries, into an array with one axis."""
        self.note_change(place.code, statement)
        size = place.shape[0]
        if isinstance(value, Array) and value.code == place.code:
            raise self.refusal(statement, "moves entries of one array: write a loop")
        if isinstance(value, (Number, Known)):
            items = [self.kept(self.number(value, statement))] * size
        else:
            items = self.items(value, statement)
        if len(items) != size:
            raise self.refusal(statement, f"has {size} entries, not {len(items)}")
        for k, item in enumerate(items):
            code = self.number(item, statement).code
            self.say(f"{place.code}[{place.offset + k}] = {code};")

    def _put_in_name(self, name: str, value: Any, statement: ast.stmt, how: str) -> None:
        """Give a name a value: a variable in C, or another name for what is there already."""
        if name in self.fixed:
            raise self.refusal(statement, f"{name} has a value already: give this one another name")
        once = self.bound[name] == 1
        if once and not isinstance(value, Number):
            if isinstance(value, tuple):
                value = tuple(self.kept(v) if isinstance(v, Number) else v for v in value)
            self.names[name] = value
            return
        if not isinstance(value, (Number, Known)):
            raise self.refusal(statement, f"{name} keeps one array or record: give it another name")

        number = self.number(value, statement)
        variable = self._joined_variable(name, number)
        c = c_name(name)
        text = f"{c} {how or '= ' + number.code};"
        if name not in self.declared and not self.depth and not self.repeats:
            text = "const " * once + f"{self.program.type_of(variable)} {text}"
        elif name not in self.declared:
            self.hoisted.append(name)
        self.declared.add(name)
        self.say(text, defines=c, effect=self.effect)

    def _joined_variable(self, name: str, number: Number) -> Number:
        """Join kind and bounds of a number to those of the variable that gets it."""
        old = self.variables.get(name)
        new = union(number, old or number)
        if old is not None and new != old:
            self.changed = True
            if self.widening:
                new = Number("", new.whole)
        self.variables[name] = new
        return new

    # Conditions and loops.

    def _if(self, statement: ast.If) -> bool:
        condition = self._only(statement.test)
        if isinstance(condition, Known):
            return self._block(statement.body if condition.value else statement.orelse)

        code = self.number(condition, statement).code
        left = self._inner(f"if ({code}) {{", statement.body)
        if statement.orelse:
            left = self._inner("} else {", statement.orelse) and left
        self.say("}")
        return left and bool(statement.orelse)

    def _while(self, statement: ast.While) -> None:
        if statement.orelse:
            raise self.refusal(statement, "has no C: write the else part after a condition")
        condition = self.pure(statement.test)
        self._inner(f"while ({self.number(condition, statement).code}) {{", statement.body)
        self.say("}")

    def _for(self, statement: ast.For) -> bool:
        if statement.orelse or not isinstance(statement.target, ast.Name):
            raise self.refusal(
                statement, "has no C: write a loop over range(...) with one variable"
            )
        name = statement.target.id
        if name in self.fixed or name in self.declared:
            raise self.refusal(statement, f"{name} has a value already: give the loop another name")
        call = statement.iter
        self.fixed.add(name)
        left = False
        if isinstance(call, ast.Call) and self.value(call.func) == Known(range):
            left = self._loop_over_range(statement, name, [self.value(end) for end in call.args])
        else:
            self._loop_over_entries(statement, name)
        self.fixed.discard(name)
        # C has no such variable after the loop.
        self.names.pop(name, None)
        return left

    def _loop_over_range(self, statement: ast.For, name: str, ends: list[Any]) -> bool:
        """Write a loop over range: as one of C, or pass by pass."""
        if all(isinstance(end, Known) for end in ends):
            passes = range(*(end.value for end in ends))
            by_passes = self.function.__module__.startswith(_WRITTEN_OUT)
            jumps = any(isinstance(node, (ast.Break, ast.Continue)) for node in ast.walk(statement))
            if not jumps and (by_passes or len(passes) < 2):
                return self._pass_by_pass(statement, name, passes)

        if len(ends) == 1:
            ends = [Known(0), *ends]
        start, stop, step = [*ends, Known(1)][:3]
        if not isinstance(step, Known):
            raise self.refusal(statement, "the step of range must be known")
        first = self.number(start, statement)
        last = self.number(stop, statement)
        if not isinstance(stop, Known):
            # Python computes the end once.
            last = self.kept(last)
        low, high = (first.low, last.high - 1) if step.value > 0 else (last.low + 1, first.high)
        c = c_name(name)
        variable = Number(c, True, low=low, high=high)
        self.names[name] = variable
        sign = "<" if step.value > 0 else ">"
        move = {1: f"{c}++", -1: f"{c}--"}.get(step.value, f"{c} += {step.value}")
        kind = self.program.type_of(variable)
        head = f"{kind} {c} = {first.code}; {c} {sign} {last.code}; {move}"
        self._inner(f"for ({head}) {{", statement.body)
        self.say("}")
        return False

    def _pass_by_pass(self, statement: ast.For, name: str, passes: range) -> bool:
        """Write each pass of a loop, with its number known."""
        several = len(passes) > 1
        self.repeats += several
        left = False
        for number in passes:
            self.names[name] = Known(number)
            left = left or self._block(statement.body)
        self.repeats -= several
        return left

    def _loop_over_entries(self, statement: ast.For, name: str) -> None:
        """Write a loop over the entries of an array."""
        over = self.value(statement.iter)
        if isinstance(over, Known):
            over = self.program.table(over.value)
        if not isinstance(over, Array) or len(over.shape) != 1:
            raise self.refusal(
                statement, "a loop is over range(...), or over an array with one axis"
            )
        index = self.temporary("k")
        place = f"{over.offset} + {index}" if over.offset else index
        self.names[name] = Number(f"{over.code}[{place}]")
        head = f"int {index} = 0; {index} < {over.shape[0]}; {index}++"
        self._inner(f"for ({head}) {{", statement.body)
        self.say("}")
