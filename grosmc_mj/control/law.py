"""The form of every law, and how a function of the user's own gets it.

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

from grosmc_mj.jitable import compiled_as, is_own, jitable, source_of

# (t, x, memory, p, u), or (t, x, memory, p) -> u of the user's own.
Law = Callable[..., Any]


class NoInputsError(TypeError):
    """A law returned something else than its inputs.

    Attributes:
        returned: The returned value.
        wanted: Description of a valid return value.
    """

    def __init__(self, returned: Any, wanted: str) -> None:
        super().__init__(f"{returned!r} is no input, must be {wanted}")
        self.returned, self.wanted = returned, wanted


def around(wrapper: Any, law: Any) -> Law:
    """A law that calls another one: it runs in Python only where that one does.

    Args:
        wrapper: The outer law; it gets the attributes ``python_only`` and ``own``, the innermost
            law.
        law: The inner one.
    """
    wrapper.python_only = getattr(law, "python_only", False)
    wrapper.own = innermost(law)
    return wrapper


def innermost(law: Any) -> Any:
    """The law inside all wrappers."""
    return getattr(law, "own", law)


@cache
def writing(law: Callable[..., Any]) -> Law:
    """The law in the form that writes its inputs.

    Python checks what a law of the user's own returns; compiled code does not, because numba
    refuses other types.

    Args:
        law: ``(t, x, memory, p, u)`` or ``(t, x, memory, p) -> u``.

    Raises:
        NoInputsError: When the law is called and returns something else than m numbers.
    """
    law = source_of(law)
    inner, writes = jitable(law), _takes_inputs(law)
    if writes and not is_own(law):
        return law
    if writes:

        def checked(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
            returned = inner(t, x, memory, p, u)
            if returned is not None:
                raise NoInputsError(returned, "nothing: a law with the argument u writes into it")

        return around(compiled_as(checked, inner), law)

    def written(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        write_inputs(u, inner(t, x, memory, p))

    return around(jitable(written), law)


def _takes_inputs(law: Callable[..., Any]) -> bool:
    """Whether a law has a fifth argument, for the inputs, that it must be given."""
    fifth = list(inspect.signature(law).parameters.values())[4:5]
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return any(x.kind in kinds and x.default is x.empty for x in fifth)


def write_inputs(u: Any, returned: Any) -> None:
    """Write a number, or m numbers, that a law returned, into u (m,).

    Raises:
        NoInputsError: For any other value: truth values too, and for m = 1 a sequence.
    """
    m = len(u)
    if m == 1:
        fits = _is_number(returned)
    else:
        fits = (
            isinstance(returned, (tuple, list, np.ndarray))
            and len(returned) == m
            and all(map(_is_number, returned))
        )
    if not fits:
        raise NoInputsError(returned, "a number" if m == 1 else f"a tuple of {m} numbers")
    u[:] = returned


@jitable
def _write(u: Any, returned: Any) -> None:
    u[:] = returned


compiled_as(write_inputs, _write)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or (
        isinstance(value, (int, np.integer, np.floating)) and not isinstance(value, bool)
    )
