"""Margins of one law in one loop: by its task's requirements, and by its sensitivity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.margins.chatter import Chatter, chatter
from grosmc_mj.margins.frequency_response import Margins
from grosmc_mj.margins.sensitivity import FEWEST, LEAVES, Place, RunningLoop
from grosmc_mj.margins.task import TaskMargin
from grosmc_mj.margins.together import disk_together
from grosmc_mj.margins.trust import measure_with_tests
from grosmc_mj.results.tables import number
from grosmc_mj.studies.cells import Cells, study_key
from grosmc_mj.studies.margins import SHARE, MarginStudy, Setup
from grosmc_mj.studies.studied import StudiedLaw

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
        refused: What breaks without any change, by the condition under which it does.
        task: Margins of the task.
        chatter: Where chatter begins; None of a law that does not switch.
        levels: S at all places and amplitudes.
    """

    model_config = ConfigDict(frozen=True)
    setup: str
    law: str
    impossible: str = ""
    refused: dict[str, str] = {}
    task: list[TaskMargin] = []
    chatter: Chatter | None = None
    levels: list[Level] = []

    @property
    def key(self) -> tuple[str, str]:
        """Key among all rows."""
        return self.setup, self.law

    def worst_of_task(self, kind: str) -> TaskMargin | None:
        """Return the least margin of a kind over the conditions; None of a task not kept."""
        of_kind = [margin for margin in self.task if margin.kind == kind]
        return min(of_kind, key=lambda margin: margin.kept, default=None)

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

    def level_index(self, shared: int | None) -> int | None:
        """Return the index of the amplitude to show; None if none can be trusted.

        Args:
            shared: That of all laws, which counts if this law can be trusted there; else its own
                lowest one does.
        """
        if not self.trusted:
            return None
        return shared if shared in self.trusted else self.trusted[0]


def shared_level(rows: Sequence[LawMargins]) -> int | None:
    """Return the lowest amplitude at which all laws that can be trusted somewhere can be.

    Args:
        rows: Rows of one setup.
    """
    lowest = [row.trusted[0] for row in rows if row.trusted]
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
    return disk_together(np.stack(columns, axis=2))


# -- search and measurement ------------------------------------------------------------------------


def cells_of(studied: MarginStudy, folder: Path) -> Cells[LawMargins]:
    """Return the finished rows of a study in a folder."""
    conditions = [condition for setup in studied.setups for condition in setup.conditions]
    return Cells(folder, LawMargins, study_key(studied.configuration(), conditions))


def law_margins(
    studied: MarginStudy,
    setup: Setup,
    law: StudiedLaw,
    advance: Callable[[str], object] = lambda _: None,
) -> LawMargins:
    """Search the margins of a law's task, and measure S at all places.

    Args:
        studied: The study.
        setup: One of its setups.
        law: One of its laws.
        advance: Told what is measured now.

    Raises:
        SetupError: If the computer, not the law, is at fault.
        ArgumentError: If an injection cannot be sized, or the loop leaves its region under each.
    """
    row = LawMargins(setup=setup.name, law=law.name)
    places = studied.places(setup)
    try:
        running = setup.running(law, setup.loop)
    except SetupError:
        raise
    except GrosmcError as error:
        return row.model_copy(update={"impossible": str(error)})

    refused: dict[str, str] = {}
    margins: list[TaskMargin] = []
    for condition in setup.conditions:
        advance(f"{condition.name}: task")
        task = setup.task(law, condition)
        (breaks,) = task.breaking([task.loop])
        if breaks:
            refused[condition.name] = breaks
        else:
            margins += task.margins()

    period = studied.period or setup.nominal.duration
    begins = None
    if law.controller.designed.switching:
        advance("chatter")
        place, largest = next(iter(places.items()))
        size = largest / SHARE
        begins = chatter(lambda loop: setup.running(law, loop), setup.loop, place, size, period)

    levels: list[Level] = []
    for place, largest in places.items():
        for rms in largest * LEVELS:
            advance(f"S at {place.name}, {number(rms)} rms")
            levels.append(_level(running, place, period, rms))
        if studied.injection and not place.output and LEAVES in levels[-1].doubt:
            raise ArgumentError(
                f"{setup.name}: the loop with {law.name} leaves its region under an injection of "
                f"{number(largest)} {levels[-1].unit} rms: give a smaller --injection"
            )
    update = {"refused": refused, "task": margins, "chatter": begins, "levels": levels}
    return row.model_copy(update=update)


def _level(running: RunningLoop, place: Place, period: float, rms: float) -> Level:
    """S at a place at one amplitude."""
    measured, doubt = measure_with_tests(running, place, period, rms, SEED)
    system = running.plant.system
    signals = system.states if place.output else system.inputs
    counting = np.zeros(len(measured.multisine.lines), bool)
    column = np.zeros((len(counting), len(signals)), np.complex128)
    if measured.usable:
        counting = measured.counting
        column = measured.column
    return Level(
        place=place.name,
        output=place.output,
        rms=rms,
        unit=signals[measured.index].unit,
        margins=measured.margins,
        errors=measured.errors,
        doubt=doubt,
        frequency=measured.multisine.frequencies[counting].tolist(),
        real=column[counting].real.tolist(),
        imaginary=column[counting].imag.tolist(),
        index=measured.index,
    )
