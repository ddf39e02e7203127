"""The inputs that a law writes, and its mistakes in one line with the file and line of the law."""

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
from numba.core.errors import NumbaError, NumbaWarning

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampled
from grosmc_mj.control.law import NoInputsError
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError, GrosmcError, one_line, shown
from grosmc_mj.jitable import jitable

# Folders of this package, of other packages and of Python's own library.
_NOT_OWN = (
    Path(__file__).resolve().parents[1],
    Path(numba.__file__).resolve().parents[1],
    Path(traceback.__file__).resolve().parent,
)
# Where numba says that it stopped, and its own reasons, the last of which counts.
_COMPILED = re.compile(r'File "([^"]+)", line (\d+)')
_REASON = re.compile(
    r"No implementation of function .* found|Unknown attribute .*|Untyped global .*|.*unsupported.*"
    r"|.*not supported.*|Cannot .*|Invalid .*|NameError: .*"
)
# What to write instead, by what numba says.
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
    """A law that failed, or that returned something else than its inputs.

    Attributes:
        undefined: Whether C would have gone on with an infinity or NaN.
    """

    undefined = False


def law_error(name: str, t: float, error: Exception) -> LawError:
    """One line for an error that a law raised in Python.

    Args:
        name: Of the law.
        t: When it was called [s].
        error: What it raised.
    """
    if isinstance(error, NoInputsError):
        return LawError(
            f"{name} returned {shown(error.returned)} at t = {t:g} s, must return {error.wanted}"
        )
    frames = traceback.extract_tb(error.__traceback__)
    place = _own_place((frame.filename, frame.lineno) for frame in frames)
    failure = LawError(f"{place}{_reason(error)} ({name} at t = {t:g} s)")
    domain = isinstance(error, ValueError) and "math domain" in str(error)
    failure.undefined = isinstance(error, ArithmeticError) or domain
    return failure


def _reason(error: Exception) -> str:
    """What Python says; of a field that memory or the numbers lack, how to give it."""
    owner = getattr(error, "obj", None)
    if not (isinstance(error, AttributeError) and isinstance(owner, (Memory, Sampled))):
        return f"{type(error).__name__}: {one_line(str(error))}".rstrip(": ")
    kind = "memory" if isinstance(owner, Memory) else "p"
    how = f"memory = {{ {error.name} = 0 }}" if kind == "memory" else f"{error.name} = 0"
    return f"{kind} has no {error.name!r}: give it as {how} beside the law, or to custom_controller"


@contextmanager
def compiling() -> Iterator[None]:
    """Compile a law in this block: without numba's warnings, and its errors in one line.

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
        page = re.sub(r"\x1b\[\d*m", "", str(error))
        # numba tells a reason before its place; what comes after the first place repeats it.
        before = page[: next((m.start() for m in _COMPILED.finditer(page)), None)]
        reason = (_REASON.findall(before) or page.splitlines() or [""])[-1].strip()
        if not isinstance(error, NumbaError):
            reason = f"{type(error).__name__}: {reason}"
        advice = ""
        for pattern, text in _INSTEAD.items():
            if match := re.search(pattern, reason):
                advice = f" ({text.format(*filter(None, match.groups()))})"
                break
        raise LawError(
            f"{_own_place(_COMPILED.findall(page))}numba cannot compile the law: {reason}{advice}; "
            'engine = "python" runs it uncompiled'
        ) from error


def _own_place(places: Iterable[tuple[str, object]]) -> str:
    """``file.py:12: `` of the last place that is neither ours nor a library's; empty if none."""
    place = ""
    for file, line in places:
        path = Path(file)
        if path.suffix == ".py" and not any(map(path.resolve().is_relative_to, _NOT_OWN)):
            place = f"{path.name}:{line}: "
    return place


@jitable
def all_finite(u: Any) -> bool:
    """Whether all inputs are finite."""
    finite = True
    for value in u:
        finite = finite and math.isfinite(value)
    return finite


def write_inputs(
    controller: Controller, t: float, x: Array, memory: Any, u: Array, *, strict: bool = False
) -> bool:
    """Let a law write its inputs in Python as compiled code would.

    Where C goes on with infinities and NaN, Python raises an error: u is then NaN.

    Args:
        controller: Law and numbers.
        t: Time [s].
        x: State, (n,).
        memory: Of the run.
        u: Where the inputs go, (m,).
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
    return all_finite(u)


def require_answer(controller: Controller, x0: Array, m: int) -> None:
    """Ask a law once in Python, at its start: compiled code does not say what is wrong with it.

    Args:
        controller: Law and numbers.
        x0: Start, (n,).
        m: Number of inputs.

    Raises:
        LawError: As ``write_inputs``, or if an input is not finite where the law is defined.
    """
    (memory, _kept_alive), u = controller.begin(), np.zeros(m)
    with np.errstate(all="ignore"):
        finite = write_inputs(controller, 0.0, np.array(x0, float), memory, u, strict=True)
    if not finite and not memory.undefined:
        raise LawError(
            f"{controller.name} returned {shown(u.item() if m == 1 else tuple(u.tolist()))} at "
            "t = 0 s, which is not finite"
        )
