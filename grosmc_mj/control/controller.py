"""A law with its numbers, and the design that they come from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from grosmc_mj.arguments import require
from grosmc_mj.control.coordinates.base import OutputCoordinates, Workspace
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.laws import Law
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.memory import Memory
from grosmc_mj.control.switching import Reach
from grosmc_mj.errors import ArgumentError, shown


@dataclass(frozen=True, eq=False)
class Design:
    """What a law was designed for, and what its runs are judged by.

    Attributes:
        error: The error coordinates that the law regulates.
        lqr: The optimum that it is to follow.
        source: Equations of the chapter.
        gains: Gains worth showing, by the chapter's symbols.
        declared: What the gains were computed from, in words; empty if they are given.
        sliding_unit: Unit of s, if the law has a surface.
        linearizing: Whether it goes through feedback linearization, eqs. (23) and (44).
        switching: Name of its switching law; empty if it has none.
        control_period: The one sampling time that it is designed for [s]; None for any.
        with_reach: Makes its law for another switching law, if it has one.
    """

    error: OutputCoordinates | StateCoordinates
    lqr: LqrDesign
    source: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    declared: str = ""
    sliding_unit: str = ""
    linearizing: bool = False
    switching: str = ""
    control_period: float | None = None
    with_reach: Callable[[Reach], Law] | None = None

    def __post_init__(self) -> None:
        kinds = (OutputCoordinates, StateCoordinates)
        require("error", self.error, kinds, "error coordinates of the plant")
        require("lqr", self.lqr, LqrDesign, "an optimum, such as lqr(A, B, Q, R)")


@dataclass(frozen=True, eq=False)
class Controller:
    """A law, its parameters and the memory that each run of it starts with.

    Attributes:
        name: ``lqr``, ``fl-lqr``, ``grosmc`` or the user's own.
        law: (t, x, memory, p) -> u in the unit of the plant's input, a number or, for several
            inputs, a tuple; plain Python.
        parameters: p, a frozen dataclass of numbers, arrays and such dataclasses.
        memory: Makes the memory of a new run.
        design: What it was designed for; None for an open loop and the like.
    """

    name: str
    law: Law
    parameters: Any
    memory: Callable[[], Memory] = Memory
    design: Design | None = None

    def __post_init__(self) -> None:
        require("name of the controller", self.name, str, "a text")
        require(f"{self.name}: design", self.design, (Design, type(None)), "a Design or None")
        for what in ("law", "memory"):
            if not callable(getattr(self, what)):
                raise ArgumentError(
                    f"{self.name}: {what} = {shown(getattr(self, what))} must be a function"
                )

    @property
    def designed(self) -> Design:
        """The design of a law that must have one.

        Raises:
            ArgumentError: If it has none.
        """
        if self.design is None:
            raise ArgumentError(
                f"{self.name} has no error coordinates and no optimum: take one of the chapter's "
                "controllers, or one made for a Task"
            )
        return self.design

    @property
    def coordinates(self) -> OutputCoordinates:
        """The error coordinates of a law that regulates outputs.

        Raises:
            ArgumentError: If it regulates the whole state, or nothing.
        """
        error = self.designed.error
        if not isinstance(error, OutputCoordinates):
            raise ArgumentError(f"{self.name} has no outputs that it regulates")
        return error

    def begin(self) -> tuple[Memory, Workspace | None]:
        """The memory of a new run, and what must be kept alive for as long as it."""
        memory, workspace = self.memory(), None
        if self.design is not None:
            workspace = self.design.error.workspace(self.parameters)
        if workspace is not None:
            memory.workspace = workspace.address
        return memory, workspace
