"""Vectors of three numbers in plain Python, for both engines and for C.

A vector is read entry by entry, so an array and a tuple will do; each function returns a tuple.
Rows of an array (n, k, 3) are told by two indices, its matrices (n, 3, 3) by one.
"""

from __future__ import annotations

from typing import Any

from grosmc_mj.ground.compilation.jitable import jitable

Triple = tuple[float, float, float]


@jitable
def row(rows: Any, i: int, j: int) -> Triple:
    """Read a row of an array, (n, k, 3)."""
    return rows[i, j, 0], rows[i, j, 1], rows[i, j, 2]


@jitable
def put(rows: Any, i: int, j: int, a: Any) -> None:
    """Write a vector into a row of an array, (n, k, 3)."""
    rows[i, j, 0] = a[0]
    rows[i, j, 1] = a[1]
    rows[i, j, 2] = a[2]


@jitable
def add(rows: Any, i: int, j: int, a: Any) -> None:
    """Add a vector to a row of an array, (n, k, 3)."""
    rows[i, j, 0] += a[0]
    rows[i, j, 1] += a[1]
    rows[i, j, 2] += a[2]


@jitable
def plus(a: Any, b: Any) -> Triple:
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@jitable
def times(factor: float, a: Any) -> Triple:
    """Vector times a number."""
    return factor * a[0], factor * a[1], factor * a[2]


@jitable
def dot(a: Any, b: Any) -> float:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jitable
def cross(a: Any, b: Any) -> Triple:
    """Vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jitable
def turned(matrices: Any, i: int, a: Any) -> Triple:
    """Product of matrix i, in the first rows of an array (n, k, 3), and a vector."""
    x = matrices[i, 0, 0] * a[0] + matrices[i, 0, 1] * a[1] + matrices[i, 0, 2] * a[2]
    y = matrices[i, 1, 0] * a[0] + matrices[i, 1, 1] * a[1] + matrices[i, 1, 2] * a[2]
    z = matrices[i, 2, 0] * a[0] + matrices[i, 2, 1] * a[1] + matrices[i, 2, 2] * a[2]
    return x, y, z


@jitable
def turned_back(matrices: Any, i: int, a: Any) -> Triple:
    """Product of the transpose of matrix i and a vector."""
    x = matrices[i, 0, 0] * a[0] + matrices[i, 1, 0] * a[1] + matrices[i, 2, 0] * a[2]
    y = matrices[i, 0, 1] * a[0] + matrices[i, 1, 1] * a[1] + matrices[i, 2, 1] * a[2]
    z = matrices[i, 0, 2] * a[0] + matrices[i, 1, 2] * a[1] + matrices[i, 2, 2] * a[2]
    return x, y, z
