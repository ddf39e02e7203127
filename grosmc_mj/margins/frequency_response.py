"""Stability margins of a loop from its sensitivity S = 1/(1 + L) at some frequencies."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from grosmc_mj.arrays import Array

# Points between two frequencies: the peak of |S| is then found within 0.1 %.
_POINTS = 40
# |L| where nothing comes back: less cannot be told from rounding.
_NOTHING = 1e-9
# L is real at f = 0 and at the Nyquist frequency. At the first and the last frequency it counts as
# real if its phase is as near to that of a negative number [rad].
_REAL = 0.35


@dataclass(frozen=True)
class Margins:
    """Margins of a loop; NaN for a frequency that does not exist.

    Attributes:
        gain_down: Factor down to which the loop's gain may fall; 0 for any.
        gain_up: Factor up to which it may grow; infinite for any.
        phase: Lag or lead that the loop may get [deg].
        delay: Further delay [s].
        modulus: Least distance of L from -1, 1/max|S|.
        disk: 1/max|S - 1/2|: gain and phase may change together within a disk of this size.
        crossover: Frequency at which |L| = 1 with the least phase margin [Hz].
        bandwidth: Least frequency at which |S| passes -3 dB [Hz].
    """

    gain_down: float
    gain_up: float
    phase: float
    delay: float
    modulus: float
    disk: float
    crossover: float
    bandwidth: float


# Margins of a loop of which nothing is known.
UNKNOWN = Margins(*[np.nan] * len(fields(Margins)))


class LoopGain(NamedTuple):
    """L between the frequencies at which S is known, all (points,).

    Attributes:
        frequency: [Hz].
        log_gain: ln |L|.
        phase: Phase of L, continuous [rad].
    """

    frequency: Array
    log_gain: Array
    phase: Array

    @property
    def L(self) -> NDArray[np.complex128]:
        """L itself."""
        return np.exp(self.log_gain + 1j * self.phase)

    def at(self, index: NDArray[np.intp], share: Array) -> LoopGain:
        """L between each of these points and the next one, at a share of the way."""
        columns = np.array([np.log(self.frequency), self.log_gain, self.phase])
        before = columns[:, index]
        log_frequency, log_gain, phase = before + share * (columns[:, index + 1] - before)
        return LoopGain(np.exp(log_frequency), log_gain, phase)


def interpolated(frequency: ArrayLike, sensitivity: ArrayLike) -> LoopGain:
    """Interpolate ln L over ln f: L is smoother than S.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
    """
    L = 1 / np.asarray(sensitivity) - 1
    x = np.log(frequency)
    steps = np.linspace(0, 1, _POINTS, endpoint=False)
    fine = np.append((x[:-1, None] + np.diff(x)[:, None] * steps).ravel(), x[-1])
    log_gain = PchipInterpolator(x, np.log(np.maximum(np.abs(L), _NOTHING)))(fine)
    phase = PchipInterpolator(x, np.unwrap(np.angle(L)))(fine)
    return LoopGain(np.exp(fine), log_gain, phase)


def margins_of(frequency: ArrayLike, sensitivity: ArrayLike) -> Margins:
    """Return the margins of a loop.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
    """
    loop = interpolated(frequency, sensitivity)
    S = 1 / (1 + loop.L)
    factors = _critical_gains(loop)
    above = factors[factors > 1]
    below = factors[factors <= 1]

    crossing = _where_zero(loop, loop.log_gain)
    # Lag [rad] after which L is -1.
    lag = np.mod(crossing.phase + np.pi, 2 * np.pi)
    distance = np.minimum(lag, 2 * np.pi - lag)
    delay = lag / (2 * np.pi * crossing.frequency)
    crossover = np.nan
    if len(distance):
        crossover = crossing.frequency[np.argmin(distance)]

    # -3 dB is a power of one half.
    passed = _where_zero(loop, np.log(np.abs(S)) + np.log(2) / 2)
    return Margins(
        gain_down=float(max(below, default=0.0)),
        gain_up=float(min(above, default=np.inf)),
        phase=float(np.degrees(min(distance, default=np.inf))),
        delay=float(min(delay, default=np.inf)),
        modulus=float(1 / np.max(np.abs(S))),
        disk=float(1 / np.max(np.abs(S - 0.5))),
        crossover=float(crossover),
        bandwidth=float(min(passed.frequency, default=np.nan)),
    )


def _where_zero(loop: LoopGain, values: Array) -> LoopGain:
    """L where values, one for each point, pass zero."""
    index = np.flatnonzero(values[:-1] * values[1:] < 0)
    share = values[index] / (values[index] - values[index + 1])
    return loop.at(index, share)


def _critical_gains(loop: LoopGain) -> Array:
    """Factors by which the gain changes until L passes -1."""
    real = _where_zero(loop, np.sin(loop.phase))
    log_gains = real.log_gain[np.cos(real.phase) < 0]
    ends = loop.log_gain[[0, -1]][np.cos(loop.phase[[0, -1]]) < -np.cos(_REAL)]
    return np.exp(-np.concatenate([log_gains, ends]))
