"""The memory of a law between two samples; it belongs to the run, never to the law."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.records import with_fields


@dataclass
class Memory:
    """Memory of a law of one input without dynamics. Every field is recorded at every sample.

    Attributes:
        v: Input that the law's quadratic index weighs: u, or the v of eqs. (23) and (44), in the
            unit of the input or of the output's highest derivative; a number or, for m inputs,
            (m,).
        undefined: 1 once the law has met a state where it is not defined, else 0.
        workspace: Address of the arrays that the feedback of this run computes in; 0 for none.
        begun: 0 at the law's first sample, 1 afterwards; whoever calls the law sets it.
    """

    v: Any = 0.0
    undefined: float = 0.0
    workspace: float = 0.0
    begun: float = 0.0


@dataclass
class SurfaceMemory(Memory):
    """Memory of the integral surface, eqs. (8), (31) and (51), for m inputs and n entries of z.

    Attributes:
        v: Input that the law's quadratic index weighs, see ``Memory``, (m,).
        z: Error state at the last sample, in the units of the error coordinates, (n,).
        s: Sliding variable at the last sample, in the law's unit of s, (m,).
        phi: Rate of s that the switching law asked for at the last sample, in that unit per
            second, (m,).
        z0: Error state at the first sample, in the units of z, (n,).
        integral: Integral of ``rate`` up to the last sample, in the unit of s, (m,).
        rate: S z at the last sample, see ``surface_rates``, in the unit of s per second, (m,).
        t: Time of the last sample [s].
        elapsed: Time between the last two samples [s]; 0 at the first.
    """

    v: Any = field(default_factory=partial(np.zeros, 1))
    z: Array = field(default_factory=partial(np.zeros, 2))
    s: Array = field(default_factory=partial(np.zeros, 1))
    phi: Array = field(default_factory=partial(np.zeros, 1))
    z0: Array = field(default_factory=partial(np.zeros, 2))
    integral: Array = field(default_factory=partial(np.zeros, 1))
    rate: Array = field(default_factory=partial(np.zeros, 1))
    t: float = 0.0
    elapsed: float = 0.0


def memory_of(m: int, n: int = 0, **initial: float | Array) -> Callable[[], Any]:
    """Return the function that makes the memory of each run of a law.

    Args:
        m: Number of inputs.
        n: Number of entries of z, of a law with a surface; 0 without one.
        initial: Further fields by name, with the values that they begin with.
    """
    arrays = {"v": np.zeros(m)}
    if not n:
        return partial(_new_memory, Memory, arrays, initial)

    for name in ("s", "integral", "rate", "phi"):
        arrays[name] = np.zeros(m)
    for name in ("z", "z0"):
        arrays[name] = np.zeros(n)
    return partial(_new_memory, SurfaceMemory, arrays, initial)


def _new_memory(kind: Any, arrays: dict[str, Any], initial: dict[str, Any]) -> Any:
    """Memory with arrays and further fields of its own: no run may share them with another."""
    memory = kind(**deepcopy(arrays))
    return with_fields(memory, **deepcopy(initial))
