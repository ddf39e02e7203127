"""Functions written once and run twice: as plain Python and inside compiled code."""

from __future__ import annotations

from typing import Any, TypeVar, cast

from numba.extending import register_jitable

Function = TypeVar("Function")


def jitable(function: Function) -> Function:
    """Let compiled code call ``function``; it stays an ordinary Python function.

    The function must keep to what both Python and numba understand in the same way: floats,
    tuples of floats, 1-D arrays, the ``math`` module. ``math`` (not NumPy) gives both engines
    the same libm, so that their results agree to the last bit.
    """
    return cast(Function, cast(Any, register_jitable)(function))
