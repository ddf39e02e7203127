"""Disk margin of several inputs that change together, from the measured matrix S."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from grosmc_mj.ground.arrays import Array

# Points from the frequency below the worst one to that above it.
_POINTS = 21
# Largest exponent of a scaling: beyond it a matrix counts as triangular.
_LARGEST = 15.0


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
    about = np.linspace(x[max(worst - 1, 0)], x[min(worst + 1, len(x) - 1)], _POINTS)
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
        d = np.exp(np.append(np.clip(exponents, -_LARGEST, _LARGEST), 0.0))
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
