"""Modes that no input reaches, and zero dynamics: rank, zeros of transfer functions, units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import GainError
from grosmc_mj.theory.control.lqr import lqr
from grosmc_mj.theory.control.modes import internal_modes, unreached_modes

# q'' = u + z, z' = 0.5 z.
CARRIED = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 0.5]])
FORCE = np.array([[0.0], [1], [0]])
LEAST = 1e-3


def test_the_state_that_no_input_reaches_is_named_with_its_growth() -> None:
    (mode,) = unreached_modes(CARRIED, FORCE, LEAST)
    assert mode.states == (2,)
    assert mode.rate == pytest.approx(0.5)
    words = "z grows by itself, at 0.5 1/s, and no input reaches it"
    assert mode.unreached(["q", "w", "z"]) == words


@pytest.mark.parametrize("units", [(1, 1, 1), (1e-3, 1, 1e5), (1e4, 1e-4, 1e-6)])
def test_units_of_states_and_inputs_do_not_matter(units: tuple[float, ...]) -> None:
    scale = np.diag(units)
    inverse = np.linalg.inv(scale)
    A = scale @ CARRIED @ inverse
    (mode,) = unreached_modes(A, 1e-12 * scale @ FORCE, LEAST)
    assert mode.states == (2,)
    assert mode.rate == pytest.approx(0.5)
    assert unreached_modes(A, 1e-12 * scale @ (FORCE + 1), LEAST) == []


@pytest.mark.parametrize(
    ("A", "B"),
    [
        # Stable; an integrator; a double integrator: none of them grows by itself.
        (np.diag([-1.0, -0.5]), np.array([[1.0], [0]])),
        (np.diag([-1.0, 0]), np.array([[1.0], [0]])),
        (np.eye(4, k=1) * [0, 1, 0, 1], np.array([[0.0], [1], [0], [0]])),
        # An undamped oscillator.
        (np.array([[0.0, 100], [-100, 0]]), np.zeros((2, 1))),
        # An upright pendulum that the input reaches.
        (np.array([[0.0, 1], [9.81, 0]]), np.array([[0.0], [1]])),
    ],
)
def test_nothing_is_said_of_what_does_not_grow_or_is_reached(A: Array, B: Array) -> None:
    assert unreached_modes(A, B, LEAST) == []


@pytest.mark.parametrize(("least", "rates"), [(0.1, [0.7, 0.3]), (0.5, [0.7]), (0.8, [])])
def test_modes_that_grow_fast_enough_are_told_the_fastest_first(
    least: float, rates: list[float]
) -> None:
    A = np.diag([0.3, -1.0, 0.7])
    B = np.array([[0.0], [1.0], [0.0]])
    T = np.array([[0.0, 1.0, 0.0]])
    assert [mode.rate for mode in unreached_modes(A, B, least)] == pytest.approx(rates)
    assert [mode.rate for mode in internal_modes(A, B, T, least)] == pytest.approx(rates)


def test_a_growing_oscillation_is_one_mode_of_both_states() -> None:
    spiral = np.array([[0.2, 3], [-3, 0.2]])
    A: Any = scipy.linalg.block_diag(-1.0, spiral)
    (mode,) = unreached_modes(A, np.array([[1.0], [0], [0]]), LEAST)
    assert mode.states == (1, 2)
    assert mode.rate == pytest.approx(0.2)


@pytest.mark.parametrize("size", [1e-308, 1e-160, 1e160, 1e300])
def test_numbers_near_the_ends_of_the_floats_are_no_error(size: float) -> None:
    A = np.array([[0.0, 1], [-size, 0]])
    assert unreached_modes(A, np.eye(2), LEAST) == []
    assert internal_modes(A, np.eye(2), np.eye(2)[:1] * size, LEAST) == []


def test_two_unstable_modes_of_one_growth_need_two_inputs() -> None:
    """With one input a combination of both moves by itself."""
    A = np.eye(2)
    assert unreached_modes(A, np.eye(2), LEAST) == []
    (mode,) = unreached_modes(A, np.array([[1.0], [1]]), LEAST)
    assert mode.states == (0, 1)
    assert mode.rate == pytest.approx(1.0)


@pytest.mark.parametrize("zero", [2.0, -2.0])
def test_internal_modes_are_the_zeros_of_the_transfer_function(zero: float) -> None:
    """y/u = (s - zero)/(s + 1)^3 has relative degree two and one zero."""
    A, B, C, _ = scipy.signal.tf2ss([1, -zero], np.poly([-1, -1, -1]))
    T = np.vstack([C, C @ A])
    modes = internal_modes(A, B, T, LEAST)
    assert [mode.rate for mode in modes] == [pytest.approx(zero)] * (zero > 0)
    assert unreached_modes(A, B, LEAST) == []


# An upright pole, its rate, a cart and its speed, under a force: theta'' = 20 theta - u.
POLE_ON_CART = np.array([[0.0, 1, 0, 0], [20, 0, 0, 0], [0, 0, 0, 1], [-2, 0, 0, 0]])
CART_FORCE = np.array([[0.0], [-1], [0], [1]])


def test_a_cart_behind_its_pole_drifts_and_does_not_grow() -> None:
    """With the pole's angle held the cart is a double integrator: its zeros are at 0."""
    assert internal_modes(POLE_ON_CART, CART_FORCE, np.eye(4)[:2], LEAST) == []


def test_a_held_cart_leaves_the_pole_falling() -> None:
    """q_c = 0 needs u = 2 theta, which leaves theta'' = 18 theta."""
    (mode,) = internal_modes(POLE_ON_CART, CART_FORCE, np.eye(4)[2:], LEAST)
    assert mode.rate == pytest.approx(np.sqrt(18))
    assert mode.states == (0, 1)


def test_no_optimum_holds_a_state_that_no_input_reaches() -> None:
    with pytest.raises(
        GainError, match=r"x3 grows by itself, at 0\.5 1/s, and no input reaches it"
    ):
        lqr(CARRIED, FORCE, np.eye(3), 1.0)
