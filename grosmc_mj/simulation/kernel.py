"""The closed loop: sample, hold, push, step, record.

``run`` is plain Python. numba compiles it once for all plants and laws, which it is handed as
functions; uncompiled it is the reference engine.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numba.core import types
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import array_at, compile_c, function_at
from grosmc_mj.errors import ModelError
from grosmc_mj.jitable import jitable
from grosmc_mj.physics.mjdata import mujoco_library
from grosmc_mj.simulation.disturbances import PUSH, push
from grosmc_mj.simulation.trajectory import Status

# What a law's function says: one more than a ``Status``, so 0 of a law that raised an error.
ANSWERED = Status.COMPLETED.value + 1
_DIVERGED = Status.DIVERGED.value + 1
_FULL = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)

_ARRAY = types.Array(types.float64, 1, "C")
LAW = types.int64(types.float64, _ARRAY, _ARRAY, _ARRAY, _ARRAY)
STEP = types.void(types.int64, types.int64)
_READ = types.void(types.int64, types.int64, types.int64, types.int64)


class KernelRun(NamedTuple):
    """One run, as ``run`` takes it.

    ``model``, ``data`` and ``states`` are Python objects where ``run`` is not compiled, else
    addresses, as are the functions.

    Attributes:
        keep: The first timestep of which a row is kept.
        stride: Timesteps in a control period.
        h: Timestep [s].
        period: Control period [s].
        step: Advances the plant: (model, data).
        read: Writes mjSTATE_FULLPHYSICS: (model, data, where, which).
        law: Samples the law: (t, x, memory, p, u), returns ``ANSWERED`` or why there is no input.
        model: Of the plant: mjModel, or the numbers of equations.
        data: Of the plant: mjData, or the state of equations.
        states: Where mjSTATE_FULLPHYSICS is kept.
        width: From one row of it to the next; 0 for none.
        x: What the law sees, (n,).
        memory: Of the law, flat.
        p: The law's numbers, flat.
        q: Positions of the plant; of equations the whole state.
        v: Its velocities; of equations nothing.
        u: Its inputs, which the law writes, (m,).
        warnings: Every other number counts reasons why the state has diverged.
        pushes: Disturbances, (count, PUSH).
        values: Courses that are known by their values, (count, steps).
        bodies: Rows of ``forces`` of the system's bodies.
        w: Wrench on each of them, flat.
        forces: Wrenches that act on the plant, (rows, 6).
        xs: States after the kept steps, (rows, n).
        us: Commands, (rows, m).
        memories: Memory, (rows, size).
        wrenches: Wrenches, (rows, 6 * bodies); no rows for an undisturbed run.
        end: Valid steps, and what the law said last or why the run ended.
    """

    keep: int
    stride: int
    h: float
    period: float
    step: Any
    read: Any
    law: Any
    model: Any
    data: Any
    states: Any
    width: int
    x: Array
    memory: Array
    p: Array
    q: Array
    v: Array
    u: Array
    warnings: NDArray[np.int32]
    pushes: Array
    values: Array
    bodies: NDArray[np.int64]
    w: Array
    forces: Array
    xs: Array
    us: Array
    memories: Array
    wrenches: Array
    end: NDArray[np.int64]


@jitable
def run(first: int, last: int, loop: KernelRun) -> None:
    """Timesteps ``first`` to ``last`` of a run."""
    x, u, q, v, w = loop.x, loop.u, loop.q, loop.v, loop.w
    nq, nv = len(q), len(v)
    for i in range(first, last):
        if i % loop.stride == 0:
            for j in range(nq):
                x[j] = q[j]
            for j in range(nv):
                x[nq + j] = v[j]
            said = loop.law(i // loop.stride * loop.period, x, loop.memory, loop.p, u)
            if said != ANSWERED:
                loop.end[0], loop.end[1] = i, said
                return
        if len(loop.pushes) > 0:
            push(loop.pushes, loop.values, i, i * loop.h, w)
            for k in range(len(loop.bodies)):
                for j in range(6):
                    loop.forces[loop.bodies[k], j] = w[6 * k + j]
        loop.step(loop.model, loop.data)
        for j in range(0, len(loop.warnings), 2):
            if loop.warnings[j] != 0:
                loop.end[0], loop.end[1] = i, _DIVERGED
                return
        row = i - loop.keep
        if row >= 0:
            for j in range(nq):
                loop.xs[row, j] = q[j]
            for j in range(nv):
                loop.xs[row, nq + j] = v[j]
            loop.us[row] = u
            loop.memories[row] = loop.memory
            if len(loop.wrenches) > 0:
                loop.wrenches[row] = w
            if loop.width > 0:
                loop.read(loop.model, loop.data, loop.states + row * loop.width, _FULL)


# The same in memory: numbers and addresses, and how long the arrays are.
_WHOLE = ("first", "last", "keep", "stride", "step", "read", "law", "model", "data", "states")
_ARRAYS = KernelRun._fields[KernelRun._fields.index("x") :]
_LENGTHS = ("width", "n", "memory_size", "p_size", "m", "nq", "nv", "warning_count", "push_count")
_LENGTHS = (*_LENGTHS, "value_count", "steps", "body_count", "force_count", "rows", "wrench_rows")
_BLOCK = np.dtype(
    [
        *((name, np.int64) for name in (*_WHOLE, *_ARRAYS, *_LENGTHS)),
        ("h", np.float64),
        ("period", np.float64),
    ]
)
_NAMES = _BLOCK.names or ()

_step_at, _read_at, _law_at = function_at(STEP), function_at(_READ), function_at(LAW)


def _entry(_model: Any, _data: Any, _sim: Any, address: Any) -> None:
    """``run`` as an mjfBatchFunc, of a block of memory."""
    b = array_at(address, (1,), _BLOCK)[0]
    loop = KernelRun(
        b.keep,
        b.stride,
        b.h,
        b.period,
        _step_at(b.step),
        _read_at(b.read),
        _law_at(b.law),
        b.model,
        b.data,
        b.states,
        b.width,
        array_at(b.x, (b.n,), np.float64),
        array_at(b.memory, (b.memory_size,), np.float64),
        array_at(b.p, (b.p_size,), np.float64),
        array_at(b.q, (b.nq,), np.float64),
        array_at(b.v, (b.nv,), np.float64),
        array_at(b.u, (b.m,), np.float64),
        array_at(b.warnings, (b.warning_count,), np.int32),
        array_at(b.pushes, (b.push_count, PUSH), np.float64),
        array_at(b.values, (b.value_count, b.steps), np.float64),
        array_at(b.bodies, (b.body_count,), np.int64),
        array_at(b.w, (6 * b.body_count,), np.float64),
        array_at(b.forces, (b.force_count, 6), np.float64),
        array_at(b.xs, (b.rows, b.n), np.float64),
        array_at(b.us, (b.rows, b.m), np.float64),
        array_at(b.memories, (b.rows, b.memory_size), np.float64),
        array_at(b.wrenches, (b.wrench_rows, 6 * b.body_count), np.float64),
        array_at(b.end, (2,), np.int64),
    )
    run(b.first, b.last, loop)


@cache
def kernel() -> Any:
    """The compiled ``run``, an mjfBatchFunc."""
    return compile_c(_entry, types.voidptr, types.voidptr, types.int32, types.voidptr)


def _address(array: NDArray[Any]) -> int:
    """Of an array without gaps."""
    assert array.flags.c_contiguous
    return array.ctypes.data


class CompiledLoop:
    """A run for compiled code, whose arrays it keeps alive.

    Args:
        loop: With addresses of functions, model, data and states.
    """

    def __init__(self, loop: KernelRun) -> None:
        lengths = (
            *(loop.width, len(loop.x), len(loop.memory), len(loop.p), len(loop.u), len(loop.q)),
            *(len(loop.v), len(loop.warnings), len(loop.pushes), *loop.values.shape),
            *(len(loop.bodies), len(loop.forces), len(loop.xs), len(loop.wrenches)),
        )
        values = dict(zip(_LENGTHS, lengths, strict=True), first=0, last=0)
        for name, value in loop._asdict().items():
            values[name] = _address(value) if isinstance(value, np.ndarray) else value
        self._loop, self._block = loop, np.array([tuple(values[x] for x in _NAMES)], _BLOCK)
        self._place = _address(self._block)

    def advance(self, first: int, last: int, guard: Guard) -> bool:
        """Timesteps ``first`` to ``last``, without Python's lock; False if the run has ended."""
        self._block["first"], self._block["last"] = first, last
        guard.call(kernel().address, self._place)
        return bool(self._loop.end[1] == ANSWERED)


