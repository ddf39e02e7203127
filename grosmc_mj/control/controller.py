"""A law with its numbers."""

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
class Controller:
    """A law, its parameters and the memory that each run of it starts with.

    Attributes:
        name: ``lqr``, ``fl-lqr``, ``grosmc`` or the user's own.
        law: (t, x, memory, p) -> u in the unit of the plant's input, a number or, for several
            inputs, a tuple; plain Python.
        parameters: p, a frozen dataclass of numbers, arrays and such dataclasses.
        memory: Makes the memory of a new run.
        error: The error coordinates that the law regulates, if it has them.
        lqr: The optimum that it is to follow, if there is one.
        source: Equations of the chapter.
        gains: Gains worth showing, by the chapter's symbols.
        declared: What the gains were computed from, in words; empty if they are given.
        sliding_unit: Unit of s, if the law has a surface.
        linearizing: Whether it goes through feedback linearization, eqs. (23) and (44).
        switching: Name of its switching law; empty if it has none.
        control_period: The one sampling time that it is designed for [s]; None for any.
        with_reach: Makes its law for another switching law, if it has one.
    """

    name: str
    law: Law
    parameters: Any
    memory: Callable[[], Memory] = Memory
    error: OutputCoordinates | StateCoordinates | None = None
    lqr: LqrDesign | None = None
    source: str = ""
    gains: Mapping[str, float] = field(default_factory=dict)
    declared: str = ""
    sliding_unit: str = ""
    linearizing: bool = False
    switching: str = ""
    control_period: float | None = None
    with_reach: Callable[[Reach], Law] | None = None

    def __post_init__(self) -> None:
        require("name of the controller", self.name, str, "a text")
        kinds = (OutputCoordinates, StateCoordinates, type(None))
        require(f"{self.name}: error", self.error, kinds, "error coordinates or None")
        for what in ("law", "memory"):
            if not callable(getattr(self, what)):
                raise ArgumentError(
                    f"{self.name}: {what} = {shown(getattr(self, what))} must be a function"
                )

    @property
    def coordinates(self) -> OutputCoordinates:
        """The error coordinates of a law that regulates outputs.

        Raises:
            ArgumentError: If it regulates the whole state, or nothing.
        """
        if not isinstance(self.error, OutputCoordinates):
            raise ArgumentError(f"{self.name} has no outputs that it regulates")
        return self.error

    def begin(self) -> tuple[Memory, Workspace | None]:
        """The memory of a new run, and what must be kept alive for as long as it."""
        memory, workspace = self.memory(), None
        if isinstance(self.error, OutputCoordinates):
            workspace = self.error.workspace(self.parameters)
        if workspace is not None:
            memory.workspace = workspace.address
        return memory, workspace
