"""Numbers of a law that are tuned: their ranges and scales, and the law with other ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.number import Number, set_numbers
from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.target import StudiedLaw
from grosmc_mj.studies.tune.search import Ranges
from grosmc_mj.theory.control.controller import Controller

# Digits of a tuned number in a case file: its last percent decides nothing.
_DIGITS = 6


@dataclass(frozen=True)
class TunedNumber:
    """Number of a law that is tuned.

    Attributes:
        name: Its path in the law, such as ``k``, ``Q[1]`` or ``uncertainty.wrench[5]``; of a number
            of the case the whole path, such as ``estimator.rotor speed.bandwidth``.
        number: The number of the experiment.
        start: Value in the file; None if the file has none.
        low: Least value of the range that is searched first.
        high: Largest value of that range.
        logarithmic: Whether it is searched by its logarithm.
    """

    name: str
    number: Number
    start: float | None
    low: float
    high: float
    logarithmic: bool = True

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds that the range cannot grow beyond."""
        low = self.number.bounds.low
        high = self.number.bounds.high
        if self.logarithmic:
            # A logarithm keeps its sign.
            return (max(low, 0.0), high) if self.sign > 0 else (low, min(high, 0.0))
        return low, high

    @property
    def sign(self) -> float:
        """Sign of all values of a number that is searched by its logarithm."""
        return -1.0 if self.high < 0 else 1.0

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value: itself, or the logarithm of its size with its sign."""
        if not self.logarithmic:
            return value
        size = self.sign * value
        return self.sign * math.log10(size) if size > 0 else -self.sign * math.inf

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate; at that of the file its value to the bit."""
        if self.start is not None and coordinate == self.coordinate(self.start):
            return self.start
        if not self.logarithmic:
            return coordinate
        return self.sign * 10.0 ** (self.sign * coordinate)

    def rounded(self, value: float) -> float:
        """Return a value as a case file has it; that of the file as it is."""
        if value == self.start:
            return value
        return float(f"{value:.{_DIGITS}g}")

    def including_start(self) -> TunedNumber:
        """Return the number with a range that has the value of the file, too, if it can."""
        if self.start is None or not math.isfinite(self.coordinate(self.start)):
            return self
        return replace(self, low=min(self.low, self.start), high=max(self.high, self.start))


def ranges_of(numbers: Sequence[TunedNumber]) -> Ranges:
    """Return the ranges of the coordinates of numbers."""
    ends = [(number.low, number.high, *number.bounds) for number in numbers]
    coordinates = [
        [number.coordinate(end) for end in ends_of_number]
        for number, ends_of_number in zip(numbers, ends, strict=True)
    ]
    low, high, hard_low, hard_high = np.array(coordinates).T.copy()
    return Ranges(low, high, hard_low, hard_high)


def start_of(numbers: Sequence[TunedNumber]) -> Array:
    """Return the coordinates of the values in the file, within the ranges, (d,).

    A number that the file does not have begins in the middle of its range.
    """
    start = []
    for number in numbers:
        low = number.coordinate(number.low)
        high = number.coordinate(number.high)
        place = (low + high) / 2
        if number.start is not None:
            place = min(max(number.coordinate(number.start), low), high)
        start.append(place)
    return np.array(start)


class Design(NamedTuple):
    """A law with some numbers, and the numbers of its case that are tuned with it.

    Attributes:
        controller: The law.
        of_case: Numbers of the case, such as an estimator's, with their values.
    """

    controller: Controller
    of_case: tuple[tuple[Number, float], ...] = ()

    def case(self, case: Experiment) -> Experiment:
        """Return a case with the numbers of the design."""
        return set_numbers(case, self.of_case) if self.of_case else case


@dataclass(frozen=True, eq=False)
class TunableLaw:
    """Law with the numbers that are tuned.

    Attributes:
        law: The law, as it is studied with the numbers of the file.
        experiment: Experiment of the target, in which the law is the only controller and has all
            its numbers in a table of its own.
        base: Name of that table among the ``[laws]``.
        numbers: The numbers that are tuned, d of them.
    """

    law: StudiedLaw
    experiment: Experiment
    base: str
    numbers: tuple[TunedNumber, ...]

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.law.name

    @property
    def table(self) -> Content:
        """Table of the law with the numbers of the file."""
        return self.experiment.file.content["laws"][self.base]

    def values_at(self, point: Array) -> dict[str, float]:
        """Return the numbers at a point of the coordinates (d,), by name."""
        return {
            number.name: number.value(float(coordinate))
            for number, coordinate in zip(self.numbers, point, strict=True)
        }

    def with_numbers(self, values: Mapping[str, float]) -> Experiment:
        """Return the experiment with other numbers of the law, by name.

        Raises:
            GrosmcError: If one is out of its bounds.
        """
        pairs = [(number.number, values[number.name]) for number in self.numbers]
        # Designs are forgotten: there are thousands, and each is asked for once.
        return replace(set_numbers(self.experiment, pairs), _designs={})

    def designed(self, values: Mapping[str, float]) -> Design:
        """Return the law with other numbers, by name.

        Raises:
            GrosmcError: If the law cannot be designed with them.
        """
        experiment = self.with_numbers(values)
        controller = experiment.law(experiment.nominal.truest, self.name)
        of_case = [
            (number.number, values[number.name])
            for number in self.numbers
            if not number.number.of_file
        ]
        return Design(controller, tuple(of_case))

    @property
    def as_in_file(self) -> Design:
        """The law with the numbers of the file."""
        return Design(self.law.controller)
