"""Range and mean of a signal that jumps at every sample; charts draw them in its place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array

# A signal jumps if the sum of its steps is more than so many times its range.
_STEPS_OVER_RANGE = 20


def jumps(values: Array) -> bool:
    """Return True if a signal (N,) jumps at every sample, so that it must be drawn thin."""
    if len(values) < 2:
        return False
    steps = np.abs(np.diff(values)).sum()
    return bool(steps > _STEPS_OVER_RANGE * np.ptp(values))


class Envelope(NamedTuple):
    """Range and mean of a signal in each of n short intervals.

    Attributes:
        time: Middles of the intervals [s], (n,).
        least: Least values, (n,).
        largest: Largest values, (n,).
        mean: Means, (n,).
    """

    time: Array
    least: Array
    largest: Array
    mean: Array


def envelope(time: Array, values: Array, pieces: int = 300) -> Envelope:
    """Return range and mean of a signal in intervals of its time.

    The mean is weighted by Hann's window over two intervals to each side, so that a switching
    signal shows no beat of its samples with the intervals.

    Args:
        time: Instants [s], (N,).
        values: The signal, (N,).
        pieces: Largest number of intervals; each has two samples or more.
    """
    count = max(1, min(pieces, len(values) // 2))
    edges = np.linspace(0, len(values), count + 1).astype(int)[:-1]
    sizes = np.diff(np.append(edges, len(values)))

    window = np.hanning(4 * int(sizes.max()) + 3)[1:-1]
    weights = np.convolve(np.ones(len(values)), window)
    mean = np.convolve(values, window) / weights
    middles = edges + sizes // 2 + len(window) // 2

    return Envelope(
        time=np.add.reduceat(time, edges) / sizes,
        least=np.minimum.reduceat(values, edges),
        largest=np.maximum.reduceat(values, edges),
        mean=mean[middles],
    )
