"""Stability margins of a loop from its sensitivity S = 1/(1 + L) at some frequencies.

Between the frequencies ln L is a cubic spline over ln f. Below the lowest one L, or 1/L where L is
large, is a polynomial of j f with real coefficients, since L(-f) is the conjugate of L(f): so L is
real at f = 0. Of several inputs S is a matrix, from which the disk margin of all at once follows.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from grosmc_mj.ground.arrays import Array

# Points between two frequencies: the peak of |S| is then found within 0.1 %.
_POINTS = 40
# Frequency that stands for f = 0, over the lowest one.
_ZERO = 1e-3
# Frequencies by which L is continued down to f = 0, and those by which its error is told.
_LOWEST = 2
_MORE = 3
# The error of an interpolation over its change if every second frequency is left out: at most a
# third if the error falls at least with the square of the distance.
_SHARE = 1 / 3
# Share of a disk margin that is clear at f = 0.
_UNCLEAR = 0.02
# |L| where nothing comes back: less cannot be told from rounding.
_NOTHING = 1e-9
# L is real at f = 0 and at the Nyquist frequency. At the lowest and the highest frequency it counts
# as real if its phase is as near to that of a negative number [rad].
_REAL = 0.35
# Points from the frequency below the worst one to that above it.
_POINTS_ABOUT_WORST = 21
# Largest exponent of a scaling: beyond it a matrix counts as triangular.
_LARGEST_EXPONENT = 15.0


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


def interpolated(frequency: ArrayLike, sensitivity: ArrayLike, lowest: int = _LOWEST) -> LoopGain:
    """Interpolate ln L over ln f, for L is smoother than S, and continue it down to f = 0.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
        lowest: Number of frequencies by which it is continued.
    """
    L = 1 / np.asarray(sensitivity) - 1
    L = np.where(np.abs(L) < _NOTHING, _NOTHING, L)
    x = np.log(frequency)
    steps = np.linspace(0, 1, _POINTS, endpoint=False)
    fine = np.append((x[:-1, None] + np.diff(x)[:, None] * steps).ravel(), x[-1])

    slow = np.exp(x[0]) * np.linspace(_ZERO, 1, _POINTS, endpoint=False)
    below = _continued(np.exp(x), L, lowest, slow)
    phase = np.unwrap(np.concatenate([np.angle(below), np.angle(L)]))
    return LoopGain(
        frequency=np.concatenate([slow, np.exp(fine)]),
        log_gain=np.concatenate(
            [np.log(np.abs(below)), CubicSpline(x, np.log(np.abs(L)))(fine)],
        ),
        phase=np.concatenate([phase[:_POINTS], CubicSpline(x, phase[_POINTS:])(fine)]),
    )


def _continued(
    frequency: Array, L: NDArray[np.complex128], lowest: int, slow: Array
) -> NDArray[np.complex128]:
    """Return L below the lowest frequency, by a polynomial of f through the lowest ones.

    Args:
        frequency: Frequencies at which L is known [Hz], (count,).
        L: L there, (count,).
        lowest: Number of frequencies that the polynomial passes, about multiples of the first.
        slow: Frequencies below the first one [Hz], (points,).
    """
    multiples = frequency[0] * np.arange(1, lowest + 1)
    used = np.unique(np.searchsorted(frequency, multiples * (1 - 1e-9)))
    large = abs(L[0]) >= 1
    known = 1 / L[used] if large else L[used]

    # The real part has the even powers of f, the imaginary part the odd ones.
    powers = np.arange(2 * len(used))
    at_used = (frequency[used, None] / frequency[0]) ** powers
    at_slow = (slow[:, None] / frequency[0]) ** powers
    real = at_slow[:, ::2] @ np.linalg.solve(at_used[:, ::2], known.real)
    imaginary = at_slow[:, 1::2] @ np.linalg.solve(at_used[:, 1::2], known.imag)
    values = real + 1j * imaginary
    values = np.where(np.abs(values) < _NOTHING, _NOTHING, values)
    return np.reciprocal(values) if large else values


def interpolation_errors(frequency: ArrayLike, sensitivity: ArrayLike) -> Margins:
    """Return the errors of margins by interpolation; NaN for a margin that some ways do not give.

    Between the frequencies it is a third of the change if every second one is left out, below
    them the change by a polynomial of higher order.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
    """
    f = np.asarray(frequency)
    S = np.asarray(sensitivity)
    margins = np.array(astuple(margins_of(f, S)))
    continued = np.array(astuple(margins_of(f, S, _MORE)))
    coarse = []
    for first in (_MORE, _MORE + 1):
        kept = np.r_[:_MORE, first : len(f) : 2]
        coarse.append(astuple(margins_of(f[kept], S[kept])))

    # The difference of two infinite margins is NaN.
    with np.errstate(invalid="ignore"):
        between = _SHARE * np.max(np.abs(np.array(coarse) - margins), axis=0)
        below = np.abs(continued - margins)
    return Margins(*(between + below).tolist())


def is_unclear_at_zero(frequency: ArrayLike, sensitivity: ArrayLike) -> bool:
    """Return whether the disk margin depends on frequencies below the lowest one, and is not clear.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
    """
    disk = margins_of(frequency, sensitivity).disk
    continued = margins_of(frequency, sensitivity, _MORE).disk
    return abs(continued - disk) > _UNCLEAR * disk


def margins_of(frequency: ArrayLike, sensitivity: ArrayLike, lowest: int = _LOWEST) -> Margins:
    """Return the margins of a loop.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S, (count,).
        lowest: Number of frequencies by which L is continued down to f = 0.
    """
    loop = interpolated(frequency, sensitivity, lowest)
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


def disk_together(frequency: ArrayLike, sensitivity: ArrayLike) -> float:
    """Return 1/max mu(S - I/2): each input may change within a disk of this size at once.

    About the worst frequency I + L = S^-1, which is smoother than S, is a cubic spline over ln f.

    Args:
        frequency: Frequencies, ascending [Hz], (count,).
        sensitivity: S there, (count, m, m).
    """
    S = np.asarray(sensitivity)
    half = 0.5 * np.eye(S.shape[1])
    norms = [scaled_norm(matrix - half) for matrix in S]
    worst = int(np.argmax(norms))

    x = np.log(frequency)
    about = np.linspace(x[max(worst - 1, 0)], x[min(worst + 1, len(x) - 1)], _POINTS_ABOUT_WORST)
    return_difference = CubicSpline(x, np.linalg.pinv(S))(about)
    norms += [scaled_norm(matrix - half) for matrix in np.linalg.pinv(return_difference)]
    return 1 / max(norms)


def scaled_norm(matrix: NDArray[np.complex128]) -> float:
    """Least norm of D M D^-1 over diagonal D > 0, a bound of mu from above; exact up to m = 3.

    Args:
        matrix: M, (m, m).
    """
    m = len(matrix)
    if m == 1:
        return float(np.abs(matrix[0, 0]))

    def norm(exponents: Array) -> float:
        d = np.exp(np.append(np.clip(exponents, -_LARGEST_EXPONENT, _LARGEST_EXPONENT), 0.0))
        return float(np.linalg.norm(matrix * d[:, None] / d, 2))

    # It is convex in the exponents; the start is the best for the magnitudes (Osborne, Perron).
    start = _perron(np.abs(matrix))
    options = {"xatol": 1e-6, "fatol": 1e-9, "maxiter": 400 * m}
    found = minimize(norm, start, method="Nelder-Mead", options=options)
    return float(min(found.fun, norm(np.zeros(m - 1))))


def _perron(magnitudes: Array) -> Array:
    """Exponents of the scaling by Perron's vectors, the last one zero, (m - 1,)."""
    positive = magnitudes + 1e-9 * magnitudes.max()
    right = _eigenvector(positive)
    left = _eigenvector(positive.T)
    exponents = 0.5 * np.log(left / right)
    return exponents[:-1] - exponents[-1]


def _eigenvector(positive: Array) -> Array:
    """Perron's vector of a positive matrix, (m,)."""
    values, vectors = np.linalg.eig(positive)
    return np.abs(vectors[:, np.argmax(np.real(values))])
