"""Controllers without feedback: one input that is held, or two."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.memory import Memory


@dataclass(frozen=True)
class Input:
    """A constant input, in the unit of the plant's."""

    u: float


def constant_input(t: float, x: Any, memory: Any, p: Any) -> float:
    memory.v = p.u
    return p.u


@dataclass(frozen=True, eq=False)
class Inputs:
    """Two constant inputs, in the units of the plant's, (2,)."""

    u: Array


def constant_inputs(t: float, x: Any, memory: Any, p: Any) -> tuple[float, float]:
    memory.v[0], memory.v[1] = p.u[0], p.u[1]
    return (p.u[0], p.u[1])


def held(u: float | tuple[float, float]) -> Controller:
    """A controller that holds one input or two."""
    if isinstance(u, tuple):
        memory = partial(_memory_of_two_inputs)
        return Controller("open loop", constant_inputs, Inputs(np.array(u)), memory)
    return Controller("open loop", constant_input, Input(u))


def _memory_of_two_inputs() -> Memory:
    return Memory(v=np.zeros(2))
