"""What a run does in its end: how far it swings, how often, and how its input chatters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from grosmc_mj.arrays import Array

# The part of a run that is its end, and the time over which an input's mean is taken [s].
_END = 0.2
_MEAN = 0.02
# Fewer swings than these are no cycle.
_SWINGS = 3


class Oscillation(NamedTuple):
    """Of a signal that swings about its mean.

    Attributes:
        amplitude: Half of the way between its ends, in the signal's unit.
        frequency: Swings a second [Hz]; None for what is no cycle.
    """

    amplitude: float
    frequency: float | None


def oscillation(time: Array, signal: Array) -> Oscillation:
    """How a signal swings in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: (N,).
    """
    tail = signal[-max(2, round(_END * len(signal))) :]
    about = tail - tail.mean()
    amplitude = float(np.ptp(tail) / 2)
    # A crossing of the mean counts once it is left by a tenth of the amplitude.
    side = np.sign(about)[np.abs(about) > 0.1 * amplitude]
    crossings = int(np.count_nonzero(np.diff(side)))
    if amplitude == 0 or crossings < 2 * _SWINGS:
        return Oscillation(amplitude, None)
    return Oscillation(amplitude, crossings / 2 / (len(tail) * float(time[1] - time[0])))


def chatter(time: Array, command: Array) -> float:
    """Root mean square of a command about its mean over 20 ms, in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        command: (N,) or (N, m), of which the largest input counts.
    """
    inputs = command.reshape(len(command), -1)
    inputs = inputs[-max(2, round(_END * len(inputs))) :]
    window = max(2, round(_MEAN / float(time[1] - time[0])))
    fast = inputs - uniform_filter1d(inputs, window, axis=0, mode="nearest")
    return float(np.sqrt(np.mean(fast**2, axis=0)).max())
