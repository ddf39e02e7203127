"""Columns of numbers of a file, and which of them a signal is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from grosmc_mj.experiments.logs.csv_file import line_of
from grosmc_mj.experiments.logs.log import GAP
from grosmc_mj.experiments.logs.numbers import are_instants, steps_from_first
from grosmc_mj.ground.arguments import require_known
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, value_text
from grosmc_mj.ground.wording import spelled

# Brackets around the unit at the end of a header.
_BRACKETS = {"]": "[", ")": "("}
# Headers that a message lists.
_LISTED = 12
# Larger numbers come from damage; a time of nanoseconds since 1970 is smaller.
_LARGEST = 1e20


@dataclass(frozen=True, eq=False)
class LogColumn:
    """Numbers of a log.

    Attributes:
        header: Its header, or the path of a number in messages.
        values: NaN where the file has no number, (N,).
        name: Name of its signal.
        unit: Unit of its numbers; empty if the file has none.
        stamps: Instants at which messages were recorded [s], (N,); None for a column of a table.
        stamped: Instants in the messages, their ``header.stamp`` [s], (N,); None if they have none.
        written: The values as they stand in the file, before they are rounded to floats; None for
            messages.
        file: The CSV file; None for other files.
        refused: Why it is not one signal; empty if it is.
    """

    header: str
    values: Array
    name: str
    unit: str = ""
    stamps: Array | None = None
    stamped: Array | None = None
    written: pa.ChunkedArray | None = None
    file: Path | None = None
    refused: str = ""

    @classmethod
    def headed(
        cls, header: str, values: Array, written: pa.ChunkedArray, file: Path | None
    ) -> LogColumn:
        """Column of a table, with name and unit in its header."""
        name, unit = name_and_unit(header)
        return cls(header, values, name, unit, written=written, file=file)

    @property
    def plain_name(self) -> str:
        """Its name in small letters, with blanks between the words."""
        return spelled(self.name).lower()

    @property
    def are_instants(self) -> bool:
        """Whether it has dates or durations, whose values are seconds already."""
        return self.written is not None and are_instants(self.written)

    def from_first(self, factor: float) -> Array:
        """The values from the first one on, times a factor.

        A time since 1970 has more digits than a float: integers and decimal text are subtracted
        exactly, and rounded once, after the factor.
        """
        steps = None
        if self.written is not None:
            steps = steps_from_first(self.written, factor)
        if steps is None:
            steps = (self.values - self.values[0]) * factor
        return steps

    def held(self, time: Array) -> Array:
        """The last value before each instant."""
        if self.stamps is None:
            return self.values
        last = np.searchsorted(self.stamps, time, side="right") - 1
        return self.values[last.clip(0)]

    def between(self, time: Array) -> Array:
        """The values at some instants, by straight lines."""
        if self.stamps is None:
            return self.values
        return np.interp(time, self.stamps, self.values)

    def is_shown(self, time: Array, *, held: bool) -> NDArray[np.bool_]:
        """Whether its messages show the signal at some instants, (N,).

        Before the first message nobody knows it. A signal that is held stays after a message for as
        long as the longest silence between two of them; one that is measured is unknown in a gap.

        Args:
            time: Instants [s], (N,).
            held: Whether it is a signal that is held, such as an input.
        """
        if self.stamps is None:
            return np.ones(len(time), bool)
        steps = np.diff(self.stamps)
        usual = float(np.median(steps)) if len(steps) else 0.0
        longest = float(steps.max(initial=0.0)) if held else usual

        is_inside = (time >= self.stamps[0] - usual) & (time <= self.stamps[-1] + longest)
        if held or not len(steps):
            return is_inside
        before = (np.searchsorted(self.stamps, time, side="right") - 1).clip(0, len(steps) - 1)
        is_in_gap = (steps[before] > GAP * usual) & (time > self.stamps[before])
        is_in_gap &= time < self.stamps[before + 1]
        return is_inside & ~is_in_gap

    def place(self, index: int) -> str:
        """Words for where a value stands, such as ``line 102``."""
        if self.file is not None:
            return f"line {line_of(self.file, index)}"
        if self.stamps is not None:
            return f"message {index + 1}"
        return f"row {index + 1}"

    def require_numbers(self) -> None:
        """Refuse what is not one signal, a value that is no number, or one that no machine has."""
        if self.refused:
            raise ArgumentError(f"{self.header}: {self.refused}")
        # False for NaN too.
        is_number = np.abs(self.values) <= _LARGEST
        if np.all(is_number):
            return

        index = int(np.argmin(is_number))
        value = value_text(self.values[index])
        if self.file is not None and self.written is not None:
            value = value_text(self.written[index].as_py())
        raise ArgumentError(
            f"{self.header} is no number in {self.place(index)}, {value}: fill or cut it"
        )


def name_and_unit(header: str) -> tuple[str, str]:
    """Return the parts of a header such as ``rotor angle [deg]`` or ``u (V)``.

    Returns:
        The name, and the unit within the last brackets; empty if it does not end with brackets.
    """
    text = header.strip()
    opening = _BRACKETS.get(text[-1:])
    if opening is None:
        return text, ""

    # The bracket that belongs to the last one: a unit such as V/(rad/s) has brackets of its own.
    depth = 0
    for place in range(len(text) - 1, -1, -1):
        if text[place] == text[-1]:
            depth += 1
        elif text[place] == opening:
            depth -= 1
        if depth == 0:
            return text[:place].rstrip(), text[place + 1 : -1].strip()
    return text, ""


def some(columns: Mapping[str, LogColumn]) -> str:
    """The headers, the first ones of many."""
    listed = ", ".join(list(columns)[:_LISTED])
    if len(columns) > _LISTED:
        return f"{listed}, ..."
    return listed


def column_of(columns: Mapping[str, LogColumn], header: str) -> LogColumn:
    """The column that the case file names.

    Raises:
        ArgumentError: If there is none.
    """
    require_known("column", header, columns, "[log]: ")
    return columns[header]


def called(columns: Mapping[str, LogColumn], names: Sequence[str]) -> LogColumn | None:
    """The column that is called by the first of some names, or else by the next one.

    Raises:
        ArgumentError: If two are.
    """
    for name in names:
        wanted = name.lower()
        found = [column for column in columns.values() if column.plain_name == wanted]
        if len(found) > 1:
            headers = " and ".join(column.header for column in found)
            raise ArgumentError(f"{headers} are both {name}: rename or remove one")
        if found:
            return found[0]
    return None
