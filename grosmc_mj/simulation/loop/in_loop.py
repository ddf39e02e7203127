"""A law in its loop: a law again, for every engine, asked at each timestep.

It samples the law itself. So the plant meets what the actuators give, and the law what sensors and
estimators tell it, while all else (engines, meters, films) sees an ordinary controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from grosmc_mj.arguments import real, require
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller, Sampling
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.control.laws import Law
from grosmc_mj.control.memory import Memory
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System
from grosmc_mj.records import extended
from grosmc_mj.simulation.loop.actuating import actuating
from grosmc_mj.simulation.loop.counter import uniform
from grosmc_mj.simulation.loop.design_model import Advance, advance_of, held, kalman_gain
from grosmc_mj.simulation.loop.estimating import filtering, rate_estimating
from grosmc_mj.simulation.loop.numbers import (
    LoopMemory,
    LoopNumbers,
    Room,
    actuator_rows,
    estimator_rows,
    sensor_rows,
)
from grosmc_mj.simulation.loop.parts import LARGEST_SEED, Loop
from grosmc_mj.simulation.loop.sensing import sensing
from grosmc_mj.vectors import algebra, each


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


def in_loop(
    controller: Controller,
    loop: Loop,
    system: System,
    *,
    control_period: float = 1e-3,
    timestep: float = 1e-3,
    predict: bool = False,
    run: int = 0,
    known: Loop | None = None,
    room: Room | None = None,
) -> Controller:
    """A controller with a loop around its law, for runs of this control period and timestep.

    The law sees what sensors and estimators give; its output reaches the plant through computer and
    actuators. With ``predict`` it is told the state at the instant when its output arrives: the
    design model runs ahead over the dead time of sensors, computer and actuators, a lag counting
    as a delay of its time constants, under the outputs that are on their way.

    Args:
        controller: Any; observers and predictions need one with a design model.
        loop: Its parts.
        system: The plant's: whose states are measured.
        control_period: Of the law [s]; a multiple of the timestep.
        timestep: Of the physics [s].
        predict: Whether the law knows its loop.
        run: Number of the run: each has noise of its own.
        known: The loop that the law knows, if it is another than the one that it meets.
        room: What its memory shall have room for: the laws of a batch need the same.

    Returns:
        The controller, with its design and a memory and parameters that have ``loop`` besides.

    Raises:
        ArgumentError: If a part does not fit the system or the timestep.
        GainError: If no filter exists.
    """
    require("controller", controller, Controller, "a Controller")
    require("loop", loop, Loop, "a Loop(computing, sensors, estimators, actuators)")
    require("system", system, System, "a System, such as plant.system")
    require("known", known, (Loop, type(None)), "a Loop or None")
    require("predict", predict, (bool, np.bool_), "True or False")
    whole = isinstance(run, (int, np.integer)) and not isinstance(run, bool)
    if not (whole and 0 <= run < LARGEST_SEED):
        raise ArgumentError(f"run = {shown(run)} must be a whole number from 0 to below 2^53")
    h, period = real(timestep), real(control_period)
    if not (0 < h <= period < math.inf and math.isclose(round(period / h) * h, period)):
        raise ArgumentError(
            f"control_period = {shown(control_period)} s must be a multiple of the timestep "
            f"{shown(timestep)} s"
        )
    if controller.sampling is not None:
        raise ArgumentError(f"{controller.name} is in a loop already: take the law without one")
    loop.require_fits(system, h, period)
    if known is not None:
        known.require_fits(system, h, period)
    known, stride = loop if known is None else known, round(period / h)
    sampling = LoopSampling(
        period=period,
        timestep=h,
        bare=controller,
        loop=loop,
        known=known,
        predicts=predict,
        run=run,
        room=room or Room.needed(loop, h, stride).with_other(Room.needed(known, h, stride)),
        system=system,
    )
    told = controller.sampled(period)
    observers = {each.law for each in loop.estimators} & {"eso", "kalman"}
    advance = _design_model(told, observers, predict=predict)
    numbers = _numbers(told, sampling)
    made = replace(
        told,
        law=_looped_law(
            told.law,
            len(system.states),
            len(system.inputs),
            advance,
            frozenset(observers),
            predict,
        ),
        parameters=extended(told.parameters, loop=numbers),
        memory=partial(_memory, told.memory, sampling, numbers),
        sampling=sampling,
    )
    if "kalman" in observers and advance is not None:
        tuned = _with_filter(made, numbers, advance)
        made = replace(made, parameters=extended(told.parameters, loop=tuned))
    return made


def _design_model(controller: Controller, observers: set[str], *, predict: bool) -> Advance | None:
    """The design model, where something runs it."""
    if not (observers or predict):
        return None
    if controller.design is None:
        what = " and ".join(sorted(observers)) or "predict"
        raise ArgumentError(f"{controller.name} has no design model, which {what} needs")
    return advance_of(controller.design.error)


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
    rates = [names[i] for i in pairs]
    for part in loop.estimators:
        if part.law == "kalman":
            continue
        for name in part.of:
            if name not in rates:
                raise ArgumentError(
                    f"estimator: {part.law} gives a rate: {name!r} is none of "
                    f"{', '.join(rates) or 'them: no state is the rate of another'}"
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
    return estimator_rows(loop.estimators, pairs, names)


def _numbers(controller: Controller, sampling: LoopSampling) -> LoopNumbers:
    """What the law in its loop needs to know; the Kalman filter's gain is still zero."""
    loop, known, system, h = sampling.loop, sampling.known, sampling.system, sampling.timestep
    n, m = len(system.states), len(system.inputs)
    error = controller.design.error if controller.design else None
    point = controller.parameters.reference if isinstance(error, StateCoordinates) else None
    A, B = np.zeros((n, n)), np.zeros((n, m))
    if point is not None and controller.design is not None:
        A, B = controller.design.lqr.A, controller.design.lqr.B
    # What it knows of its own loop: nothing, unless it predicts.
    computer, actuators = actuator_rows(known, system, h), known.actuators
    delays = computer[:, 0] + computer[:, 4] * computer[:, 5]
    to_output = round(known.computing.delay / h) + round(float(delays.max(initial=0.0)))
    age = round(max((each.delay for each in known.sensors), default=0.0) / h)
    knows = 1.0 if sampling.predicts else 0.0
    given = np.zeros(n)
    for each_one in loop.estimators:
        if each_one.law == "kalman":
            given[[_state(system, name) for name in each_one.of]] = 1.0
    return LoopNumbers(
        timestep=h,
        period=sampling.period,
        stride=float(round(sampling.period / h)),
        seed=float(loop.seed),
        run=float(sampling.run),
        delay=float(round(loop.computing.delay / h)),
        jitter=float(round(loop.computing.jitter / h)),
        missed=float(loop.computing.missed),
        sensors=sensor_rows(loop, system, h),
        estimators=_estimators(loop, system),
        gain=np.zeros((n, n)),
        filtered=given,
        settled=float(any(each.settled for each in loop.estimators if each.law == "kalman")),
        actuators=actuator_rows(loop, system, h),
        rest=np.zeros(m) if point is None else np.array(point.u, float),
        dead=knows * (to_output + age),
        ahead=knows * to_output * h,
        known_limit=computer[:, 2] if knows and actuators else np.full(m, np.inf),
        A=np.ascontiguousarray(A),
        B=np.ascontiguousarray(B),
        x_e=np.zeros(n) if point is None else np.array(point.x, float),
    )


