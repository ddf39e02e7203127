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
from grosmc_mj.own_law import NoInputsError, require_inputs
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
    try:
        given = source_of(controller.law)(t, x, memory, controller.parameters)
        require_inputs(given, m)
    except GrosmcError:
        raise
    except NoInputsError as error:
        wanted = "a number" if m == 1 else f"a tuple of {m} numbers"
        raise LawError(
            f"{controller.name} returned {shown(error.given)} at t = {t:g} s, must return {wanted}"
        ) from error
    except Exception as error:
        raise law_error(controller.name, t, error) from error
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
