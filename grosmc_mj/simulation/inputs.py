"""What a law returns, as the array of inputs that an engine holds."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.jitable import jitable


@cache
def written_inputs(m: int) -> Callable[[Any, Any], None]:
    """Jitable (u, given): write a law's number, or its tuple of m numbers, into u, (m,)."""

    @jitable
    def number(u: Any, given: Any) -> None:
        u[0] = given

    @jitable
    def several(u: Any, given: Any) -> None:
        for i in range(m):
            u[i] = given[i]

    return number if m == 1 else several


def ask(controller: Controller, t: float, x: Array, memory: Any, u: Array) -> None:
    """Write what a law asks for into u, (m,), in Python as compiled code would.

    Where C goes on with infinities and NaN, Python raises an error: u is then NaN.
    """
    try:
        written_inputs(len(u))(u, controller.law(t, x, memory, controller.parameters))
    except ArithmeticError:
        u[:] = np.nan
    except ValueError as error:
        if "math domain" not in str(error):
            raise
        u[:] = np.nan