def _state(system: System, name: str) -> int:
    return [state.name for state in system.states].index(name)


def _with_filter(made: Controller, numbers: LoopNumbers, advance: Advance) -> LoopNumbers:
    """The numbers with the Kalman filter's gain.

    Raises:
        ArgumentError: If nothing is measured, or without noise.
        GainError: If there is no such filter.
    """
    sampling = loop_of(made)
    loop, system = sampling.loop, sampling.system
    measured = {_state(system, sensor.of): sensor for sensor in loop.sensors}
    if not measured:
        raise ArgumentError("estimator: kalman has nothing to go by: give it a [[sensor]]")
    for sensor in loop.sensors:
        if not (sensor.noise or sensor.resolution):
            raise ArgumentError(
                f"estimator: kalman: the sensor of {sensor.of} has neither noise nor resolution"
            )
    # A reading rounded to q is off by q / sqrt(12).
    variances = np.array([s.noise**2 + s.resolution**2 / 12 for s in measured.values()])
    load = next(each.number for each in loop.estimators if each.law == "kalman")
    memory, _kept_alive = made.begin()
    A, B = held(made.designed, advance, memory, made.parameters, sampling.period)
    gain, _covariance = kalman_gain(A, B, list(measured), variances, load)
    whole = np.zeros_like(numbers.gain)
    whole[:, list(measured)] = gain
    return replace(numbers, gain=whole)


