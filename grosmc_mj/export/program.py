"""All functions of C that a law reaches, specialised for its arguments and records."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any

import numpy as np

from grosmc_mj.export.c_text import (
    HELPERS,
    INDENT,
    c_name,
    calls,
    comment,
    literal,
    mentions,
    wrapped,
)
from grosmc_mj.export.expressions import UnknownIndexError
from grosmc_mj.export.function import Function, Parameter
from grosmc_mj.export.lines import Line, without_hidden_functions, without_unused
from grosmc_mj.export.statements import Statements
from grosmc_mj.export.syntax import ExportError, where
from grosmc_mj.export.values import Array, Known, Number, Record, signature
from grosmc_mj.jitable import compiled_source

# Writings of a function until kinds and bounds of its variables settle, and how many of them pass
# before bounds that still grow are given up.
_MOST_WRITINGS = 20
_BEFORE_WIDENING = 4


@dataclass
class Program:
    """The C of a law.

    Attributes:
        memory: Name of the pointer to what the law remembers.
        memory_type: Its type.
        real: ``double``, or ``float`` in single precision.
        replacements: Python functions that stand for others.
        reserved: Names that no function may have.
    """

    memory: str
    memory_type: str
    real: str = "double"
    replacements: Mapping[Any, Any] = field(default_factory=dict)
    reserved: set[str] = field(default_factory=set)
    _functions: dict[Any, Function | None] = field(default_factory=dict)
    _finished_functions: list[Function] = field(default_factory=list)
    _tables: dict[Any, tuple[str, str]] = field(default_factory=dict)

    @property
    def suffix(self) -> str:
        """Suffix of numbers and of library functions in this precision."""
        return "f" if self.real == "float" else ""

    def table(self, numbers: Any) -> Array | None:
        """Return an array of known floats as an array in C; None for any other value."""
        values = np.asarray(numbers)
        if values.dtype.kind != "f" or not values.ndim:
            return None
        key = values.shape, values.tobytes()
        name = f"table_{len(self._tables) + 1}"
        if key in self._tables:
            name, _ = self._tables[key]
        entries = ", ".join(literal(value, self.suffix) for value in values.ravel().tolist())
        text = f"static const {self.real} {name}[{values.size}] = {{{entries}}};"
        self._tables[key] = name, text
        return Array(name, values.shape, constant=True)

    def root(self, function: FunctionType, arguments: Sequence[Any]) -> Function:
        """Return the C of a function that no other one calls.

        Raises:
            ExportError: If it has no C.
        """
        try:
            return self.function(function, arguments, {})
        except UnknownIndexError as error:
            raise error.refusal from None

    def function(
        self, function: FunctionType, arguments: Sequence[Any], named: Mapping[str, Any]
    ) -> Function:
        """Return the C function of a Python one for such arguments.

        Raises:
            ExportError: If it has no C.
        """
        function = self._implementation(function)
        bound = inspect.signature(function).bind(*arguments, **named)
        bound.apply_defaults()
        values: dict[str, Any] = {}
        for name, value in bound.arguments.items():
            values[name] = value if _is_value(value) else Known(value)
        key = function, tuple(signature(value) for value in values.values())
        if key not in self._functions:
            self._functions[key] = None
            try:
                self._functions[key] = self._written(function, values)
            except BaseException:
                del self._functions[key]
                raise
        written = self._functions[key]
        if written is None:
            raise ExportError(f"{where(function)}: {function.__name__} calls itself: write a loop")
        return written

    def _implementation(self, function: FunctionType) -> FunctionType:
        """The function that compiled code calls in place of a Python function."""
        if function in self.replacements:
            return self.replacements[function]
        return compiled_source(function)

    def _written(self, function: FunctionType, values: Mapping[str, Any]) -> Function:
        """Write a function, again and again until its variables keep their kinds and bounds."""
        writer = Statements(self, function)
        body = writer.tree.body
        if isinstance(writer.tree, ast.Lambda):
            body = [ast.copy_location(ast.Return(writer.tree.body), writer.tree)]
        assert isinstance(body, list)

        for writing in range(_MOST_WRITINGS):
            writer.begin()
            writer.widening = writing >= _BEFORE_WIDENING
            parameters = self._parameters(writer, function, values)
            writer.block(body)
            if not writer.changed:
                break
        else:
            writer.refuse(writer.tree, "its variables change their kind: give them other names")
        return self._finished(writer, function, parameters)

    def _parameters(
        self, writer: Statements, function: FunctionType, values: Mapping[str, Any]
    ) -> list[Parameter]:
        """Give the parameters of a function their values."""
        parameters = []
        defaults = inspect.signature(function).parameters
        for place, (name, value) in enumerate(values.items()):
            c = c_name(name)
            default = defaults[name].default
            if isinstance(value, Array):
                writer.names[name] = Array(c, value.shape, 0, c, value.constant)
                writer.fixed.add(name)
                text = f"{self.real} *{c}"
                parameters.append(Parameter(name, place, c, text, True, default))
                continue

            # Known whole numbers make another function, floats an argument.
            is_float = isinstance(value, Known) and isinstance(value.value, float)
            if not isinstance(value, Number) and not is_float and not writer.bound[name]:
                writer.names[name] = value
                continue
            number = writer.number(value, writer.tree)
            if writer.bound[name]:
                writer.assume(name, number)
            else:
                low, high = number.low, number.high
                writer.names[name] = Number(c, number.kind, low=low, high=high)
            text = f"{writer.type_of(number)} {c}"
            parameters.append(Parameter(name, place, c, text, False, default))
        return parameters

    def _finished(
        self, writer: Statements, function: FunctionType, parameters: list[Parameter]
    ) -> Function:
        """Put head, variables and lines of a function together."""
        hoisted = []
        for name, c in writer.hoisted.items():
            kind = writer.type_of(writer.variables[name])
            hoisted.append(Line(0, f"{kind} {c} = 0;", c, declares=True))
        lines = without_hidden_functions(without_unused([*hoisted, *writer.lines]))
        text = "\n".join(line.text for line in lines)
        used = [parameter for parameter in parameters if mentions(parameter.name, text)]

        declarations = []
        for parameter in used:
            const = parameter.pointer and parameter.name not in writer.written
            declarations.append(f"const {parameter.text}" if const else parameter.text)
        needs_memory = mentions(self.memory, text)
        if needs_memory:
            declarations.append(f"{self.memory_type} *{self.memory}")
        if isinstance(writer.returns, int):
            declarations.append(f"{self.real} out[{writer.returns}]")

        name = self._new_name(function)
        kind = "void"
        if isinstance(writer.returns, Number):
            kind = writer.type_of(writer.returns)
        head = f"static {kind} {name}({', '.join(declarations) or 'void'})"
        doc = (function.__doc__ or "").strip().partition("\n\n")[0]
        body = [text for line in lines for text in line.written()]
        finished = Function(
            name=name,
            parameters=used,
            returns=writer.returns,
            written=writer.written,
            changes=writer.changes,
            needs_memory=needs_memory,
            about=comment(f"{doc} [{where(function)}]"),
            lines=[*wrapped(head, 0), "{", *body, "}", ""],
        )
        self._finished_functions.append(finished)
        return finished

    def _new_name(self, function: FunctionType) -> str:
        """A name for a function that no other one has."""
        name = "value" if function.__name__ == "<lambda>" else function.__name__.lstrip("_")
        name = c_name(name)
        numbered = name
        number = 1
        taken = {item.name for item in self._finished_functions}
        while numbered in taken | self.reserved:
            number += 1
            numbered = f"{name}_{number}"
        return numbered

    def text(self, roots: Sequence[Function]) -> str:
        """Return the C of some functions and of all that they call, each after what it calls."""
        used = {root.name for root in roots}
        # Functions are finished after those that they call.
        functions: list[Function] = []
        for item in reversed(self._finished_functions):
            if item.name in used:
                functions.insert(0, item)
                body = "\n".join(item.lines)
                others = self._finished_functions
                used |= {other.name for other in others if calls(other.name, body)}

        code = "\n".join(line for item in functions for line in item.lines)
        parts: list[str] = []
        for name, helper in HELPERS.items():
            if calls(name, code) or (name == "mod_" and calls("div_", code)):
                parts.append(f"static inline {helper.format(real=self.real, suffix=self.suffix)}")
        for name, table in self._tables.values():
            if mentions(name, code):
                parts += wrapped(table, 0, len(INDENT))
        if parts:
            parts.append("")
        for item in functions:
            parts += [*item.about, *item.lines]
        return "\n".join(parts)


def _is_value(value: Any) -> bool:
    """Whether an argument is a value of the evaluation already, not a default of Python's."""
    return isinstance(value, (Known, Number, Array, Record, tuple))
