"""What a law returns, as the array of inputs that an engine holds."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

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
