"""The optimum that the chapter makes robust: LQR and its nominal trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from grosmc_mj.ground.arguments import reals
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, GainError, array_text, value_text
from grosmc_mj.theory.control.modes import unreached_modes


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
        h = 0.0
        if len(time) > 1:
            h = time[1] - time[0]
        multiples = np.arange(len(time)) * h
        if not np.allclose(time, multiples, rtol=1e-9, atol=0):
            raise ArgumentError("the optimal trajectory needs equally spaced instants from t = 0")

        rows = np.asarray(x0, float)[None]
        closed_loop = self.closed_loop.tobytes()
        while len(rows) < len(time):
            transition = _exponential(closed_loop, self.A.shape, h * len(rows))
            rows = np.concatenate([rows, rows @ transition.T])
        return rows[: len(time)]


@lru_cache(maxsize=1024)
def _exponential(matrix: bytes, shape: tuple[int, ...], t: float) -> Array:
    """exp(A t), cached: all runs of one design at one timestep ask for the same matrices."""
    A = np.frombuffer(matrix).reshape(shape)
    return scipy.linalg.expm(A * t)


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
    return lqr_of_states(A, B, Q, R, names=())


def lqr_of_states(
    A: ArrayLike,
    B: ArrayLike,
    Q: ArrayLike,
    R: ArrayLike,
    *,
    names: Sequence[str],
) -> LqrDesign:
    """Design the optimal law as ``lqr``, with the names of the states in its messages.

    Args:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: Positive semidefinite weight of the state, (n, n).
        R: Positive definite weight of the input, (m, m) or a number.
        names: Names of the states; empty for x1, x2 ...

    Raises:
        GainError: As ``lqr`` does.
    """
    A, B, Q, R = _checked(A, B, Q, R)
    try:
        # Weights near the ends of the floats overflow in it, and the poles below tell.
        with np.errstate(all="ignore"):
            P = scipy.linalg.solve_continuous_are(A, B, Q, R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise GainError(_unsolvable(A, B, Q, error, names)) from error

    K = np.linalg.solve(R, B.T @ P)
    design = LqrDesign(A, B, Q, R, K, P)
    # Q does not weigh the mode of a pole on the axis; rounding puts the pole within this of zero.
    rounding = 1e-9 * max(1.0, float(np.abs(A).max()))
    if design.poles.real.max() > -rounding:
        reason = f"closed-loop poles {array_text(design.poles)}"
        raise GainError(_unsolvable(A, B, Q, reason, names))
    return design


def design_of_gain(
    A: Array,
    B: Array,
    Q: ArrayLike,
    R: ArrayLike,
    K: Array,
) -> LqrDesign:
    """Design of a stable feedback u = -K x whose gain is given, with its cost by the index (4).

    P solves Lyapunov's equation instead of the Riccati equation: x0' P x0 / 2 is the cost of this
    feedback, not the least one.

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
        raise GainError(f"K = {array_text(K)} does not stabilize A - B K")

    weight = Q + K.T @ R @ K
    P = scipy.linalg.solve_continuous_lyapunov(closed.T, -weight)
    return LqrDesign(A, B, Q, R, K, P)


def _checked(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike
) -> tuple[Array, Array, Array, Array]:
    """A, B, Q, R of a design; a number for R weighs every input alike.

    Raises:
        GainError: If shapes do not fit or Q or R is not definite as needed.
    """
    state = np.atleast_2d(reals(A))
    input_matrix = np.atleast_2d(reals(B))
    state_weight = np.atleast_2d(reals(Q))
    input_weight = reals(R)
    n = len(state)
    m = input_matrix.shape[-1]
    if input_weight.ndim == 0:
        input_weight = input_weight * np.eye(m)
    else:
        input_weight = np.atleast_2d(input_weight)

    _require_matrix("A", A, state, (n, n))
    _require_matrix("B", B, input_matrix, (n, m))
    _require_matrix("Q", Q, state_weight, (n, n))
    _require_matrix("R", R, input_weight, (m, m))

    # Rounding of a product C'C may leave an eigenvalue this far below zero.
    size = max(1.0, float(np.abs(state_weight).max()))
    rounding = 1e-12 * size
    if np.linalg.eigvalsh(state_weight).min() < -rounding:
        raise GainError(f"LQR: Q must be positive semidefinite, is {array_text(state_weight)}")
    if np.linalg.eigvalsh(input_weight).min() <= 0:
        raise GainError(f"LQR: R must be positive definite, is {array_text(input_weight)}")
    return state, input_matrix, state_weight, input_weight


def _require_matrix(
    name: str,
    argument: ArrayLike,
    matrix: Array,
    shape: tuple[int, int],
) -> None:
    """Refuse a matrix with entries that are not finite, or of another shape."""
    if not np.all(np.isfinite(matrix)):
        raise GainError(f"LQR: {name} = {value_text(argument)} must be a matrix of finite numbers")
    if matrix.shape != shape:
        raise GainError(f"LQR: {name} has shape {matrix.shape}, must be {shape}")


def _unsolvable(
    A: Array,
    B: Array,
    Q: Array,
    reason: object,
    names: Sequence[str],
) -> str:
    """Message about a plant and weights without a stabilizing optimum, in one line."""
    unreached = unreached_modes(A, B, 0.0)
    if unreached:
        names = names or [f"x{index}" for index in range(1, len(A) + 1)]
        return f"LQR: {unreached[0].unreached(names)}: no feedback holds it"
    return (
        f"LQR: no stabilizing solution of the Riccati equation for A = {array_text(A)}, "
        f"B = {array_text(B)}, Q = {array_text(Q)}: (A, B) must be stabilizable and (A, Q) "
        f"detectable ({reason})"
    )
