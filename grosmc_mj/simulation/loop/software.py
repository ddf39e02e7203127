"""The software's half of a loop: estimators, filter and prediction around the law.

It reads measurements, its own outputs, its control period and the times that it knows of its loop;
never the true state, nor a number of the world's half.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numba import types

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import VECTOR, Matrix, Vector
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop.actuators import ACTUATOR
from grosmc_mj.simulation.loop.design_model import held
from grosmc_mj.simulation.loop.estimators import ESTIMATOR, KINDS, estimate, note_gains
from grosmc_mj.simulation.loop.kalman import filter_states, kalman_gain
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.prediction import LEARNING, expect, learn, predict
from grosmc_mj.simulation.loop.rows import numbers_dtype, ring, row_objects, rows_of, rows_type
from grosmc_mj.simulation.loop.task import LoopTask
from grosmc_mj.theory.control.matrices import copy
from grosmc_mj.theory.plants import System

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


class _KnownTimes(NamedTuple):
    """Times that the software knows of its loop, in timesteps.

    Attributes:
        to_output: From a sample to the arrival of its output.
        age: Age of its measurements.
    """

    to_output: int
    age: int

    @property
    def dead(self) -> int:
        """Dead time: from a measurement to the arrival of the output that follows it."""
        return self.to_output + self.age


def ideal_software(n: int, m: int) -> Software:
    """Software's half of an ideal loop of n states and m inputs: it has no parts."""
    nothing = np.zeros(0)
    return Software(
        address=0,
        setup=np.zeros(0, SETUP),
        states=np.zeros(0, STATE),
        inputs=np.zeros(0, INPUT),
        estimators=np.zeros(0, ESTIMATOR),
        gain=np.zeros((0, 0)),
        sent=ring(0, m),
        sent_at=ring(0, 1),
        seen=nothing,
        predicted=nothing,
        x=np.zeros(n),
        mean=np.zeros(m),
        advance=0,
        memory=nothing,
        p=nothing,
        own=nothing,
    )


def software_at_start(task: LoopTask) -> Software:
    """Software's half of a loop as a run begins, but for what it knows of the start.

    Raises:
        ArgumentError: If an estimator does not fit.
        GainError: If there is no Kalman filter.
    """
    n = len(task.system.states)
    m = len(task.system.inputs)
    times = _known_times(task)
    # Samples from the oldest output that still acts up to the present one: two more than whole
    # periods where samples are late, and one where a sample is looked at before its time.
    samples = times.dead // task.stride + 4
    return ideal_software(n, m)._replace(
        setup=_setup_row(task, times),
        states=_state_rows(task),
        inputs=_input_rows(task),
        estimators=_estimator_rows(task.loop, task.system),
        gain=_filter_gain(task),
        sent=ring(samples, m),
        sent_at=ring(samples, 1),
    )


def settle(software: Software, x0: Array) -> None:
    """Tell settled estimators and filters the true state at the start, (n,)."""
    estimators = software.estimators
    rates = x0[estimators["of"].astype(int)]
    estimators["rate"] = np.where(estimators["settled"] != 0.0, rates, 0.0)

    states = software.states
    states["observed"] = np.where(states["settled"] != 0.0, x0, 0.0)


def _known_times(task: LoopTask) -> _KnownTimes:
    """Times that the software knows; a lag counts as a delay of its time constants."""
    # A law that does not predict knows nothing of its loop.
    if not task.predicts:
        return _KnownTimes(0, 0)

    known = task.known
    h = task.timestep
    actuators = rows_of(task.known_actuators, ACTUATOR, h)
    delays = actuators["delay"] + actuators["lag"] / h * actuators["order"]
    oldest = max((sensor.delay for sensor in known.sensors), default=0.0)
    return _KnownTimes(
        to_output=round(known.computing.delay / h) + round(float(delays.max(initial=0.0))),
        age=round(oldest / h),
    )


def _setup_row(task: LoopTask, times: _KnownTimes) -> np.ndarray[Any, Any]:
    """Row of the software's own numbers, (1,)."""
    h = task.timestep
    laws = [part.law for part in task.loop.estimators]
    learning = 0.0
    if times.dead > 0:
        learning = 1.0 - math.exp(-LEARNING * task.period / (times.dead * h))

    row = np.zeros(1, SETUP)
    row["period"] = task.period
    row["tick"] = h
    row["stride"] = task.stride
    row["filters"] = "kalman" in laws
    row["observes"] = "eso" in laws
    row["predicts"] = task.predicts
    row["dead"] = times.dead
    row["age"] = times.age
    row["ahead"] = times.to_output * h
    row["learning"] = learning
    return row


