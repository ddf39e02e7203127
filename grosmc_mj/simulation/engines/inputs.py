"""What a law returns, as the array of inputs that an engine holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import GrosmcError, shown
from grosmc_mj.jitable import jitable, source_of
from grosmc_mj.simulation.law_errors import LawError, law_error


@cache
def written_inputs(m: int) -> Callable[[Any, Any], bool]:
    """Jitable (u, given): write a law's number, or its tuple of m numbers, into u, (m,).

    It returns whether all of them are finite. numba refuses other kinds when it compiles.
    """

    @jitable
    def number(u: Any, given: Any) -> bool:
        u[0] = given
        return math.isfinite(u[0])

    @jitable
    def several(u: Any, given: Any) -> bool:
        if len(given) != m:
            raise ValueError("a law must return as many numbers as there are inputs")
        finite = True
        for i in range(m):
            u[i] = given[i]
            finite = finite and math.isfinite(u[i])
        return finite

    return number if m == 1 else several


def ask(controller: Controller, t: float, x: Array, memory: Any, u: Array) -> bool:
    """Write what a law asks for into u, (m,), in Python as compiled code would.

    Where C goes on with infinities and NaN, Python raises an error: u is then NaN.

    Returns:
        Whether all of u is finite.

    Raises:
        LawError: If the law raises an error or returns something else than m numbers.
    """
    try:
        return written_inputs(len(u))(u, answer(controller, t, x, memory, len(u)))
    except LawError as error:
        if not error.undefined:
            raise
    u[:] = np.nan
    return False


def answer(controller: Controller, t: float, x: Array, memory: Any, m: int) -> Any:
    """What a law returns in Python, once: a number or, for several inputs, m of them.

    Args:
        controller: Law and numbers.
        t: Time [s].
        x: State, (n,).
        memory: Of the run.
        m: Number of inputs.

    Raises:
        LawError: As ``ask``, and where it divides by zero or leaves a function's domain.
    """
    law, p = controller.law, controller.parameters
    # A law of the user's own is looked at before what it returns is weighed.
    note = getattr(law, "note", None)
    own = source_of(law) if note is None else law.own  # pyright: ignore[reportFunctionMemberAccess]
    try:
        given = own(t, x, memory, p)
        if _fits(given, m) and note is not None:
            note(t, x, memory, p, given)
    except GrosmcError:
        raise
    except Exception as error:
        raise law_error(controller.name, t, error) from error
    if not _fits(given, m):
        wanted = "a number" if m == 1 else f"a tuple of {m} numbers"
        raise LawError(
            f"{controller.name} returned {shown(given)} at t = {t:g} s, must return {wanted}"
        )
    return given


def require_answer(controller: Controller, x0: Array, m: int) -> None:
    """Ask a law once in Python, at its start: compiled code does not say what is wrong with it.

    Args:
        controller: Law and numbers.
        x0: Start, (n,).
        m: Number of inputs.

    Raises:
        LawError: As ``answer``, or if an input is not finite where the law is defined.
    """
    memory, _kept_alive = controller.begin()
    with np.errstate(all="ignore"):
        given = answer(controller, 0.0, np.array(x0, float), memory, m)
    if not np.all(np.isfinite(np.array(given, float))) and not memory.undefined:
        raise LawError(f"{controller.name} returned {shown(given)} at t = 0 s, which is not finite")


def _fits(given: Any, m: int) -> bool:
    """Whether a law returned m numbers: no truth values, for m = 1 no sequence."""
    if m == 1:
        return isinstance(given, float) or _is_number(given)
    if not isinstance(given, (tuple, list, np.ndarray)) or len(given) != m:
        return False
    return all(isinstance(each, float) or _is_number(each) for each in given)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
