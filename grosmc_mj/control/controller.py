"""A law with its numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from grosmc_mj.control.error_coordinates import ErrorCoordinates
from grosmc_mj.control.laws import Law
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.memory import Memory


@dataclass(frozen=True, eq=False)
class Controller:
    """A law, its parameters and the memory that each run of it starts with.

    Attributes:
        name: ``lqr``, ``fl-lqr``, ``grosmc`` or the user's own.
        law: (t, x, memory, p) -> u in the unit of the plant's input; plain Python.
        parameters: p, a frozen dataclass of numbers, arrays and such dataclasses.
        memory: Makes the memory of a new run.
        error: The error coordinates that the law regulates, if it has them.
        lqr: The optimum that it is to follow, if there is one.
        source: Equations of the chapter.
        gains: Gains worth showing, by the chapter's symbols.
        declared: What the gains were computed from, in words; empty if they are given.
        sliding_unit: Unit of s, if the law has a surface.
        linearizing: Whether it goes through feedback linearization, eqs. (23) and (44).
    """

    name: str
    law: Law
    parameters: Any
    memory: Callable[[], Memory] = Memory
    error: ErrorCoordinates | None = None
    lqr: LqrDesign | None = None
    source: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    declared: str = ""
    sliding_unit: str = ""
    linearizing: bool = False
