"""A batch of closed loops in MuJoCo, recorded or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.base import Workspace
from grosmc_mj.records import pack
from grosmc_mj.simulation.engines.control_callback import (
    MAGIC,
    control_callback,
    installed,
    refuse_foreign_callback,
    userdata_dtype,
)
from grosmc_mj.simulation.engines.native_pushes import PUSH, most_pushes, packed
from grosmc_mj.simulation.law_errors import compiling
from grosmc_mj.simulation.machine.unseen import starts
from grosmc_mj.simulation.problem import Problem, Record, refuse_failed
from grosmc_mj.simulation.template import batch_of
from grosmc_mj.simulation.trajectory import Status

# Rows in one call: bounds the memory of a recorded chunk and the wait for Ctrl-C.
_RECORDED_ROWS, _UNRECORDED_ROWS = 100_000, 1_000_000
# Of an unrecorded run, in numbers: laws that take turns on the same plants share their models.
_ROOM = 128
_PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
_WRENCH = int(mujoco.mjtState.mjSTATE_XFRC_APPLIED)


class NativeBatch:
    """All simulations of a problem in a ``mujoco.batch.Batch``, ready to step."""

    def __init__(self, problem: Problem) -> None:
        """Compile the callback and lay out every simulation's state and userdata.

        Raises:
            SetupError: If somebody else's control callback is installed.
        """
        refuse_foreign_callback()
        self._problem = problem
        self._kept_alive: list[Workspace | None] = []
        self._dtype = userdata_dtype(problem)
        with compiling(problem.controller):
            self._callback = control_callback(problem.system, problem.controller.law, self._dtype)
        pushes = most_pushes(problem.disturbances) if problem.pushed_in_compiled_code else 0
        size = self._dtype.itemsize // 8 + PUSH * pushes
        if not problem.record:
            size = _ROOM * math.ceil(size / _ROOM)
        plants: Any = problem.plants  # in MuJoCo, all of them
        self._batch, models = batch_of(plants, size, problem.threads)
        self._bodies = {name: models[0].body(name).id for name in problem.system.bodies}
        self._n, self._nq = problem.system.degrees_of_freedom, models[0].nq
        self._batch.bind("qpos")[:], self._batch.bind("qvel")[:] = self._starts(models)
        self._userdata = self._batch.bind("userdata")
        initial = self._initial_userdata(models)
        self._userdata[:, : initial.shape[1]] = initial

    def _starts(self, models: Sequence[mujoco.MjModel]) -> tuple[Array, Array]:
        """qpos and qvel of every simulation, (nsim, nq) and (nsim, nv)."""
        problem, n = self._problem, self._n
        if self._nq == n:
            return problem.x0[:, :n], problem.x0[:, n:]
        rows = zip(models, problem.x0[:, None], strict=True)
        qpos, qvel = zip(*(starts(each, problem.system, x0) for each, x0 in rows), strict=True)
        return np.concatenate(qpos), np.concatenate(qvel)

    def _initial_userdata(self, models: list[mujoco.MjModel]) -> Array:
        """Headers, fresh memories, numbers and pushes of all simulations, flat, (nsim, size)."""
        problem = self._problem
        userdata = np.zeros(len(problem.x0), self._dtype)
        header = userdata["header"]
        header["magic"], header["control_period"] = MAGIC, problem.control_period
        header["timestep"], header["stride"] = problem.timestep, problem.stride
        # RK4 calls back in each of its four stages; the first begins a timestep.
        rk4 = np.array([m.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 for m in models])
        header["calls_per_step"] = np.where(rk4, 4, 1)
        flat = userdata.view(np.float64).reshape(len(userdata), -1)
        for row, controller in zip(flat, problem.controllers, strict=True):
            memory, workspace = controller.begin()
            self._kept_alive.append(workspace)
            row[self._memory :] = np.concatenate([pack(memory), pack(controller.parameters)])
        if not problem.pushed_in_compiled_code:
            return flat
        pushes = packed(problem.disturbances, self._bodies)
        header["pushes"] = pushes.shape[1]
        pushes = np.broadcast_to(pushes, (len(flat), *pushes.shape[1:]))
        return np.concatenate([flat, pushes.reshape(len(flat), -1)], axis=1)

    @property
    def _memory(self) -> int:
        """Where the memory begins in userdata, in numbers."""
        return self._dtype["header"].itemsize // 8

    def advance(self, steps: int) -> None:
        """Step every simulation, unrecorded and without the disturbances that need a table."""
        with installed(self._callback):
            self._batch.step(nstep=steps)

    def run(self) -> Record:
        """Run the whole problem."""
        problem, nsim = self._problem, len(self._problem.x0)
        record = Record.empty(problem)
        size = mujoco.mj_stateSize(self._batch.model, _PHYSICS)
        record.physics = np.zeros((*record.u.shape[:2], size))
        record.start = self._physics()
        rolled = problem.record or self._tabled
        chunk = max(1, (_RECORDED_ROWS if rolled else _UNRECORDED_ROWS) // nsim)
        for first in range(0, problem.steps, chunk):
            steps = min(chunk, problem.steps - first)
            if problem.record:
                self._run_recorded(record, first, steps)
            else:
                self._run_unrecorded(record, first, steps)
        return record

    @property
    def _tabled(self) -> bool:
        """Whether wrenches come from a table, step by step."""
        return self._problem.disturbed and not self._problem.pushed_in_compiled_code

    def _run_recorded(self, record: Record, first: int, steps: int) -> None:
        """Run the steps of one chunk and write all their rows."""
        out = self._roll(first, steps, [_PHYSICS, "ctrl", "userdata"])
        rows = slice(first, first + steps)
        self._write(record, rows, out[_PHYSICS], out["ctrl"], out["userdata"])
        stop = self._header("stop", out["userdata"])
        for run in self._newly_ended(record, stop[:, -1]):
            if record.status[run] == Status.DIVERGED.value:
                record.valid[run] = self._diverged_at(out[_PHYSICS][run, -1, 0])
            else:
                record.valid[run] = first + int(np.argmax(stop[run] != 0))

    def _run_unrecorded(self, record: Record, first: int, steps: int) -> None:
        """Run the steps of one chunk and write where they ended."""
        if self._tabled:
            self._roll(first, steps, ["qpos"])
        else:
            self._advance_to_first_warning(first, steps)
        ctrl, userdata = self._batch.bind("ctrl")[:, None], self._userdata[:, None]
        self._write(record, slice(0, 1), self._physics()[:, None], ctrl, userdata)
        for run in self._newly_ended(record, self._header("stop", self._userdata)):
            if record.status[run] == Status.DIVERGED.value:
                record.valid[run] = self._diverged_at(self._batch.bind("time")[run])
            else:
                samples = self._header("samples", self._userdata)[run]
                record.valid[run] = int(samples - 1) * self._problem.stride

    def _advance_to_first_warning(self, first: int, steps: int) -> None:
        """Advance, but leave a simulation that raises a warning at the step that raised it.

        ``Batch.step`` steps on; ``Batch.rollout`` stops there, so such a chunk is run again.
        """
        before, warned = self._batch.state.copy(), self._warned()
        self.advance(steps)
        again = np.flatnonzero(self._warned() & ~warned)
        if len(again):
            self._batch.state[again] = before[again]
            self._roll(first, steps, ["qpos"], again)

    def _diverged_at(self, time: float) -> int:
        """Valid steps of a simulation that raised a warning: its time stands still since."""
        return max(0, round(time / self._problem.timestep) - 1)

    def _roll(
        self, first: int, steps: int, record: list[str | int], ids: Any = None
    ) -> dict[Any, Array]:
        """Step under the chunk's wrenches, recording."""
        control = self._wrenches(first, steps)
        with installed(self._callback):
            return self._batch.rollout(
                steps, control=control, control_spec=_WRENCH, record=record, ids=ids
            )

    def _write(
        self, record: Record, rows: slice, physics: Array, ctrl: Array, userdata: Array
    ) -> None:
        """Write rows of all simulations."""
        assert record.physics is not None
        memory = slice(self._memory, self._memory + record.memory.shape[-1])
        record.physics[:, rows] = physics
        n, nq = self._n, self._nq
        if nq == n:
            record.x[:, rows] = physics[..., 1 : 1 + 2 * n]
        else:
            record.x[:, rows, :n] = physics[..., 1 : 1 + n]
            record.x[:, rows, n:] = physics[..., 1 + nq : 1 + nq + n]
        record.u[:, rows] = ctrl
        record.memory[:, rows] = userdata[..., memory]

    def _physics(self) -> Array:
        """mjSTATE_FULLPHYSICS of every simulation now, (nsim, size)."""
        names = ("time", "qpos", "qvel", "act", "history")
        time, *parts = (self._batch.bind(name) for name in names)
        return np.concatenate([time[:, None], *parts], axis=1)

    def _wrenches(self, first: int, steps: int) -> Array | None:
        """xfrc_applied of every simulation in a chunk, (nsim, steps, 6 * nbody), if tabled."""
        problem = self._problem
        if not self._tabled or problem.wrenches is None:
            return None
        part = problem.wrenches[:, first : first + steps]
        table = np.zeros((len(part), steps, self._batch.model.nbody, 6))
        table[:, :, list(self._bodies.values())] = part.reshape(*part.shape[:2], -1, 6)
        flat = table.reshape(len(part), steps, -1)
        return np.broadcast_to(flat, (len(problem.x0), *flat.shape[1:]))

    def _header(self, name: str, userdata: Array) -> Array:
        """A number of the header in rows of userdata."""
        names = self._dtype["header"].names or ()
        return userdata[..., names.index(name)]

    def _warned(self) -> NDArray[np.bool_]:
        """Whether each simulation has raised a warning, (nsim,)."""
        return self._batch.warning.any(axis=tuple(range(1, self._batch.warning.ndim)))

    def _newly_ended(self, record: Record, stop: Array) -> list[int]:
        """Simulations that ended in this chunk; their status is noted.

        One that the callback has stopped drifts on without a law: if it diverges then, that is
        not why it ended.
        """
        refuse_failed(self._problem, stop)
        running = record.status == Status.COMPLETED.value
        stopped, diverged = running & (stop != 0), running & (stop == 0) & self._warned()
        record.status[stopped] = stop[stopped]
        record.status[diverged] = Status.DIVERGED.value
        return np.flatnonzero(stopped | diverged).tolist()
