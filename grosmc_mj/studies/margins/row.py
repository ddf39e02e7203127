"""Margins of one law in one loop as a row: by its task's requirements, and by its sensitivity."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from grosmc_mj.output.results.verdicts import Verdict
from grosmc_mj.studies.margins.chatter import Chatter
from grosmc_mj.studies.margins.frequency_response import Margins, disk_together
from grosmc_mj.studies.margins.sensitivity import AGREES, FEWEST
from grosmc_mj.studies.margins.task import AS_IS

# Sizes of the injections, over the largest: half decades.
LEVELS = 10 ** np.linspace(-2, 0, 5)
# Seed of the injected phases.
SEED = 0


class Level(BaseModel):
    """S at a place at one amplitude.

    Attributes:
        place: Name of the input or of the measured state.
        output: Whether it is a measured state.
        rms: Size of the injection.
        unit: Its unit.
        margins: Margins of the loop.
        errors: Their standard errors.
        doubt: Reason why they cannot be trusted; empty if they can.
        frequency: Frequencies of the lines that count [Hz], (lines,).
        real: Real part of S at all inputs, or all states, (lines, signals).
        imaginary: Imaginary part.
        index: Index of the place among the signals.
    """

    model_config = ConfigDict(frozen=True)
    place: str
    output: bool
    rms: float
    unit: str
    margins: Margins
    errors: Margins
    doubt: str
    frequency: list[float]
    real: list[list[float]]
    imaginary: list[list[float]]
    index: int

    @property
    def column(self) -> NDArray[np.complex128]:
        """S at all signals, (lines, signals)."""
        return np.array(self.real) + 1j * np.array(self.imaginary)


class LawMargins(BaseModel):
    """Margins of a law in a setup.

    Attributes:
        setup: Name of the setup.
        law: Name of the law.
        impossible: Why there can be no such run; empty if there can.
        task: Verdicts on the task under each condition, see ``task_margins``.
        chatter: Where chatter begins; None of a law that does not switch.
        levels: S at all places and amplitudes.
    """

    model_config = ConfigDict(frozen=True)
    setup: str
    law: str
    impossible: str = ""
    task: list[Verdict] = []
    chatter: Chatter | None = None
    levels: list[Level] = []

    @property
    def changes(self) -> list[Verdict]:
        """The largest changes that are kept."""
        return [row for row in self.task if row.step != AS_IS]

    @property
    def refused(self) -> list[Verdict]:
        """The verdicts on a task that is not kept without any change."""
        return [row for row in self.task if row.step == AS_IS]

    def worst_of_task(self, kind: str) -> Verdict | None:
        """Return the least margin of a kind over the conditions; None of a task not kept."""
        of_kind = [row for row in self.task if row.step == kind]
        return min(of_kind, key=lambda row: row.largest_kept or 0.0, default=None)

    @property
    def of_inputs(self) -> list[Level]:
        """S at the inputs, from the smallest amplitude to the largest at each of them."""
        return [level for level in self.levels if not level.output]

    def at(self, index: int) -> list[Level]:
        """S at each input at the amplitude of this index."""
        return self.of_inputs[index :: len(LEVELS)]

    @property
    def trusted(self) -> list[int]:
        """Indices of the amplitudes that can be trusted at all inputs."""
        indices = range(len(LEVELS)) if self.levels else ()
        return [i for i in indices if not any(level.doubt for level in self.at(i))]

    @property
    def switches(self) -> bool:
        """Whether the law switches, so that its S depends on the amplitude."""
        return self.chatter is not None

    def level_index(self, shared: int | None) -> int | None:
        """Return the index of the amplitude to show; None if none can be trusted.

        Args:
            shared: That of all laws that switch, which counts if this law switches and can be
                trusted there; else its own lowest one does.
        """
        if not self.trusted:
            return None
        if self.switches and shared in self.trusted:
            return shared
        return self.trusted[0]

    def disagreeing(self, margin: str) -> tuple[Level, Level] | None:
        """Return the trusted levels with the least and the largest margin if they disagree.

        They do if the margins differ by more than a quarter and more than their errors.

        Args:
            margin: Name of a field of ``Margins``; infinite ones are left out.
        """
        levels = [
            min(self.at(index), key=lambda level: level.margins.disk) for index in self.trusted
        ]
        finite = [level for level in levels if np.isfinite(getattr(level.margins, margin))]
        if not finite:
            return None

        least = min(finite, key=lambda level: getattr(level.margins, margin))
        largest = max(finite, key=lambda level: getattr(level.margins, margin))
        low = getattr(least.margins, margin)
        difference = getattr(largest.margins, margin) - low
        errors = getattr(least.errors, margin) + getattr(largest.errors, margin)
        if difference <= AGREES * low or difference <= errors:
            return None
        return least, largest


def shared_level(rows: Sequence[LawMargins]) -> int | None:
    """Return the lowest amplitude at which all laws that switch can be trusted, if anywhere.

    Args:
        rows: Rows of one setup.
    """
    lowest = [row.trusted[0] for row in rows if row.switches and row.trusted]
    return max(lowest, default=None)


def together(levels: Sequence[Level]) -> float | None:
    """Return the disk margin of all inputs at once; None if they have too few lines in common.

    Args:
        levels: S at each input, at one amplitude.
    """
    common = set(levels[0].frequency)
    for level in levels:
        common &= set(level.frequency)
    if len(common) < FEWEST:
        return None

    columns = []
    for level in levels:
        shared = [frequency in common for frequency in level.frequency]
        columns.append(level.column[shared])
    return disk_together(sorted(common), np.stack(columns, axis=2))
