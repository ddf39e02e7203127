"""Laws of the user's own: what they return is looked at in Python, wherever they are called."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.jitable import compiled_as, is_own, jitable

# (t, x, memory, p) -> u.
_Law = Callable[[float, Any, Any, Any], Any]


class NoInputsError(TypeError):
    """A law returned something else than its inputs.

    Attributes:
        given: The returned value.
    """

    def __init__(self, given: Any) -> None:
        super().__init__(f"{given!r} is no input")
        self.given = given


def around(wrapper: Any, law: _Law) -> _Law:
    """A law that calls another one: it runs in Python only where that one does.

    Args:
        wrapper: The outer law; it gets the attributes ``python_only`` and ``own``, the innermost
            law.
        law: The inner one.
    """
    wrapper.python_only = getattr(law, "python_only", False)
    wrapper.own = innermost(law)
    return wrapper


def innermost(law: _Law) -> _Law:
    """The law within all that was put around it."""
    return getattr(law, "own", law)


@cache
def checked(law: _Law, m: int) -> _Law:
    """The law, jitable; of a law of the user's own Python checks that it returns m numbers.

    Compiled code calls the law itself: numba refuses other kinds.

    Raises:
        NoInputsError: When it is called and returns something else.
    """
    called = jitable(law)
    if not is_own(called):
        return called

    def checking(t: float, x: Any, memory: Any, p: Any) -> Any:
        given = called(t, x, memory, p)
        require_inputs(given, m)
        return given

    return compiled_as(checking, called)


def require_inputs(given: Any, m: int) -> None:
    """Refuse what are no m numbers: truth values too, for m = 1 a sequence.

    Raises:
        NoInputsError: With the value.
    """
    if m == 1:
        fits = _is_number(given)
    else:
        fits = (
            isinstance(given, (tuple, list, np.ndarray))
            and len(given) == m
            and all(_is_number(entry) for entry in given)
        )
    if not fits:
        raise NoInputsError(given)


def _is_number(value: Any) -> bool:
    return isinstance(value, float) or (
        isinstance(value, (int, np.integer, np.floating)) and not isinstance(value, bool)
    )
