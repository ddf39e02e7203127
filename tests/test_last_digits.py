"""Linear algebra with other last digits finds what is compared to the bit after it."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from last_digits import other_digits, with_other_digits

EPS = float(np.finfo(float).eps)


@pytest.mark.parametrize("value", [1.0, -0.3, 1e-200, 1e308])
def test_a_number_becomes_its_neighbour(value: float) -> None:
    changed = other_digits(value)
    neighbours = (np.nextafter(value, np.inf), np.nextafter(value, -np.inf))
    assert changed in neighbours


@pytest.mark.parametrize("value", [0.0, np.inf, -np.inf])
def test_zero_and_infinity_stay(value: float) -> None:
    assert other_digits(value) == value


def test_parts_of_an_answer_keep_their_names() -> None:
    matrix = np.array([[1.0, 2.0], [3.0, 4.0]])
    changed = with_other_digits(np.linalg.svd)(matrix)
    sizes = changed.S
    assert sizes == pytest.approx(np.linalg.svd(matrix).S, rel=2 * EPS)


def test_a_gain_has_another_text_and_the_same_one_each_time() -> None:
    """Riccati equation of a double integrator, P = [[√3, 1], [1, √3]]."""
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    B = np.array([[0.0], [1.0]])
    Q = np.eye(2)
    R = np.eye(1)
    other = with_other_digits(scipy.linalg.solve_continuous_are)
    P = scipy.linalg.solve_continuous_are(A, B, Q, R)
    assert str(other(A, B, Q, R).tolist()) != str(P.tolist())
    assert str(other(A, B, Q, R).tolist()) == str(other(A, B, Q, R).tolist())
    assert other(A, B, Q, R) == pytest.approx(np.array([[3**0.5, 1], [1, 3**0.5]]), rel=1e-12)
