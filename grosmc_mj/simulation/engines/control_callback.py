"""The law as a C callback that MuJoCo calls itself at each step.

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
import numpy as np
from numba.core import types

from grosmc_mj.control.laws import Law
from grosmc_mj.errors import SetupError
from grosmc_mj.plants import System
from grosmc_mj.records import record_dtype
from grosmc_mj.simulation.engines.compilation import array_at, compile_c, shared
from grosmc_mj.simulation.engines.inputs import written_inputs
from grosmc_mj.simulation.engines.mjdata import mjdata_dtype
from grosmc_mj.simulation.engines.native_pushes import write_wrenches
from grosmc_mj.simulation.problem import FAILED, Problem
from grosmc_mj.simulation.quiet import callback_errors_ignored, warnings_counted_only
from grosmc_mj.simulation.trajectory import Status

# Marks the userdata of our own simulations: the callback is process-wide.
MAGIC = 0.47114711
_lock = threading.RLock()


def userdata_dtype(problem: Problem) -> np.dtype[Any]:
    """Layout of mjData.userdata: the callback's header, the law's memory, the law's numbers.

    The header has: calls until the next timestep, and in each; steps begun, and until the next
    sample; stride, the steps in a control period; samples taken; timestep and control_period
    [s]; stop, a ``Status`` value; pushes, how many follow the numbers; x, the state for the law.
    """
    names = ("magic", "calls", "calls_per_step", "steps", "steps_left", "stride", "samples")
    names = (*names, "timestep", "control_period", "stop", "pushes")
    header = [*((name, np.float64) for name in names), ("x", np.float64, problem.x0.shape[1:])]
    return np.dtype(
        [
            ("header", np.dtype(header)),
            ("memory", problem.memory_dtype),
            ("parameters", record_dtype(problem.controller.parameters)),
        ]
    )


@cache
def control_callback(system: System, law: Law, userdata_dtype: np.dtype[Any]) -> Any:
    """Compile the control callback of one law, as a ctypes function."""
    law, singular, write = shared(law), system.singular, shared(write_wrenches)
    data_dtype = mjdata_dtype("qpos", "qvel", "ctrl", "userdata", "xfrc_applied")
    size = userdata_dtype.itemsize
    blank = np.zeros((), userdata_dtype)
    x_offset = blank["header"]["x"].ctypes.data - blank.ctypes.data
    n, m = system.degrees_of_freedom, len(system.inputs)
    inputs = written_inputs(m)
    singular_plant, undefined_law = Status.SINGULAR_PLANT.value, Status.UNDEFINED_LAW.value
    undefined_input = Status.UNDEFINED_INPUT.value
    completed, failed = float(Status.COMPLETED.value), float(FAILED)

    def control(model: Any, data_address: Any) -> None:
        data = array_at(data_address, (1,), data_dtype)[0]
        userdata = array_at(data.userdata, (1,), userdata_dtype)[0]
        header = userdata.header
        if header.magic != MAGIC:
            return
        header.calls -= 1.0
        if header.calls > 0.0:
            return
        # A new timestep: wrench and input are held from here on.
        header.calls = header.calls_per_step
        t = header.steps * header.timestep
        write(int(header.pushes), data.userdata + size, data.xfrc_applied, t)
        header.steps += 1.0
        header.steps_left -= 1.0
        if header.steps_left > 0.0 or header.stop != 0.0:
            return
        header.steps_left = header.stride
        qpos = array_at(data.qpos, (n,), np.float64)
        qvel = array_at(data.qvel, (n,), np.float64)
        ctrl = array_at(data.ctrl, (m,), np.float64)
        # An array, as in loops on equations: they share the law.
        x, memory = array_at(data.userdata + x_offset, (2 * n,), np.float64), userdata.memory
        for i in range(n):
            x[i] = qpos[i]
            x[i + n] = qvel[i]
        for i in range(m):
            ctrl[i] = 0.0
        if singular(x):
            header.stop = singular_plant
        else:
            t = header.samples * header.control_period
            header.stop = failed
            finite = inputs(ctrl, law(t, x, memory, userdata.parameters))
            header.stop = completed if finite else undefined_input
            if memory.undefined != 0.0:
                header.stop = undefined_law
            if header.stop != completed:
                for i in range(m):
                    ctrl[i] = 0.0
        header.samples += 1.0

    compiled = compile_c(control, types.voidptr, types.voidptr)
    prototype: Any = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    callback = prototype(compiled.address)
    callback.compiled = compiled  # keeps the machine code alive
    return callback


# MuJoCo's callbacks that have a part in the motion.
_CALLBACKS = ("control", "passive", "act_dyn", "act_gain", "act_bias", "contactfilter", "sensor")


def refuse_foreign_callback() -> None:
    """Refuse to run while somebody else's callback would set the control or add forces.

    Raises:
        SetupError: If one is installed.
    """
    # Under the lock, so that it is not our own callback of another thread.
    with _lock:
        for kind in _CALLBACKS:
            if getattr(mujoco, f"get_mjcb_{kind}")() is not None:
                does = "overrule the law" if kind == "control" else "change the plant"
                raise SetupError(
                    f"a MuJoCo {kind} callback is already installed in this process and would "
                    f"{does}: remove it with mujoco.set_mjcb_{kind}(None)"
                )


@contextmanager
def installed(callback: Any) -> Iterator[None]:
    """Have MuJoCo call ``callback`` for control, in this block only.

    Raises:
        SetupError: If somebody else's callback is installed.
    """
    with _lock:
        refuse_foreign_callback()
        mujoco.set_mjcb_control(callback)
        try:
            with warnings_counted_only(), callback_errors_ignored():
                yield
        finally:
            mujoco.set_mjcb_control(None)
