"""The steady-state Kalman filter of the design model."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import GainError, one_line
from grosmc_mj.simulation.loop.prediction import move_by_a_period

# Larger poles of a filter are 1 up to the rounding of the differences in A and B.
_FADES = 1 - 1e-9


@jitable
def filter_states(k: int, measured: Any, software: Any) -> None:
    """Step the filter at sample k; its estimates go into ``software.seen``."""
    n = len(software.states)
    # Until a first measurement arrives there is nothing to correct with.
    fresh = True
    for j in range(n):
        fresh = fresh and measured.fresh[j] > 0.0

    # Prediction.
    for j in range(n):
        software.x[j] = software.states[j].observed
    if k > 0 and fresh:
        move_by_a_period(k, int(measured.clock[0]), software)

    # Correction.
    for j in range(n):
        state = software.states[j]
        state.observed = software.x[j]
        for i in range(n):
            if fresh and software.gain[j, i] != 0.0:
                state.observed += software.gain[j, i] * (software.seen[i] - software.x[i])
    for j in range(n):
        if software.states[j].filtered != 0.0:
            software.seen[j] = software.states[j].observed


def kalman_gain(
    A: Array,
    B: Array,
    measured: list[int],
    variances: Array,
    load: float,
) -> Array:
    """Steady-state Kalman gain of x_{k+1} = A x + B (u + w), y = C x + v.

    Args:
        A: (n, n).
        B: (n, m).
        measured: Indices of the measured states.
        variances: Variances of their noise v, (len(measured),).
        load: Standard deviation of each entry of w.

    Returns:
        Gain on y - C x of the predicted state, (n, len(measured)).

    Raises:
        GainError: If there is no such filter.
    """
    C = np.eye(len(A))[measured]
    noise = np.diag(variances)
    try:
        # Its balancing overflows where noise and load are too far apart.
        with np.errstate(all="ignore"):
            P = scipy.linalg.solve_discrete_are(A.T, C.T, load**2 * B @ B.T, noise)
    except (np.linalg.LinAlgError, ValueError, OverflowError) as error:
        raise GainError(
            "kalman: no steady filter: what has a [[sensor]] does not determine the other states; "
            f"measure another one ({one_line(str(error))})"
        ) from None
    gain = P @ C.T @ np.linalg.inv(C @ P @ C.T + noise)
    # Where noise and load are too far apart the solver returns numbers that are no solution.
    largest_pole = np.inf
    if np.all(np.isfinite(gain)):
        largest_pole = np.abs(np.linalg.eigvals(A - gain @ C @ A)).max()
    if not largest_pole < _FADES:
        raise GainError(
            "kalman: no steady filter for what is measured: noise and load are too far apart, or "
            "a state that the load does not reach is not seen"
        )
    return gain
