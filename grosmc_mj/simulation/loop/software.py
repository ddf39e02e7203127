"""The software's half of a loop: estimators, filter and prediction around the law.

It reads measurements, its own outputs, its control period and the times that it knows of its loop;
never the true state, nor a number of the world's half.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from numba import types

from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import VECTOR, Matrix, Vector
from grosmc_mj.simulation.loop.estimators import ESTIMATOR, estimate, note_gains
from grosmc_mj.simulation.loop.kalman import filter_states
from grosmc_mj.simulation.loop.prediction import expect, learn, predict
from grosmc_mj.simulation.loop.rows import numbers_dtype, row_objects, rows_type
from grosmc_mj.theory.control.matrices import copy

# Signature of a step of the design model: (t, x, u, h, address of the ``Software``).
ADVANCE = types.void(types.float64, VECTOR, VECTOR, types.float64, types.voidptr)

# Row of the software's own numbers.
SETUP = numbers_dtype(
    # Control period [s], tick of the computer's clock [s], ticks in a control period.
    "period",
    "tick",
    "stride",
    # 1 if there is a Kalman filter, an extended-state observer, a prediction; else 0.
    "filters",
    "observes",
    "predicts",
    # Times that it knows: dead time from a measurement to the arrival of the output that follows
    # it, and the age of the measurements, a part of that, both in ticks; time from a sample to the
    # arrival of its output [s].
    "dead",
    "age",
    "ahead",
    # Share of the model's error that the prediction learns in a period.
    "learning",
)
# Row of each state: period of its sensor in ticks, 0 for one that is read at each sample; 1 if the
# Kalman filter estimates it; 1 if that begins settled. Memory of a run, in the state's unit: the
# filter's estimate; the rate that the design model misses, per second; the change in a period by
# the model.
STATE = numbers_dtype("sensor_period", "filtered", "settled", "observed", "missed", "gained")
# Row of each input, in its unit: the input before the first output arrives, and the largest |u|
# that the actuator gives, as the software knows it.
INPUT = numbers_dtype("rest", "known_limit")


class Software(NamedTuple):
    """Software around the law of a run, for n states and m inputs.

    Attributes:
        address: Address of this structure, for ``advance``.
        setup: One row of ``SETUP``, (1,).
        states: Rows of ``STATE``, (n,).
        inputs: Rows of ``INPUT``, (m,).
        estimators: Rows of ``ESTIMATOR``, one for each rate that is estimated.
        gain: Gain of the Kalman filter on the innovation of each state, (n, n).
        sent: Outputs of the last samples, in the units of the inputs, (a power of two, m).
        sent_at: The clock as each of them was sent, in ticks, (a power of two, 1).
        seen: State by sensors and estimators at the last sample, (n,).
        predicted: State that the law gets, (n,); room to compute in before that.
        x: State of the design model, (n,).
        mean: Input under which it moves, (m,).
        advance: Function that moves it by a time h, see ``ADVANCE``.
        memory: Memory of the law, flat.
        p: Numbers of the law, flat.
        own: Numbers of the design model, flat.
    """

    address: Annotated[Any, types.voidptr]
    setup: Annotated[Any, rows_type(SETUP)]
    states: Annotated[Any, rows_type(STATE)]
    inputs: Annotated[Any, rows_type(INPUT)]
    estimators: Annotated[Any, rows_type(ESTIMATOR)]
    gain: Matrix
    sent: Matrix
    sent_at: Matrix
    seen: Vector
    predicted: Vector
    x: Vector
    mean: Vector
    advance: Annotated[Any, types.FunctionType(ADVANCE)]
    memory: Vector
    p: Vector
    own: Vector

    def uncompiled(self) -> Software:
        """Copy with rows as Python objects, for the stages as plain Python."""
        return self._replace(
            setup=row_objects(self.setup),
            states=row_objects(self.states),
            inputs=row_objects(self.inputs),
            estimators=row_objects(self.estimators),
        )


@jitable
def observe(k: int, measured: Any, software: Any) -> float:
    """Write the state that the law gets at sample k into ``software.predicted``.

    Args:
        k: Number of the sample, from 0.
        measured: What the sensors give, see ``Measured``.
        software: Estimators, filter and prediction.

    Returns:
        The time for which the law gets it [s]: of the sample, or of the arrival of its output.
    """
    setup = software.setup[0]
    clock = int(measured.clock[0])
    t = k * setup.period

    # Expectations of the design model for this sample.
    if k > 0 and setup.observes != 0.0:
        note_gains(k, clock, software)
    if k > 0 and setup.predicts != 0.0:
        expect(k, clock, software)

    copy(measured.y, software.seen)
    estimate(k, measured, software)
    if setup.filters != 0.0:
        filter_states(k, measured, software)

    # The filter's model moves in ``x`` only: ``predicted`` is still that of ``expect``.
    if k > 0 and setup.predicts != 0.0 and clock - setup.stride >= setup.age:
        learn(software)
    copy(software.seen, software.x)
    if setup.predicts != 0.0:
        predict(k, clock, software)
    copy(software.x, software.predicted)
    return t + setup.ahead
