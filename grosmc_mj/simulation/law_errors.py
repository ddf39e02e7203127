"""What goes wrong in a law, in one line with the file and line of whoever wrote it."""

from __future__ import annotations

import re
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numba
from numba.core.errors import NumbaError, NumbaWarning

from grosmc_mj.errors import ArgumentError, GrosmcError

_PACKAGE = Path(__file__).resolve().parents[1]
_LIBRARIES = Path(numba.__file__).resolve().parents[1]
_PYTHON = Path(traceback.__file__).resolve().parent
# Where numba says that it stopped, and its own reasons, the last of which counts.
_COMPILED = re.compile(r'File "([^"]+)", line (\d+)')
_REASON = re.compile(
    r"No implementation of function .* found|Unknown attribute .*|Untyped global .*|.*unsupported.*"
    r"|.*not supported.*|Cannot .*|Invalid .*"
)


class LawError(ArgumentError):
    """A law that failed, or that returned something else than its inputs.

    Attributes:
        undefined: Whether C would have gone on with an infinity or NaN.
    """

    undefined = False


class FailedInCompiledCodeError(LawError):
    """A law that raised an error in compiled code, which does not say where.

    Attributes:
        run: Which simulation it was.
    """

    def __init__(self, name: str, run: int) -> None:
        super().__init__(
            f"{name} raised an error in compiled code: run it with engine='python' to see where"
        )
        self.run = run


def law_error(name: str, t: float, error: Exception) -> LawError:
    """One line for an error that a law raised in Python.

    Args:
        name: Of the law.
        t: When it was asked [s].
        error: What it raised.
    """
    said = " ".join(str(error).split())
    if not said or not isinstance(error, ValueError):
        said = f"{type(error).__name__}: {said}".rstrip(": ")
    frames = traceback.extract_tb(error.__traceback__)
    place = _own_place([(frame.filename, frame.lineno or 0) for frame in frames])
    made = LawError(f"{place}{said} ({name} at t = {t:g} s)")
    made.undefined = isinstance(error, ArithmeticError) or (
        isinstance(error, ValueError) and "math domain" in said
    )
    return made


@contextmanager
def compiling(name: str) -> Iterator[None]:
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
        raise LawError(
            f'{_not_compiled(name, error)}; engine = "python" runs it uncompiled'
        ) from error


def _not_compiled(name: str, error: Exception) -> str:
    """Where and why numba stopped: of its page the reason before the place."""
    page = str(error)
    found = [(file, int(line)) for file, line in _COMPILED.findall(page)]
    place = _own_place(found)
    if not isinstance(error, NumbaError) or not place:
        lines = _REASON.findall(page) or page.splitlines() or [""]
        said = lines[-1 if isinstance(error, NumbaError) else 0].strip()
        return f"numba cannot compile the law: {type(error).__name__}: {said} ({name})"
    marks = [each for each in _COMPILED.finditer(page) if Path(each[1]).suffix == ".py"]
    reason = (_REASON.findall(page[: marks[0].start()]) or page.splitlines())[-1].strip()
    return f"{place}numba cannot compile this: {reason}"


def _own_place(places: list[tuple[str, int]]) -> str:
    """``file.py:12: `` of the last place that is neither ours nor a library's; empty if none."""
    for file, line in reversed(places):
        path = Path(file)
        if path.suffix == ".py" and not any(
            path.resolve().is_relative_to(folder) for folder in (_PACKAGE, _LIBRARIES, _PYTHON)
        ):
            return f"{path.name}:{line}: "
    return ""
