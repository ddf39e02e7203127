"""Functions that run both as plain Python and inside compiled code."""

from __future__ import annotations

import contextlib
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import types
from numba.core.registry import cpu_target

Function = TypeVar("Function")

# Options of numba for functions that only compiled code calls.
OPTIONS = {
    # Wrappers for calls from Python would take a sixth of the time of a compilation.
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    # Division by zero gives an infinity: no exception can leave a C callback.
    "error_model": "numpy",
    # Passing structures of arrays to a function is slow.
    "forceinline": True,
}

# Numba's dispatcher of each jitable function. Numba itself refers to it weakly, and an attribute
# of the function would be pickled with it, to processes that have no such dispatcher.
_compiled: dict[Any, Any] = {}


def jitable(function: Function) -> Function:
    """Let compiled code call ``function``; it stays an ordinary Python function.

    The function may use what Python and numba understand in the same way: floats, tuples of
    floats, 1-D arrays, the ``math`` module. ``math`` (not NumPy) gives both engines the same
    libm, so that their results agree to the last bit.

    Compiled code checks every index of a user's function, as Python does: a wrong index would
    read foreign memory. The package's own functions are tested, and not slowed down by checks.

    Returns:
        The function, or its source if numba has compiled it already.
    """
    function = source_of(function)
    # Numba refuses whatever is not a function, where compiled code calls it.
    if not isinstance(function, FunctionType) or function in _compiled:
        return function

    is_users = is_users_function(function)
    if is_users:
        _check_helpers(function)
    compiled = cast(Any, numba.njit)(boundscheck=is_users, **OPTIONS)(function)
    _register(function, compiled)
    return function


def compiled_as(function: Function, other: Any) -> Function:
    """Let compiled code call the jitable function ``other`` where Python calls ``function``."""
    compiled = compiled_of(other)
    if compiled is not None:
        _register(function, compiled)
    return function


def _register(function: Any, compiled: Any) -> None:
    """Let numba call a dispatcher where compiled code names a Python function."""
    _compiled[function] = compiled
    cast(Any, cpu_target.typing_context).insert_global(function, types.Dispatcher(compiled))


def compiled_of(function: Any) -> Any:
    """Return numba's dispatcher of a jitable function; None for any other object."""
    if not isinstance(function, FunctionType):
        return None
    return _compiled.get(function)


def source_of(function: Any) -> Any:
    """Return the Python function of a compiled function; any other object is returned as it is."""
    return getattr(function, "py_func", function)


def _check_helpers(function: Any) -> None:
    """Let the compiled functions that a user's function calls check their indices, too."""
    if not hasattr(function, "__code__"):
        return

    for helper in _referenced_objects(function):
        options = getattr(helper, "targetoptions", None)
        source = source_of(helper)
        if (
            isinstance(options, dict)
            and is_users_function(source)
            and not options.get("boundscheck")
        ):
            options["boundscheck"] = True
            if helper.signatures:
                helper.recompile()
            _check_helpers(source)


def _referenced_objects(function: Any) -> list[Any]:
    """Return the global and enclosed objects that a Python function refers to."""
    objects = [function.__globals__.get(name) for name in function.__code__.co_names]
    for cell in function.__closure__ or ():
        # A cell is empty until the enclosing function has bound its variable.
        with contextlib.suppress(ValueError):
            objects.append(cell.cell_contents)
    return objects


def is_users_function(function: Any) -> bool:
    """Return True if a function is the user's own, written outside this package."""
    module = str(getattr(function, "__module__", ""))
    return module.split(".")[0] != __name__.split(".")[0]
