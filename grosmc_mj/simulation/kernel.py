"""The closed loop: observe, ask the law, actuate, push, step, record.

``run_of`` is plain Python. numba compiles it once for all plants, laws, loops and metrics, which it
is handed as functions and arrays; uncompiled it is the reference engine.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
from numba.core import types
from numpy.typing import NDArray

from grosmc_mj.compilation import compile_c, laid_out, laid_out_as, numba_type, structure_at
from grosmc_mj.jitable import jitable
from grosmc_mj.loop.actuators import actuate
from grosmc_mj.loop.delay import send
from grosmc_mj.loop.stages import LoopRun, Matrix, Vector, observe, remember
from grosmc_mj.simulation.disturbances import push
from grosmc_mj.simulation.guard import Guard
from grosmc_mj.simulation.trajectory import Status

# A law's function returns one more than a ``Status``, so 0 of a law that raised an error.
ANSWERED = Status.COMPLETED.value + 1
_DIVERGED = Status.DIVERGED.value + 1
_FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)

_FLOAT, _INT, _VECTOR = types.float64, types.int64, types.Array(types.float64, 1, "C")
# (t, x, seen, memory, p, u): x is the true state, seen what the law gets.
LAW = _INT(_FLOAT, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR)
# (t, x, u, memory, p, meters, numbers).
NOTE = types.void(_FLOAT, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR)
STEP = types.void(_INT, _INT)
_READ = types.void(_INT, _INT, _INT, _INT)


class KernelRun(NamedTuple):
    """One run, as ``run_of`` takes it.

    ``model``, ``data`` and ``physics`` are Python objects where it is not compiled, else
    addresses, as are the functions.

    Attributes:
        clock: The next timestep, the one to stop before, and the law's last return or why the
            run ended.
        keep: The first timestep of which a row is kept.
        stride: Timesteps in a control period.
        h: Timestep [s].
        period: Control period [s].
        step: Advances the plant: (model, data).
        read: Writes mjSTATE_FULLPHYSICS: (model, data, where, which).
        law: Samples the law, see ``LAW``; returns ``ANSWERED`` or why there is no input.
        note: Accumulates metrics at each timestep, see ``NOTE``.
        model: Of the plant: mjModel, or the numbers of equations.
        data: Of the plant: mjData, or the state of equations.
        physics: Where mjSTATE_FULLPHYSICS is kept.
        width: From one row of it to the next; 0 for none.
        q: Positions of the plant; of equations the whole state.
        v: Its velocities; of equations nothing.
        u: Its inputs, (m,).
        warnings: Every other number counts reasons why the state has diverged.
        pushes: Disturbances, (count, PUSH).
        values: Courses that are known by their values, (count, steps).
        bodies: Rows of ``forces`` of the system's bodies.
        forces: Wrenches that act on the plant, (rows, 6).
        now: The signals that are recorded: all of the following up to ``given`` lie in it.
        x: True state, (n,).
        command: The law's output, (m,).
        memory: Of the law, flat.
        w: Wrench on each of the bodies, flat.
        given: What the actuators of a loop give, (m,); without a loop nothing.
        seen: State that the law gets, (n,).
        p: The law's numbers, flat.
        meters: Accumulated metrics, flat; nothing where none are wanted.
        meter_numbers: What ``note`` needs to know, flat.
        rows: ``now`` after the kept steps, (rows, at least its size).
        loop: What is between law and plant.
    """

    clock: Annotated[NDArray[np.int64], types.Array(_INT, 1, "C")]
    keep: int
    stride: int
    h: float
    period: float
    step: Annotated[Any, types.FunctionType(STEP)]
    read: Annotated[Any, types.FunctionType(_READ)]
    law: Annotated[Any, types.FunctionType(LAW)]
    note: Annotated[Any, types.FunctionType(NOTE)]
    model: Annotated[Any, _INT]
    data: Annotated[Any, _INT]
    physics: Annotated[Any, _INT]
    width: int
    q: Vector
    v: Vector
    u: Vector
    warnings: Annotated[NDArray[np.int32], types.Array(types.int32, 1, "C")]
    pushes: Matrix
    values: Matrix
    bodies: Annotated[NDArray[np.int64], types.Array(_INT, 1, "C")]
    forces: Matrix
    now: Vector
    x: Vector
    command: Vector
    memory: Vector
    w: Vector
    given: Vector
    seen: Vector
    p: Vector
    meters: Vector
    meter_numbers: Vector
    rows: Matrix
    loop: LoopRun


@cache
def run_of(*, looped: bool) -> Callable[[KernelRun], None]:
    """The function that makes the next timesteps of a run.

    Args:
        looped: Whether a loop is between law and plant. numba leaves its stages out of the code for
            ideal loops, which is compiled in half the time.
    """

    @jitable
    def run(r: KernelRun) -> None:
        """A run's next timesteps."""
        x, u, q, v, w, loop, clock = r.x, r.u, r.q, r.v, r.w, r.loop, r.clock
        n, m, nq = len(x), len(u), len(q)
        sample = -(-clock[0] // r.stride)
        due = sample * r.stride
        for i in range(clock[0], clock[1]):
            if looped:
                remember(i, x, loop)
                due = int(loop.computer[0].due)
            if i >= due:
                if looped:
                    t = observe(i, loop)
                else:
                    t, sample, due = sample * r.period, sample + 1, due + r.stride
                    for j in range(n):
                        r.seen[j] = x[j]
                answer = r.law(t, x, r.seen, r.memory, r.p, r.command)
                if answer != ANSWERED:
                    clock[0], clock[2] = i, answer
                    return
                if looped:
                    send(r.command, loop)
                else:
                    for j in range(m):
                        u[j] = r.command[j]
            if looped:
                actuate(i, loop, u)
                for j in range(m):
                    r.given[j] = u[j]
            if len(r.pushes) > 0:
                push(r.pushes, r.values, i, i * r.h, w)
                for k in range(len(r.bodies)):
                    for j in range(6):
                        r.forces[r.bodies[k], j] = w[6 * k + j]
            if len(r.meters) > 0:
                r.note(i * r.h, x, u, r.memory, r.p, r.meters, r.meter_numbers)
            r.step(r.model, r.data)
            for j in range(0, len(r.warnings), 2):
                if r.warnings[j] != 0:
                    clock[0], clock[2] = i, _DIVERGED
                    return
            for j in range(nq):
                x[j] = q[j]
            for j in range(n - nq):
                x[nq + j] = v[j]
            row = i - r.keep
            if row >= 0:
                for j in range(len(r.now)):
                    r.rows[row, j] = r.now[j]
                if r.width > 0:
                    r.read(r.model, r.data, r.physics + row * r.width, _FULL)
        clock[0] = clock[1]

    return run


_run_at = structure_at(numba_type(KernelRun))


@cache
def kernel(*, looped: bool) -> Any:
    """The compiled ``run_of``, an mjfBatchFunc of a ``KernelRun`` in memory."""
    run = run_of(looped=looped)

    def entry(_model: Any, _data: Any, _sim: Any, address: Any) -> None:
        run(_run_at(address))

    return compile_c(entry, types.voidptr, types.voidptr, types.int32, types.voidptr)


class CompiledRun:
    """Runs for compiled code, one after the other, whose arrays it keeps alive.

    Args:
        r: With addresses of functions, model, data and states.
        looped: Whether it has a loop that is not ideal.

    Attributes:
        r: As it is now.
        kept_alive: What the law of this run computes in.
    """

    kept_alive: Any = None

    def __init__(self, r: KernelRun, *, looped: bool) -> None:
        self.r, self._block = r, laid_out_as(KernelRun, r)
        self._place, self._kernel = self._block.ctypes.data, kernel(looped=looped).address

    def put(self, **members: Any) -> None:
        """Put other arrays and addresses into the place of some."""
        self.r = self.r._replace(**members)
        for name, member in members.items():
            self._block[name][0] = laid_out(member)

    def advance(self, last: int, guard: Guard) -> bool:
        """Timesteps up to ``last``, without Python's lock; False if the run has ended."""
        self.r.clock[1] = last
        guard.call(self._kernel, self._place)
        return bool(self.r.clock[2] == ANSWERED)
