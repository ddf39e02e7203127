"""A log of a machine: time, inputs and measured states."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError

# A step of the time this many times the median is a gap.
GAP = 3.0
# Fewer samples between two gaps have no curvature, and are left out.
SHORTEST_PIECE = 3
# Multiples of an encoder's step are whole within this: its values are rounded, too.
_WHOLE = 0.1


def name_of_log(path: Path) -> str:
    """Return the name of a log's file without its ending, ``servo`` of ``servo.csv.gz``."""
    if path.suffix.lower() == ".gz":
        path = path.with_suffix("")
    return path.stem


@dataclass(frozen=True, eq=False)
class Log:
    """A log of a machine.

    Attributes:
        name: Of its file.
        time: Instants of the samples [s], rising from 0, (N,).
        inputs: Held from their instants on, in the plant's units, (N, m); NaN where unknown.
        states: The measured states by name, in the plant's units, (N,) each; NaN where unknown.
        pieces: The samples that are used, from gap to gap.
        notes: What may be wrong with it, in lines.
    """

    name: str
    time: Array
    inputs: Array
    states: Mapping[str, Array]
    pieces: Sequence[slice]
    notes: Sequence[str] = ()

    @property
    def sampling(self) -> float:
        """Median time between two samples [s]."""
        return float(np.median(np.diff(self.time)))

    def noise(self, state: str) -> float:
        """Standard deviation of white noise on a smooth state, from its third differences."""
        pieces = [np.diff(self.states[state][piece], 3) for piece in self.pieces]
        return float(np.std(np.concatenate(pieces)) / math.sqrt(20.0))

    def resolution(self, state: str) -> float:
        """The step of its encoder; 0 for none."""
        values = self.states[state]
        steps = np.diff(np.unique(values))
        if not len(steps):
            return 0.0

        # An encoder repeats its values; of other sensors nearly every value is new.
        least = float(steps.min())
        if len(steps) < len(values) // 3:
            return least
        # On a long way it repeats few, but all steps are whole multiples of one above the noise.
        multiples = steps / least
        rounded = np.rint(multiples)
        if least > self.noise(state) and np.abs(multiples - rounded).max() < _WHOLE:
            return float(np.median(steps / rounded))
        return 0.0

    def deviation(self, state: str) -> float:
        """Standard deviation of a sensor's noise, at least that of its rounding."""
        rounding = float(self.resolution(state) / np.sqrt(12.0))
        return max(self.noise(state), rounding, 1e-9 * self.span(state), 1e-12)

    def span(self, state: str) -> float:
        """Largest less smallest value of a state."""
        used = [self.states[state][piece] for piece in self.pieces]
        return float(np.ptp(np.concatenate(used)))

    def between(self, start: float, stop: float) -> Log:
        """The part of it from one share of the time that is used to another, such as 0.7 to 1."""
        begin = self.time[self.pieces[0].start]
        duration = self.time[self.pieces[-1].stop - 1] - begin
        first = 0
        if start != 0:
            first = int(np.searchsorted(self.time, begin + start * duration, side="right"))
        last = int(np.searchsorted(self.time, begin + stop * duration, side="right"))

        parts = [slice(max(p.start, first), min(p.stop, last)) for p in self.pieces]
        pieces = [part for part in parts if part.stop - part.start >= SHORTEST_PIECE]
        return replace(self, pieces=pieces)


def join_logs(logs: Sequence[Log]) -> Log:
    """Several logs of one machine as one: a window never reaches from one into the next.

    Raises:
        ArgumentError: If they do not measure the same states.
    """
    log = logs[0]
    for following in logs[1:]:
        if log.states.keys() != following.states.keys():
            raise ArgumentError(
                f"{log.name} measures {', '.join(log.states)}, {following.name} "
                f"{', '.join(following.states)}: several logs must measure the same states"
            )
        log = _followed(log, following)
    return log


def _followed(log: Log, following: Log) -> Log:
    """Two logs as one, a gap between them.

    A sample in the gap, of no piece, holds the first input of the second log: before that log
    began its input was there.
    """
    gap = log.time[-1] + GAP * log.sampling
    shift = gap + GAP * following.sampling
    outputs = {}
    for name, values in following.states.items():
        outputs[name] = np.concatenate([log.states[name], values[:1], values])

    begin = len(log.time) + 1
    pieces = [slice(begin + piece.start, begin + piece.stop) for piece in following.pieces]
    return Log(
        name=f"{log.name} and {following.name}",
        time=np.concatenate([log.time, [gap], following.time + shift]),
        inputs=np.vstack([log.inputs, following.inputs[:1], following.inputs]),
        states=outputs,
        pieces=[*log.pieces, *pieces],
        notes=[*log.notes, *following.notes],
    )


def held(
    time: Array,
    values: Array,
    delay: float,
    grid: Array,
) -> Array:
    """The mean over each interval of a grid of inputs that are held, later by a delay.

    Args:
        time: Instants from which they are held [s], (N,).
        values: (N, m).
        delay: [s]; the result depends on it without jumps.
        grid: Ends of the intervals [s], (K + 1,).

    Returns:
        (K, m).
    """
    # Integrals from the first instant to the ends of the held values.
    widths = np.diff(time, append=time[-1] + (time[-1] - time[-2]))
    ends = np.append(time, time[-1] + widths[-1])
    areas = np.cumsum(values * widths[:, None], axis=0)
    sums = np.vstack([np.zeros(values.shape[1]), areas])

    late = grid - delay
    integral = np.column_stack([np.interp(late, ends, column, left=math.nan) for column in sums.T])

    # Before the first instant the first value is held.
    before = np.isnan(integral[:, :1])
    first_held = values[0] * (late - time[0])[:, None]
    integral = np.where(before, first_held, integral)
    return np.diff(integral, axis=0) / np.diff(grid)[:, None]