def loop_of(controller: Controller) -> LoopSampling:
    """The loop that a controller is in.

    Raises:
        ArgumentError: If it is in none.
    """
    if not isinstance(controller.sampling, LoopSampling):
        raise ArgumentError(f"{controller.name} is in no loop")
    return controller.sampling


def _memory(make: Callable[[], Memory], sampling: LoopSampling, numbers: LoopNumbers) -> Memory:
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
        slope=np.zeros(n),
        stage=np.zeros(n),
        total=np.zeros(n),
        calm=np.zeros(max(1, 6 * len(sampling.system.bodies))),
    )
    memory = extended(make(), loop=loop)
    memory.first = numbers.ahead
    return memory


@cache
def _looped_law(
    law: Law,
    n: int,
    m: int,
    advance: Advance | None,
    observers: frozenset[str],
    predicts: bool,
) -> Law:
    """The law in a loop of n states and m inputs."""
    inner, store, given = jitable(law), algebra(m).store, algebra(m).given
    sense, actuate = sensing(n), actuating(m)
    expect, estimate = rate_estimating(n, m, advance if "eso" in observers else None)
    entries = each(m, lambda i, u: u[i])
    vector = jitable(lambda u: (u,)) if m == 1 else jitable(lambda u: u)
    observe, foresee = _nothing, _nothing
    if advance is not None and "kalman" in observers:
        observe = filtering(n, m, advance)
    if advance is not None and predicts:
        foresee = _foreseeing(m, advance)

    @jitable
    def late(k: int, q: Any) -> float:
        """By how many timesteps sample k is late."""
        if q.jitter == 0.0:
            return 0.0
        return math.floor(uniform(q.seed, q.run, n, k) * (q.jitter + 1.0)) * 1.0

    def looped_law(t: float, x: Any, memory: Any, p: Any) -> Any:
        loop, q = memory.loop, p.loop
        i, k = int(loop.step), int(loop.sample)
        row = i % loop.past.shape[0]
        for j in range(n):
            loop.past[row, j] = x[j]
        if loop.step >= loop.due:
            t_k = k * q.period
            if k > 0:
                expect(i, t_k, memory, p)
            sense(i, loop, q)
            estimate(i, t_k, memory, p)
            observe(i, t_k, memory, p)
            for j in range(n):
                loop.model[j] = loop.seen[j]
            foresee(i, t_k, memory, p)
            for j in range(n):
                loop.believed[j] = loop.model[j]
            u = vector(inner(t_k + q.ahead, loop.believed, memory, p))
            store(loop.asked, u)
            for j in range(m):
                if not math.isfinite(u[j]):
                    return given(u)
            if q.missed == 0.0 or uniform(q.seed, q.run, n + 1, k) >= q.missed:
                store(loop.output, u)
            loop.sample = k + 1.0
            loop.due = (k + 1) * q.stride + late(k + 1, q)
        row = i % loop.queue.shape[0]
        for j in range(m):
            loop.queue[row, j] = loop.output[j]
        actuate(i, loop, q)
        loop.step = i + 1.0
        return given(entries(loop.given))

    made: Any = looped_law
    made.python_only = getattr(law, "python_only", False)
    return looped_law


@jitable
def _nothing(i: int, t: float, memory: Any, p: Any) -> None:
    """Where nothing is observed or foreseen."""


@cache
def _foreseeing(m: int, move: Advance) -> Callable[..., None]:
    """Jitable (i, t, memory, p): move ``loop.model`` on by the dead time that the law knows."""

    @jitable
    def foresee(i: int, t: float, memory: Any, p: Any) -> None:
        loop, q = memory.loop, p.loop
        dead, room = int(q.dead), loop.queue.shape[0]
        for step in range(dead):
            a = i - dead + step
            for j in range(m):
                asked = q.rest[j] if a < 0 else loop.queue[a % room, j]
                loop.mean[j] = min(q.known_limit[j], max(-q.known_limit[j], asked))
            move(t + q.ahead + (step - dead) * q.timestep, loop.mean, memory, p, q.timestep)

    return foresee
