"""A law with its numbers, and the design that they come from."""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.ground.arguments import real, reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.records import with_fields
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.fields import Is, Name, checked_call
from grosmc_mj.theory.control.coordinates.base import (
    InputMap,
    OutputCoordinates,
    regulated_outputs,
)
from grosmc_mj.theory.control.coordinates.state import StateCoordinates
from grosmc_mj.theory.control.law import Law, wrapped, writing
from grosmc_mj.theory.control.lqr import LqrDesign
from grosmc_mj.theory.control.memory import Memory, memory_of
from grosmc_mj.theory.control.switching import SwitchingTerm

# Fields of p that every law gets.
_OF_THE_NOMINAL_PLANT = ("plant", "reference", "period")
# Fields of memory that belong to the engines, or mean the chapter's sliding variable.
_OF_THE_RUN = ("v", "undefined", "begun", "s")


@dataclass(frozen=True, eq=False)
class Sampled:
    """Numbers of a law that reads its control period, such as a user's own law.

    Attributes:
        period: Control period of the run [s]; NaN before there is one.
    """

    period: float = math.nan


@dataclass(frozen=True, eq=False, kw_only=True)
class TaskNumbers(Sampled):
    """Numbers of a law for a task that reads its control period.

    Attributes:
        plant: Parameters of the nominal plant.
        reference: Parameters of the reference.
    """

    plant: Any
    reference: Any


