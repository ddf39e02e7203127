"""Small vectors as tuples: what laws compute with, in Python and in compiled code alike.

Tuples need no memory, so a compiled law of one or two inputs allocates none. Matrices are 2-D
arrays of a law's parameters, or the row-by-row tuples that generated functions return.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.jitable import jitable

# A reciprocal condition number below this is rounding.
_SINGULAR = 1e-12

Vector = tuple[float, ...]
Element = Callable[..., float]


@cache
def each(count: int, element: Element) -> Callable[..., Vector]:
    """Jitable (*a) -> (element(0, *a), ..., element(count - 1, *a))."""
    last, element = count - 1, jitable(element)
    if count == 1:

        @jitable
        def single(*a: Any) -> Vector:
            return (element(0, *a),)

        return single
    before = each(last, element)

    @jitable
    def joined(*a: Any) -> Vector:
        return before(*a) + (element(last, *a),)

    return joined


@jitable
def norm(z: Any) -> float:
    """The Euclidean norm of a tuple; for row-by-row matrices the Frobenius norm."""
    total = 0.0
    for value in z:
        total += value * value
    return math.sqrt(total)


@jitable
def row_times(i: int, K: Any, z: Any) -> float:
    """Entry i of K z, for a matrix K with 2 axes."""
    total = 0.0
    for j in range(len(z)):
        total += K[i, j] * z[j]
    return total


@jitable
def quadratic(z: Any, W: Any) -> float:
    """z'W z, for a matrix W with 2 axes."""
    total = 0.0
    for i in range(len(z)):
        for j in range(len(z)):
            total += z[i] * W[i, j] * z[j]
    return total


class Algebra(NamedTuple):
    """Jitable operations on vectors with one entry for each of m inputs.

    Attributes:
        times: (K, z) -> K z, for K (m, n) and z of any n.
        add: (a, b) -> a + b.
        subtract: (a, b) -> a - b.
        solve: (E, b) -> E^-1 b, for a row-by-row E; infinities or NaN if E is singular, where
            Python raises ZeroDivisionError for one or two inputs.
        regular: E -> whether E, row by row, is finite and nonsingular beyond rounding, whatever
            the units of its rows and columns.
        product: (G, E) -> G E row by row, for G (m, m) and a row-by-row E.
        within: (a, limit) -> a with each entry between -limit and limit.
        differ: (a, b) -> whether an entry of them does.
        store: (row, a): write a vector into an array.
        nothing: (0, ..., 0).
        given: What a law returns: a number for one input, else the vector.
    """

    times: Callable[[Any, Any], Vector]
    add: Callable[[Any, Any], Vector]
    subtract: Callable[[Any, Any], Vector]
    solve: Callable[[Any, Any], Vector]
    regular: Callable[[Any], bool]
    product: Callable[[Any, Any], Vector]
    within: Callable[[Any, Any], Vector]
    differ: Callable[[Any, Any], bool]
    store: Callable[[Any, Any], None]
    nothing: Vector
    given: Callable[[Any], Any]


@cache
def algebra(m: int) -> Algebra:
    """The operations for m inputs."""

    def product_entry(index: int, G: Any, E: Any) -> float:
        i, j, total = index // m, index % m, 0.0
        for k in range(m):
            total += G[i, k] * E[k * m + j]
        return total

    @jitable
    def differ(a: Any, b: Any) -> bool:
        found = False
        for i in range(m):
            found = found or a[i] != b[i]
        return found

    @jitable
    def store(row: Any, a: Any) -> None:
        for i in range(m):
            row[i] = a[i]

    @jitable
    def first(a: Any) -> float:
        return a[0]

    @jitable
    def whole(a: Any) -> Any:
        return a

    return Algebra(
        times=each(m, row_times),
        add=each(m, _sum),
        subtract=each(m, _difference),
        solve=_solver(m),
        regular=_regular(m),
        product=each(m * m, product_entry),
        within=each(m, _within),
        differ=differ,
        store=store,
        nothing=(0.0,) * m,
        given=first if m == 1 else whole,
    )


@jitable
def _sum(i: int, a: Any, b: Any) -> float:
    return a[i] + b[i]


@jitable
def _within(i: int, a: Any, limit: Any) -> float:
    return min(limit, max(-limit, a[i]))


@jitable
def _difference(i: int, a: Any, b: Any) -> float:
    return a[i] - b[i]


@cache
def _solver(m: int) -> Callable[[Any, Any], Vector]:
    """E x = b: by hand for one and two inputs, by elimination for more."""
    if m == 1:
        return jitable(lambda E, b: (b[0] / E[0],))
    if m == 2:

        @jitable
        def by_cramer(E: Any, b: Any) -> Vector:
            whole = E[0] * E[3] - E[1] * E[2]
            return ((b[0] * E[3] - b[1] * E[1]) / whole, (b[1] * E[0] - b[0] * E[2]) / whole)

        return by_cramer
    entry, eliminate = each(m, _column_entry), _elimination(m)

    @jitable
    def by_elimination(E: Any, b: Any) -> Vector:
        rows = np.empty((m, m + 1))
        for i in range(m):
            for j in range(m):
                rows[i, j] = E[i * m + j]
            rows[i, m] = b[i]
        eliminate(rows)
        return entry(rows, m)

    return by_elimination


@cache
def _elimination(m: int) -> Callable[[Any], bool]:
    """Make the first m columns of ``rows`` diagonal, with pivoting; False if a pivot is zero."""

    @jitable
    def eliminate(rows: Any) -> bool:
        columns = rows.shape[1]
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

    return eliminate


@cache
def _regular(m: int) -> Callable[[Any], bool]:
    """Whether the relative gains E_ij (E^-1)_ji have magnitudes of less than 1e12 m in sum.

    No scaling of rows or columns changes them: E. H. Bristol, IEEE Trans. Automatic Control 11,
    1966. Their sum is about the condition number of E under the scaling that makes it least:
    C. N. Nett and V. Manousiouthakis, the same journal 32, 1987.
    """
    if m == 1:
        return jitable(lambda E: 0.0 < abs(E[0]) < math.inf)
    if m == 2:

        @jitable
        def of_two(E: Any) -> bool:
            along, across = E[0] * E[3], E[1] * E[2]
            return abs(along - across) > _SINGULAR * (abs(along) + abs(across))

        return of_two
    eliminate = _elimination(m)

    @jitable
    def of_more(E: Any) -> bool:
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
        if not eliminate(rows):
            return False
        gains = 0.0
        for i in range(m):
            for j in range(m):
                gains += abs(E[i * m + j] * rows[j, m + i] / rows[j, j])
        return _SINGULAR * gains < m

    return of_more


@jitable
def _column_entry(i: int, rows: Any, m: int) -> float:
    return rows[i, m] / rows[i, i]


def signed_difference(
    count: int, sign: float, places: tuple[int, ...]
) -> Callable[[Any, Any], Vector]:
    """Jitable (values, reference) -> sign (values - the reference's entries at the places)."""
    return each(count, lambda i, values, y_r: sign * (values[i] - y_r[places[i]]))
