"""What a signal that jumps all the time is drawn as: its range and its mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array

# A curve whose steps sum up to so many times its range jumps at every sample.
_JUMPS = 20


def jumps(values: Array) -> bool:
    """Whether a signal (N,) jumps at every sample, so that it must be drawn thin."""
    return len(values) > 1 and bool(np.abs(np.diff(values)).sum() > _JUMPS * np.ptp(values))


class Envelope(NamedTuple):
    """What a signal that jumps does in each of many short times.

    Attributes:
        time: Their middles [s], (n,).
        least: The least value in each, (n,).
        largest: The largest.
        mean: The mean.
    """

    time: Array
    least: Array
    largest: Array
    mean: Array


def envelope(time: Array, values: Array, pieces: int = 300) -> Envelope:
    """Range and mean of a signal (N,) in so many pieces of its time.

    The mean is weighted by Hann's window over two pieces to each side, so that what switches
    leaves no beat of its samples with the pieces.
    """
    count = max(1, min(pieces, len(values) // 2))
    edges = np.linspace(0, len(values), count + 1).astype(int)[:-1]
    sizes = np.diff(np.append(edges, len(values)))
    window = np.hanning(4 * int(sizes.max()) + 3)[1:-1]
    weights = np.convolve(np.ones(len(values)), window)
    mean = np.convolve(values, window) / weights
    middles = edges + sizes // 2 + len(window) // 2
    return Envelope(
        np.add.reduceat(time, edges) / sizes,
        np.minimum.reduceat(values, edges),
        np.maximum.reduceat(values, edges),
        mean[middles],
    )
