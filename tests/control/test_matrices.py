"""Sums over small arrays, for one to four inputs: against NumPy, and the same in compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grosmc_mj.arrays import Array
from grosmc_mj.control.matrices import (
    norm,
    norm_of_product,
    quadratic,
    row_times,
    solve,
)

SIZES = (1, 2, 3, 4)
each_size = pytest.mark.parametrize("m", SIZES)
POINTS = 100


@cache
def compiled(function: Callable[..., Any], arity: int) -> Callable[..., Any]:
    """An operation called from numba's code, where it divides as C does."""
    if arity == 1:
        return numba.njit(lambda a: function(a), error_model="numpy")
    if arity == 2:
        return numba.njit(lambda a, b: function(a, b), error_model="numpy")
    return numba.njit(lambda a, b, c: function(a, b, c), error_model="numpy")


def both(function: Callable[..., Any], *arguments: Any) -> Any:
    """What Python makes of it, which compiled code makes of it to the last bit."""
    found = function(*arguments)
    assert compiled(function, len(arguments))(*arguments) == found
    return found


def row(values: Array) -> tuple[float, ...]:
    """A vector, or a matrix row by row, as a tuple."""
    return tuple(values.ravel().tolist())


def draws(m: int, n: int = 5) -> Iterator[tuple[Array, Array, Array, Array, Array]]:
    """Random a and b (m,), G and E (m, m) and K (m, n) of very different sizes."""
    random = np.random.default_rng(m)
    for _ in range(POINTS):
        size = 10.0 ** random.uniform(-3, 3)
        yield (
            size * random.normal(size=m),
            random.normal(size=m),
            random.normal(size=(m, m)),
            size * random.normal(size=(m, m)),
            random.normal(size=(m, n)),
        )


def solution(E: Any, b: Any) -> Array:
    """E^-1 b, the same in compiled code to the last bit."""
    here, there = np.array(b, float), np.array(b, float)
    solve(E, here)
    compiled(solve, 2)(E, there)
    np.testing.assert_array_equal(here, there)
    return here


@pytest.mark.parametrize("n", [1, 2, 6])
@each_size
def test_rows_times_a_vector_of_any_length_are_the_product(m: int, n: int) -> None:
    random = np.random.default_rng(n)
    for *_, K in draws(m, n):
        z = random.normal(size=n)
        scale = 1e-15 * (np.abs(K) @ np.abs(z)).max()
        product = [both(row_times, i, K, row(z)) for i in range(m)]
        np.testing.assert_allclose(product, K @ z, rtol=0, atol=n * scale)
        # An array does as well as a tuple.
        assert [both(row_times, i, K, z) for i in range(m)] == product


@pytest.mark.parametrize("n", [1, 2, 4])
def test_quadratic_form_counts_every_entry(n: int) -> None:
    random = np.random.default_rng(n)
    z, W = random.standard_normal(n), random.standard_normal((n, n))
    assert quadratic(z, W) == pytest.approx(z @ W @ z, rel=1e-12)


@each_size
def test_norm_of_a_product_of_matrices(m: int) -> None:
    for _, _, G, E, _ in draws(m):
        scale = 1e-15 * float(np.linalg.norm(np.abs(G) @ np.abs(E)))
        size = both(norm_of_product, G, row(E))
        assert size == pytest.approx(float(np.linalg.norm(G @ E)), rel=0, abs=m * scale)


@each_size
def test_solve_is_that_of_linear_equations(m: int) -> None:
    for a, _, _, E, _ in draws(m):
        wanted = np.linalg.solve(E, a)
        tolerance = 1e-14 * np.linalg.cond(E) * np.abs(wanted).max()
        np.testing.assert_allclose(solution(row(E), a), wanted, rtol=0, atol=tolerance)


