"""How a loop is laid out for compiled code: its numbers and its memory."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampling
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError
from grosmc_mj.loop.loop import Loop, steps_in
from grosmc_mj.loop.numbers import (
    DIFFERENCE,
    ESO,
    FILTERED,
    HIGH_GAIN,
    LEVANT,
    LoopMemory,
    LoopNumbers,
)
from grosmc_mj.loop.parts import Actuator, Sensor
from grosmc_mj.plants import System
from grosmc_mj.records import extended

_KINDS = {
    "difference": DIFFERENCE,
    "filtered": FILTERED,
    "levant": LEVANT,
    "high-gain": HIGH_GAIN,
    "eso": ESO,
}

# A law that predicts learns what its model misses at this part of one over its dead time: faster,
# a wrong inertia makes it ring; slower, a load goes on misleading it.
LEARNING = 0.1


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


@dataclass(frozen=True, eq=False)
class LoopSampling(Sampling):
    """How a law in its loop is asked.

    Attributes:
        bare: The law without it.
        loop: The loop.
        known: The loop as the law knows it, if it predicts.
        predicts: Whether it is told the state at the instant when its output arrives.
        run: Number of the run.
        room: What its memory has room for.
        system: The plant's.
    """

    bare: Controller
    loop: Loop
    known: Loop
    predicts: bool
    run: int
    room: Room
    system: System


def rate_positions(system: System) -> dict[int, int]:
    """The states that are another state's rate, with that: of a mechanical system its velocities.

    Of equations of one's own those whose drift is just another state.
    """
    n = system.degrees_of_freedom
    if n:
        return {i + n: i for i in range(n)}
    if not system.symbolic:
        return {}
    x = list(system.equations.x)
    return {x.index(f): i for i, f in enumerate(system.equations.f) if f in x}


def _estimators(loop: Loop, system: System) -> Array:
    """``LoopNumbers.estimators``.

    Raises:
        ArgumentError: If one is of what is no rate, or needs what is not measured.
    """
    names, pairs = [state.name for state in system.states], rate_positions(system)
    rates, measured = [names[i] for i in pairs], {sensor.of for sensor in loop.sensors}
    estimated = [(p, name) for p in loop.estimators if p.law != "kalman" for name in p.of]
    for part, name in estimated:
        if name not in rates:
            raise ArgumentError(
                f"estimator: {part.law} gives a rate: {name!r} is none of "
                f"{', '.join(rates) or 'them: no state is the rate of another'}"
            )
        if name in measured:
            raise ArgumentError(
                f"estimator: {name!r} has a sensor too, which would go unheard: leave one out"
            )
    if sum(part.law == "kalman" for part in loop.estimators) > 1:
        raise ArgumentError("estimator: two filters by kalman: give one of them all states")
    slow = [sensor.of for sensor in loop.sensors if sensor.period]
    for part in loop.estimators:
        if part.law in ("eso", "kalman") and slow:
            raise ArgumentError(
                f"estimator: {part.law} runs at the law's pace: the sensor of {slow[0]} has a "
                "period of its own"
            )
    rows = [
        (_KINDS[p.law], names.index(name), pairs[names.index(name)], p.number, float(p.settled))
        for p, name in estimated
    ]
    # Compiled code has no arrays without rows: one that is of no state.
    return np.array(rows or [(0.0, -1.0, -1.0, 0.0, 0.0)], float)


def loop_numbers(controller: Controller, sampling: LoopSampling) -> LoopNumbers:
    """What the law in its loop needs to know; the Kalman filter's gain is still zero."""
    loop, known, system, h = sampling.loop, sampling.known, sampling.system, sampling.timestep
    n, m = len(system.states), len(system.inputs)
    error = controller.design.error if controller.design else None
    point = controller.parameters.reference if isinstance(error, StateCoordinates) else None
    A, B = np.zeros((n, n)), np.zeros((n, m))
    if point is not None and controller.design is not None:
        A, B = controller.design.lqr.A, controller.design.lqr.B
    # What it knows of its own loop: nothing, unless it predicts.
    told, actuators = _actuator_rows(known, system, h), known.actuators
    delays = told[:, 0] + told[:, 4] * told[:, 5]
    to_output = round(known.computing.delay / h) + round(float(delays.max(initial=0.0)))
    age = round(max((each.delay for each in known.sensors), default=0.0) / h)
    knows = 1.0 if sampling.predicts else 0.0
    dead = knows * (to_output + age)
    given = np.zeros(n)
    for part in loop.estimators:
        if part.law == "kalman":
            given[[state_index(system, name) for name in part.of]] = 1.0
    return LoopNumbers(
        timestep=h,
        period=sampling.period,
        stride=float(round(sampling.period / h)),
        seed=float(loop.seed),
        run=float(sampling.run),
        delay=float(round(loop.computing.delay / h)),
        jitter=float(round(loop.computing.jitter / h)),
        missed=float(loop.computing.missed),
        sensors=_sensor_rows(loop, system, h),
        estimators=_estimators(loop, system),
        gain=np.zeros((n, n)),
        filtered=given,
        oldest=float(round(max((each.delay for each in loop.sensors), default=0.0) / h)),
        settled=float(any(each.settled for each in loop.estimators if each.law == "kalman")),
        actuators=_actuator_rows(loop, system, h),
        rest=np.zeros(m) if point is None else np.array(point.u, float),
        dead=dead,
        age=knows * age,
        ahead=knows * to_output * h,
        learning=0.0 if dead == 0 else 1.0 - math.exp(-LEARNING * sampling.period / (dead * h)),
        known_limit=told[:, 2] if knows and actuators else np.full(m, np.inf),
        A=np.ascontiguousarray(A),
        B=np.ascontiguousarray(B),
        x_e=np.zeros(n) if point is None else np.array(point.x, float),
    )


