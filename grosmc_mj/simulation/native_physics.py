"""A closed loop in MuJoCo as a C callback that MuJoCo calls itself.

All that a simulation needs lies in its own mjData.userdata: a header, the law's memory and the
law's numbers. So one callback serves every simulation of a batch, on any thread.
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np
from mujoco.batch import Batch
from numba.core import types
from numpy.typing import NDArray

from grosmc_mj.control.laws import Law
from grosmc_mj.errors import SetupError
from grosmc_mj.jitable import jitable
from grosmc_mj.plants import System
from grosmc_mj.simulation.compilation import compile_c, pointer
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.records import pack, record_dtype
from grosmc_mj.simulation.trajectory import Status

Array = NDArray[np.float64]
_State = mujoco.mjtState

# Marks the userdata of our own simulations: the callback is process-wide.
_MAGIC = 0.47114711
# Rows recorded in one call: bounds the memory of a chunk and the wait for Ctrl-C.
_CHUNK = 100_000
_lock = threading.RLock()


def _header_dtype(n: int) -> np.dtype[Any]:
    """The header of userdata: what the callback keeps for itself.

    Returns:
        countdown: calls until the next sample; samples: taken so far; calls_per_sample;
        control_period [s]; stop: a ``Status`` value; x: the state handed to the law.
    """
    names = ("magic", "countdown", "samples", "calls_per_sample", "control_period", "stop")
    return np.dtype([*((name, np.float64) for name in names), ("x", np.float64, (n,))])


def _userdata_dtype(problem: Problem) -> np.dtype[Any]:
    """Layout of mjData.userdata."""
    return np.dtype(
        [
            ("header", _header_dtype(problem.x0.shape[1])),
            ("memory", problem.memory_dtype),
            ("parameters", record_dtype(problem.controller.parameters)),
        ]
    )


@cache
def _data_dtype() -> np.dtype[Any]:
    """Where mjData keeps the pointers that the callback follows.

    The offsets are read off a live mjData, so that they are those of the installed MuJoCo.
    """
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><size nuserdata='1'/><worldbody><body><joint name='j'/><geom size='1'/></body>"
        "</worldbody><actuator><motor joint='j'/></actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    wanted = {
        getattr(data, name).ctypes.data: name for name in ("qpos", "qvel", "ctrl", "userdata")
    }
    offsets, offset = {}, 0
    # Every array's pointer is a field of the struct, so the search ends inside it.
    while wanted:
        word = ctypes.c_uint64.from_address(data._address + offset).value
        if word in wanted:
            offsets[wanted.pop(word)] = offset
        offset += 8
    return np.dtype(
        {"names": list(offsets), "formats": [np.int64] * 4, "offsets": list(offsets.values())}
    )


@cache
def _callback(system: System, law: Law, userdata_dtype: np.dtype[Any]) -> Any:
    """Compile the control callback of one law, as a ctypes function."""
    law, singular, data_dtype = jitable(law), system.singular, _data_dtype()
    n = system.degrees_of_freedom
    singular_plant, undefined_law = Status.SINGULAR_PLANT.value, Status.UNDEFINED_LAW.value

    def control(model: Any, data_address: Any) -> None:
        data = numba.carray(data_address, (1,), data_dtype)[0]
        userdata = numba.carray(pointer(data.userdata), (1,), userdata_dtype)[0]
        header = userdata.header
        if header.magic != _MAGIC:
            return
        header.countdown -= 1.0
        if header.countdown > 0.0 or header.stop != 0.0:
            return
        header.countdown = header.calls_per_sample
        qpos = numba.carray(pointer(data.qpos), (n,), np.float64)
        qvel = numba.carray(pointer(data.qvel), (n,), np.float64)
        ctrl = numba.carray(pointer(data.ctrl), (1,), np.float64)
        x, memory = header.x, userdata.memory
        for i in range(n):
            x[i] = qpos[i]
            x[i + n] = qvel[i]
        u = 0.0
        if singular(x):
            header.stop = singular_plant
        else:
            u = law(header.samples * header.control_period, x, memory, userdata.parameters)
            if memory.undefined != 0.0:
                header.stop = undefined_law
                u = 0.0
        header.samples += 1.0
        ctrl[0] = u

    compiled = compile_c(control, types.voidptr, types.voidptr)
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    callback = prototype(compiled.address)
    callback.compiled = compiled  # keeps the machine code alive
    return callback


@contextmanager
def installed(callback: Any) -> Iterator[None]:
    """Have MuJoCo call ``callback`` for control, in this block only.

    Raises:
        SetupError: If somebody else's callback is installed: it would be silenced.
    """
    with _lock:
        if mujoco.get_mjcb_control() is not None:
            raise SetupError(
                "a MuJoCo control callback is already installed in this process: remove it with "
                "mujoco.set_mjcb_control(None), or use engine='python'"
            )
        mujoco.set_mjcb_control(callback)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(None)


class NativeBatch:
    """All simulations of a problem in a ``mujoco.batch.Batch``, ready to step."""

    def __init__(self, problem: Problem) -> None:
        """Compile the callback and lay out every simulation's state and userdata."""
        self._problem = problem
        self._dtype = _userdata_dtype(problem)
        self.callback = _callback(problem.system, problem.controller.law, self._dtype)
        size, nsim = self._dtype.itemsize // 8, len(problem.x0)
        compiled = {plant: _compile(plant, size) for plant in dict.fromkeys(problem.plants)}
        models = [compiled[plant] for plant in problem.plants]
        self.batch = Batch(models[0], nsim, problem.threads)
        if len(compiled) > 1:
            self.batch.set_models(models)
        self._bodies = [models[0].body(name).id for name in problem.system.bodies]
        n = problem.system.degrees_of_freedom
        self.batch.bind("qpos")[:] = problem.x0[:, :n]
        self.batch.bind("qvel")[:] = problem.x0[:, n:]
        # RK4 calls back in each of its four stages; the law samples in the first.
        stages = 4 if models[0].opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 else 1
        userdata = np.zeros(nsim, self._dtype)
        header = userdata["header"]
        header["magic"], header["control_period"] = _MAGIC, problem.control_period
        header["calls_per_sample"] = stages * problem.stride
        flat = userdata.view(np.float64).reshape(nsim, size)
        head = self._dtype["header"].itemsize // 8
        for row, controller in zip(flat, problem.controllers, strict=True):
            row[head:] = np.concatenate([pack(controller.memory()), pack(controller.parameters)])
        self.batch.bind("userdata")[:] = flat

    def advance(self, steps: int) -> None:
        """Step every simulation, undisturbed and unrecorded."""
        with installed(self.callback):
            self.batch.step(nstep=steps)

    def run(self) -> Record:
        """Run the whole problem."""
        problem, nsim = self._problem, len(self._problem.x0)
        record = Record.empty(problem)
        physics = int(_State.mjSTATE_FULLPHYSICS)
        size = mujoco.mj_stateSize(self.batch.model, physics)
        record.physics = np.zeros((*record.u.shape, size))
        record.start = np.zeros((nsim, size))
        n = problem.system.degrees_of_freedom
        record.start[:, 1 : 1 + 2 * n] = problem.x0
        if not problem.record and problem.wrenches is None:
            chunk = max(1, 10 * _CHUNK // nsim)
        else:
            chunk = max(1, _CHUNK // nsim)
        for first in range(0, problem.steps, chunk):
            steps = min(chunk, problem.steps - first)
            rows = slice(first, first + steps) if problem.record else slice(0, 1)
            self._run_chunk(record, first, steps, rows)
        return record

    def _run_chunk(self, record: Record, first: int, steps: int, rows: slice) -> None:
        """Run the steps of one chunk and write its rows."""
        problem, physics = self._problem, int(_State.mjSTATE_FULLPHYSICS)
        if problem.record or problem.wrenches is not None:
            with installed(self.callback):
                out = self.batch.rollout(
                    steps,
                    control=self._wrenches(first, steps),
                    control_spec=int(_State.mjSTATE_XFRC_APPLIED),
                    record=[physics, "ctrl", "userdata"] if problem.record else [physics],
                )
            states = out[physics] if problem.record else out[physics][:, -1:]
        else:
            self.advance(steps)
            states = self._states()
        userdata = out["userdata"] if problem.record else self.batch.bind("userdata")[:, None]
        ctrl = out["ctrl"] if problem.record else self.batch.bind("ctrl")[:, None]
        memory = self._dtype.fields["memory"][1] // 8  # pyright: ignore
        record.physics[:, rows] = states  # pyright: ignore
        record.x[:, rows] = states[..., 1 : 1 + record.x.shape[-1]]
        record.u[:, rows] = ctrl[..., 0]
        record.memory[:, rows] = userdata[..., memory : memory + record.memory.shape[-1]]
        self._note_ends(record, first, steps, states, userdata)

    def _states(self) -> Array:
        """mjSTATE_FULLPHYSICS of every simulation now, (nsim, 1, size)."""
        parts = [self.batch.time[:, None], self.batch.qpos, self.batch.qvel]
        return np.concatenate(parts, axis=1)[:, None]

    def _wrenches(self, first: int, steps: int) -> Array | None:
        """xfrc_applied of every simulation in a chunk, (nsim, steps, 6 * nbody)."""
        problem = self._problem
        if problem.wrenches is None:
            return None
        part = problem.wrenches[:, first : first + steps]
        table = np.zeros((len(part), steps, self.batch.model.nbody, 6))
        table[:, :, self._bodies] = part.reshape(*part.shape[:2], -1, 6)
        return np.broadcast_to(
            table.reshape(len(part), steps, -1), (len(problem.x0), steps, table[0, 0].size)
        )

    def _note_ends(
        self, record: Record, first: int, steps: int, states: Array, userdata: Array
    ) -> None:
        """Note which simulations ended in this chunk, when and why."""
        problem = self._problem
        stop_column = list(self._dtype["header"].names or ()).index("stop")
        running = record.status == Status.COMPLETED.value
        diverged = running & self.batch.warning.any(axis=tuple(range(1, self.batch.warning.ndim)))
        for run in np.flatnonzero(diverged):
            record.status[run] = Status.DIVERGED.value
            # A simulation that raised a warning steps no further: its time stands still.
            last = self.batch.time[run] if not problem.record else states[run, -1, 0]
            record.valid[run] = max(0, round(last / problem.timestep) - 1)
        stopped = userdata[..., stop_column]
        for run in np.flatnonzero(running & ~diverged & (stopped[:, -1] != 0)):
            record.status[run] = int(stopped[run, -1])
            if problem.record:
                record.valid[run] = first + int(np.argmax(stopped[run] != 0))
            else:
                samples = self.batch.bind("userdata")[run, 2]
                record.valid[run] = int(samples - 1) * problem.stride


def _compile(plant: Any, size: int) -> mujoco.MjModel:
    """A plant's model with room for the userdata."""
    assert isinstance(plant, MujocoPlant)
    return plant.model_with_userdata(size)
