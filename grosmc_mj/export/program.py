"""The C of a law: functions, tables, names."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.export.c_names import MEMORY, c_function_name
from grosmc_mj.export.c_text import calls, literal
from grosmc_mj.export.syntax import NoCError
from grosmc_mj.export.values import Array, Number
from grosmc_mj.ground.compilation.jitable import compiled_source


@dataclass(eq=False)
class Function:
    """A Python function in C, for certain arguments.

    Attributes:
        name: Its name.
        values: Values of the parameters in Python; kept, for a program knows some by their id.
        parameters: Names in Python of the parameters that it has in C.
        returns: None for nothing, a number or an array without code, or a known value: then it
            needs no call.
        written: Names of the parameters that it writes into, and ``memory``.
        needs_memory: Whether it has the memory as its last parameter.
        lines: Its text.
    """

    name: str
    values: Mapping[str, Any]
    parameters: list[str]
    returns: Any
    written: set[str]
    needs_memory: bool
    lines: list[str]

    @property
    def arguments(self) -> list[str]:
        """Arguments of a call with arguments of the parameters' names."""
        return [*self.parameters, *([MEMORY] * self.needs_memory)]


class Table(NamedTuple):
    """A constant array in C.

    Attributes:
        name: Its name.
        entries: Its numbers.
    """

    name: str
    entries: Sequence[str]


@dataclass
class Program:
    """The C of a law.

    Attributes:
        law: Begin of the names that the law's header declares.
        real: ``double``, or ``float`` in single precision.
        undefined: Place in memory that is 1 after a sample for which the law is not defined.
        replacements: Python functions that stand for others.
        functions: Functions by what they are of; None for one that is being written.
        finished: Functions, each after those that it calls.
        tables: Tables by what is in them.
    """

    law: str
    real: str = "double"
    undefined: str = f"{MEMORY}->undefined"
    replacements: Mapping[Any, Any] = field(default_factory=dict)
    functions: dict[Any, Function | None] = field(default_factory=dict)
    finished: list[Function] = field(default_factory=list)
    tables: dict[Any, Table] = field(default_factory=dict)

    def type_of(self, number: Number) -> str:
        """Return the type in C of a number."""
        if not number.whole:
            return self.real
        return "int" if number.is_small else "int64_t"

    def table(self, numbers: Any) -> Array | None:
        """Return an array of known floats as an array in C; None for any other value."""
        values = np.asarray(numbers)
        if values.dtype.kind != "f" or not values.ndim:
            return None
        key = values.shape, values.tobytes()
        if key not in self.tables:
            entries = [literal(value, self.real) for value in values.ravel().tolist()]
            self.tables[key] = Table(f"table_{len(self.tables) + 1}", entries)
        return Array(self.tables[key].name, values.shape)

    def bind(
        self, function: FunctionType, arguments: Sequence[Any], named: Mapping[str, Any]
    ) -> tuple[FunctionType, dict[str, Any]]:
        """Return the function that compiled code calls, and the values of its parameters.

        Raises:
            NoCError: If it has other parameters.
        """
        function = self.replacements.get(function) or compiled_source(function)
        try:
            bound = inspect.signature(function).bind(*arguments, **named)
        except TypeError as error:
            raise NoCError(str(error)) from None
        bound.apply_defaults()
        return function, bound.arguments

    def new_name(self, function: FunctionType) -> str:
        """Return a name for a function that no other one has."""
        name = c_function_name(function.__name__)
        numbered = name
        number = 1
        taken = {f"{self.law}_{end}" for end in ("init", "step", "missed", "numbers", "memory")}
        taken.update(item.name for item in self.finished)
        while numbered in taken:
            number += 1
            numbered = f"{name}_{number}"
        return numbered

    def text(self, roots: Sequence[Function]) -> str:
        """Return the C of some functions and of all that they call, each after what it calls."""
        lines: list[str] = []
        for item in reversed(self.finished):
            if item in roots or calls("\n".join(lines), item.name):
                lines = [*item.lines, *lines]
        return "\n".join(lines)
