"""Sums over small arrays, for one to four inputs, against NumPy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from grosmc_mj.ground.arrays import Array
from grosmc_mj.theory.control.matrices import norm, norm_of_product, quadratic, row_times, solve

each_order = pytest.mark.parametrize("m", [1, 2, 3, 4])


def row(matrix: Any) -> tuple[float, ...]:
    """Entries row by row, as generated functions return them."""
    return tuple(np.ravel(matrix).tolist())


def solution(E: Any, b: Any) -> Array | None:
    """E^-1 b; None if E is called singular."""
    x = np.array(b, float)
    return x if solve(row(E), x) else None


each_size = pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])


@each_size
@each_order
def test_product_is_that_of_numpy(m: int, size: float) -> None:
    random = np.random.default_rng(m)
    K = size * random.normal(size=(m, 5))
    z = random.normal(size=5)
    product = [row_times(i, K, z) for i in range(m)]
    rounding = 5e-15 * (np.abs(K) @ np.abs(z)).max()
    np.testing.assert_allclose(product, K @ z, rtol=0, atol=rounding)


@pytest.mark.parametrize("n", range(1, 7))
def test_quadratic_form_and_norm_are_those_of_numpy(n: int) -> None:
    random = np.random.default_rng(n)
    z = random.normal(size=n)
    W = np.ones((n, n)) + random.normal(size=(n, n))
    assert quadratic(z, W) == pytest.approx(z @ W @ z, rel=1e-12, abs=1e-12)
    assert norm(row(z)) == pytest.approx(np.linalg.norm(z), rel=1e-14)


@each_size
@each_order
def test_norm_of_a_product_is_that_of_numpy(m: int, size: float) -> None:
    random = np.random.default_rng(m)
    G = random.normal(size=(m, m))
    E = size * random.normal(size=(m, m))
    rounding = m * 1e-15 * float(np.linalg.norm(np.abs(G) @ np.abs(E)))
    assert norm_of_product(G, row(E)) == pytest.approx(np.linalg.norm(G @ E), abs=rounding)


def random_matrix(random: np.random.Generator, m: int) -> Array:
    return random.normal(size=(m, m))


def permuted_diagonal(random: np.random.Generator, m: int) -> Array:
    """Zeros on the diagonal: the pivots are sought."""
    return np.diag(random.uniform(1, 3, m))[random.permutation(m)]


def tiny_pivot(random: np.random.Generator, m: int) -> Array:
    """Elimination without pivoting would lose all of the first unknown."""
    E = np.ones((m, m)) + np.eye(m)
    E[0, 0] = 1e-20 if m > 1 else 1.0
    return E


@each_size
@each_order
@pytest.mark.parametrize("make", [random_matrix, permuted_diagonal, tiny_pivot])
def test_solution_is_that_of_numpy(make: Any, m: int, size: float) -> None:
    random = np.random.default_rng(m)
    E = make(random, m)
    b = size * random.normal(size=m)
    expected = np.linalg.solve(E, b)
    actual = solution(E, b)
    assert actual is not None
    rounding = 1e-14 * np.linalg.cond(E) * np.abs(expected).max()
    np.testing.assert_allclose(actual, expected, rtol=0, atol=rounding)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("m", [1, 2, 7])
def test_a_matrix_is_regular_in_any_units_unless_a_row_repeats_others(m: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    rows, columns = 10.0 ** random.uniform(-8, 8, (2, m, 1))
    E = random.normal(size=(m, m))
    assert solution(rows * E * columns.T, np.ones(m)) is not None

    E[-1] = random.normal(size=m - 1) @ E[:-1]
    assert solution(rows * E * columns.T, np.ones(m)) is None


@pytest.mark.parametrize("m", [1, 2, 7])
@pytest.mark.parametrize("exponent", [3, 11, 14])
def test_a_matrix_is_regular_up_to_a_condition_number_of_1e11(exponent: int, m: int) -> None:
    random = np.random.default_rng(m)
    left, _ = np.linalg.qr(random.normal(size=(m, m)))
    right, _ = np.linalg.qr(random.normal(size=(m, m)))
    singular_values = np.logspace(0, -exponent, m)

    regular = solution(left * singular_values @ right, np.ones(m)) is not None
    assert regular is (exponent <= 11 or m == 1)


@pytest.mark.parametrize(
    ("E", "regular"),
    [
        ((0.0, 1e-8, 1e6, 0.0), True),
        ((1.0, 1e13, 0.0, 1.0), True),  # in other units [[1, 1], [0, 1]]
        ((1.0, 1.0, 1.0, 1.0 + 1e-13), False),
        ((1.0, 0.0, 0.0, 0.0), False),
        ((math.inf, 0.0, 0.0, 1.0), False),
        ((math.nan,), False),
        ((1e-200,), True),
    ],
)
def test_a_matrix_is_regular_or_singular(E: tuple[float, ...], regular: bool) -> None:
    m = math.isqrt(len(E))
    assert (solution(E, np.ones(m)) is not None) is regular
