"""The inputs that a law writes, in Python as in compiled code."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import GrosmcError, shown
from grosmc_mj.jitable import jitable
from grosmc_mj.simulation.law_errors import LawError, law_error


@jitable
def all_finite(u: Any) -> bool:
    """Whether all inputs are finite."""
    finite = True
    for value in u:
        finite = finite and math.isfinite(value)
    return finite


def write_inputs(
    controller: Controller, t: float, x: Array, memory: Any, u: Array, *, strict: bool = False
) -> bool:
    """Let a law write its inputs in Python as compiled code would.

    Where C goes on with infinities and NaN, Python raises an error: u is then NaN.

    Args:
        controller: Law and numbers.
        t: Time [s].
        x: State, (n,).
        memory: Of the run.
        u: Where the inputs go, (m,).
        strict: Whether a division by zero or a value outside a function's domain is an error.

    Returns:
        Whether all of u is finite.

    Raises:
        LawError: If the law raises an error or returns something else than m numbers.
    """
    try:
        controller.law(t, x, memory, controller.parameters, u)
    except GrosmcError:
        raise
    except Exception as error:
        failure = law_error(controller.name, t, error)
        if strict or not failure.undefined:
            raise failure from error
        u[:] = np.nan
    return all_finite(u)


def require_answer(controller: Controller, x0: Array, m: int) -> None:
    """Ask a law once in Python, at its start: compiled code does not say what is wrong with it.

    Args:
        controller: Law and numbers.
        x0: Start, (n,).
        m: Number of inputs.

    Raises:
        LawError: As ``write_inputs``, or if an input is not finite where the law is defined.
    """
    (memory, _kept_alive), u = controller.begin(), np.zeros(m)
    with np.errstate(all="ignore"):
        finite = write_inputs(controller, 0.0, np.array(x0, float), memory, u, strict=True)
    if not finite and not memory.undefined:
        raise LawError(
            f"{controller.name} returned {shown(u.item() if m == 1 else tuple(u.tolist()))} at "
            "t = 0 s, which is not finite"
        )