def _state_rows(task: LoopTask) -> np.ndarray[Any, Any]:
    """Rows of the states, (n,)."""
    filters = [part for part in task.loop.estimators if part.law == "kalman"]
    filtered = set()
    for part in filters:
        filtered.update(part.of)

    rows = np.zeros(len(task.system.states), STATE)
    rows["sensor_period"] = [round(sensor.period / task.timestep) for sensor in task.sensors]
    rows["filtered"] = [state.name in filtered for state in task.system.states]
    rows["settled"] = any(part.settled for part in filters)
    return rows


def _input_rows(task: LoopTask) -> np.ndarray[Any, Any]:
    """Rows of the inputs, (m,)."""
    rows = np.zeros(len(task.system.inputs), INPUT)
    rows["rest"] = task.rest
    rows["known_limit"] = np.inf
    if task.predicts:
        rows["known_limit"] = [actuator.limit for actuator in task.known_actuators]
    return rows


def _estimator_rows(loop: Loop, system: System) -> np.ndarray[Any, Any]:
    """Rows of the estimators of rates, one for each rate.

    Raises:
        ArgumentError: If a state is no rate, or needs a measurement that there is not.
    """
    names = [state.name for state in system.states]
    positions = {names[rate]: position for rate, position in system.rate_positions.items()}
    rates = [(part, name) for part in loop.estimators if part.law != "kalman" for name in part.of]
    for part, name in rates:
        if name not in positions:
            raise ArgumentError(
                f"estimator: {part.law} gives a rate: {name!r} is none of "
                f"{', '.join(positions) or 'them: no state is the rate of another'}"
            )
    _refuse_unfit_estimators(loop)

    rows = np.zeros(len(rates), ESTIMATOR)
    rows["kind"] = [KINDS.index(part.law) for part, _ in rates]
    rows["number"] = [part.number for part, _ in rates]
    rows["of"] = [names.index(name) for _, name in rates]
    rows["position"] = [positions[name] for _, name in rates]
    rows["settled"] = [part.settled for part, _ in rates]
    return rows


def _refuse_unfit_estimators(loop: Loop) -> None:
    """Refuse estimators beside sensors, or two filters, that do not go together."""
    measured = {sensor.of for sensor in loop.sensors}
    filters = 0
    for part in loop.estimators:
        if part.law == "kalman":
            filters += 1
            continue
        for name in part.of:
            if name in measured:
                raise ArgumentError(
                    f"estimator: {name!r} has a sensor too, which would go unheard: leave one out"
                )
    if filters > 1:
        raise ArgumentError("estimator: two filters by kalman: give one of them all states")

    slow = [sensor.of for sensor in loop.sensors if sensor.period]
    paced = [part.law for part in loop.estimators if part.law in ("eso", "kalman")]
    if slow and paced:
        raise ArgumentError(
            f"estimator: {paced[0]} runs at the law's pace: the sensor of {slow[0]} has a period "
            "of its own"
        )


def _filter_gain(task: LoopTask) -> Array:
    """Gain of the Kalman filter, (n, n); zero on states without a sensor, and without a filter.

    Raises:
        ArgumentError: If nothing is measured, or without noise.
        GainError: If there is no such filter.
    """
    names = [state.name for state in task.system.states]
    gain = np.zeros((len(names), len(names)))
    loads = [part.number for part in task.loop.estimators if part.law == "kalman"]
    if not loads:
        return gain

    sensors = task.loop.sensors
    if not sensors:
        raise ArgumentError(
            "estimator: kalman goes by sensors with noise or resolution: there is no [[sensor]]"
        )
    for sensor in sensors:
        if not sensor.noise and not sensor.resolution:
            raise ArgumentError(
                "estimator: kalman goes by sensors with noise or resolution: the sensor of "
                f"{sensor.of} has neither"
            )

    measured = [names.index(sensor.of) for sensor in sensors]
    # A reading rounded to q is off by q / sqrt(12).
    variances = np.array([part.noise**2 + part.resolution**2 / 12 for part in sensors])
    assert task.model is not None
    A, B = held(task.controller, task.model, task.rest, task.period)
    gain[:, measured] = kalman_gain(A, B, measured, variances, loads[0])
    return gain
