"""Sums over small arrays in a fixed order, the same in Python and in compiled code.

A matrix has two axes, but for E: its entries row by row, as generated functions return them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grosmc_mj.jitable import jitable

# A reciprocal condition number below this is rounding.
_SINGULAR = 1e-12


@jitable
def norm(z: Any) -> float:
    """The Euclidean norm of a vector."""
    total = 0.0
    for value in z:
        total += value * value
    return math.sqrt(total)


@jitable
def row_times(i: int, K: Any, z: Any) -> float:
    """Entry i of K z."""
    total = 0.0
    for j in range(len(z)):
        total += K[i, j] * z[j]
    return total


@jitable
def quadratic(z: Any, W: Any) -> float:
    """z'W z."""
    total = 0.0
    for i in range(len(z)):
        for j in range(len(z)):
            total += z[i] * W[i, j] * z[j]
    return total


@jitable
def norm_of_product(G: Any, E: Any) -> float:
    """The Frobenius norm of G E, both (m, m)."""
    m, total = len(G), 0.0
    for i in range(m):
        for j in range(m):
            entry = 0.0
            for k in range(m):
                entry += G[i, k] * E[k * m + j]
            total += entry * entry
    return math.sqrt(total)


@jitable
def solve(E: Any, b: Any) -> None:
    """Replace b (m,) by E^-1 b: Cramer's rule for two unknowns, elimination for more.

    A singular E gives infinities or NaN; Python raises ZeroDivisionError for one or two unknowns.
    """
    m = len(b)
    if m == 1:
        b[0] = b[0] / E[0]
    elif m == 2:
        # Places that depend on m: a tuple of one entry has no constant place 3.
        first, second, determinant = b[0], b[1], E[0] * E[m + 1] - E[m - 1] * E[m]
        b[0] = (first * E[m + 1] - second * E[m - 1]) / determinant
        b[1] = (second * E[0] - first * E[m]) / determinant
    else:
        rows = np.empty((m, m + 1))
        for i in range(m):
            for j in range(m):
                rows[i, j] = E[i * m + j]
            rows[i, m] = b[i]
        _eliminate(rows)
        for i in range(m):
            b[i] = rows[i, m] / rows[i, i]


@jitable
def regular(E: Any, m: int) -> bool:
    """Whether E (m, m) is finite and nonsingular beyond rounding, whatever its units.

    The relative gains E_ij (E^-1)_ji have magnitudes of less than 1e12 m in sum. No scaling of
    rows or columns changes them: E. H. Bristol, IEEE Trans. Automatic Control 11, 1966. Their sum
    is about the condition number of E under the scaling that makes it least: C. N. Nett and V.
    Manousiouthakis, the same journal 32, 1987.
    """
    if m == 1:
        return 0.0 < abs(E[0]) < math.inf
    if m == 2:
        along, across = E[0] * E[m + 1], E[m - 1] * E[m]
        return abs(along - across) > _SINGULAR * (abs(along) + abs(across))
    rows = np.zeros((m, 2 * m))
    for i in range(m):
        size = 0.0
        for j in range(m):
            size = max(size, abs(E[i * m + j]))
        if not 0.0 < size < math.inf:
            return False
        for j in range(m):
            rows[i, j] = E[i * m + j] / size
        rows[i, m + i] = 1.0 / size
    if not _eliminate(rows):
        return False
    gains = 0.0
    for i in range(m):
        for j in range(m):
            gains += abs(E[i * m + j] * rows[j, m + i] / rows[j, j])
    return _SINGULAR * gains < m


@jitable
def _eliminate(rows: Any) -> bool:
    """Make the first m columns of m rows diagonal, with pivoting; False if a pivot is zero."""
    m, columns = rows.shape
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(rows[i, k]) > abs(rows[pivot, k]):
                pivot = i
        for j in range(k, columns):
            rows[k, j], rows[pivot, j] = rows[pivot, j], rows[k, j]
        if rows[k, k] == 0.0:
            return False
        for i in range(m):
            if i != k:
                share = rows[i, k] / rows[k, k]
                for j in range(k, columns):
                    rows[i, j] -= share * rows[k, j]
    return True
