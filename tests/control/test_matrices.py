"""Sums over small arrays, for one to four inputs: against NumPy, and the same in compiled code."""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grosmc_mj.arrays import Array
from grosmc_mj.control.matrices import norm, norm_of_product, quadratic, row_times, solve

each_size = pytest.mark.parametrize("m", [1, 2, 3, 4])


def row(matrix: Array) -> tuple[float, ...]:
    """A matrix row by row, as a tuple."""
    return tuple(matrix.ravel().tolist())


def solution(E: Any, b: Any) -> Array | None:
    """E^-1 b; None if E is called singular."""
    x = np.array(b, float)
    return x if solve(E, x) else None


@each_size
def test_products_and_norms_are_numpy_s(m: int) -> None:
    random = np.random.default_rng(m)
    for n in (1, 2, 6):
        for size in 10.0 ** random.uniform(-3, 3, 20):
            K, z, W = size * random.normal(size=(m, n)), random.normal(size=n), np.ones((n, n))
            W += random.normal(size=(n, n))
            G, E = random.normal(size=(m, m)), size * random.normal(size=(m, m))
            scale = 1e-15 * (np.abs(K) @ np.abs(z)).max()
            product = [row_times(i, K, z) for i in range(m)]
            np.testing.assert_allclose(product, K @ z, rtol=0, atol=n * scale)
            assert [row_times(i, K, row(z)) for i in range(m)] == product
            assert quadratic(z, W) == pytest.approx(z @ W @ z, rel=1e-12, abs=1e-12)
            scale = m * 1e-15 * float(np.linalg.norm(np.abs(G) @ np.abs(E)))
            assert norm_of_product(G, row(E)) == pytest.approx(np.linalg.norm(G @ E), abs=scale)


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=6))
def test_norm_is_euclidean(z: list[float]) -> None:
    # Squares below 1e-308 vanish, which hypot avoids and no law needs.
    assert norm(tuple(z)) == pytest.approx(math.hypot(*z), rel=1e-14, abs=1e-150)


@each_size
def test_solve_is_that_of_linear_equations(m: int) -> None:
    """For every order of the rows, with zeros on the diagonal too: the pivots are sought."""
    random = np.random.default_rng(m)
    for size in 10.0 ** random.uniform(-3, 3, 50):
        b = size * random.normal(size=m)
        ordered = np.diag(random.uniform(1, 3, m))[random.permutation(m)]
        # Elimination without pivoting loses all of the first unknown.
        tiny = np.ones((m, m)) + np.eye(m)
        tiny[0, 0] = 1e-20 if m > 1 else 1.0
        for E in (random.normal(size=(m, m)), ordered, tiny):
            before, expected = E.copy(), np.linalg.solve(E, b)
            tolerance = 1e-14 * np.linalg.cond(E) * np.abs(expected).max()
            x: Any = solution(E.ravel(), b)
            np.testing.assert_allclose(x, expected, rtol=0, atol=tolerance)
            np.testing.assert_array_equal(E, before)


@numba.njit(error_model="numpy")
def compiled(K: Any, E: Any, z: Any, b: Any) -> Any:
    """All of them from numba's code, where it divides as C does."""
    regular = solve(E, b)
    return row_times(0, K, z), norm(z), norm_of_product(K, E), quadratic(z, K), regular


@pytest.mark.parametrize("m", [1, 3])
def test_compiled_code_computes_the_same_to_the_last_bit(m: int) -> None:
    random = np.random.default_rng(m)
    for _ in range(100):
        K, E = random.normal(size=(2, m, m)) * 10.0 ** random.uniform(-3, 3)
        z, here = random.normal(size=(2, m))
        there, values, flat = here.copy(), row(z), row(E)
        found: Any = compiled(K, flat, values, there)
        assert found == (
            row_times(0, K, values),
            norm(values),
            norm_of_product(K, flat),
            quadratic(values, K),
            solve(flat, here),
        )
        np.testing.assert_array_equal(there, here)
    for entry in (math.nan, 0.0):
        assert compiled(np.eye(m), (entry,) * m**2, (1.0,) * m, np.ones(m))[-1] is False


@pytest.mark.parametrize("decades", [0, 8])
@pytest.mark.parametrize("m", [1, 2, 4, 7])
def test_a_matrix_is_regular_in_any_units_unless_a_row_repeats_others(m: int, decades: int) -> None:
    random, b = np.random.default_rng(m), np.ones(m)
    for _ in range(50):
        rows, columns = 10.0 ** random.uniform(-decades, decades, (2, m, 1))
        E = random.normal(size=(m, m))
        assert solution(row(rows * E * columns.T), b) is not None
        E[-1] = random.normal(size=m - 1) @ E[:-1]
        assert solution(row(rows * E * columns.T), b) is None


@pytest.mark.parametrize("m", [2, 7])
def test_a_matrix_is_regular_up_to_a_condition_number_of_1e11(m: int) -> None:
    random = np.random.default_rng(m)
    for exponent, regular in [(0, True), (3, True), (11, True), (14, False)]:
        left, right = (np.linalg.qr(random.normal(size=(m, m)))[0] for _ in range(2))
        E = left * np.logspace(0, -exponent, m) @ right
        assert (solution(row(E), np.ones(m)) is not None) is regular


@pytest.mark.parametrize(
    ("E", "regular"),
    [
        ((1e6, 0.0, 0.0, 1e-8), True),
        ((0.0, 1e-8, 1e6, 0.0), True),
        ((1.0, 1e13, 0.0, 1.0), True),  # in other units [[1, 1], [0, 1]]
        ((1.0, 1.0, 1.0, 1.0 + 1e-13), False),
        ((1e6, 1e-8, 1e6, 1e-8), False),
        ((1.0, 0.0, 0.0, 0.0), False),
        ((math.inf, 0.0, 0.0, 1.0), False),
        ((math.nan,) * 9, False),
        ((0.0,) * 9, False),
        ((math.nan,), False),
        ((1e-200,), True),
    ],
)
def test_a_matrix_of_any_scale_is_regular_or_not(E: tuple[float, ...], *, regular: bool) -> None:
    assert (solution(E, np.ones(math.isqrt(len(E)))) is not None) is regular
