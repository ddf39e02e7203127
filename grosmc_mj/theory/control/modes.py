"""Modes of a linear model that grow, and that no input or no output reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import name_list

# Least singular value, over the largest, of a matrix that has lost rank: rounding of exact
# Jacobians is far below it, and of finite differences, too.
_RANK = 1e-8
# Growth that an eigenvalue of zero may seem to have, over the norm of A.
_ZERO = 1e-6
# Part of the largest entry of a vector from which on a state counts as one of its mode.
_PART = 0.1


@dataclass(frozen=True)
class Mode:
    """A motion exp(rate t) of a linear model.

    Attributes:
        rate: Growth, the real part of the eigenvalue [1/s].
        states: Indices of the states that it consists of.
    """

    rate: float
    states: tuple[int, ...]

    def grows(self, names: Sequence[str]) -> str:
        """Its states with their verb.

        Args:
            names: Names of all states.
        """
        own = [names[index] for index in self.states]
        verb = "grows" if len(own) == 1 else "grow together"
        return f"{name_list(own)} {verb}"

    def unreached(self, names: Sequence[str]) -> str:
        """Sentence about a mode that no input reaches.

        Args:
            names: Names of all states.
        """
        itself = "itself"
        them = "it"
        if len(self.states) > 1:
            itself = "themselves"
            them = "them"
        return (
            f"{self.grows(names)} by {itself}, at {self.rate:.3g} 1/s, and no input reaches {them}"
        )


def unreached_modes(A: Array, B: Array, least: float) -> list[Mode]:
    """Modes of x' = A x + B u that grow and that no input reaches.

    By the test of Popov, Belevitch and Hautus: [A - lambda I, B] loses rank, and its left null
    vectors w give the w'x that move by themselves.

    Args:
        A: (n, n).
        B: (n, m).
        least: Growth from which on a mode counts [1/s].
    """
    A, scales = _balanced(A)
    B = B / scales[:, None]
    size = max(float(np.linalg.norm(A, 2)), least)
    columns = np.linalg.norm(B, axis=0)
    # Each input in a unit of its own; one that moves nothing stays zero.
    B = size * B / np.where(columns > 0, columns, 1.0)

    modes = []
    for eigenvalue in _growing(A, least):
        pencil = np.hstack([A - eigenvalue * np.eye(len(A)), B])
        left, values, _ = np.linalg.svd(pencil, full_matrices=False)
        lost = values <= _RANK * size
        if lost.any():
            modes.append(Mode(float(eigenvalue.real), _large(left[:, lost])))
    return _each_once(modes)


def internal_modes(A: Array, B: Array, T: Array, least: float) -> list[Mode]:
    """Modes of x' = A x + B u that grow while T x is held at zero by the input.

    T x has the outputs with their derivatives below the relative degree. On N, the null space of
    T, the input that keeps T x zero leaves x' = (A - B (T B)^+ T A) x: the zero dynamics.

    Args:
        A: (n, n).
        B: (n, m).
        T: (sum of r, n).
        least: Growth from which on a mode counts [1/s].
    """
    A, scales = _balanced(A)
    B = B / scales[:, None]
    T = T * scales
    N = scipy.linalg.null_space(T)
    if not N.size:
        return []

    drift = A @ N
    held = drift - B @ (np.linalg.pinv(T @ B) @ (T @ drift))
    inner = N.T @ held
    modes = []
    for eigenvalue in _growing(inner, least):
        _, values, right = np.linalg.svd(inner - eigenvalue * np.eye(len(inner)))
        lost = values <= _RANK * max(values[0], abs(eigenvalue))
        lost[-1] = True
        modes.append(Mode(float(eigenvalue.real), _large(N @ right[lost].conj().T)))
    return _each_once(modes)


def _balanced(A: Array) -> tuple[Array, Array]:
    """A in units of the states in which its rows and columns are alike, and these units, (n,)."""
    # Numbers near the ends of the floats overflow in it.
    with np.errstate(all="ignore"):
        balanced, (scales, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    if not np.isfinite(balanced).all() or not np.isfinite(scales).all():
        return A, np.ones(len(A))
    return balanced, scales


def _growing(A: Array, least: float) -> list[complex]:
    """Eigenvalues that grow, one of each pair."""
    least = max(least, _ZERO * float(np.linalg.norm(A, 2)))
    return [value for value in np.linalg.eigvals(A) if value.real > least and value.imag >= 0]


def _large(vectors: Array) -> tuple[int, ...]:
    """Rows of vectors, (n, k), with large entries."""
    sizes = np.abs(vectors).max(axis=1)
    return tuple(np.flatnonzero(sizes >= _PART * sizes.max()).tolist())


def _each_once(modes: list[Mode]) -> list[Mode]:
    """Modes without those of repeated eigenvalues, the fastest first."""
    kept: list[Mode] = []
    for mode in sorted(modes, key=lambda mode: -mode.rate):
        same = [other for other in kept if other.states == mode.states]
        if not any(np.isclose(other.rate, mode.rate, rtol=1e-6) for other in same):
            kept.append(mode)
    return kept
