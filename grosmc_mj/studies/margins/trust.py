"""Measurement of S with the tests that tell whether it can be trusted."""

from __future__ import annotations

import numpy as np

from grosmc_mj.studies.margins.frequency_response import Margins
from grosmc_mj.studies.margins.multisine import multisine
from grosmc_mj.studies.margins.sensitivity import Place, RunningLoop, Sensitivity, measure

# Longest period that is tried, over the first one.
_LONGEST = 4
# Two amplitudes agree if their margins are within this share of each other.
AGREES = 0.25


def measure_with_tests(
    loop: RunningLoop, place: Place, period: float, rms: float, seed: int = 0
) -> tuple[Sensitivity, str]:
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
    while measured.needs_slower_lines and signal.period < _LONGEST * period:
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
