"""Numbers of a run on a rung that are shown and not judged."""

from __future__ import annotations

import numpy as np

from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.ground.arrays import Array

# Share of a run that is its end.
_END = 0.2
# Fewer swings than these are no cycle.
_SWINGS = 3


def shown_numbers(run: RunResult) -> dict[str, float | None]:
    """Return numbers of a run that are shown and not judged; none of one that ended early.

    They are half of the range of the error in the end, ``amplitude``, in its unit; its swings a
    second, ``frequency`` [Hz]; the total ``variation`` of the input a second; and the largest
    distance from the nominal optimum of a law that follows it, ``deviation``.
    """
    if run.ended:
        return {}
    deviation = None
    if run.controller.designed.follows_optimum:
        deviation = run.metrics["deviation"].value

    amplitude, frequency = oscillation(run.comparison.time, run.comparison.error)
    return {
        "amplitude": amplitude,
        "frequency": frequency,
        "variation": run.metrics["total_variation"].value,
        "deviation": deviation,
    }


def oscillation(time: Array, signal: Array) -> tuple[float, float | None]:
    """Return amplitude and frequency of a signal in the end of a run.

    Args:
        time: Equally spaced instants [s], (N,).
        signal: The signal, (N,).

    Returns:
        Half of its range, in its unit, and its swings a second [Hz]; None for no cycle.
    """
    tail = signal[-max(2, round(_END * len(signal))) :]
    about = tail - tail.mean()
    amplitude = float(np.ptp(tail) / 2)

    # A crossing of the mean counts once it is left by a tenth of the amplitude.
    side = np.sign(about)[np.abs(about) > 0.1 * amplitude]
    crossings = int(np.count_nonzero(np.diff(side)))
    if amplitude == 0 or crossings < 2 * _SWINGS:
        return amplitude, None
    duration = len(tail) * float(time[1] - time[0])
    return amplitude, crossings / 2 / duration
