"""The steady-state Kalman filter of the design model."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.errors import GainError, one_line
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.prediction import move_by_a_period

# Larger poles of a filter are 1 up to the rounding of the differences in A and B.
_FADES = 1 - 1e-9


@jitable
def filter_states(i: int, t: float, loop: Any) -> None:
    """Step the filter at the sample of timestep i; its estimates go into ``loop.seen``."""
    q = loop.computer[0]
    n = len(loop.sensors)
    # Until a first measurement arrives there is nothing to correct with.
    fresh = q.sample == 0.0 or i > q.oldest
    for j in range(n):
        loop.x[j] = loop.sensors[j].observed
        if q.sample == 0.0 and q.settled != 0.0:
            loop.x[j] = loop.true[j]
    if q.sample > 0.0 and fresh:
        move_by_a_period(i, t, loop)
    for j in range(n):
        sensor = loop.sensors[j]
        sensor.observed = loop.x[j]
        for k in range(n):
            if fresh and loop.gain[j, k] != 0.0:
                sensor.observed += loop.gain[j, k] * (loop.seen[k] - loop.x[k])
    for j in range(n):
        if loop.sensors[j].filtered != 0.0:
            loop.seen[j] = loop.sensors[j].observed


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
