"""The numbers of a loop as a run begins: rows of its parts, and memory for delayed signals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.design_model import DesignModel
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.errors import ArgumentError
from grosmc_mj.loop.actuators import ACTUATOR, Actuator, kept_in_a_timestep
from grosmc_mj.loop.delay import COMPUTER
from grosmc_mj.loop.design_model import held
from grosmc_mj.loop.estimators import ESTIMATOR, KINDS, MEMORY
from grosmc_mj.loop.kalman import kalman_gain
from grosmc_mj.loop.loop import Loop
from grosmc_mj.loop.prediction import LEARNING
from grosmc_mj.loop.rows import rows_of
from grosmc_mj.loop.sensors import SENSOR, Sensor
from grosmc_mj.loop.stages import LoopRun
from grosmc_mj.plants import Signal, System


class LoopTask(NamedTuple):
    """A loop and the runs that it is for.

    Attributes:
        controller: Controller in the loop, told its control period.
        loop: Parts of the loop.
        known: Loop that the law knows.
        system: System of the plant.
        model: Design model; None where nothing runs it.
        timestep: [s].
        period: Control period [s].
        stride: Timesteps in a control period.
        run: Number of the run.
        predicts: Whether the law gets the state at the instant when its output arrives.
    """

    controller: Controller
    loop: Loop
    known: Loop
    system: System
    model: DesignModel | None
    timestep: float
    period: float
    stride: int
    run: int
    predicts: bool


class _KnownTimes(NamedTuple):
    """Times that a predicting law knows of its loop, in timesteps.

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


def ideal_loop(n: int, m: int) -> LoopRun:
    """Ideal loop of n states and m inputs: without sensors the kernel leaves it out."""
    nothing = np.zeros(0)
    return LoopRun(
        address=0,
        computer=np.zeros(0, COMPUTER),
        sensors=np.zeros(0, SENSOR),
        estimators=np.zeros(0, ESTIMATOR),
        actuators=np.zeros(0, ACTUATOR),
        gain=np.zeros((0, 0)),
        past=_ring(0, n),
        true=np.zeros(n),
        queue=_ring(0, m),
        seen=nothing,
        predicted=nothing,
        x=np.zeros(n),
        mean=np.zeros(m),
        advance=0,
        memory=nothing,
        p=nothing,
        own=nothing,
    )


def loop_at_start(task: LoopTask) -> LoopRun:
    """Numbers of a loop as a run begins.

    Raises:
        ArgumentError: If an estimator does not fit.
        GainError: If there is no Kalman filter.
    """
    loop = task.loop
    h = task.timestep
    sensors = _one_each(task.system.states, Sensor, loop.sensors)
    actuators = _one_each(task.system.inputs, Actuator, loop.actuators)
    rest = _input_at_rest(task.controller, len(actuators))
    dead = _known_times(task).dead if task.predicts else 0

    oldest = max(round(part.delay / h) + round(part.period / h) for part in sensors)
    latest = round(loop.computing.delay / h) + max(round(part.delay / h) for part in actuators)
    return ideal_loop(len(sensors), len(actuators))._replace(
        computer=_computer_row(task),
        sensors=_sensor_rows(task, sensors),
        estimators=_estimator_rows(loop, task.system),
        actuators=_actuator_rows(task, actuators, rest),
        gain=_filter_gain(task, rest),
        past=_ring(oldest, len(sensors)),
        queue=_ring(max(latest, dead + task.stride), len(actuators)),
    )


def _ring(steps: int, columns: int) -> Array:
    """Memory for the numbers of so many timesteps, in a power of two rows."""
    return np.zeros((1 << steps.bit_length(), columns))


def _one_each(signals: Sequence[Signal], kind: Any, parts: Sequence[Any]) -> list[Any]:
    """Part of each state or input, an ideal one where there is none."""
    named = {part.of: part for part in parts}
    return [named.get(signal.name, kind(signal.name)) for signal in signals]


def _input_at_rest(controller: Controller, m: int) -> Array:
    """Input before the first output arrives, (m,): that of an operating point, or zero."""
    if controller.design is not None and isinstance(controller.design.error, StateCoordinates):
        return np.zeros(m) + controller.parameters.reference.u
    return np.zeros(m)


def _known_times(task: LoopTask) -> _KnownTimes:
    """Times of the loop that the law knows; a lag counts as a delay of its time constants."""
    known = task.known
    h = task.timestep
    actuators = rows_of(_one_each(task.system.inputs, Actuator, known.actuators), ACTUATOR, h)
    delays = actuators["delay"] + actuators["lag"] / h * actuators["order"]
    return _KnownTimes(
        to_output=round(known.computing.delay / h) + round(float(delays.max(initial=0.0))),
        age=_oldest(known, h),
    )


def _oldest(loop: Loop, h: float) -> int:
    """Age of the oldest measurement, in timesteps of h [s]."""
    return round(max((sensor.delay for sensor in loop.sensors), default=0.0) / h)


def _computer_row(task: LoopTask) -> np.ndarray[Any, Any]:
    """Row of the computer, (1,)."""
    loop = task.loop
    h = task.timestep
    filters = [part for part in loop.estimators if part.law == "kalman"]
    # A law that does not predict knows nothing of its loop.
    times = _known_times(task) if task.predicts else _KnownTimes(0, 0)
    learning = 0.0
    if times.dead > 0:
        learning = 1.0 - math.exp(-LEARNING * task.period / (times.dead * h))
    return rows_of(
        [loop.computing],
        COMPUTER,
        h,
        timestep=h,
        period=task.period,
        stride=task.stride,
        seed=loop.seed,
        run=task.run,
        filters=bool(filters),
        settled=any(part.settled for part in filters),
        oldest=_oldest(loop, h),
        observes=any(part.law == "eso" for part in loop.estimators),
        predicts=task.predicts,
        dead=times.dead,
        age=times.age,
        ahead=times.to_output * h,
        learning=learning,
    )


def _sensor_rows(task: LoopTask, sensors: Sequence[Sensor]) -> np.ndarray[Any, Any]:
    """Rows of the sensors, (n,)."""
    filtered = set()
    for part in task.loop.estimators:
        if part.law == "kalman":
            filtered.update(part.of)
    return rows_of(
        sensors,
        SENSOR,
        task.timestep,
        filtered=[state.name in filtered for state in task.system.states],
    )


def _actuator_rows(
    task: LoopTask, actuators: Sequence[Actuator], rest: Array
) -> np.ndarray[Any, Any]:
    """Rows of the actuators, (m,), with the input at rest, (m,)."""
    h = task.timestep
    known_limit: Any = np.inf
    if task.predicts and task.known.actuators:
        known = _one_each(task.system.inputs, Actuator, task.known.actuators)
        known_limit = [actuator.limit for actuator in known]
    return rows_of(
        actuators,
        ACTUATOR,
        h,
        rest=rest,
        output=rest,
        rated=rest,
        first=rest,
        second=rest,
        kept=[kept_in_a_timestep(actuator, h) for actuator in actuators],
        known_limit=known_limit,
    )


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

    rows = []
    unset = (0.0,) * len(MEMORY)
    for part, name in rates:
        kind = KINDS.index(part.law)
        row = (kind, part.number, names.index(name), positions[name], part.settled)
        rows.append(row + unset)
    return np.array(rows, ESTIMATOR)


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


def _filter_gain(task: LoopTask, rest: Array) -> Array:
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
    A, B = held(task.controller, task.model, rest, task.period)
    gain[:, measured] = kalman_gain(A, B, measured, variances, loads[0])
    return gain
