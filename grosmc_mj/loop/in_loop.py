"""A law in its loop: a law again, for every engine, asked at each timestep.

It samples the law itself. So the plant meets what the actuators give, and the law what sensors and
estimators tell it, while all else (engines, meters, films) sees an ordinary controller.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import partial

import numpy as np

from grosmc_mj.arguments import real, require, require_whole
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, shown
from grosmc_mj.loop.design_model import Advance, advance_of, held, kalman_gain
from grosmc_mj.loop.layout import (
    LoopSampling,
    Room,
    loop_memory,
    loop_numbers,
    state_index,
)
from grosmc_mj.loop.loop import LARGEST_SEED, SEED, Loop
from grosmc_mj.loop.looped_law import looped_law_of
from grosmc_mj.loop.numbers import LoopNumbers
from grosmc_mj.plants import System
from grosmc_mj.records import extended
from grosmc_mj.simulation.prepare import stride_of


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
    as a delay of its time constants, under the outputs that are on their way. What the model has
    missed of the state's rate lately, a load say, it goes on missing.

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
    run = require_whole("run", run, 0, LARGEST_SEED - 1, SEED)
    h = real(timestep)
    if not 0 < h < math.inf:
        raise ArgumentError(f"timestep = {shown(timestep)} s must be finite and positive")
    stride, period = stride_of(control_period, h)
    if controller.sampling is not None:
        raise ArgumentError(f"{controller.name} is in a loop already: take the law without one")
    loop.require_fits(system, h, period)
    if known is not None:
        known.require_fits(system, h, period)
        _require_one_age(known, system, {"predict"} if predict else set())
    known = loop if known is None else known
    needed = Room.needed(loop, h, stride).with_other(Room.needed(known, h, stride))
    sampling = LoopSampling(
        period=period,
        timestep=h,
        bare=controller,
        loop=loop,
        known=known,
        predicts=predict,
        run=run,
        room=room or needed,
        system=system,
    )
    if room is not None and room.with_other(needed) != room:
        raise ArgumentError(f"room = {shown(room)} is less than the loop needs, {needed}")
    told = controller.sampled(period)
    observers = {each.law for each in loop.estimators} & {"eso", "kalman"}
    _require_one_age(loop, system, observers | ({"predict"} if predict else set()))
    advance = _design_model(told, observers, predict=predict)
    numbers = loop_numbers(told, sampling)
    made = replace(
        told,
        law=looped_law_of(
            told.law,
            len(system.states),
            len(system.inputs),
            advance,
            frozenset(observers),
            predict,
        ),
        parameters=extended(told.parameters, loop=numbers),
        memory=partial(loop_memory, told.memory, sampling, numbers),
        sampling=sampling,
    )
    if "kalman" in observers and advance is not None:
        tuned = _with_filter(made, numbers, advance)
        made = replace(made, parameters=extended(told.parameters, loop=tuned))
    return made


def relooped(
    controller: Controller, loop: Loop, run: int = 0, room: Room | None = None
) -> Controller:
    """A controller with another loop around its law, of which it knows what it knew.

    Args:
        controller: In a loop.
        loop: The other one.
        run: Number of the run.
        room: What its memory shall have room for.

    Raises:
        ArgumentError: If it is in none, or a part does not fit.
    """
    of = loop_of(controller)
    return in_loop(
        of.bare, loop, of.system, control_period=of.period, timestep=of.timestep,
        predict=of.predicts, run=run, known=of.known, room=room,
    )  # fmt: skip


def room_of(controller: Controller, loops: Iterable[Loop]) -> Room:
    """Room for each of these loops around a controller that is in one."""
    of = loop_of(controller)
    found = of.room
    for loop in loops:
        found = found.with_other(Room.needed(loop, of.timestep, round(of.period / of.timestep)))
    return found


def _require_one_age(loop: Loop, system: System, users: set[str]) -> None:
    """Refuse states of different ages where one model is to run ahead of all of them."""
    # A filter goes by every sensor; other estimates are as old as what they are made of.
    filtered = any(each.law == "kalman" for each in loop.estimators)
    estimated = {name for each in loop.estimators for name in each.of}
    estimated -= {each.of for each in loop.sensors} if filtered else set()
    delays = {each.of: each.delay for each in loop.sensors}
    measured = [state.name for state in system.states if state.name not in estimated]
    ages = {name: delays.get(name, 0.0) for name in measured}
    delays_out = {each.delay for each in loop.actuators}
    if "predict" in users and len(delays_out) > 1:
        raise ArgumentError(
            "predict: the actuators have different delays, and the state is told at one instant: "
            "give them the same, the longest one's"
        )
    if users and len(set(ages.values())) > 1:
        told = ", ".join(f"{of} {delay:g} s" for of, delay in ages.items())
        raise ArgumentError(
            f"{' and '.join(sorted(users))}: what is seen is of different ages, {told}: give "
            "each of these states a [[sensor]] with the delay of the oldest one"
        )


def _design_model(controller: Controller, observers: set[str], *, predict: bool) -> Advance | None:
    """The design model, where something runs it."""
    if not (observers or predict):
        return None
    if controller.design is None:
        what = " and ".join(sorted(observers)) or "predict"
        raise ArgumentError(f"{controller.name} has no design model, which {what} needs")
    return advance_of(controller.design.error)


def _with_filter(made: Controller, numbers: LoopNumbers, advance: Advance) -> LoopNumbers:
    """The numbers with the Kalman filter's gain.

    Raises:
        ArgumentError: If nothing is measured, or without noise.
        GainError: If there is no such filter.
    """
    sampling = loop_of(made)
    loop, system = sampling.loop, sampling.system
    measured = {state_index(system, sensor.of): sensor for sensor in loop.sensors}
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