@each_size
def test_solve_undoes_the_product(m: int) -> None:
    """E^-1 (E x) = x, for every order of the rows: the pivots are sought."""
    random = np.random.default_rng(m)
    for _ in range(20):
        order = random.permutation(m)
        E = np.diag(random.uniform(1, 3, m))[order]  # zeros on the diagonal, unless in order
        x = random.normal(size=m)
        np.testing.assert_allclose(solution(row(E), E @ x), x, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_small_pivots_do_not_spoil_the_solution(m: int) -> None:
    """[[1e-20, 1], [1, 1]]: elimination without pivoting loses all of the first unknown."""
    E = np.ones((m, m)) + np.eye(m)
    E[0, 0] = 1e-20
    x = np.arange(1.0, m + 1)
    np.testing.assert_allclose(solution(row(E), E @ x), x, rtol=1e-12)


@each_size
def test_solve_leaves_the_matrix_alone(m: int) -> None:
    E = np.eye(m) + 0.1
    before = E.copy()
    solve(E.ravel(), np.arange(1.0, m + 1))
    np.testing.assert_array_equal(E, before)


def test_row_of_a_product() -> None:
    K, z = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), (0.5, -1.0, 2.0)
    assert both(row_times, 0, K, z) == 4.5
    assert both(row_times, 1, K, z) == 9.0


@each_size
def test_norm_is_the_euclidean_one_and_that_of_frobenius(m: int) -> None:
    for a, _, _, E, _ in draws(m):
        assert both(norm, row(a)) == pytest.approx(float(np.linalg.norm(a)), rel=1e-15)
        assert both(norm, row(E)) == pytest.approx(float(np.linalg.norm(E)), rel=4e-15)
    assert both(norm, (0.0,) * m) == 0.0


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=6))
def test_norm_of_any_length(z: list[float]) -> None:
    # Squares below 1e-308 vanish, which hypot avoids and no law needs.
    assert norm(tuple(z)) == pytest.approx(math.hypot(*z), rel=1e-14, abs=1e-150)


def regular(E: Any, m: int) -> bool:
    """Whether there is a solution, which compiled code agrees on."""
    said = compiled(solve, 2)(E, np.ones(m))
    assert solve(E, np.ones(m)) == said
    return said


@pytest.mark.parametrize("decades", [0, 8])
@pytest.mark.parametrize("m", [1, 2, 3, 4, 7])
def test_a_matrix_is_regular_in_any_units_unless_a_row_repeats_others(
    m: int, decades: float
) -> None:
    random = np.random.default_rng(m)
    for _ in range(50):
        rows, columns = 10.0 ** random.uniform(-decades, decades, (2, m, 1))
        E = random.normal(size=(m, m))
        assert regular(row(rows * E * columns.T), m)
        E[-1] = random.normal(size=m - 1) @ E[:-1]
        assert not regular(row(rows * E * columns.T), m)


@pytest.mark.parametrize("m", [2, 3, 7])
def test_a_matrix_is_regular_up_to_a_condition_number_of_1e11(m: int) -> None:
    random = np.random.default_rng(m)
    for exponent, said in [(0, True), (3, True), (11, True), (14, False)]:
        left, right = (np.linalg.qr(random.normal(size=(m, m)))[0] for _ in range(2))
        values = np.logspace(0, -exponent, m)
        assert regular(row(left * values @ right), m) == said


@pytest.mark.parametrize(
    ("E", "said"),
    [
        ((1e6, 0.0, 0.0, 1e-8), True),
        ((0.0, 1e-8, 1e6, 0.0), True),
        ((1.0, 1e13, 0.0, 1.0), True),  # in other units [[1, 1], [0, 1]]
        ((1.0, 1.0, 1.0, 1.0 + 1e-13), False),
        ((1e6, 1e-8, 1e6, 1e-8), False),
        ((1.0, 0.0, 0.0, 0.0), False),
        ((math.inf, 0.0, 0.0, 1.0), False),
        ((math.nan,) * 4, False),
        ((math.nan,) * 9, False),
        ((0.0,) * 9, False),
        ((1.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0, 1.0), False),
        ((math.nan,), False),
        ((1e-200,), True),
    ],
)
def test_a_matrix_of_any_scale_is_regular_or_not(E: tuple[float, ...], said: bool) -> None:
    assert regular(E, math.isqrt(len(E))) is said
