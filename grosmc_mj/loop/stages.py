"""The loop's stages in the kernel: measure, estimate, predict, delay, actuate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import numba
from numba.core import types

from grosmc_mj.arrays import Array
from grosmc_mj.control.matrices import copy
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.actuators import ACTUATOR
from grosmc_mj.loop.delay import COMPUTER
from grosmc_mj.loop.estimators import ESTIMATOR, estimate, note_gains
from grosmc_mj.loop.kalman import filter_states
from grosmc_mj.loop.prediction import expect, learn, predict
from grosmc_mj.loop.sensors import SENSOR, measure, ring_row

_FLOAT = types.float64
_VECTOR = types.Array(_FLOAT, 1, "C")
# Signature of a step of ``design_model``: (t, x, u, h, address of the ``LoopRun``).
ADVANCE = types.void(_FLOAT, _VECTOR, _VECTOR, _FLOAT, types.voidptr)

Vector = Annotated[Array, _VECTOR]
Matrix = Annotated[Array, types.Array(_FLOAT, 2, "C")]


def _rows(dtype: Any) -> types.Type:
    return types.Array(numba.from_dtype(dtype), 1, "C")


class LoopRun(NamedTuple):
    """A loop of n states and m inputs in a run; an ideal one has no sensors.

    Attributes:
        address: Address of this structure, for ``advance``.
        computer: One row of ``COMPUTER``.
        sensors: Rows of ``SENSOR``, (n,).
        estimators: Rows of ``ESTIMATOR``, one for each rate that is estimated.
        actuators: Rows of ``ACTUATOR``, (m,).
        gain: Of the Kalman filter on the innovation of each state, (n, n).
        past: States of the last timesteps as sensors measure them, with the disturbances of
            their measurement, (a power of two, n).
        true: True state, (n,).
        queue: Outputs of the last timesteps, (a power of two, m).
        seen: State by sensors and estimators at the last sample, (n,).
        predicted: State that the law gets, (n,); room to compute in before that.
        x: The design model's state, (n,).
        mean: Input under which it moves, (m,).
        advance: Moves it by a time h, see ``ADVANCE``.
        memory: The law's memory.
        p: The law's numbers.
        own: The design model's numbers.
    """

    address: Annotated[Any, types.voidptr]
    computer: Annotated[Any, _rows(COMPUTER)]
    sensors: Annotated[Any, _rows(SENSOR)]
    estimators: Annotated[Any, _rows(ESTIMATOR)]
    actuators: Annotated[Any, _rows(ACTUATOR)]
    gain: Matrix
    past: Matrix
    true: Vector
    queue: Matrix
    seen: Vector
    predicted: Vector
    x: Vector
    mean: Vector
    advance: Annotated[Any, types.FunctionType(ADVANCE)]
    memory: Vector
    p: Vector
    own: Vector

    def uncompiled(self) -> LoopRun:
        """Copy with rows as Python objects, for the stages as plain Python."""
        rows = {}
        for name in ("computer", "sensors", "estimators", "actuators"):
            table = getattr(self, name)
            columns = table.dtype.names
            rows[name] = [
                SimpleNamespace(**dict(zip(columns, row, strict=True))) for row in table.tolist()
            ]
        return self._replace(**rows)


@jitable
def remember(i: int, x: Any, disturbance: Any, loop: Any) -> None:
    """Keep the state of timestep i, (n,), for sensors whose measurements are late.

    A sensor reads the state with the disturbance of its measurement, (n,) or nothing, at the
    instant at which it measures. Estimators that start settled start from the true state.
    """
    row = ring_row(i, loop.past)
    for j in range(len(loop.sensors)):
        loop.true[j] = x[j]
        loop.past[row, j] = x[j]
    for j in range(len(disturbance)):
        loop.past[row, j] += disturbance[j]


@jitable
def observe(i: int, loop: Any) -> float:
    """Write the state that the law gets at a sample in timestep i into ``loop.predicted``.

    Returns:
        The time for which the law gets it [s]: of the sample, or of the arrival of its output.
    """
    q = loop.computer[0]
    t = int(q.sample) * q.period
    if q.sample > 0.0 and q.observes != 0.0:
        note_gains(i, t, loop)
    if q.sample > 0.0 and q.predicts != 0.0:
        expect(i, t, loop)
    measure(i, loop)
    estimate(i, loop)
    if q.filters != 0.0:
        filter_states(i, t, loop)
    # The filter's model moves in ``x`` only: ``predicted`` is still that of ``expect``.
    if q.sample > 0.0 and q.predicts != 0.0 and i - q.stride >= q.age:
        learn(loop)
    copy(loop.seen, loop.x)
    if q.predicts != 0.0:
        predict(i, t, loop)
    copy(loop.x, loop.predicted)
    return t + q.ahead
