"""What goes wrong in a law, in one line with the file and line of whoever wrote it."""

from __future__ import annotations

import ast
import builtins
import dis
import inspect
import re
import textwrap
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.errors import NumbaError, NumbaWarning

from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.jitable import is_own, source_of

_PACKAGE = Path(__file__).resolve().parents[1]
_LIBRARIES = Path(numba.__file__).resolve().parents[1]
_PYTHON = Path(traceback.__file__).resolve().parent
# Where numba says that it stopped, and its own reasons, the last of which counts.
_COMPILED = re.compile(r'File "([^"]+)", line (\d+)')
_REASON = re.compile(
    r"No implementation of function .* found|Unknown attribute .*|Untyped global .*|.*unsupported.*"
    r"|.*not supported.*|Cannot .*|Invalid .*"
)
# Fields of memory that no law of one's own names.
_OF_THE_RUN = ("v", "undefined", "workspace", "first")
# What to write instead, by what numba says.
_INSTEAD = {
    r"use of yield|generator": "a generator is not compiled: add up in a for loop",
    r"list\.(append|insert|extend)|Cannot unify .*[Ll]ist|[Rr]eflected list": (
        "a list keeps one type: put numbers only into it, or an array into memory"
    ),
    r"Unknown attribute '(\w+)' of type Record": (
        "it has no such field: give what a law remembers as memory = {{ {0} = 0 }}, its numbers "
        "beside it"
    ),
    r"Cannot cast (list|array|tuple|Tuple|UniTuple)": (
        "a field keeps the kind that it begins with: begin it as a list of numbers"
    ),
    r"Cannot unify": "a variable keeps one type: give it another name",
    r"Untyped global name '(\w+)'": (
        "{0} is no number, array or function: put it into the law's numbers"
    ),
    r"_cast|build_map|[Dd]ict": "a dictionary keeps one type: use variables",
    r"Use of unsupported opcode|not supported|unsupported|No implementation of function": (
        "use numbers, arrays, loops, conditions, math and numpy functions of them"
    ),
}


class LawError(ArgumentError):
    """A law that failed, or that returned something else than its inputs.

    Attributes:
        undefined: Whether C would have gone on with an infinity or NaN.
    """

    undefined = False


def law_error(name: str, t: float, error: Exception) -> LawError:
    """One line for an error that a law raised in Python.

    Args:
        name: Of the law.
        t: When it was asked [s].
        error: What it raised.
    """
    said = _lacking(error) or " ".join(str(error).split())
    if not said or not (isinstance(error, ValueError) or _lacking(error)):
        said = f"{type(error).__name__}: {said}".rstrip(": ")
    frames = traceback.extract_tb(error.__traceback__)
    place = _own_place([(frame.filename, frame.lineno or 0) for frame in frames])
    made = LawError(f"{place}{said} ({name} at t = {t:g} s)")
    made.undefined = isinstance(error, ArithmeticError) or (
        isinstance(error, ValueError) and "math domain" in said
    )
    return made


def _lacking(error: Exception) -> str:
    """What a law reads of its memory or its numbers that is not there; empty for other errors."""
    owner = getattr(error, "obj", None)
    if not isinstance(error, AttributeError) or not isinstance(owner, (Memory, Sampled)):
        return ""
    what = "memory" if isinstance(owner, Memory) else "p"
    there = ", ".join(name for name in vars(owner) if name not in _OF_THE_RUN)
    return f"{_no_field(what, str(error.name))}; it has {there or 'nothing'}"


def _no_field(owner: str, field: str) -> str:
    """What to do about a field that is not there."""
    how = f"{field} = 0" if owner == "p" else f"memory = {{ {field} = 0 }}"
    return f"{owner} has no {field!r}: give it as {how} beside the law, or to custom_controller"


@contextmanager
def compiling(controller: Controller) -> Iterator[None]:
    """Compile a law in this block: without numba's warnings, and its errors in one line.

    Args:
        controller: Of the law.

    Raises:
        LawError: In place of what numba raises.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NumbaWarning)
            yield
    except GrosmcError:
        raise
    except Exception as error:
        # What a record has no field for is all that numba says of it.
        if isinstance(error, KeyError) and (said := _missing(controller, str(error.args[0]))):
            raise LawError(said) from error
        if said := _undefined(controller):
            raise LawError(said) from error
        raise LawError(
            f'{_not_compiled(controller.name, error)}; engine = "python" runs it uncompiled'
        ) from error


def _missing(controller: Controller, field: str) -> str:
    """Where a law reads or writes a field that neither its memory nor its numbers have."""
    for function in _users_own(controller.law, set()):
        try:
            lines, first = inspect.getsourcelines(function)
            file = Path(inspect.getsourcefile(function) or "").name
            tree = ast.parse(textwrap.dedent("".join(lines)))
        except (OSError, TypeError, SyntaxError):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and node.attr == field:
                owner = ast.unparse(node.value)
                return f"{file}:{first + node.lineno - 1}: {_no_field(owner, field)}"
    return ""


def _undefined(controller: Controller) -> str:
    """Where a law names what is defined nowhere, which numba's page does not always say."""
    for function in _users_own(controller.law, set()):
        for step in dis.get_instructions(function):
            name, known = str(step.argval), {*vars(builtins), *function.__globals__}
            if step.opname == "LOAD_GLOBAL" and name not in known:
                line = step.positions.lineno if step.positions else function.__code__.co_firstlineno
                file = Path(function.__code__.co_filename).name
                return f"{file}:{line}: name {name!r} is not defined"
    return ""


def _users_own(function: Any, seen: set[int]) -> Iterator[Any]:
    """The functions of the user's own that a law is made of, whatever is wrapped around them."""
    function = source_of(function)
    if not inspect.isfunction(function) or id(function) in seen:
        return
    seen.add(id(function))
    if is_own(function):
        yield function
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # a cell that is still empty
            yield from _users_own(cell.cell_contents, seen)


def _not_compiled(name: str, error: Exception) -> str:
    """Where and why numba stopped: of its page the reason before the place."""
    page = str(error)
    found = [(file, int(line)) for file, line in _COMPILED.findall(page)]
    place = _own_place(found)
    if not isinstance(error, NumbaError) or not place:
        lines = _REASON.findall(page) or page.splitlines() or [""]
        said = lines[-1 if isinstance(error, NumbaError) else 0].strip()
        said = f"{type(error).__name__}: {said} ({name}){_instead(said)}"
        return f"numba cannot compile the law: {said}"
    marks = [each for each in _COMPILED.finditer(page) if Path(each[1]).suffix == ".py"]
    reason = (_REASON.findall(page[: marks[0].start()]) or page.splitlines())[-1].strip()
    return f"{place}numba cannot compile this: {reason}{_instead(reason)}"


def _instead(reason: str) -> str:
    """What to write instead of what numba cannot compile; empty if nothing is known."""
    for pattern, advice in _INSTEAD.items():
        if found := re.search(pattern, reason):
            return f" ({advice.format(*found.groups())})"
    return ""


def _own_place(places: list[tuple[str, int]]) -> str:
    """``file.py:12: `` of the last place that is neither ours nor a library's; empty if none."""
    for file, line in reversed(places):
        path = Path(file)
        if path.suffix == ".py" and not any(
            path.resolve().is_relative_to(folder) for folder in (_PACKAGE, _LIBRARIES, _PYTHON)
        ):
            return f"{path.name}:{line}: "
    return ""
