"""Numbers of a law that are tuned: their paths, ranges and scales, and the law with other ones."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.content import Content
from grosmc_mj.experiments.file.reading import case_file_of
from grosmc_mj.ground.arrays import Array
from grosmc_mj.studies.target import StudiedLaw
from grosmc_mj.studies.tune.search import Ranges
from grosmc_mj.theory.control.controller import Controller

# A key of a path, or the number of an entry of a list.
_KEY = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


@dataclass(frozen=True)
class TunedNumber:
    """Number of a law that is tuned.

    Attributes:
        path: Place in the law's table, such as ``k``, ``Q[1]`` or
            ``uncertainty.wrench[5]``; entries of lists are counted from 1.
        start: Value in the file; None if the file has none.
        low: Least value of the range that is searched first.
        high: Largest value of that range.
        least: Bound that the range cannot grow beyond.
        most: Bound that the range cannot grow beyond.
        unit: Unit; empty for a number without one, or in the units of the law.
        logarithmic: Whether it is searched by its logarithm.
    """

    path: str
    start: float | None
    low: float
    high: float
    least: float = 0.0
    most: float = math.inf
    unit: str = ""
    logarithmic: bool = True

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value: itself, or its decimal logarithm."""
        if not self.logarithmic:
            return value
        return math.log10(value) if value > 0 else -math.inf

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        return 10.0**coordinate if self.logarithmic else coordinate

    def including(self, value: float | None) -> TunedNumber:
        """Return the number with a range that has a value, too, if it can."""
        if value is None or not math.isfinite(self.coordinate(value)):
            return self
        return replace(self, low=min(self.low, value), high=max(self.high, value))


def ranges_of(numbers: Sequence[TunedNumber]) -> Ranges:
    """Return the ranges of the coordinates of numbers."""
    columns = [
        [
            number.coordinate(number.low),
            number.coordinate(number.high),
            number.coordinate(number.least),
            number.coordinate(number.most),
        ]
        for number in numbers
    ]
    return Ranges(*np.array(columns).T.copy())


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


@dataclass(frozen=True, eq=False)
class TunableLaw:
    """Law with the numbers that are tuned.

    Attributes:
        law: The law, as it is studied with the numbers of the file.
        experiment: Experiment of the target.
        table: Its table as a controller of the file, with all its numbers.
        numbers: The numbers that are tuned, d of them.
    """

    law: StudiedLaw
    experiment: Experiment
    table: Content
    numbers: tuple[TunedNumber, ...]

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.law.name

    def values_at(self, point: Array) -> dict[str, float]:
        """Return the numbers at a point of the coordinates (d,), by path."""
        return {
            number.path: number.value(float(coordinate))
            for number, coordinate in zip(self.numbers, point, strict=True)
        }

    def table_with(self, values: Mapping[str, float]) -> Content:
        """Return the table of the law with other numbers, by path."""
        table = deepcopy(self.table)
        weights = {path: value for path, value in values.items() if path.startswith("Q[")}
        if weights:
            table["Q"] = _with_diagonal(self.law.controller.designed.lqr.Q, weights)
        for path, value in values.items():
            if path not in weights:
                _set(table, path, value)
        return table

    def designed(self, values: Mapping[str, float]) -> Controller:
        """Return the law with other numbers, by path.

        Raises:
            GrosmcError: If the law cannot be designed with them.
        """
        experiment = self.experiment
        content = {**experiment.file.content, "controller": [self.table_with(values)]}
        file = case_file_of(content, experiment.path)
        # Designs are forgotten: there are thousands, and each is asked for once.
        case = replace(experiment, file=file, chosen=(), _designs={})
        return case.law(experiment.nominal.truest, self.name)


def _with_diagonal(Q: Array, weights: Mapping[str, float]) -> list[Any]:
    """Return a weight with other entries on its diagonal, as a file has it.

    D Q D, with D diagonal, is as definite as Q is.

    Args:
        Q: Weight of the file, (n, n).
        weights: Entries of the diagonal by path, ``Q[1]``.
    """
    old = np.diag(Q)
    new = old.copy()
    for path, value in weights.items():
        new[keys_of(path)[1]] = value

    factors = np.sqrt(np.divide(new, old, out=np.zeros_like(new), where=old > 0))
    changed = Q * np.outer(factors, factors)
    np.fill_diagonal(changed, new)
    if np.array_equal(changed, np.diag(new)):
        return new.tolist()
    return changed.tolist()


def keys_of(path: str) -> list[Any]:
    """Return the keys of a path, and indices from 0 for entries of lists."""
    return [int(index) - 1 if index else key for key, index in _KEY.findall(path)]


def _set(table: Content, path: str, value: float) -> None:
    """Set a number in a table, in tables and lists inside it too."""
    *keys, last = keys_of(path)
    owner: Any = table
    for key in keys:
        owner = owner[key]
    owner[last] = value
