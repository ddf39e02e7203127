"""Sums over small arrays in a fixed order, the same in Python and in compiled code.

A matrix has two axes, but for E: its entries row by row, as generated functions return them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from grosmc_mj.ground.compilation.jitable import jitable

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
def copy(z: Any, target: Any) -> None:
    """Write a vector into another one: a slice takes a second more to compile."""
    for i in range(len(z)):
        target[i] = z[i]


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
    m = len(G)
    total = 0.0
    for i in range(m):
        for j in range(m):
            entry = 0.0
            for k in range(m):
                entry += G[i, k] * E[k * m + j]
            total += entry * entry
    return math.sqrt(total)


@jitable
def divide(E: Any, b: Any) -> bool:
    """``solve`` for a single equation, which compiles in a tenth of the time."""
    if not 0.0 < abs(E[0]) < math.inf:
        return False
    b[0] = b[0] / E[0]
    return True


@jitable
def solve(E: Any, b: Any) -> bool:
    """Replace b (m,) by E^-1 b, by elimination; False if E is singular, whatever its units.

    The relative gains E_ij (E^-1)_ji of a regular E have magnitudes of less than 1e12 m in sum. No
    scaling of rows or columns changes them: E. H. Bristol, IEEE Trans. Automatic Control 11, 1966.
    Their sum is about the condition number of E under the scaling that makes it least: C. N. Nett
    and V. Manousiouthakis, the same journal 32, 1987.
    """
    m = len(b)
    rows = np.zeros((m, 2 * m + 1))
    if not _write_equations(E, b, rows):
        return False
    if not _eliminate(rows):
        return False

    relative_gains = 0.0
    for i in range(m):
        for j in range(m):
            relative_gains += abs(E[i * m + j] * rows[j, m + i] / rows[j, j])
    for i in range(m):
        b[i] = rows[i, 2 * m] / rows[i, i]
    return _SINGULAR * relative_gains < m


@jitable
def _write_equations(E: Any, b: Any, rows: Any) -> bool:
    """Write E, the identity and b into the rows (m, 2m + 1), each divided by its largest E_ij.

    False if a row of E is zero or not finite.
    """
    m = len(b)
    for i in range(m):
        size = 0.0
        for j in range(m):
            size = max(size, abs(E[i * m + j]))
        if not 0.0 < size < math.inf:
            return False

        for j in range(m):
            rows[i, j] = E[i * m + j] / size
        rows[i, m + i] = 1.0 / size
        rows[i, 2 * m] = b[i] / size
    return True


@jitable
def _eliminate(rows: Any) -> bool:
    """Make the first m columns diagonal, with the largest pivot of each; False if it is zero."""
    m = len(rows)
    columns = 2 * m + 1
    for k in range(m):
        pivot = k
        for i in range(k + 1, m):
            if abs(rows[i, k]) > abs(rows[pivot, k]):
                pivot = i
        for j in range(columns):
            moved = rows[k, j]
            rows[k, j] = rows[pivot, j]
            rows[pivot, j] = moved
        if rows[k, k] == 0.0:
            return False

        for i in range(m):
            if i != k:
                share = rows[i, k] / rows[k, k]
                for j in range(k, columns):
                    rows[i, j] -= share * rows[k, j]
    return True
