"""The optimum that the chapter makes robust: LQR and its nominal trajectory."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from grosmc_mj.arguments import reals
from grosmc_mj.arrays import Array
from grosmc_mj.errors import ArgumentError, GainError, shown


class LqrDesign(NamedTuple):
    """An LQR design for x' = A x + B u.

    Attributes:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: State weight, (n, n).
        R: Input weight, (m, m).
        K: Gain of u = -K x, (m, n): R^-1 B' P of eq. (5).
        P: Solution of the Riccati equation (6), (n, n).
    """

    A: Array
    B: Array
    Q: Array
    R: Array
    K: Array
    P: Array

    @property
    def closed_loop(self) -> Array:
        """A - B K of eqs. (7), (30) and (50), (n, n)."""
        return self.A - self.B @ self.K

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A - B K [1/s], (n,)."""
        return np.linalg.eigvals(self.closed_loop).astype(complex)

    def optimal_cost(self, x0: ArrayLike) -> float:
        """J* = x0' P x0 / 2, the least value of the index (4)."""
        x0 = np.asarray(x0, float)
        return float(0.5 * x0 @ self.P @ x0)

    def optimal_trajectory(self, x0: ArrayLike, time: Array) -> Array:
        """x*(t) = exp((A - B K) t) x0 of eqs. (7), (30) and (50), exact at every instant.

        The rows known so far give as many more through one exponential, so N instants take
        log2 N of them.

        Args:
            x0: Start, (n,).
            time: Equally spaced instants from 0 [s], (N,).

        Returns:
            x*, (N, n).

        Raises:
            ArgumentError: If the instants are not equally spaced from 0.
        """
        time = np.asarray(time, float)
        h = time[1] - time[0] if len(time) > 1 else 0.0
        if not np.allclose(time, np.arange(len(time)) * h, rtol=1e-9, atol=0):
            raise ArgumentError("the optimal trajectory needs equally spaced instants from t = 0")
        rows = np.asarray(x0, float)[None]
        generator = self.closed_loop.tobytes()
        while len(rows) < len(time):
            transition = _exponential(generator, self.A.shape, h * len(rows))
            rows = np.concatenate([rows, rows @ transition.T])
        return rows[: len(time)]


@lru_cache(maxsize=1024)
def _exponential(matrix: bytes, shape: tuple[int, ...], t: float) -> Array:
    """exp(A t); the runs of one design at one timestep ask for the same ones."""
    return scipy.linalg.expm(np.frombuffer(matrix).reshape(shape) * t)


def lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> LqrDesign:
    """Design the optimal law (5) for the index (4) from the Riccati equation (6).

    Args:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: Positive semidefinite weight of the state, (n, n).
        R: Positive definite weight of the input, (m, m) or a number.

    Raises:
        GainError: If shapes do not fit, Q or R is not definite as needed, or (A, B) is not
            stabilizable.
    """
    A, B, Q, R = _checked(A, B, Q, R)
    try:
        P = scipy.linalg.solve_continuous_are(A, B, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise GainError(_unsolvable(A, B, Q, error)) from error
    design = LqrDesign(A, B, Q, R, np.linalg.solve(R, B.T @ P), P)
    # A pole on the axis is one that Q does not see; rounding puts it within this of zero.
    if design.poles.real.max() > -1e-9 * max(1.0, float(np.abs(A).max())):
        raise GainError(_unsolvable(A, B, Q, f"closed-loop poles {design.poles.tolist()}"))
    return design


def priced(A: Array, B: Array, Q: ArrayLike, R: ArrayLike, K: Array) -> LqrDesign:
    """A given stable feedback u = -K x with what the index (4) says of it.

    P is not the Riccati equation's but the cost of this feedback, from Lyapunov's equation.

    Args:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: Weight of the state, (n, n).
        R: Weight of the input, (m, m).
        K: Gain, (m, n).

    Raises:
        GainError: If A - B K is not stable.
    """
    A, B, Q, R = _checked(A, B, Q, R)
    closed = A - B @ K
    if np.linalg.eigvals(closed).real.max() >= 0:
        raise GainError(f"K = {K.tolist()} does not stabilize A - B K")
    P = scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + K.T @ R @ K))
    return LqrDesign(A, B, Q, R, K, P)


def _checked(*matrices: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """A, B, Q, R of a design; a number for R weighs every input alike.

    Raises:
        GainError: If shapes do not fit or Q or R is not definite as needed.
    """
    *system, R = map(reals, matrices)
    A, B, Q = map(np.atleast_2d, system)
    n, m = len(A), B.shape[-1]
    R = R * np.eye(m) if R.ndim == 0 else np.atleast_2d(R)
    shapes = {"A": (A, (n, n)), "B": (B, (n, m)), "Q": (Q, (n, n)), "R": (R, (m, m))}
    for (name, (matrix, shape)), value in zip(shapes.items(), matrices, strict=True):
        if not np.all(np.isfinite(matrix)):
            raise GainError(f"LQR: {name} = {shown(value)} must be a matrix of finite numbers")
        if matrix.shape != shape:
            raise GainError(f"LQR: {name} has shape {matrix.shape}, must be {shape}")
    if np.linalg.eigvalsh(Q).min() < -1e-12 * max(1.0, float(np.abs(Q).max())):
        raise GainError(f"LQR: Q must be positive semidefinite, is {Q.tolist()}")
    if np.linalg.eigvalsh(R).min() <= 0:
        raise GainError(f"LQR: R must be positive definite, is {R.tolist()}")
    return A, B, Q, R


def _unsolvable(A: Array, B: Array, Q: Array, why: object) -> str:
    """One line about a pair without a stabilizing optimum."""
    return (
        f"LQR: no stabilizing solution of the Riccati equation for A = {A.tolist()}, "
        f"B = {B.tolist()}, Q = {Q.tolist()}: (A, B) must be stabilizable and (A, Q) detectable "
        f"({why})"
    )
