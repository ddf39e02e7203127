"""The closed loop: disturb, sample the law, actuate, accumulate metrics, step, record.

``run_of`` is plain Python. numba compiles it once for all plants, laws, loops and metrics, which it
calls at their addresses; uncompiled it is the reference engine.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
from numba import types
from numpy.typing import NDArray

from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.compilation.structures import (
    Matrix,
    Vector,
    members_at,
    structure_at,
)
from grosmc_mj.simulation.disturbances import disturb
from grosmc_mj.simulation.loop.actuators import actuate
from grosmc_mj.simulation.loop.applied import LoopRun
from grosmc_mj.simulation.loop.computer import send
from grosmc_mj.simulation.loop.sent import keep_output
from grosmc_mj.simulation.loop.software import Software, observe
from grosmc_mj.simulation.loop.world import remember, sense
from grosmc_mj.simulation.trajectory import Status

# Entries of ``KernelRun.progress``.
NEXT_STEP = 0
LAST_STEP = 1
ANSWER = 2
FIRST_ROW = 3

# A law's function returns one more than a ``Status``; a law that raised an error returns 0.
ANSWERED = Status.COMPLETED.value + 1
_DIVERGED = Status.DIVERGED.value + 1
_FULL_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)

_FLOAT = types.float64
_INT = types.int64
_INTEGERS = types.Array(_INT, 1, "C")
# Arguments: time and address of a ``KernelRun``. They find the rest there: an array by value costs
# a law more than its own arithmetic.
LAW = _INT(_FLOAT, types.voidptr)
NOTE = types.void(_FLOAT, types.voidptr)
STEP = types.void(_INT, _INT)
READ = types.void(_INT, _INT, _INT, _INT)


class PlantRun(NamedTuple):
    """A plant in a run; its stepper makes it.

    ``model`` and ``data`` are Python objects where the kernel is not compiled, else addresses; so
    are the functions.

    Attributes:
        step: Advances the plant: (model, data).
        read: Writes mjSTATE_FULLPHYSICS: (model, data, address, kind of state).
        model: Model of the plant: mjModel, or the numbers of equations.
        data: State of the plant: mjData, or the state of equations.
        q: Positions of the plant; of equations the whole state.
        v: Velocities of the plant; of equations nothing.
        u: Inputs of the plant, (m,).
        warnings: Counts of reasons why the state has diverged, in every other entry.
        bodies: Rows of ``forces`` of the system's bodies.
        forces: Wrenches that act on the plant, (rows, 6).
        rates: Rates that are added to those of the states, (n,); of equations only.
    """

    step: Annotated[Any, types.FunctionType(STEP)]
    read: Annotated[Any, types.FunctionType(READ)]
    model: Annotated[Any, _INT]
    data: Annotated[Any, _INT]
    q: Vector
    v: Vector
    u: Vector
    warnings: Annotated[NDArray[np.int32], types.Array(types.int32, 1, "C")]
    bodies: Annotated[NDArray[np.int64], _INTEGERS]
    forces: Matrix
    rates: Vector


class DisturbanceRun(NamedTuple):
    """Disturbances in a run.

    Attributes:
        numbers: Numbers of the disturbances, (count, NUMBERS).
        values: Values of disturbances without a formula, flat.
        sums: Sums of the disturbances; the next four are views of it, and empty where nothing is
            disturbed.
        w: Wrench on each of the bodies, flat.
        input_disturbance: Disturbance of each input, (m,).
        output_disturbance: Disturbance of each state as it is measured, (n,).
        rate_disturbance: Disturbance of the rate of each state, (n,).
    """

    numbers: Matrix
    values: Vector
    sums: Vector
    w: Vector
    input_disturbance: Vector
    output_disturbance: Vector
    rate_disturbance: Vector


class KernelRun(NamedTuple):
    """One run for ``run_of``: what is told of it, and its memory.

    ``physics`` and the functions are Python objects where the kernel is not compiled, else
    addresses.

    Attributes:
        address: Address of this structure, for ``law`` and ``note``.
        progress: Next timestep, timestep to stop before, last answer of the law or the reason why
            the run ended, and row of the first timestep that is kept: see ``NEXT_STEP``.
        keep: First timestep of which a row is kept.
        stride: Timesteps in a control period.
        h: Timestep [s].
        period: Control period [s].
        plant: Plant.
        disturbances: Disturbances of it.
        law: Samples the law, see ``LAW``; returns ``ANSWERED`` or the reason why there is no input.
        note: Accumulates metrics at each timestep, see ``NOTE``.
        now: Recorded signals; the next five, and those of ``disturbances``, are views of it.
        engine_time: Time as MuJoCo adds it up [s], (1,).
        x: True state, (n,).
        command: Output of the law, (m,).
        memory: Memory of the law, flat.
        given: Output of the actuators of a loop, (m,); nothing without a loop.
        seen: State that the law gets, (n,).
        p: Numbers of the law, flat.
        accumulated: Values of the accumulator, flat; nothing without one.
        accumulator_numbers: Constants of ``note``, flat.
        rows: ``now`` after the kept steps of all runs, (rows, at least its size).
        physics: Memory for mjSTATE_FULLPHYSICS.
        width: Distance from one row of it to the next; 0 if it is not kept.
        loop: Sensors, computer, estimators and actuators between law and plant.
    """

    address: Annotated[Any, types.voidptr]
    progress: Annotated[NDArray[np.int64], _INTEGERS]
    keep: int
    stride: int
    h: float
    period: float
    plant: PlantRun
    disturbances: DisturbanceRun
    law: Annotated[Any, types.FunctionType(LAW)]
    note: Annotated[Any, types.FunctionType(NOTE)]
    now: Vector
    engine_time: Vector
    x: Vector
    command: Vector
    memory: Vector
    given: Vector
    seen: Vector
    p: Vector
    accumulated: Vector
    accumulator_numbers: Vector
    rows: Matrix
    physics: Annotated[Any, _INT]
    width: int
    loop: LoopRun


@jitable
def act_on_plant(disturbances: DisturbanceRun, plant: PlantRun) -> None:
    """Bring wrenches on bodies and rates of states, or none of them, to the plant."""
    w = disturbances.w
    rates = disturbances.rate_disturbance
    for k in range(len(w) // 6):
        for j in range(6):
            plant.forces[plant.bodies[k], j] = w[6 * k + j]
    for j in range(len(rates)):
        plant.rates[j] = rates[j]


# One function serves all runs, and is compiled once.
@cache
def run_of(*, looped: bool) -> Callable[[KernelRun], None]:
    """Function that makes the next timesteps of a run.

    Args:
        looped: Whether a loop lies between law and plant. numba leaves the stages of a loop out of
            the code for ideal loops, which it compiles in half the time.
    """

    @jitable
    def run(r: KernelRun) -> None:
        """Make the timesteps of a run from ``NEXT_STEP`` to before ``LAST_STEP``."""
        plant = r.plant
        disturbances = r.disturbances
        progress = r.progress
        x, u, q, v = r.x, plant.u, plant.q, plant.v
        world, measured, software = r.loop
        disturbed = len(disturbances.sums) > 0
        output_disturbance = disturbances.output_disturbance
        input_disturbance = disturbances.input_disturbance
        n = len(x)
        m = len(u)
        nq = len(q)

        first = progress[NEXT_STEP]
        sample = -(-first // r.stride)
        due = sample * r.stride
        for i in range(first, progress[LAST_STEP]):
            if disturbed:
                numbers, values, sums = disturbances.numbers, disturbances.values, disturbances.sums
                disturb(numbers, values, i, i * r.h, r.h, sums)
                act_on_plant(disturbances, plant)

            if looped:
                remember(i, x, output_disturbance, world)
                due = int(world.computer[0].due)

            # A sample.
            if i >= due:
                if looped:
                    sample = sense(i, world, measured)
                    t = observe(sample, measured, software)
                else:
                    t = sample * r.period
                    sample += 1
                    due += r.stride
                    for j in range(n):
                        r.seen[j] = x[j]
                    for j in range(len(output_disturbance)):
                        r.seen[j] += output_disturbance[j]

                answer = r.law(t, r.address)
                if answer != ANSWERED:
                    progress[NEXT_STEP] = i
                    progress[ANSWER] = answer
                    return

                if looped:
                    in_time = send(r.command, world)
                    keep_output(sample, r.command, in_time, measured, software)
                else:
                    for j in range(m):
                        u[j] = r.command[j]

            if looped:
                actuate(i, world, u)
                for j in range(m):
                    r.given[j] = u[j]

            if len(r.accumulated) > 0:
                r.note(i * r.h, r.address)

            # Metrics and the next timestep have the input without its disturbance.
            if len(input_disturbance) > 0:
                for j in range(m):
                    u[j] += input_disturbance[j]
                plant.step(plant.model, plant.data)
                for j in range(m):
                    u[j] = r.given[j] if looped else r.command[j]
            else:
                plant.step(plant.model, plant.data)
            for j in range(0, len(plant.warnings), 2):
                if plant.warnings[j] != 0:
                    progress[NEXT_STEP] = i
                    progress[ANSWER] = _DIVERGED
                    return
            r.engine_time[0] += r.h
            for j in range(nq):
                x[j] = q[j]
            for j in range(n - nq):
                x[nq + j] = v[j]

            if i >= r.keep:
                row = progress[FIRST_ROW] + i - r.keep
                for j in range(len(r.now)):
                    r.rows[row, j] = r.now[j]
                if r.width > 0:
                    place = r.physics + row * r.width
                    plant.read(plant.model, plant.data, place, _FULL_PHYSICS)

        progress[NEXT_STEP] = progress[LAST_STEP]

    return run


# Functions for compiled code, from the address of a ``KernelRun``, or of a ``Software``, to the
# members that a law, a metric and a design model read and write.
law_members_at = members_at(KernelRun, "x", "seen", "command", "memory", "p")
note_members_at = members_at(
    KernelRun, "x", "plant.u", "memory", "p", "accumulated", "accumulator_numbers"
)
advance_members_at = members_at(Software, "memory", "p", "own")
_run_at = structure_at(KernelRun)


@cache
def kernel(*, looped: bool) -> Any:
    """Compiled ``run_of``: an mjfBatchFunc that takes the address of a ``KernelRun``."""
    run = run_of(looped=looped)

    def entry(
        _model: Any,
        _data: Any,
        _sim: Any,
        address: Any,
    ) -> None:
        run(_run_at(address))

    return compile_c(entry, types.voidptr, types.voidptr, types.int32, types.voidptr)
