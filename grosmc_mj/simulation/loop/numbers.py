"""What a law in its loop needs to know, and what it remembers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.plants import System
from grosmc_mj.simulation.loop.parts import Actuator, Estimator, Loop, Sensor, steps_in

# How estimators of a rate are told apart in compiled code.
DIFFERENCE, FILTERED, LEVANT, HIGH_GAIN, ESO = 0.0, 1.0, 2.0, 3.0, 4.0
_KINDS = {
    "difference": DIFFERENCE,
    "filtered": FILTERED,
    "levant": LEVANT,
    "high-gain": HIGH_GAIN,
    "eso": ESO,
}


@dataclass(frozen=True, eq=False)
class LoopNumbers:
    """Numbers of a loop around a law of n states and m inputs; times in timesteps.

    Attributes:
        timestep: [s].
        period: Of the law [s].
        stride: Timesteps in it.
        seed: Of what is drawn.
        run: Number of the run.
        delay: Of the computer.
        jitter: Latest that a sample is.
        missed: Share of the samples without a new output.
        sensors: Resolution, noise, bias, drift [1/s], delay and period of each state, (n, 6).
        estimators: Kind, rate, position, number and whether it begins settled, of each estimator of
            a rate, (k, 5).
        gain: Of the Kalman filter, on the innovation of each state, (n, n).
        filtered: 1 for each state that it gives, (n,).
        settled: 1 if it begins settled.
        actuators: Delay, resolution, limit, change in a timestep, time constant over the timestep,
            order and dead zone of each input, (m, 7).
        rest: Input before the first output arrives, (m,).
        dead: Dead time that the law knows of.
        ahead: From its sample to when its output arrives, as it knows [s].
        known_limit: Largest |u| that it knows of, (m,).
        A: Of a design model that is linear about an operating point, (n, n).
        B: The same, (n, m).
        x_e: The operating point's state, (n,).
    """

    timestep: float
    period: float
    stride: float
    seed: float
    run: float
    delay: float
    jitter: float
    missed: float
    sensors: Array
    estimators: Array
    gain: Array
    filtered: Array
    settled: float
    actuators: Array
    rest: Array
    dead: float
    ahead: float
    known_limit: Array
    A: Array
    B: Array
    x_e: Array


@dataclass
class LoopMemory:
    """What a loop of n states and m inputs remembers.

    Attributes:
        step: Timesteps begun.
        sample: Samples taken.
        due: Timestep of the next one.
        seen: What sensors and estimators give, at the last sample, (n,).
        believed: The state that the law was told, (n,).
        asked: What it asked for, (m,).
        output: The computer's output, (m,).
        given: What the actuators make of it, (m,).
        past: True states of the last timesteps, (room, n).
        queue: Outputs of the last timesteps, (room, m).
        rates: Of each estimator of a rate: whether it has begun, position, rate, disturbance, what
            was seen last and the instant of that in timesteps, (k, 6).
        observed: The Kalman filter's state, (n,).
        lags: Of each input: after the rate limit, the first lag and the second, (m, 3).
        mean: Input over the last period, as estimators know it, (m,).
        model: The design model's state, (n,).
        slope: To compute in, (n,).
        stage: To compute in, (n,).
        total: To compute in, (n,).
        calm: No wrench, (6 * bodies,).
    """

    step: float
    sample: float
    due: float
    seen: Array
    believed: Array
    asked: Array
    output: Array
    given: Array
    past: Array
    queue: Array
    rates: Array
    observed: Array
    lags: Array
    mean: Array
    model: Array
    slope: Array
    stage: Array
    total: Array
    calm: Array


@dataclass(frozen=True)
class Room:
    """How much of the past is kept, in timesteps.

    Attributes:
        past: Of the state.
        queue: Of the outputs.
    """

    past: int
    queue: int

    @classmethod
    def needed(cls, loop: Loop, timestep: float, stride: int) -> Room:
        """What a loop needs; a power of two, so that few layouts occur.

        Args:
            loop: The loop.
            timestep: [s].
            stride: Timesteps in a control period.
        """

        def steps(seconds: float) -> int:
            return steps_in("delay", seconds, timestep)

        sensors = max((steps(s.delay) + steps(s.period) for s in loop.sensors), default=0)
        delay = steps(loop.computing.delay)
        delay += max((steps(each.delay) for each in loop.actuators), default=0)
        lag = max((each.lag * each.order for each in loop.actuators), default=0.0)
        most = delay + sensors + math.ceil(lag / timestep) + stride
        return cls(1 << sensors.bit_length(), 1 << most.bit_length())

    def with_other(self, other: Room) -> Room:
        """Enough for both."""
        return Room(max(self.past, other.past), max(self.queue, other.queue))


def sensor_rows(loop: Loop, system: System, timestep: float) -> Array:
    """``LoopNumbers.sensors``."""
    known = {sensor.of: sensor for sensor in loop.sensors}
    sensors = [known.get(state.name, Sensor(state.name)) for state in system.states]
    rows = [
        (s.resolution, s.noise, s.bias, s.drift, s.delay / timestep, s.period / timestep)
        for s in sensors
    ]
    return _whole(np.array(rows, float), (4, 5))


def actuator_rows(loop: Loop, system: System, timestep: float) -> Array:
    """``LoopNumbers.actuators``."""
    known = {actuator.of: actuator for actuator in loop.actuators}
    actuators = [known.get(each.name, Actuator(each.name)) for each in system.inputs]
    rows = [
        (
            a.delay / timestep,
            a.resolution,
            a.limit,
            a.rate_limit * timestep,
            a.lag / timestep,
            a.order,
            a.dead_zone,
        )
        for a in actuators
    ]
    return _whole(np.array(rows, float), (0,))


def _whole(rows: Array, columns: tuple[int, ...]) -> Array:
    """Rows whose columns of timesteps are whole numbers."""
    for column in columns:
        rows[:, column] = np.round(rows[:, column])
    return rows


def estimator_rows(
    estimators: tuple[Estimator, ...], pairs: dict[int, int], names: list[str]
) -> Array:
    """``LoopNumbers.estimators``: of each rate its position, by ``pairs``."""
    rows = [
        (
            _KINDS[each.law],
            names.index(name),
            pairs[names.index(name)],
            each.number,
            float(each.settled),
        )
        for each in estimators
        if each.law != "kalman"
        for name in each.of
    ]
    # Compiled code has no arrays without rows: one that is of no state.
    return np.array(rows or [(0.0, -1.0, -1.0, 0.0, 0.0)], float)
