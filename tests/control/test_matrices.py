"""Sums over small arrays, for one to four inputs, against NumPy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.control.matrices import norm, norm_of_product, quadratic, row_times, solve


def row(matrix: Any) -> tuple[float, ...]:
    return tuple(np.ravel(matrix).tolist())


def solution(E: Any, b: Any) -> Array | None:
    """E^-1 b; None if E is called singular."""
    x = np.array(b, float)
    return x if solve(row(E), x) else None


@pytest.mark.parametrize("m", [1, 2, 3, 4])
def test_products_norms_and_solutions_are_numpy_s(m: int) -> None:
    """For every order of the rows, with zeros on the diagonal too: the pivots are sought."""
    random = np.random.default_rng(m)
    for size in 10.0 ** random.uniform(-3, 3, 30):
        n = int(random.integers(1, 7))
        K, z, W = size * random.normal(size=(m, n)), random.normal(size=n), np.ones((n, n))
        W += random.normal(size=(n, n))
        G, E = random.normal(size=(m, m)), size * random.normal(size=(m, m))
        atol = n * 1e-15 * (np.abs(K) @ np.abs(z)).max()
        product = [row_times(i, K, z) for i in range(m)]
        np.testing.assert_allclose(product, K @ z, rtol=0, atol=atol)
        assert quadratic(z, W) == pytest.approx(z @ W @ z, rel=1e-12, abs=1e-12)
        assert norm(row(z)) == pytest.approx(np.linalg.norm(z), rel=1e-14)
        scale = m * 1e-15 * float(np.linalg.norm(np.abs(G) @ np.abs(E)))
        assert norm_of_product(G, row(E)) == pytest.approx(np.linalg.norm(G @ E), abs=scale)
        ordered = np.diag(random.uniform(1, 3, m))[random.permutation(m)]
        # Elimination without pivoting loses all of the first unknown.
        tiny, b = np.ones((m, m)) + np.eye(m), size * random.normal(size=m)
        tiny[0, 0] = 1e-20 if m > 1 else 1.0
        for matrix in (random.normal(size=(m, m)), ordered, tiny):
            expected = np.linalg.solve(matrix, b)
            atol = 1e-14 * np.linalg.cond(matrix) * np.abs(expected).max()
            np.testing.assert_allclose(solution(matrix, b), expected, rtol=0, atol=atol)  # pyright: ignore


@pytest.mark.parametrize("m", [1, 2, 7])
def test_a_matrix_is_regular_in_any_units_unless_a_row_repeats_others(m: int) -> None:
    """Up to a condition number of 1e11."""
    random, b = np.random.default_rng(m), np.ones(m)
    for _ in range(50):
        rows, columns = 10.0 ** random.uniform(-8, 8, (2, m, 1))
        E = random.normal(size=(m, m))
        assert solution(rows * E * columns.T, b) is not None
        E[-1] = random.normal(size=m - 1) @ E[:-1]
        assert solution(rows * E * columns.T, b) is None
    for exponent, regular in [(3, True), (11, True), (14, m == 1)]:
        left, right = (np.linalg.qr(random.normal(size=(m, m)))[0] for _ in range(2))
        assert (solution(left * np.logspace(0, -exponent, m) @ right, b) is not None) is regular
    for E, regular in (
        ((0.0, 1e-8, 1e6, 0.0), True),
        ((1.0, 1e13, 0.0, 1.0), True),  # in other units [[1, 1], [0, 1]]
        ((1.0, 1.0, 1.0, 1.0 + 1e-13), False),
        ((1.0, 0.0, 0.0, 0.0), False),
        ((math.inf, 0.0, 0.0, 1.0), False),
        ((math.nan,), False),
        ((1e-200,), True),
    ):
        assert (solution(E, np.ones(math.isqrt(len(E)))) is not None) is regular
