"""Functions that run both as plain Python and inside compiled code."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numba.extending import overload, register_jitable

from grosmc_mj.ground.compilation.numba_internals import check_indices

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

# Functions that compiled code can call: numba would take a second registration for an overload. An
# attribute of the function would be pickled with it, to processes where it is not registered.
_registered: set[FunctionType] = set()
# Functions that compiled code calls in place of others, see ``compiled_as``.
_compiled_instead: dict[Any, Any] = {}


def jitable(function: Function) -> Function:
    """Let compiled code call ``function``; it stays an ordinary Python function.

    The function may use what Python and numba understand in the same way: floats, tuples of
    floats, 1-D arrays, the ``math`` module. ``math`` (not NumPy) gives both engines the same
    libm, so that their results agree to the last bit.

    Compiled code checks every index of a user's function, as Python does: a wrong index would
    read foreign memory. The package's own functions are tested, and not slowed down by checks.
    Functions of the user's own that it calls need no decorator: they are registered, too.

    Returns:
        The function, or its source if numba has compiled it already.
    """
    function = source_of(function)
    # Numba refuses whatever is not a function, where compiled code calls it.
    if not isinstance(function, FunctionType) or function in _registered:
        return function

    _registered.add(function)
    if is_users_function(function):
        _prepare_helpers(function)
    register_jitable(**_options(function))(function)
    return function


@overload(math.fmod, jit_options=cast(Any, OPTIONS), strict=False)
def _remainder(a: Any, b: Any) -> Any:
    """Remainder of floats with the sign of the dividend, which numba has of numpy alone."""
    return lambda a, b: np.fmod(float(a), float(b))


def compiled_as(function: Function, other: Any) -> Function:
    """Let compiled code call the function ``other`` where Python calls ``function``."""
    if not isinstance(other, FunctionType):
        return function

    _compiled_instead[function] = other
    # numba's type of these options has the documented ones only.
    options: Any = _options(other)

    @overload(cast(Any, function), jit_options=options, strict=False)
    def _implementation(*_argument_types: Any) -> Any:
        return other

    return function


def compiled_source(function: Any) -> Any:
    """Return the Python function that compiled code calls where Python calls ``function``."""
    return source_of(_compiled_instead.get(function, function))


def _options(function: Any) -> dict[str, Any]:
    """Options of numba for a function: a user's checks its indices."""
    return {**OPTIONS, "boundscheck": is_users_function(function)}


def source_of(function: Any) -> Any:
    """Return the Python function of a compiled function; any other object is returned as it is."""
    return getattr(function, "py_func", function)


def _prepare_helpers(function: Any) -> None:
    """Let compiled code call the functions that a user's function calls, with checked indices."""
    if not hasattr(function, "__code__"):
        return

    for helper in _referenced_objects(function):
        source = source_of(helper)
        if is_users_function(source) and check_indices(helper):
            _prepare_helpers(source)
        elif isinstance(helper, FunctionType) and _is_own_file(helper):
            jitable(helper)


def _is_own_file(function: FunctionType) -> bool:
    """Whether a function stands in a file of the user's own: numba knows some installed ones."""
    folders = Path(function.__code__.co_filename).parts
    return is_users_function(function) and not {"site-packages", "dist-packages"} & {*folders}


def _referenced_objects(function: Any) -> list[Any]:
    """Return the global and enclosed objects that a Python function refers to."""
    names = function.__code__.co_names
    objects = [function.__globals__.get(name) for name in names]
    for module in objects[:]:
        if isinstance(module, ModuleType):
            objects += [getattr(module, name, None) for name in names]
    for cell in function.__closure__ or ():
        # A cell is empty until the enclosing function has bound its variable.
        with contextlib.suppress(ValueError):
            objects.append(cell.cell_contents)
    return objects


def is_users_function(function: Any) -> bool:
    """Return True if a function is the user's own, written outside this package."""
    module = str(getattr(function, "__module__", ""))
    return module.split(".")[0] != __name__.split(".")[0]
