"""The memory of a law between two samples; it belongs to the run, never to the law."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.records import with_fields


def vector(size: str) -> Any:
    """Field of memory that begins as an array of zeros.

    Args:
        size: Name of its size, which ``memory_of`` is told: "m" inputs, "n" entries of z, or
            another one. Without ``memory_of`` there are one input and two entries of z.
    """
    usual = 2 if size == "n" else 1
    return field(default_factory=partial(np.zeros, usual), metadata={"size": size})


@dataclass
class Memory:
    """Memory of a law of one input without dynamics. Every field is recorded at every sample.

    Attributes:
        v: Input that the law's quadratic index weighs: u, or the v of eqs. (23) and (44), in the
            unit of the input or of the output's highest derivative; a number or, for m inputs,
            (m,).
        undefined: 1 once the law has met a state where it is not defined, else 0.
        begun: 0 at the law's first sample, 1 afterwards; whoever calls the law sets it.
    """

    v: Any = 0.0
    undefined: float = 0.0
    begun: float = 0.0


@dataclass
class FeedbackMemory(Memory):
    """Memory of a feedback of the error state without dynamics.

    Attributes:
        z: Error state at the last sample, in the units of the error coordinates, (n,).
    """

    z: Array = vector("n")


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

    v: Any = vector("m")
    z: Array = vector("n")
    s: Array = vector("m")
    phi: Array = vector("m")
    z0: Array = vector("n")
    integral: Array = vector("m")
    rate: Array = vector("m")
    t: float = 0.0
    elapsed: float = 0.0


def memory_of(
    kind: type[Memory],
    initial: Mapping[str, Any] | None = None,
    further: Mapping[str, Any] | None = None,
    **sizes: int,
) -> Callable[[], Any]:
    """Return the function that makes the memory of each run of a law.

    Args:
        kind: Class of the memory.
        initial: Values with which its fields begin, if not with zeros.
        further: Fields that a user's own law has beside them, with their initial values.
        sizes: Sizes of its arrays, see ``vector``; m at least.
    """
    values: dict[str, Any] = {"v": np.zeros(sizes["m"])}
    for item in fields(kind):
        if "size" in item.metadata:
            values[item.name] = np.zeros(sizes[item.metadata["size"]])
    values.update(initial or {})
    return partial(_new_memory, kind, values, further or {})


def _new_memory(kind: type[Memory], values: Mapping[str, Any], further: Mapping[str, Any]) -> Any:
    """Memory with arrays of its own: no run may share them with another."""
    return with_fields(kind(**deepcopy(values)), **deepcopy(further))
