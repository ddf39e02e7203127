"""Vectors as tuples, for one to four inputs: against NumPy, and the same in compiled code."""

from __future__ import annotations

import contextlib
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
from grosmc_mj.vectors import algebra, each, norm, quadratic, row_times

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


@each_size
def test_sum_and_difference_are_entry_by_entry(m: int) -> None:
    operations = algebra(m)
    for a, b, *_ in draws(m):
        assert both(operations.add, row(a), row(b)) == row(a + b)
        assert both(operations.subtract, row(a), row(b)) == row(a - b)
        assert both(operations.subtract, operations.nothing, row(a)) == row(0.0 - a)
    assert operations.nothing == (0.0,) * m


@pytest.mark.parametrize("n", [1, 2, 6])
@each_size
def test_times_is_the_product_with_a_vector_of_any_length(m: int, n: int) -> None:
    operations, random = algebra(m), np.random.default_rng(n)
    for *_, K in draws(m, n):
        z = random.normal(size=n)
        scale = 1e-15 * (np.abs(K) @ np.abs(z)).max()
        found = both(operations.times, K, row(z))
        assert len(found) == m
        np.testing.assert_allclose(found, K @ z, rtol=0, atol=n * scale)
        # An array does as well as a tuple.
        assert both(operations.times, K, z) == found


@pytest.mark.parametrize("n", [1, 2, 4])
def test_quadratic_form_counts_every_entry(n: int) -> None:
    random = np.random.default_rng(n)
    z, W = random.standard_normal(n), random.standard_normal((n, n))
    assert quadratic(z, W) == pytest.approx(z @ W @ z, rel=1e-12)


@each_size
def test_product_is_that_of_matrices_row_by_row(m: int) -> None:
    operations = algebra(m)
    for _, _, G, E, _ in draws(m):
        found = both(operations.product, G, row(E))
        scale = 1e-15 * (np.abs(G) @ np.abs(E)).max()
        np.testing.assert_allclose(np.reshape(found, (m, m)), G @ E, rtol=0, atol=m * scale)


@each_size
def test_solve_is_that_of_linear_equations(m: int) -> None:
    operations = algebra(m)
    for a, _, _, E, _ in draws(m):
        found = both(operations.solve, row(E), row(a))
        wanted = np.linalg.solve(E, a)
        tolerance = 1e-14 * np.linalg.cond(E) * np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance)


@each_size
def test_solve_undoes_the_product(m: int) -> None:
    """E^-1 (E x) = x, for every order of the rows: the pivots are sought."""
    operations, random = algebra(m), np.random.default_rng(m)
    for _ in range(20):
        order = random.permutation(m)
        E = np.diag(random.uniform(1, 3, m))[order]  # zeros on the diagonal, unless in order
        x = random.normal(size=m)
        found = both(operations.solve, row(E), row(E @ x))
        np.testing.assert_allclose(found, x, rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("m", [2, 3, 4])
def test_small_pivots_do_not_spoil_the_solution(m: int) -> None:
    """[[1e-20, 1], [1, 1]]: elimination without pivoting loses all of the first unknown."""
    E = np.ones((m, m)) + np.eye(m)
    E[0, 0] = 1e-20
    x = np.arange(1.0, m + 1)
    found = both(algebra(m).solve, row(E), row(E @ x))
    np.testing.assert_allclose(found, x, rtol=1e-12)


@each_size
def test_solve_leaves_its_arguments_alone(m: int) -> None:
    E, b = np.eye(m) + 0.1, np.arange(1.0, m + 1)
    before = E.copy(), b.copy()
    algebra(m).solve(E.ravel(), b)
    np.testing.assert_array_equal(E, before[0])
    np.testing.assert_array_equal(b, before[1])


@each_size
def test_singular_matrix_gives_no_finite_solution(m: int) -> None:
    """As C has it: no exception can leave a compiled law. Python may raise one."""
    E, b = np.zeros((m, m)), np.ones(m)
    E[:, 0] = 1.0  # for m > 1 of rank one
    if m == 1:
        E[0, 0] = 0.0
    solve = algebra(m).solve
    assert not np.all(np.isfinite(compiled(solve, 2)(row(E), row(b))))
    with np.errstate(all="ignore"), contextlib.suppress(ZeroDivisionError):
        assert not np.all(np.isfinite(solve(row(E), row(b))))


@each_size
def test_store_writes_every_entry(m: int) -> None:
    operations = algebra(m)
    for a, *_ in draws(m):
        for store in (operations.store, compiled(operations.store, 2)):
            there = np.full(m, np.nan)
            assert store(there, row(a)) is None
            assert row(there) == row(a)


@each_size
def test_one_input_is_given_as_a_number_and_more_as_a_vector(m: int) -> None:
    a = tuple(float(i) + 0.5 for i in range(m))
    given = both(algebra(m).given, a)
    assert given == (0.5 if m == 1 else a)
    assert isinstance(given, float if m == 1 else tuple)


@each_size
def test_operations_of_a_size_are_made_once(m: int) -> None:
    """The compiled engine compiles what it has not compiled yet, by identity."""
    assert algebra(m) is algebra(m)


@pytest.mark.parametrize("count", [1, 2, 5, 16])
def test_each_calls_the_element_with_every_index_in_order(count: int) -> None:
    def element(i: int, a: float, b: float) -> float:
        return a * i + b

    function = each(count, element)
    assert both(function, 2.0, 0.25) == tuple(2.0 * i + 0.25 for i in range(count))
    assert each(count, element) is function


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


@pytest.mark.parametrize("decades", [0, 8])
@pytest.mark.parametrize("m", [1, 2, 3, 4, 7])
def test_a_matrix_is_regular_in_any_units_unless_a_row_repeats_others(
    m: int, decades: float
) -> None:
    regular, random = algebra(m).regular, np.random.default_rng(m)
    for _ in range(50):
        rows, columns = 10.0 ** random.uniform(-decades, decades, (2, m, 1))
        E = random.normal(size=(m, m))
        assert both(regular, row(rows * E * columns.T))
        E[-1] = random.normal(size=m - 1) @ E[:-1]
        assert not both(regular, row(rows * E * columns.T))


@pytest.mark.parametrize("m", [2, 3, 7])
def test_a_matrix_is_regular_up_to_a_condition_number_of_1e11(m: int) -> None:
    regular, random = algebra(m).regular, np.random.default_rng(m)
    for exponent, said in [(0, True), (3, True), (11, True), (14, False)]:
        left, right = (np.linalg.qr(random.normal(size=(m, m)))[0] for _ in range(2))
        values = np.logspace(0, -exponent, m)
        assert both(regular, row(left * values @ right)) == said


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
    assert both(algebra(math.isqrt(len(E))).regular, E) is said
