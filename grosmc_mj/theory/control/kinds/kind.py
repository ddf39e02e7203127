"""The base class of all kinds of laws."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import MISSING, fields
from enum import Enum
from functools import cache
from typing import Any, ClassVar

from grosmc_mj.ground.fields import range_of
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.law_number import LawNumber
from grosmc_mj.theory.control.task import Task

# Only the ratios of weights count, so a search takes factors on those of the file. On a machine
# with friction an error weighs up to 1e5 times as much as on the chapter's plants.
WEIGHTS: Mapping[str, LawNumber] = {
    "Q": LawNumber(
        low=0,
        meaning="weight of the error state",
        search=(1e-2, 1e6),
        each="state",
        relative=True,
    ),
    "R": LawNumber(
        low=0,
        above=True,
        meaning="weight of the input",
        search=(1e-3, 1e3),
        each="input",
        relative=True,
    ),
}


class Where(Enum):
    """Kind of nominal plant that laws are designed from; its value says it in words."""

    EQUATIONS = "equations"
    AT_REST = "equations with an operating point"
    COMPUTED_TORQUE = "a robot with an actuator for each joint"
    UNDERACTUATED = "a robot with fewer actuators than joints"


OF_EQUATIONS = frozenset({Where.EQUATIONS, Where.AT_REST})
OF_OUTPUTS = OF_EQUATIONS | {Where.COMPUTED_TORQUE}


class LawKind(ABC):
    """Numbers of a law, from which it is designed for a task.

    A kind of law is a ``checked`` subclass in a file of its own, listed in ``KINDS``; its fields
    are its numbers, each with a ``LawNumber``.

    Attributes:
        key: Name of the law in a file.
        where: Nominal plants that it can be designed for.
        system: Name of the only system that has it; empty for none.
        linearizing: Whether it goes through feedback linearization, so that R weighs v.
        switches: Whether it has a switching law, with numbers of its own.
        takes_limits: Whether it takes the limits of the loop's inputs where it has no ``limit``.
        weights: Its weights in a file, of the task or its own.
        follows_weights: Whether the law itself depends on its weights; else they only weigh the
            index by which its runs are judged.
        own_weights: Q and R of all states of its system, which no file changes; None for most.
        ways: Numbers that exclude each other: exactly one of these groups is given, by its first.
    """

    key: ClassVar[str]
    where: ClassVar[frozenset[Where]] = frozenset()
    system: ClassVar[str] = ""
    linearizing: ClassVar[bool] = True
    switches: ClassVar[bool] = False
    takes_limits: ClassVar[bool] = False
    weights: ClassVar[Mapping[str, LawNumber]] = WEIGHTS
    follows_weights: ClassVar[bool] = True
    own_weights: ClassVar[tuple[Any, Any] | None] = None
    ways: ClassVar[tuple[tuple[str, ...], ...]] = ()

    @classmethod
    def holds_states(cls, where: Where, *, follows: bool) -> bool:
        """Whether it holds all states at the operating point, instead of outputs.

        Args:
            where: Kind of nominal plant.
            follows: Whether the task has a reference or outputs of its own.
        """
        return False

    @abstractmethod
    def design(self, task: Task) -> Controller:
        """Return the law for a task, with the switching law and the surface as printed.

        Raises:
            GrosmcError: If it cannot be designed with these numbers.
        """

    # -- its numbers -------------------------------------------------------------------------------

    @classmethod
    def field_names(cls) -> list[str]:
        """Return the keys of its numbers, matrices and names."""
        return [item.name for item in fields(cls)]  # pyright: ignore[reportArgumentType]

    @classmethod
    def required(cls) -> list[str]:
        """Return the keys without which it cannot be designed."""
        all_fields = fields(cls)  # pyright: ignore[reportArgumentType]
        return [item.name for item in all_fields if item.default is MISSING]

    @classmethod
    def numbers(cls) -> Mapping[str, LawNumber]:
        """Return its numbers by their keys, without matrices, names and weights."""
        return _numbers(cls)

    @classmethod
    def tunable(cls, way: str = "") -> Mapping[str, LawNumber]:
        """Return the numbers that a search may change, weights too, without those it excludes.

        Args:
            way: First number of one of ``ways``; by default the first of them.

        Raises:
            KeyError: If there is no such way.
        """
        excluded = set(cls._excluded_by(way))
        found = dict(cls.numbers())
        if cls.follows_weights:
            found.update(cls.weights)
        return {
            key: number
            for key, number in found.items()
            if number.search is not None and key not in excluded
        }

    @classmethod
    def defaults(cls) -> Mapping[str, float]:
        """Return the values of the numbers that a file need not give."""
        defaults = {}
        for item in fields(cls):  # pyright: ignore[reportArgumentType]
            if item.name in cls.numbers() and isinstance(item.default, float):
                defaults[item.name] = item.default
        return defaults

    @classmethod
    def way_of(cls, given: Collection[str]) -> str:
        """Return the first number of the way that a file takes; empty for none or for no ways.

        Args:
            given: Keys that the file gives.
        """
        for way in cls.ways:
            if way[0] in given:
                return way[0]
        return ""

    @classmethod
    def _excluded_by(cls, way: str) -> list[str]:
        """Return the keys of all ways but one."""
        if not cls.ways:
            return []
        groups = {group[0]: group for group in cls.ways}
        taken = groups[way or cls.ways[0][0]]
        return [key for group in cls.ways for key in group if key not in taken]


# Reading types is slow, and each number of a law is asked for often.
@cache
def _numbers(kind: Any) -> Mapping[str, LawNumber]:
    """Return the numbers of a kind by their keys."""
    numbers = {}
    for key in kind.field_names():
        number = range_of(kind, key)
        if isinstance(number, LawNumber):
            numbers[key] = number
    return numbers
