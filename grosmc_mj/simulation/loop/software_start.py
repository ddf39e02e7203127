"""The software's half of a loop as a run begins: rows of its parts, and room for its outputs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.simulation.loop.actuators import ACTUATOR
from grosmc_mj.simulation.loop.design_model import held
from grosmc_mj.simulation.loop.estimators import ESTIMATOR, KINDS
from grosmc_mj.simulation.loop.kalman import kalman_gain
from grosmc_mj.simulation.loop.loop import Loop
from grosmc_mj.simulation.loop.prediction import LEARNING
from grosmc_mj.simulation.loop.ring import ring
from grosmc_mj.simulation.loop.rows import rows_of
from grosmc_mj.simulation.loop.software import INPUT, SETUP, STATE, Software
from grosmc_mj.simulation.loop.task import LoopTask
from grosmc_mj.theory.plants import System


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
