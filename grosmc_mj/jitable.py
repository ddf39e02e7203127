"""Functions written once and run twice: as plain Python and inside compiled code."""

from __future__ import annotations

import contextlib
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import types
from numba.core.registry import cpu_target

Function = TypeVar("Function")

# Nobody calls these from outside of compiled code: wrappers for that would take a sixth of the time
# of a compilation. Division by zero gives an infinity: no exception can leave a C callback.
# Inlined, for structures of arrays are slow to hand over.
OPTIONS = {
    "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "error_model": "numpy",
    "forceinline": True,
}  # fmt: skip

# What numba compiles for each function; numba itself refers to it weakly. A function's attribute
# would travel with it to other processes, which know nothing of it.
_compiled: dict[Any, Any] = {}


def jitable(function: Function) -> Function:
    """Let compiled code call ``function``; it stays an ordinary Python function.

    The function must keep to what both Python and numba understand in the same way: floats,
    tuples of floats, 1-D arrays, the ``math`` module. ``math`` (not NumPy) gives both engines
    the same libm, so that their results agree to the last bit.

    Of a function of the user's own compiled code checks every index, as Python does: else it
    reads whatever lies there. The package's own are tested, and not slowed down.

    Returns:
        The function, or its source if numba has compiled it already.
    """
    function = source_of(function)
    # What is no function numba cannot compile: it says so where it is called.
    if isinstance(function, FunctionType) and function not in _compiled:
        own = is_own(function)
        if own:
            _check_helpers(function)
        compiled = cast(Any, numba.njit)(boundscheck=own, **OPTIONS)(function)
        _stand_for(function, compiled)
    return function


def compiled_as(function: Function, other: Any) -> Function:
    """Let compiled code call the jitable function ``other`` where Python calls ``function``."""
    if (compiled := compiled_of(other)) is not None:
        _stand_for(function, compiled)
    return function


def _stand_for(function: Any, compiled: Any) -> None:
    """Let numba take a Python function for what it has compiled."""
    _compiled[function] = compiled
    cast(Any, cpu_target.typing_context).insert_global(function, types.Dispatcher(compiled))


def compiled_of(function: Any) -> Any:
    """What numba compiles where compiled code calls a jitable function; None of another one."""
    return _compiled.get(function) if isinstance(function, FunctionType) else None


def source_of(function: Any) -> Any:
    """A function that numba has compiled stands for its source."""
    return getattr(function, "py_func", function)


def _check_helpers(function: Any) -> None:
    """Have the compiled functions that one of the user's own calls check their indices too."""
    block = getattr(function, "__code__", None)
    if block is None:
        return
    helpers = [function.__globals__.get(name) for name in block.co_names]
    for cell in function.__closure__ or ():
        with contextlib.suppress(ValueError):  # a cell that is still empty
            helpers.append(cell.cell_contents)
    for helper in helpers:
        options, source = getattr(helper, "targetoptions", None), source_of(helper)
        if isinstance(options, dict) and is_own(source) and not options.get("boundscheck"):
            options["boundscheck"] = True
            if helper.signatures:
                helper.recompile()
            _check_helpers(source)


def is_own(function: Any) -> bool:
    """Whether a function was written outside this package."""
    return str(getattr(function, "__module__", "")).split(".")[0] != __name__.split(".")[0]
