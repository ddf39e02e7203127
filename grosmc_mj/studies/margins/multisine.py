"""Multisines of random phases, which are injected into a loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, value_text

# Control periods in a period of a multisine, at least.
_FEWEST = 16


@dataclass(frozen=True, eq=False)
class Multisine:
    """A sum of sines with equal amplitudes, sampled at the control period.

    Attributes:
        samples: Control periods in its period, N; even.
        control_period: T [s].
        lines: Excited harmonics of 1/(N T), ascending, (lines,).
    """

    samples: int
    control_period: float
    lines: NDArray[np.intp]

    @property
    def period(self) -> float:
        """N T [s]."""
        return self.samples * self.control_period

    @property
    def frequencies(self) -> Array:
        """Frequencies of the lines [Hz], (lines,)."""
        return self.lines / self.period

    def values(self, rms: float, random: np.random.Generator) -> Array:
        """One period with phases drawn at random and this rms, (N,)."""
        phases = 2 * np.pi * random.random(len(self.lines))
        spectrum = np.zeros(self.samples // 2 + 1, complex)
        spectrum[self.lines] = np.exp(1j * phases)
        signal = np.fft.irfft(spectrum, self.samples)
        return signal * (rms / np.sqrt(np.mean(signal**2)))


def multisine(period: float, control_period: float, per_decade: int = 10) -> Multisine:
    """Return the multisine with about so many lines a decade, all low harmonics among them.

    Args:
        period: Its period [s]; rounded to an even number of control periods.
        control_period: T [s]; the lines reach up to 1/(2 T).
        per_decade: Lines a decade.

    Raises:
        ArgumentError: If the period has fewer than 16 control periods.
    """
    samples = 2 * round(period / control_period / 2)
    if samples < _FEWEST:
        raise ArgumentError(
            f"period of the injection {value_text(period)} s: at least {_FEWEST} control periods "
            f"of {control_period:g} s"
        )

    highest = samples // 2 - 1
    count = int(np.ceil(np.log10(highest) * per_decade)) + 1
    lines = np.unique(np.round(np.geomspace(1, highest, count)).astype(int))
    return Multisine(samples, control_period, lines)