@dataclass(frozen=True, eq=False)
class Design:
    """Error coordinates and optimum that a law was designed for and its runs are judged by.

    Attributes:
        error: The error coordinates that the law regulates.
        lqr: The optimum that it is to follow.
        source: Equations of the chapter.
        gains: Gains worth showing, by the chapter's symbols.
        declared: The uncertainty that the gains were computed from, in words; empty if the gains
            are given.
        sliding_unit: Unit of s, if the law has a surface.
        linearizing: Whether it goes through feedback linearization, eqs. (23) and (44).
        switching: Name of its switching law; empty if it has none.
        control_period: The only sampling time that it is designed for [s]; None for any.
        switched_law: Makes its law for another switching law, if it has one.
        numbers_at: Its numbers that depend on the control period [s], by their names; None for
            none.
        follows_optimum: Whether the error of the nominal loop is that of the optimum: the law is
            the LQR, with or without a term that vanishes where nothing disturbs it.
        weighed: Whether somebody has chosen the weights of that optimum; else its runs have
            neither a distance from it nor a cost.
        neglected: Poles of the plant that its gains were computed without [1/s], much faster than
            the bandwidth that is asked for.
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
    switched_law: Callable[[SwitchingTerm], Law] | None = None
    numbers_at: Callable[[float], Mapping[str, Any]] | None = None
    follows_optimum: bool = True
    weighed: bool = True
    neglected: tuple[complex, ...] = ()


@dataclass(frozen=True, eq=False)
class Controller:
    """A law, its parameters and the memory that each run of it starts with.

    Attributes:
        name: ``lqr``, ``fl-lqr``, ``grosmc`` or the user's own.
        law: (t, x, memory, p, u), which writes the inputs u (m,) in the unit of the plant's. It is
            made of a function (t, x, memory, p) too, which returns a number or m numbers; plain
            Python.
        parameters: p, a frozen dataclass of numbers, arrays and such dataclasses.
        memory: Makes the memory of a new run.
        design: Its error coordinates and optimum; None for an open loop and the like.
    """

    name: str
    law: Law
    parameters: Any
    memory: Callable[[], Memory] = Memory
    design: Design | None = None

    def __post_init__(self) -> None:
        Is(str, "a text").require("name of the controller", self.name)
        if not callable(self.law):
            raise ArgumentError(f"{self.name}: law = {value_text(self.law)} must be a function")
        if not callable(self.memory):
            raise ArgumentError(
                f"{self.name}: memory = {value_text(self.memory)} must be a function"
            )
        Is((Design, type(None)), "a Design or None").require(f"{self.name}: design", self.design)
        object.__setattr__(self, "law", writing(self.law))

    def input_at(self, t: float, x: ArrayLike, memory: Memory) -> Array:
        """Return the law's inputs at one sample, (m,).

        Args:
            t: Time [s].
            x: State, (n,).
            memory: Memory of the run, which the law changes.
        """
        # v has an entry for each input.
        u = np.zeros(np.size(memory.v))
        state = np.asarray(x, float)
        self.law(t, state, memory, self.parameters, u)
        memory.begun = 1.0
        return u

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
        return regulated_outputs(self.designed.error, self.name)

    def sampled(self, control_period: float) -> Controller:
        """Copy with the control period [s] set in its parameters.

        The numbers that depend on it are set too. A law that does not read ``p.period`` is
        returned as it is.
        """
        p = self.parameters
        if not isinstance(p, Sampled) or p.period == control_period:
            return self

        numbers: Mapping[str, Any] = {}
        if self.design is not None and self.design.numbers_at is not None:
            numbers = self.design.numbers_at(control_period)
        return replace(self, parameters=replace(p, period=control_period, **numbers))


@checked_call
def custom_controller(
    name: Name,
    law: Any,
    like: Annotated[Controller, Is(Controller, "a controller, such as chapter_controller's")],
    numbers: Mapping[str, Any] | None = None,
    memory: Mapping[str, Any] | None = None,
) -> Controller:
    """Make a controller of any law, judged against the optimum of another controller.

    Args:
        name: Name of the controller.
        law: (t, x, memory, p, u), which writes the inputs into u (m,); or (t, x, memory, p), which
            returns a number or, for several inputs, a tuple.
        like: A controller with error coordinates and an optimum, whose index weighs this one.
        numbers: Fields of p besides ``plant``, ``reference`` and ``period``, the control period:
            numbers and arrays.
        memory: Fields of memory with their values when a run begins, such as
            ``{"integral": 0.0, "past": np.zeros(8)}``: numbers and arrays, which the law changes
            in place (``memory.past[0] = e``). Each is recorded in ``Trajectory.memory``.

    Raises:
        ArgumentError: If ``like`` has no optimum, or a name or a value cannot be a field.
    """
    if not callable(law):
        raise ArgumentError(
            f"{name}: law = {value_text(law)} must be a function (t, x, memory, p, u)"
        )
    design = like.designed
    numbers = numbers or {}
    memory = memory or {}
    _require_names(numbers, reserved=_OF_THE_NOMINAL_PLANT)
    _require_names(memory, reserved=_OF_THE_RUN)

    initial: dict[str, Any] = {}
    for key, value in memory.items():
        initial[key] = _initial_value(key, value)

    parameters = with_fields(
        Sampled(),
        plant=like.parameters.plant,
        reference=like.parameters.reference,
        **numbers,
    )
    return noting_controller(
        name,
        law,
        like,
        parameters,
        memory_of(Memory, further=initial, m=design.error.inputs),
        source="a law of one's own",
        gains=_gains_to_show(numbers),
    )


def noting_controller(
    name: str,
    law: Callable[..., Any],
    like: Controller,
    parameters: Any,
    memory: Callable[[], Any],
    *,
    source: str,
    gains: dict[str, float],
) -> Controller:
    """Make a controller of a law that does not compute v: it is noted after each sample.

    Args:
        name: Name of the controller.
        law: The law.
        like: Controller whose error coordinates and optimum it is judged by.
        parameters: Numbers of the law.
        memory: Makes the memory of a new run.
        source: Source of the law in the literature.
        gains: Gains worth showing.
    """
    design = like.designed
    _, virtual_input = design.error.input_maps(linearizing=design.linearizing)
    return Controller(
        name=name,
        law=_noting(law, virtual_input),
        parameters=parameters,
        memory=memory,
        design=Design(
            design.error,
            design.lqr,
            source=source,
            gains=gains,
            linearizing=design.linearizing,
            follows_optimum=False,
            weighed=design.weighed,
        ),
    )


def _require_names(fields: Mapping[str, Any], reserved: Sequence[str]) -> None:
    """Refuse names that cannot be fields of a dataclass, or that are reserved."""
    for name in fields:
        if not name.isidentifier() or keyword.iskeyword(name) or name in reserved:
            raise ArgumentError(f"{name!r} cannot be the name of a number or memory")


def _gains_to_show(numbers: Mapping[str, Any]) -> dict[str, float]:
    """Finite numbers of a law: an array or an infinite limit is no gain worth showing."""
    gains: dict[str, float] = {}
    for key, value in numbers.items():
        number = real(value)
        if math.isfinite(number):
            gains[key] = number
    return gains


def _initial_value(name: str, value: Any) -> float | Array:
    """Value of a field of memory as a run begins: a float, or an array of floats."""
    entries = reals(value)
    if not np.all(np.isfinite(entries)):
        raise ArgumentError(f"memory: {name} = {value_text(value)} must be finite")
    if entries.ndim == 0:
        return float(entries)
    return entries


def named_gains(**matrices: Array) -> dict[str, float]:
    """Gains by their symbols: K1, K2 ... or, of several inputs, K11, K12 ... row by row."""
    gains: dict[str, float] = {}
    for symbol, matrix in matrices.items():
        for (i, j), key in gain_keys(symbol, *matrix.shape).items():
            gains[key] = float(matrix[i, j])
    return gains


def gain_keys(symbol: str, rows: int, columns: int) -> dict[tuple[int, int], str]:
    """Keys of the entries of a gain matrix by their indices, see ``named_gains``.

    From eleven rows on, K1_11 and K11_1 are told apart.
    """
    between = "_" if rows > 10 else ""
    keys: dict[tuple[int, int], str] = {}
    for i, j in np.ndindex(rows, columns):
        row = ""
        if rows > 1:
            row = f"{i + 1}{between}"
        keys[i, j] = f"{symbol}{row}{j + 1}"
    return keys


# Cached, so that controllers of one law have one wrapper, which is compiled once.
@cache
def _noting(law: Callable[..., Any], virtual_input: InputMap) -> Law:
    """Wrap a law so that it notes v, which the index weighs: u, or v of eqs. (24) and (45)."""
    inner = jitable(writing(law))

    def noting(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
        inner(t, x, memory, p, u)
        virtual_input(t, x, u, memory, p, memory.v)

    return wrapped(noting, law)
