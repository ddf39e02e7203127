"""Python functions as functions of C, each for certain arguments."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import FunctionType
from typing import Any

import numpy as np

from grosmc_mj.export.arithmetic import is_known_call, known_result, library_call
from grosmc_mj.export.c_names import LIBRARY, MEMORY, c_name
from grosmc_mj.export.c_text import (
    Line,
    comment,
    mentions,
    without_hidden_functions,
    without_unused,
    wrapped,
)
from grosmc_mj.export.program import Function, Program
from grosmc_mj.export.statements import Statements
from grosmc_mj.export.syntax import ExportError, NoCError, where, whole_expressions
from grosmc_mj.export.values import ATOM, Array, Number, is_known, items, signature
from grosmc_mj.ground.compilation.jitable import source_of


def translate(program: Program, function: Any, *arguments: Any) -> Function:
    """Return the C of a Python function for arguments in their order, see ``function_in_c``."""
    return function_in_c(program, *program.bind(function, arguments, {}))


def function_in_c(program: Program, function: FunctionType, values: Mapping[str, Any]) -> Function:
    """Return the C of a Python function, which the program keeps.

    Args:
        program: The C that it is part of.
        function: The Python function.
        values: Values of its parameters.

    Raises:
        ExportError: If it has no C.
    """
    parameters = dict(values)
    for name, value in values.items():
        # A known float is passed as a number: functions are shared.
        if isinstance(value, float):
            parameters[name] = Number("")

    key = function, tuple(signature(value) for value in parameters.values())
    if key not in program.functions:
        program.functions[key] = None
        program.functions[key] = _written(program, function, parameters)
    written = program.functions[key]
    if written is None:
        raise ExportError(f"{where(function)}: {function.__name__} calls itself: write a loop")
    return written


def _written(program: Program, function: FunctionType, values: Mapping[str, Any]) -> Function:
    """The C of a function, written again until its variables keep their kinds and bounds."""
    variables: dict[str, Number] = {}
    while True:
        before = dict(variables)
        try:
            translation = Translation(program, function, variables, values)
            leaves = translation.write(translation.body)
        except RecursionError:
            raise ExportError(
                f"{where(function)}: {function.__name__} is nested too deep: write its longest "
                "expressions as several statements"
            ) from None
        if variables == before:
            translation.refuse_lost_value(leaves)
            return translation.finished()


class Translation(Statements):
    """A function with its parameters, and the calls of others in it.

    Args:
        program: The C that the function is part of.
        function: The Python function.
        variables: Kinds and bounds of the variables, as far as a writing before has told them.
        values: Values of its parameters.

    Attributes:
        parameters: Declarations in C of the parameters, without ``const``, by their names.
        alone: Expressions that are all that a statement computes: a call there may change things.
    """

    def __init__(
        self,
        program: Program,
        function: FunctionType,
        variables: dict[str, Number],
        values: Mapping[str, Any],
    ) -> None:
        super().__init__(program, function, variables)
        self.values = values
        self.alone = whole_expressions(self.body)
        self.parameters: dict[str, str] = {}
        for name, value in values.items():
            self._name_parameter(name, value)

    def _name_parameter(self, name: str, value: Any) -> None:
        """Give a parameter its value: an argument in C, or what is known."""
        c = c_name(name)
        self.fixed.add(name)
        self.names[name] = value
        if isinstance(value, Array):
            self.names[name] = Array(c, value.shape)
            self.parameters[name] = f"{self.program.real} *{c}"
        if isinstance(value, Number):
            self.names[name] = value.named(c)
            self.parameters[name] = f"{self.program.type_of(value)} {c}"

    def refuse_lost_value(self, leaves: bool) -> None:
        """Refuse a function that returns a value, but not on each way through it.

        Args:
            leaves: Whether its statements always leave it.
        """
        if self.returns is not None and (self.returns_nothing or not leaves):
            raise ExportError(
                f"{where(self.function)}: {self.function.__name__} does not always return a "
                "value: end it with one"
            )

    def finished(self) -> Function:
        """Put head and lines of the function together."""
        program = self.program
        lines = self._needed_lines()
        text = "\n".join(line.text for line in lines)

        places = {re.split(r"\W", place)[0] for place in self.written}
        parameters = [name for name in self.parameters if mentions(text, c_name(name))]
        written = {name for name in parameters if c_name(name) in places}
        declarations = []
        for name in parameters:
            const = "*" in self.parameters[name] and name not in written
            declarations.append("const " * const + self.parameters[name])
        needs_memory = mentions(text, MEMORY)
        if needs_memory:
            declarations.append(f"struct {program.law}_memory *{MEMORY}")
        if isinstance(self.returns, Array):
            declarations.append(f"{program.real} out[{self.returns.shape[0]}]")

        name = program.new_name(self.function)
        kind = program.type_of(self.returns) if isinstance(self.returns, Number) else "void"
        head = f"static {kind} {name}({', '.join(declarations) or 'void'})"
        body = [part for line in lines for part in line.written()]
        finished = Function(
            name=name,
            values=self.values,
            parameters=parameters,
            returns=self.returns,
            written=written | ({MEMORY} & places),
            needs_memory=needs_memory,
            lines=[self._about(), *wrapped(head, 0), "{", *body, "}", ""],
        )
        program.finished.append(finished)
        return finished

    def _needed_lines(self) -> list[Line]:
        """Variables that are declared first, and the lines, without what nothing needs."""
        variables = []
        for name in self.hoisted:
            c = c_name(name)
            kind = self.program.type_of(self.variables[name])
            variables.append(Line(0, f"{kind} {c} = 0;", c))
        lines = without_hidden_functions(without_unused([*variables, *self.lines]))
        if lines and lines[-1] == Line(0, "return;"):
            lines.pop()
        return lines

    def _about(self) -> str:
        """Comment on the function: its docstring's first paragraph, and where it stands."""
        doc = (self.function.__doc__ or "").strip().partition("\n\n")[0]
        return comment(f"{doc} [{where(self.function)}]")

    # Calls.

    def visit_Call(self, node: ast.Call) -> Any:
        """Value of a call."""
        function = source_of(self.visit(node.func))
        if not callable(function):
            raise NoCError("is no function")
        arguments = [self.visit(item) for item in node.args]
        if isinstance(function, FunctionType) and function not in LIBRARY:
            named = {item.arg or "": self.visit(item.value) for item in node.keywords}
            function, values = self.program.bind(function, arguments, named)
            return self._call(node, function_in_c(self.program, function, values), values)

        if node.keywords:
            raise NoCError("has no C with named arguments")
        if function is len:
            value = arguments[0]
            return value.shape[0] if isinstance(value, Array) else len(items(value))
        if function is np.zeros:
            return self._zeros(arguments)
        if is_known_call(function, arguments):
            return known_result(function, *arguments)
        numbers = [self.number(item) for item in arguments]
        return library_call(function, numbers, self.program.real, self.program.undefined)

    def _zeros(self, arguments: Sequence[Any]) -> Array:
        """An array of a known size, which begins with zeros."""
        if len(arguments) != 1 or not is_known(*arguments):
            raise NoCError("an array has a known size: begin it in memory")
        shape = tuple(np.atleast_1d(arguments[0]).tolist())
        name = self.temporary()
        size = math.prod(shape)
        self.say(f"{self.program.real} {name}[{size}] = {{0}};", defines=name)
        return Array(name, shape)

    def _call(self, node: ast.Call, function: Function, values: Mapping[str, Any]) -> Any:
        """Value of a call of a function of this program.

        Args:
            node: The call.
            function: The function.
            values: Values of its parameters in Python.
        """
        returns = function.returns
        if returns is not None and is_known(returns):
            return returns
        arguments = []
        for name in function.parameters:
            value = values[name]
            if isinstance(value, Array):
                if name in function.written:
                    self.note_change(value.code)
                arguments.append(value.pointer)
            else:
                arguments.append(self.number(value).code)
        if function.needs_memory:
            arguments.append(MEMORY)
        if function.written and node not in self.alone:
            raise NoCError("changes something: give it a line of its own before")
        self.written |= {MEMORY} & function.written

        if isinstance(returns, Array):
            name = self.temporary(function.name)
            self.say(f"{self.program.real} {name}[{returns.shape[0]}];", defines=name)
            code = f"{function.name}({', '.join([*arguments, name])});"
            self.say(code, defines="" if function.written else name)
            return replace(returns, code=name)
        code = f"{function.name}({', '.join(arguments)})"
        if returns is None:
            self.say(f"{code};")
            return None
        effect = f"{code};" if function.written else ""
        return replace(returns, code=code, level=ATOM, effect=effect)
