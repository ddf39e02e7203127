"""Functions of C, and what expressions need of the program that they are part of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any, Protocol

from grosmc_mj.export.values import Array, Known


@dataclass(frozen=True)
class Parameter:
    """A parameter of a function in C.

    Attributes:
        python: Its name in Python.
        place: Its place in Python.
        name: Its name in C.
        text: Its declaration without ``const``.
        pointer: Whether it is an array.
        default: Its default in Python.
    """

    python: str
    place: int
    name: str
    text: str
    pointer: bool
    default: Any = None

    def argument(self, arguments: Sequence[Any], named: Mapping[str, Any]) -> Any:
        """Return the value that a call gives it."""
        if self.place < len(arguments):
            return arguments[self.place]
        return named.get(self.python, Known(self.default))


@dataclass
class Function:
    """A function in C.

    Attributes:
        name: Its name.
        parameters: Its parameters, those that it uses.
        returns: See ``Statements``.
        written: Names of the parameters that it writes into.
        changes: Whether it changes anything.
        needs_memory: Whether it has the memory as its last parameter.
        about: Its comment.
        lines: Its text.
    """

    name: str
    parameters: list[Parameter]
    returns: Any
    written: set[str]
    changes: bool
    needs_memory: bool
    about: list[str]
    lines: list[str]


class Functions(Protocol):
    """The C that a function is part of; see ``Program``."""

    memory: str
    real: str

    @property
    def suffix(self) -> str:
        """Suffix of numbers and of library functions in this precision."""
        ...

    def table(self, numbers: Any) -> Array | None:
        """Return known floats as an array in C."""
        ...

    def function(
        self, function: FunctionType, arguments: Sequence[Any], named: Mapping[str, Any]
    ) -> Function:
        """Return the C function of a Python one."""
        ...
