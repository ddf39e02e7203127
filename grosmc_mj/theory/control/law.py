"""Form of every law, and wrappers that give this form to a user's function.

A law is plain Python, ``law(t, x, memory, p, u)``: it reads the time t [s], the state x (n,) and
the numbers p, changes the memory of its run and writes the inputs u (m,). A function without ``u``
that returns a number, or a tuple of m numbers, will do as well.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.ground.compilation.jitable import compiled_as, is_users_function, jitable, source_of

# (t, x, memory, p, u), or (t, x, memory, p) -> u of the user's own.
Law = Callable[..., Any]


class NoInputsError(TypeError):
    """A law returned something else than its inputs.

    Attributes:
        returned: The returned value.
        expected: Description of a valid return value.
    """

    def __init__(self, returned: Any, expected: str) -> None:
        super().__init__(f"{returned!r} is no input, must be {expected}")
        self.returned = returned
        self.expected = expected


def wrapped(wrapper: Any, law: Any) -> Law:
    """Mark a law as one that calls another law, and return it.

    Args:
        wrapper: The outer law. It gets the attributes ``python_only``, which says that it runs in
            Python only, as the inner law, and ``own``, the innermost law.
        law: The inner law.
    """
    wrapper.python_only = getattr(law, "python_only", False)
    wrapper.own = innermost(law)
    return wrapper


def innermost(law: Any) -> Any:
    """Return the law inside all wrappers."""
    return getattr(law, "own", law)


# Cached, so that a law has one wrapper, which is compiled once.
@cache
def writing(law: Callable[..., Any]) -> Law:
    """Return a law in the form that writes its inputs.

    Python checks what a law of the user's own returns; compiled code does not, because numba
    refuses other types.

    Args:
        law: ``(t, x, memory, p, u)`` or ``(t, x, memory, p) -> u``.

    Raises:
        NoInputsError: When the law is called and returns something else than m numbers.
    """
    law = source_of(law)
    inner = jitable(law)
    if not _takes_inputs(law):
        return wrapped(_returning(inner), law)
    if is_users_function(law):
        return wrapped(_checked(inner), law)
    return law


# The wrappers below are closures, because numba compiles a law together with the one it calls.


def _returning(inner: Callable[..., Any]) -> Law:
    """Wrap a law that returns its inputs."""

    def written(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        returned = inner(t, x, memory, p)
        write_inputs(u, returned)

    return jitable(written)


def _checked(inner: Callable[..., Any]) -> Law:
    """Wrap a law that writes its inputs, and so must not return any."""

    def checked(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        returned = inner(t, x, memory, p, u)
        if returned is not None:
            raise NoInputsError(returned, "nothing: a law with the argument u writes into it")

    return compiled_as(checked, inner)


def _takes_inputs(law: Callable[..., Any]) -> bool:
    """Whether a law has a fifth positional argument without a default, for the inputs."""
    parameters = list(inspect.signature(law).parameters.values())
    if len(parameters) < 5:
        return False
    fifth = parameters[4]
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return fifth.kind in positional and fifth.default is fifth.empty


def write_inputs(u: Any, returned: Any) -> None:
    """Write a number, or m numbers, that a law returned, into u (m,).

    Raises:
        NoInputsError: For any other value: truth values too, and for m = 1 a sequence.
    """
    m = len(u)
    if m == 1:
        expected = "a number"
        fits = _is_number(returned)
    else:
        expected = f"a tuple of {m} numbers"
        fits = _are_numbers(returned, m)
    if not fits:
        raise NoInputsError(returned, expected)
    u[:] = returned


@jitable
def _write(u: Any, returned: Any) -> None:
    u[:] = returned


compiled_as(write_inputs, _write)


def _is_number(value: Any) -> bool:
    """Whether a value is a real number; truth values are none."""
    if isinstance(value, bool):
        return False
    return isinstance(value, (float, int, np.integer, np.floating))


def _are_numbers(values: Any, count: int) -> bool:
    """Whether a value is a sequence of this many real numbers."""
    if not isinstance(values, (tuple, list, np.ndarray)) or len(values) != count:
        return False
    return all(map(_is_number, values))
