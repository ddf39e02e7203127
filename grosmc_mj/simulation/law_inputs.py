"""Inputs of a law, and its mistakes in one line with the file and line of the law."""

from __future__ import annotations

import math
import re
import traceback
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numba
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError, GrosmcError, one_line, value_text
from grosmc_mj.theory.control.controller import Controller, Sampled
from grosmc_mj.theory.control.law import NoInputsError
from grosmc_mj.theory.control.memory import Memory

# Folders of this package, of other packages and of Python's own library.
_NOT_THE_USERS = (
    Path(__file__).resolve().parents[1],
    Path(numba.__file__).resolve().parents[1],
    Path(traceback.__file__).resolve().parent,
)
# Places and reasons in a message of numba; the last reason counts.
_COMPILED = re.compile(r'File "([^"]+)", line (\d+)')
_REASON = re.compile(
    r"No implementation of function .* found|Unknown attribute .*|Untyped global .*|.*unsupported.*"
    r"|.*not supported.*|Cannot .*|Invalid .*|NameError: .*"
)
# Advice by the reason that numba gives.
_INSTEAD = {
    r"list\.(append|insert|extend)|Cannot unify .*[Ll]ist|[Rr]eflected list": (
        "a list keeps one type: put numbers only into it, or an array into memory"
    ),
    r"KeyError: '(\w+)'|Unknown attribute '(\w+)' of type Record": (
        "memory or p has no such field: write memory = {{ {0} = 0 }}, or {0} = 0 for a number, "
        "beside the law"
    ),
    r"Cannot cast (list|array|tuple|Tuple|UniTuple)": (
        "a field keeps the kind that it begins with: begin it as a list of numbers"
    ),
    r"Cannot unify": "a variable keeps one type: give it another name",
    r"Untyped global name '(\w+)'": (
        "{0} is no number, array or function: put it into the law's numbers"
    ),
    r"unsupported|not supported|No implementation of function|yield|generator|_cast|[Dd]ict": (
        "use numbers, arrays, loops, conditions, math and numpy functions of them"
    ),
}


class LawError(ArgumentError):
    """Error of a law that failed, or that returned something else than its inputs.

    Attributes:
        undefined: Whether C would have gone on with an infinity or NaN.
    """

    undefined = False


def law_error(name: str, t: float, error: Exception) -> LawError:
    """Make one line of an error that a law raised in Python.

    Args:
        name: Name of the law.
        t: Time of its call [s].
        error: Error that it raised.
    """
    if isinstance(error, NoInputsError):
        return LawError(
            f"{name} returned {value_text(error.returned)} at t = {t:g} s, must return "
            f"{error.expected}"
        )
    frames = traceback.extract_tb(error.__traceback__)
    place = _users_place((frame.filename, frame.lineno) for frame in frames)
    failure = LawError(f"{place}{_reason(error)} ({name} at t = {t:g} s)")
    domain = isinstance(error, ValueError) and "math domain" in str(error)
    failure.undefined = isinstance(error, ArithmeticError) or domain
    return failure


def _reason(error: Exception) -> str:
    """Message of an error, with advice for a field that memory or p lack."""
    owner = getattr(error, "obj", None)
    if isinstance(error, AttributeError) and isinstance(owner, Memory):
        record = "memory"
        how = f"memory = {{ {error.name} = 0 }}"
    elif isinstance(error, AttributeError) and isinstance(owner, Sampled):
        record = "p"
        how = f"{error.name} = 0"
    else:
        return f"{type(error).__name__}: {one_line(str(error))}".rstrip(": ")
    return (
        f"{record} has no {error.name!r}: give it as {how} beside the law, or to custom_controller"
    )


@contextmanager
def compiling() -> Iterator[None]:
    """Compile a law in this block without numba's warnings, and with its errors in one line.

    Raises:
        LawError: In place of an error of numba.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.errors.NumbaWarning)
            yield
    except GrosmcError:
        raise
    except Exception as error:
        message = re.sub(r"\x1b\[\d*m", "", str(error))
        reason = _compiler_reason(message)
        if not isinstance(error, numba.errors.NumbaError):
            reason = f"{type(error).__name__}: {reason}"
        raise LawError(
            f"{_users_place(_COMPILED.findall(message))}numba cannot compile the law: "
            f'{reason}{_advice(reason)}; engine = "python" runs it uncompiled'
        ) from error


def _compiler_reason(message: str) -> str:
    """Reason in a message of numba, which gives it before the first place and repeats it later."""
    first_place = _COMPILED.search(message)
    before = message[: first_place.start()] if first_place else message
    reasons = _REASON.findall(before) or message.splitlines() or [""]
    return reasons[-1].strip()


def _advice(reason: str) -> str:
    """Advice for a reason of numba, in parentheses; empty if there is none."""
    for pattern, text in _INSTEAD.items():
        match = re.search(pattern, reason)
        if match:
            return f" ({text.format(*filter(None, match.groups()))})"
    return ""


def _users_place(places: Iterable[tuple[str, object]]) -> str:
    """``file.py:12: `` of the last place in the user's own files; empty if there is none."""
    place = ""
    for file, line in places:
        path = Path(file)
        if path.suffix == ".py" and not any(map(path.resolve().is_relative_to, _NOT_THE_USERS)):
            place = f"{path.name}:{line}: "
    return place


@jitable
def all_finite(u: Any) -> bool:
    """Whether all inputs are finite."""
    finite = True
    for value in u:
        finite = finite and math.isfinite(value)
    return finite


def sample_law(
    controller: Controller,
    t: float,
    x: Array,
    memory: Any,
    u: Array,
    *,
    strict: bool = False,
) -> bool:
    """Sample a law in Python as compiled code would: it writes its inputs.

    Where C goes on with infinities and NaN, Python raises an error: u is then NaN.

    Args:
        controller: Controller with law and numbers.
        t: Time [s].
        x: State, (n,).
        memory: Memory of the run.
        u: Array for the inputs, (m,).
        strict: Whether a division by zero or a value outside a function's domain is an error.

    Returns:
        Whether all of u is finite.

    Raises:
        LawError: If the law raises an error or returns something else than m numbers.
    """
    try:
        controller.law(t, x, memory, controller.parameters, u)
    except GrosmcError:
        raise
    except Exception as error:
        failure = law_error(controller.name, t, error)
        if strict or not failure.undefined:
            raise failure from error
        u[:] = np.nan
    memory.begun = 1.0
    return all_finite(u)


def require_answer(controller: Controller, x0: Array, m: int) -> None:
    """Sample a law once in Python, at its start: compiled code does not say what is wrong with it.

    Args:
        controller: Controller with law and numbers.
        x0: Start, (n,).
        m: Number of inputs.

    Raises:
        LawError: As ``sample_law``, or if an input is not finite where the law is defined.
    """
    memory = controller.memory()
    u = np.zeros(m)
    with np.errstate(all="ignore"):
        finite = sample_law(controller, 0.0, np.array(x0, float), memory, u, strict=True)
    if not finite and not memory.undefined:
        inputs = u.item() if m == 1 else tuple(u.tolist())
        raise LawError(
            f"{controller.name} returned {value_text(inputs)} at t = 0 s, which is not finite"
        )