def state_index(system: System, name: str) -> int:
    """Which of the states has that name."""
    return [state.name for state in system.states].index(name)


def loop_memory(make: Callable[[], Memory], sampling: LoopSampling, numbers: LoopNumbers) -> Memory:
    """The law's own memory, and the loop's."""
    n, m = len(sampling.system.states), len(sampling.system.inputs)
    rest = numbers.rest
    loop = LoopMemory(
        step=0.0,
        sample=0.0,
        due=0.0,
        seen=np.zeros(n),
        believed=np.zeros(n),
        asked=rest.copy(),
        output=rest.copy(),
        given=rest.copy(),
        past=np.zeros((sampling.room.past, n)),
        queue=np.zeros((sampling.room.queue, m)),
        rates=np.zeros((len(numbers.estimators), 6)),
        observed=np.zeros(n),
        lags=np.repeat(rest[:, None], 3, axis=1),
        mean=np.zeros(m),
        model=np.zeros(n),
        missed=np.zeros(n),
        slope=np.zeros(n),
        stage=np.zeros(n),
        total=np.zeros(n),
        calm=np.zeros(max(1, 6 * len(sampling.system.bodies))),
    )
    memory = extended(make(), loop=loop)
    memory.first = numbers.ahead
    return memory


def _sensor_rows(loop: Loop, system: System, timestep: float) -> Array:
    """``LoopNumbers.sensors``."""
    known = {sensor.of: sensor for sensor in loop.sensors}
    sensors = [known.get(state.name, Sensor(state.name)) for state in system.states]
    rows = [
        (
            s.resolution,
            s.noise,
            s.bias,
            s.drift,
            round(s.delay / timestep),
            round(s.period / timestep),
        )
        for s in sensors
    ]
    return np.array(rows, float)


def _actuator_rows(loop: Loop, system: System, timestep: float) -> Array:
    """``LoopNumbers.actuators``."""
    known = {actuator.of: actuator for actuator in loop.actuators}
    actuators = [known.get(each.name, Actuator(each.name)) for each in system.inputs]
    rows = [
        (
            round(a.delay / timestep),
            a.resolution,
            a.limit,
            a.rate_limit * timestep,
            a.lag / timestep,
            a.order,
            a.dead_zone,
            math.exp(-timestep / a.lag) if a.lag > 0 else 0.0,
        )
        for a in actuators
    ]
    return np.array(rows, float)
