"""A loop attached to a controller: its numbers for one system, timestep and control period."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any

import numpy as np
from pydantic import InstanceOf

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.state import StateCoordinates
from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Flag, Range, checked_call
from grosmc_mj.loop.actuators import ACTUATOR, Actuator, kept_in_a_timestep
from grosmc_mj.loop.delay import COMPUTER
from grosmc_mj.loop.design_model import DesignModel, design_model, held
from grosmc_mj.loop.estimators import ESTIMATOR, KINDS, MEMORY
from grosmc_mj.loop.kalman import kalman_gain
from grosmc_mj.loop.loop import LARGEST_SEED, Loop
from grosmc_mj.loop.prediction import LEARNING
from grosmc_mj.loop.rows import rows_of
from grosmc_mj.loop.sensors import SENSOR, Sensor
from grosmc_mj.loop.stages import LoopRun
from grosmc_mj.loop.timing import LONGEST, SHORTEST, ControlPeriod, steps_in, stride_of
from grosmc_mj.plants import Signal, System

# The arrays of a ``LoopRun`` that are a run's own.
_CHANGING = (
    "computer", "sensors", "estimators", "actuators", "gain", "past", "queue", "x", "mean",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class AppliedLoop:
    """A loop as a controller meets it.

    Attributes:
        loop: Its parts.
        known: The loop that the law knows.
        predicts: Whether the law gets the state at the instant when its output arrives.
        run: Number of the run.
        system: The plant's.
        period: Control period [s].
        timestep: [s].
        model: The design model; None where nothing runs it.
        start: As a run begins.
    """

    loop: Loop
    known: Loop
    predicts: bool
    run: int
    system: System
    period: float
    timestep: float
    model: DesignModel | None
    start: LoopRun

    @property
    def ahead(self) -> float:
        """From a sample to the arrival of its output, as the law knows it [s]."""
        return float(self.start.computer["ahead"][0])

    def begin(self, seen: Array, predicted: Array, **of_engine: Any) -> LoopRun:
        """The loop of a new run.

        Args:
            seen: Where the state by sensors and estimators is written, (n,).
            predicted: Where the state that the law gets is written, (n,).
            of_engine: ``advance``, ``memory``, ``p`` and ``own`` of ``LoopRun``.
        """
        copies = {name: getattr(self.start, name).copy() for name in _CHANGING}
        return self.start._replace(**copies, seen=seen, predicted=predicted, **of_engine)

    def restart(self, loop: LoopRun) -> None:
        """Bring a loop with arrays of this one's sizes, see ``sizes``, to the start of a run."""
        for name in _CHANGING:
            getattr(loop, name)[...] = getattr(self.start, name)
        if self.model is not None:
            loop.own[:] = self.model.own

    @cached_property
    def sizes(self) -> tuple[Any, ...]:
        """Shapes of what a run changes."""
        return tuple(getattr(self.start, name).shape for name in _CHANGING)

    def begin_uncompiled(
        self, controller: Controller, memory: Any, seen: Array, predicted: Array
    ) -> LoopRun:
        """Loop of a new run for plain Python.

        Args:
            controller: Controller in this loop.
            memory: Memory of its law.
            seen: Array for the state by sensors and estimators, (n,).
            predicted: Array for the state that the law gets, (n,).
        """
        model: Any = self.model

        def advance(t: float, x: Any, u: Any, h: float, _address: Any) -> None:
            model.advance(t, x, u, h, memory, controller.parameters, model.own)

        return self.begin(seen, predicted, advance=advance).uncompiled()