class Guard:
    """What catches an error of MuJoCo's, which else ends the process, in one thread at a time.

    MuJoCo's batch leaves a simulation at its error. This one has a single and empty simulation,
    beside which another function runs.
    """

    def __init__(self) -> None:
        self._library, error = _library(), ctypes.create_string_buffer(1000)
        model = mujoco.MjModel.from_xml_string("<mujoco><size memory='1k'/></mujoco>")
        config = (ctypes.c_int * 2)(1, 0)
        batch = self._library.mjb_makeBatch(model._address, 1, config, error, len(error))
        if not batch:
            raise ModelError(f"MuJoCo makes no batch: {error.value.decode()}")
        self._batch, self._first = batch, (ctypes.c_int * 1)(0)

    def call(self, function: int, argument: int) -> None:
        """Call a C function of an mjModel, an mjData, an integer and a pointer.

        Args:
            function: Its address.
            argument: The pointer.

        Raises:
            ModelError: If MuJoCo raised an error in it.
        """
        batch, first = self._batch, self._first
        if self._library.mjb_apply(batch, first, 1, function, argument, False):
            raise cannot_step(self._library.mjb_error(batch, 0).decode(errors="replace"))

    def __del__(self) -> None:
        if batch := getattr(self, "_batch", None):
            self._library.mjb_deleteBatch(batch)


def cannot_step(said: str) -> ModelError:
    """What becomes of an error of MuJoCo's."""
    return ModelError(f"MuJoCo cannot step the model: {' '.join(said.split())}")


_idle: list[Guard] = []


@contextmanager
def guard() -> Iterator[Guard]:
    """A guard for this thread, kept for the next one."""
    own = _idle.pop() if _idle else Guard()
    yield own
    _idle.append(own)


@cache
def _library() -> Any:
    """MuJoCo's C functions that guards call."""
    library, pointer = ctypes.CDLL(str(mujoco_library())), ctypes.c_void_p
    make, apply = library.mjb_makeBatch, library.mjb_apply
    make.restype, library.mjb_error.restype = pointer, ctypes.c_char_p
    make.argtypes = (pointer, ctypes.c_int, pointer, ctypes.c_char_p, ctypes.c_int)
    apply.argtypes = (pointer, pointer, ctypes.c_int, pointer, pointer, ctypes.c_bool)
    library.mjb_error.argtypes = (pointer, ctypes.c_int)
    library.mjb_deleteBatch.argtypes = (pointer,)
    return library


@cache
def c_address(name: str) -> int:
    """Of a C function of MuJoCo's."""
    found = ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value
    assert found is not None
    return found
