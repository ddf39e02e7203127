"""Sensitivity of a running loop, measured by injection of multisines, and whether to trust it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import counted
from grosmc_mj.simulation.disturbances import InputDisturbance, OutputDisturbance, Table
from grosmc_mj.simulation.loop import AppliedLoop
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory
from grosmc_mj.studies.margins.frequency_response import (
    UNKNOWN,
    Margins,
    interpolation_errors,
    is_unclear_at_zero,
    margins_of,
)
from grosmc_mj.studies.margins.multisine import Multisine, multisine
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import Plant

# Periods of a run that pass before it counts, and that count: a window of Hann over two of them
# suppresses what is not periodic.
SETTLING = 1
COUNTED = 2
REALIZATIONS = 6
# Runs at a time: the records of all of them are in memory.
_BATCH = 3
# Largest standard deviation of one realization over |S|: of a line that counts, and of the median
# line near crossover.
_LARGEST = 0.5
LARGEST_NEAR = 0.25
# Words of a doubt about a loop of which a run ended early.
LEAVES = "leave the region of the loop"
# |S - 1| without feedback.
_NOTHING = 1e-9
# Lines are near crossover up to this factor from it.
_NEAR = 3.0
# Periods of the crossover frequency in a period of the multisine, and lines, at least.
_PERIODS = 6
FEWEST = 8
# Longest period that is tried, over the first one.
_LONGEST_PERIOD = 4
# Two amplitudes agree if their margins are within this share of each other.
AGREES = 0.25


@dataclass(frozen=True, eq=False)
class RunningLoop:
    """A loop at rest, or following its reference, into which signals are injected.

    Attributes:
        plant: The plant.
        controller: The law.
        x0: Start, where the reference is kept, (n,).
        control_period: [s].
        timestep: [s].
        loops: Loop of each realization, which differ in what they draw at random; one that is
            None for an ideal loop.
        moving: Whether the reference moves: a run without injection is subtracted.
        engine: Engine of the runs.
        threads: Threads of the runs; 0 for all cores.
    """

    plant: Plant
    controller: Controller
    x0: Array
    control_period: float
    timestep: float
    loops: Sequence[AppliedLoop | None] = (None,)
    moving: bool = False
    engine: Engine = "native"
    threads: int = 0

    def run(
        self,
        place: LoopPlace,
        tables: Sequence[Table],
        first: int,
        duration: float,
    ) -> Trajectory:
        """Run a batch, with one injection in each run.

        Args:
            place: Place of the injections.
            tables: What is injected.
            first: Number of the first realization.
            duration: [s].
        """
        numbers = [(first + i) % len(self.loops) for i in range(len(tables))]
        return simulate(
            [self.plant] * len(tables),
            [self.controller] * len(tables),
            self.x0,
            duration=duration,
            loop=[self.loops[number] for number in numbers],
            control_period=self.control_period,
            timestep=self.timestep,
            disturbances=[[place.disturbance(table)] for table in tables],
            engine=self.engine,
            threads=self.threads,
        )

    def sampled(self, applied: Array) -> Array:
        """Mean of inputs over each control period, (runs, periods, m)."""
        stride = round(self.control_period / self.timestep)
        periods = applied.shape[1] // stride
        steps = applied[:, : periods * stride]
        return steps.reshape(len(applied), periods, stride, -1).mean(axis=2)


class LoopPlace(NamedTuple):
    """Place of an injection.

    Attributes:
        name: Name of the input or of the state that is measured.
        output: Whether it is a measured output; else an input of the plant.
    """

    name: str
    output: bool = False

    def disturbance(self, profile: Table) -> InputDisturbance | OutputDisturbance:
        """Return the injection of a table of values."""
        if self.output:
            return OutputDisturbance(self.name, 1.0, profile)
        return InputDisturbance(self.name, 1.0, profile)


@dataclass(frozen=True, eq=False)
class LoopSensitivity:
    """S at a place of a loop: the response there to what is injected, and at the other places.

    Attributes:
        multisine: The injected signal.
        rms: Its size, in the unit of the place.
        realizations: S of each realization at all inputs, or all measured states,
            (realizations, lines, signals).
        index: Index of the place among the signals.
        ended: Number of realizations that ended early.
    """

    multisine: Multisine
    rms: float
    realizations: NDArray[np.complex128]
    index: int
    ended: int = 0

    @property
    def column(self) -> NDArray[np.complex128]:
        """Mean response at all signals, (lines, signals): a column of the matrix S."""
        return self.realizations.mean(axis=0)

    @property
    def at_place(self) -> NDArray[np.complex128]:
        """S of each realization at the place itself, (realizations, lines)."""
        return self.realizations[:, :, self.index]

    @property
    def deviation(self) -> Array:
        """Standard deviation of one realization over |S|, (lines,): noise and distortion."""
        if len(self.at_place) < 2:
            return np.zeros(self.at_place.shape[1])
        return np.std(self.at_place, axis=0, ddof=1) / np.abs(self.at_place.mean(axis=0))

    @property
    def counting(self) -> NDArray[np.bool_]:
        """Whether a line counts, (lines,)."""
        return self.deviation <= _LARGEST

    @property
    def usable(self) -> bool:
        """Whether all runs reached their end, and enough lines count."""
        return not self.ended and int(np.count_nonzero(self.counting)) >= FEWEST

    @property
    def margins(self) -> Margins:
        """Margins by the mean of the realizations; NaN if it is not usable."""
        return self._margins(self.at_place)

    @property
    def errors(self) -> Margins:
        """Errors of the margins: the standard error and that of the interpolation, in sum."""
        pairs = zip(astuple(self.standard_errors), astuple(self.interpolation_errors), strict=True)
        return Margins(*[sum(pair) for pair in pairs])

    @property
    def standard_errors(self) -> Margins:
        """Standard errors of the margins, by the jackknife over the realizations."""
        count = len(self.at_place)
        if count < 2:
            return UNKNOWN
        without_one = []
        for i in range(count):
            margins = self._margins(np.delete(self.at_place, i, axis=0))
            without_one.append(astuple(margins))
        with np.errstate(invalid="ignore"):
            spread = np.var(without_one, axis=0)
        return Margins(*np.sqrt((count - 1) * spread).tolist())

    @property
    def interpolation_errors(self) -> Margins:
        """Errors of the margins between the lines and below them; NaN if it is not usable."""
        if not self.usable:
            return UNKNOWN
        return interpolation_errors(*self._mean_that_counts)

    @property
    def _mean_that_counts(self) -> tuple[Array, NDArray[np.complex128]]:
        """Frequencies of the lines that count [Hz], and S there."""
        counting = self.counting
        return self.multisine.frequencies[counting], self.at_place.mean(axis=0)[counting]

    def _margins(self, realizations: NDArray[np.complex128]) -> Margins:
        if not self.usable:
            return UNKNOWN
        counting = self.counting
        frequency = self.multisine.frequencies[counting]
        return margins_of(frequency, realizations.mean(axis=0)[counting])

    @property
    def too_short(self) -> bool:
        """Whether the period has too few periods of the crossover frequency."""
        return self.margins.crossover * self.multisine.period < _PERIODS

    @property
    def needs_slower_lines(self) -> bool:
        """Whether the lowest line is too far from f = 0, or from the crossover frequency."""
        if not self.usable:
            return False
        return self.too_short or is_unclear_at_zero(*self._mean_that_counts)

    @property
    def doubt(self) -> str:
        """Reason why the margins cannot be trusted; empty if they can."""
        if self.ended:
            runs = counted(self.ended + len(self.at_place), "run")
            return f"{self.ended} of {runs} {LEAVES}"
        if np.all(np.abs(self.at_place - 1) < _NOTHING):
            return "the law does not use it"
        if not self.usable:
            return "the response differs from run to run at nearly all frequencies"
        if self.too_short:
            return f"the injection has less than {_PERIODS} periods of the crossover frequency"

        crossover = self.margins.crossover
        if np.isnan(crossover) and not np.all(self.counting):
            return "the runs differ too much at the crossover frequency"
        near = np.abs(np.log(self.multisine.frequencies / crossover)) < np.log(_NEAR)
        if not np.any(near):
            near = self.counting
        spread = float(np.median(self.deviation[near]))
        if spread > LARGEST_NEAR:
            return f"runs differ by {spread:.0%} near the crossover frequency"
        return ""


def measure(
    loop: RunningLoop,
    place: LoopPlace,
    signal: Multisine,
    rms: float,
    *,
    realizations: int = REALIZATIONS,
    seed: int = 0,
) -> LoopSensitivity:
    """Measure S at a place of a running loop.

    What is injected is held over the control period, and the response is its mean over it; that of
    a measured state is what is measured at the samples.

    Args:
        loop: The loop.
        place: The place.
        signal: The multisine.
        rms: Its size, in the unit of the place.
        realizations: Number of runs, each with phases of its own.
        seed: Seed of the phases.

    Raises:
        ArgumentError: If the loop has no such place.
    """
    random = np.random.default_rng(seed)
    injected = [signal.values(rms, random) for _ in range(realizations)]
    if loop.moving:
        injected.append(np.zeros(signal.samples))

    duration = (SETTLING + COUNTED) * signal.period
    responses: list[Array] = []
    status: list[Status] = []
    for first in range(0, len(injected), _BATCH):
        batch = injected[first : first + _BATCH]
        tables = [Table(tuple(w), signal.control_period, periodic=True) for w in batch]
        run = loop.run(place, tables, first, duration)
        responses += list(_response(loop, place, run))
        status += list(run.status)

    baseline = np.zeros_like(responses[0])
    if loop.moving:
        baseline = responses[realizations]
    measured = [
        _at_lines(signal, injected[i], responses[i] - baseline)
        for i in range(realizations)
        if status[i] is Status.COMPLETED
    ]
    shape = (len(measured), len(signal.lines), responses[0].shape[1])
    signals = loop.plant.system.states if place.output else loop.plant.system.inputs
    index = [signal.name for signal in signals].index(place.name)
    return LoopSensitivity(
        signal, rms, np.reshape(measured, shape), index, realizations - len(measured)
    )


def _response(loop: RunningLoop, place: LoopPlace, run: Trajectory) -> Array:
    """Response of each run in each control period, (runs, periods, signals)."""
    if place.output:
        assert run.output_disturbance is not None
        stride = round(loop.control_period / loop.timestep)
        return (run.state[:, :-1] + run.output_disturbance)[:, ::stride]
    assert run.input_disturbance is not None
    return loop.sampled(run.input + run.input_disturbance)


def _at_lines(signal: Multisine, injected: Array, response: Array) -> NDArray[np.complex128]:
    """Response over injection at the lines, (lines, signals)."""
    counted = response[SETTLING * signal.samples :]
    window = 1 - np.cos(2 * np.pi * np.arange(len(counted)) / len(counted))
    spectrum = np.fft.rfft(counted * window[:, None], axis=0)[signal.lines * COUNTED] / COUNTED
    return spectrum / np.fft.rfft(injected)[signal.lines, None]


def measure_with_tests(
    loop: RunningLoop, place: LoopPlace, period: float, rms: float, seed: int = 0
) -> tuple[LoopSensitivity, str]:
    """Measure S, for a longer period if the loop is slow, and again with half the amplitude.

    Args:
        loop: The loop.
        place: Place of the injection.
        period: Period of the multisine [s].
        rms: Size of the injection, in the unit of the place.
        seed: Seed of the phases.

    Returns:
        The measurement, and the reason why its margins cannot be trusted; empty if they can.

    Raises:
        ArgumentError: If the loop has no such place, or the period is too short for lines.
    """
    signal = multisine(period, loop.control_period)
    measured = measure(loop, place, signal, rms, seed=seed)
    while measured.needs_slower_lines and signal.period < _LONGEST_PERIOD * period:
        signal = multisine(2 * signal.period, loop.control_period)
        measured = measure(loop, place, signal, rms, seed=seed)

    doubt = measured.doubt
    if not doubt:
        half = measure(loop, place, signal, rms / 2, seed=seed)
        doubt = _disagreement(measured.margins, half.margins)
    return measured, doubt


def _disagreement(margins: Margins, half: Margins) -> str:
    """Difference of the margins at half the amplitude, in words; empty if they agree."""
    whole = margins.delay
    other = half.delay
    if np.isinf(whole) or np.isinf(other):
        whole = margins.disk
        other = half.disk
    if abs(other - whole) <= AGREES * whole:
        return ""
    return f"half the amplitude gives {other / whole:.2g} times the margin"