def ideal_loop(n: int, m: int) -> LoopRun:
    """No loop: without sensors the kernel leaves it out."""
    nothing = np.zeros(0)
    return LoopRun(
        address=0,
        computer=np.zeros(0, COMPUTER),
        sensors=np.zeros(0, SENSOR),
        estimators=np.zeros(0, ESTIMATOR),
        actuators=np.zeros(0, ACTUATOR),
        gain=np.zeros((0, 0)),
        past=_ring(0, n),
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


@checked_call
def in_loop(
    controller: InstanceOf[Controller],
    loop: Loop,
    system: InstanceOf[System],
    *,
    control_period: ControlPeriod = 1e-3,
    timestep: Annotated[float, Range(SHORTEST, LONGEST, unit="s")] = 1e-3,
    predict: Flag = False,
    run: Annotated[int, Range(0, LARGEST_SEED, below=True, whole=True)] = 0,
    known: Loop | None = None,
) -> Controller:
    """A controller with a loop around its law, for runs of this control period and timestep.

    The law sees what sensors and estimators give; its output reaches the plant through computer and
    actuators. With ``predict`` it gets the state at the instant when its output arrives: the
    design model runs ahead over the dead time of sensors, computer and actuators, a lag counting
    as a delay of its time constants, under the outputs that are on their way. The model's recent
    error in the state's rate, a load say, goes on in the prediction.

    Args:
        controller: Any; observers and predictions need one with a design model.
        loop: Its parts.
        system: The plant's: whose states are measured.
        control_period: Of the law [s]; a multiple of the timestep.
        timestep: Of the physics [s].
        predict: Whether the law knows its loop.
        run: Number of the run: every run has noise of its own.
        known: The loop that the law knows, if it is another than the one that it meets.

    Returns:
        The controller with its law as it is, and the loop for the kernel.

    Raises:
        ArgumentError: If a part does not fit the system or the timestep.
        GainError: If no filter exists.
    """
    if controller.loop is not None:
        raise ArgumentError(f"{controller.name} is in a loop already: take the law without one")
    known = loop if known is None else known
    stride, period = stride_of(control_period, timestep)
    steps_in("control_period", period, timestep)
    predictor = ["predict"] if predict else []
    users = sorted({part.law for part in loop.estimators} & {"eso", "kalman"})
    for one, readers in ((known, predictor), (loop, [*users, *predictor])):
        one.require_fits(system, timestep, period)
        _require_one_age(one, system, readers)
    sampled = controller.sampled(period)
    needing = users or predictor
    model = design_model(sampled, " and ".join(needing)) if needing else None
    ideal = ideal_loop(len(system.states), len(system.inputs))
    applied = AppliedLoop(loop, known, predict, run, system, period, timestep, model, ideal)
    return replace(sampled, loop=replace(applied, start=_start_of(sampled, applied, stride)))


def relooped(controller: Controller, loop: Loop, run: int = 0) -> Controller:
    """A controller with another loop around its law, of which it knows what it knew.

    Args:
        controller: In a loop.
        loop: The other one.
        run: Number of the run.

    Raises:
        ArgumentError: If it is in none, or a part does not fit.
    """
    if (of := controller.loop) is None:
        raise ArgumentError(f"{controller.name} is in no loop")
    return in_loop(
        replace(controller, loop=None), loop, of.system, control_period=of.period,
        timestep=of.timestep, predict=of.predicts, run=run, known=of.known,
    )  # fmt: skip


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


def _require_one_age(loop: Loop, system: System, users: list[str]) -> None:
    """Refuse states of different ages where one model is to run ahead of all of them."""
    # A filter goes by every sensor; other estimates are as old as their measurements.
    delays = {sensor.of: sensor.delay for sensor in loop.sensors}
    estimated = {name for part in loop.estimators for name in part.of} - set(delays)
    names = [state.name for state in system.states if state.name not in estimated]
    ages = {name: delays.get(name, 0.0) for name in names}
    if "predict" in users and len({part.delay for part in loop.actuators}) > 1:
        raise ArgumentError(
            "predict: the actuators have different delays, and the state is told at one instant: "
            "give them the same, the longest one's"
        )
    if users and len(set(ages.values())) > 1:
        listed = ", ".join(f"{of} {delay:g} s" for of, delay in ages.items())
        raise ArgumentError(
            f"{' and '.join(users)}: the measurements have different ages, {listed}: give "
            "each of these states a [[sensor]] with the delay of the oldest one"
        )


def _start_of(controller: Controller, applied: AppliedLoop, stride: int) -> LoopRun:
    """The loop as a run begins.

    Raises:
        ArgumentError: If an estimator does not fit.
        GainError: If there is no Kalman filter.
    """
    loop, known, system = applied.loop, applied.known, applied.system
    h, period, predicts = applied.timestep, applied.period, applied.predicts
    sensors = _of_all(system.states, Sensor, loop.sensors)
    actuators = _of_all(system.inputs, Actuator, loop.actuators)
    error = controller.design.error if controller.design else None
    of_state = isinstance(error, StateCoordinates)
    rest = np.zeros(len(actuators)) + (controller.parameters.reference.u if of_state else 0.0)
    # What the law knows of its own loop: nothing, unless it predicts.
    known_actuators = rows_of(_of_all(system.inputs, Actuator, known.actuators), ACTUATOR, h)
    delays = known_actuators["delay"] + known_actuators["lag"] / h * known_actuators["order"]
    to_output = round(known.computing.delay / h) + round(float(delays.max(initial=0.0)))
    age = round(max((sensor.delay for sensor in known.sensors), default=0.0) / h)
    dead = (to_output + age) if predicts else 0
    filters = [part for part in loop.estimators if part.law == "kalman"]
    filtered = {name for part in filters for name in part.of}
    computer = rows_of(
        [loop.computing], COMPUTER, h,
        timestep=h, period=period, stride=stride, seed=loop.seed, run=applied.run,
        filters=bool(filters), settled=any(part.settled for part in filters),
        oldest=round(max((sensor.delay for sensor in loop.sensors), default=0.0) / h),
        observes=any(part.law == "eso" for part in loop.estimators),
        predicts=predicts, dead=dead, age=age * predicts, ahead=to_output * h * predicts,
        learning=0.0 if dead == 0 else 1.0 - math.exp(-LEARNING * period / (dead * h)),
    )  # fmt: skip
    latest = round(loop.computing.delay / h) + max(round(part.delay / h) for part in actuators)
    oldest = max(round(part.delay / h) + round(part.period / h) for part in sensors)
    return applied.start._replace(
        computer=computer,
        sensors=rows_of(
            sensors, SENSOR, h, filtered=[state.name in filtered for state in system.states]
        ),
        estimators=_estimators(loop, system),
        actuators=rows_of(
            actuators, ACTUATOR, h, rest=rest, output=rest, rated=rest, first=rest, second=rest,
            kept=[kept_in_a_timestep(actuator, h) for actuator in actuators],
            known_limit=known_actuators["limit"] if predicts and known.actuators else np.inf,
        ),
        gain=_filter_gain(controller, applied, rest),
        past=_ring(oldest, len(sensors)),
        queue=_ring(max(latest, dead + stride), len(actuators)),
    )  # fmt: skip


def _ring(steps: int, columns: int) -> Array:
    """Room for the numbers of so many timesteps, in a power of two rows."""
    return np.zeros((1 << steps.bit_length(), columns))


def _of_all(signals: Sequence[Signal], kind: Any, parts: Sequence[Any]) -> list[Any]:
    """The part of each state or input, an ideal one where there is none."""
    named = {part.of: part for part in parts}
    return [named.get(signal.name, kind(signal.name)) for signal in signals]


def _estimators(loop: Loop, system: System) -> np.ndarray[Any, Any]:
    """Rows of the estimators of rates.

    Raises:
        ArgumentError: If one is of what is no rate, or needs what is not measured.
    """
    names, pairs = [state.name for state in system.states], rate_positions(system)
    positions = {names[i]: position for i, position in pairs.items()}
    estimated = [(part, of) for part in loop.estimators if part.law != "kalman" for of in part.of]
    measured = {sensor.of for sensor in loop.sensors}
    for part, of in estimated:
        if of not in positions:
            raise ArgumentError(
                f"estimator: {part.law} gives a rate: {of!r} is none of "
                f"{', '.join(positions) or 'them: no state is the rate of another'}"
            )
        if of in measured:
            raise ArgumentError(
                f"estimator: {of!r} has a sensor too, which would go unheard: leave one out"
            )
    if sum(part.law == "kalman" for part in loop.estimators) > 1:
        raise ArgumentError("estimator: two filters by kalman: give one of them all states")
    slow = [sensor.of for sensor in loop.sensors if sensor.period]
    paced = [part.law for part in loop.estimators if part.law in ("eso", "kalman")]
    if slow and paced:
        raise ArgumentError(
            f"estimator: {paced[0]} runs at the law's pace: the sensor of {slow[0]} has a period "
            "of its own"
        )
    rows = [
        (KINDS.index(part.law), part.number, names.index(of), positions[of], part.settled)
        for part, of in estimated
    ]
    nothing = (0.0,) * len(MEMORY)
    return np.array([row + nothing for row in rows], ESTIMATOR)


def _filter_gain(controller: Controller, applied: AppliedLoop, rest: Array) -> Array:
    """The Kalman filter's gain, (n, n); zero on states without a sensor, and without a filter.

    Raises:
        ArgumentError: If nothing is measured, or without noise.
        GainError: If there is no such filter.
    """
    names, sensors = [state.name for state in applied.system.states], applied.loop.sensors
    gain = np.zeros((len(names), len(names)))
    loads = [part.number for part in applied.loop.estimators if part.law == "kalman"]
    if not loads:
        return gain
    exact = [sensor.of for sensor in sensors if not (sensor.noise or sensor.resolution)]
    if exact or not sensors:
        lacks = f"the sensor of {exact[0]} has neither" if exact else "there is no [[sensor]]"
        raise ArgumentError(f"estimator: kalman goes by sensors with noise or resolution: {lacks}")
    measured = [names.index(sensor.of) for sensor in sensors]
    # A reading rounded to q is off by q / sqrt(12).
    variances = np.array([s.noise**2 + s.resolution**2 / 12 for s in sensors])
    assert applied.model is not None
    A, B = held(controller, applied.model, rest, applied.period)
    gain[:, measured] = kalman_gain(A, B, measured, variances, loads[0])
    return gain
