"""A closed loop on an analytic plant as one C function."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import mujoco
import numba
import numpy as np

from grosmc_mj.control.laws import Law
from grosmc_mj.plants import System
from grosmc_mj.records import record_dtype
from grosmc_mj.simulation.engines.compilation import array_at, compile_c, shared
from grosmc_mj.simulation.engines.inputs import written_inputs
from grosmc_mj.simulation.engines.native_pushes import write_wrenches
from grosmc_mj.simulation.engines.runge_kutta import runge_kutta_step
from grosmc_mj.simulation.problem import Problem
from grosmc_mj.simulation.trajectory import Status

_SIGNATURE = (*(numba.int64,) * 5, *(numba.float64,) * 2, *(numba.int64,) * 10)


def analytic_kernel(problem: Problem) -> Callable[..., None]:
    """The compiled loop for a problem's plant and law; the same as ``python_engine`` runs."""
    return _kernel(
        problem.system,
        problem.controller.law,
        record_dtype(problem.plants[0].parameters),
        record_dtype(problem.controller.parameters),
        problem.memory_dtype,
    )


@cache
def _kernel(
    system: System,
    law: Law,
    plant_dtype: np.dtype[Any],
    law_dtype: np.dtype[Any],
    memory_dtype: np.dtype[Any],
) -> Callable[..., None]:
    """Compile the loop of one system, law and layout of numbers."""
    law, write = shared(law), shared(write_wrenches)
    singular, step = system.singular, runge_kutta_step(system)
    n, m, nw = len(system.states), len(system.inputs), 6 * len(system.bodies)
    nm, inputs = memory_dtype.itemsize // 8, written_inputs(m)
    largest = mujoco.mjMAXVAL
    undefined_law, singular_plant = Status.UNDEFINED_LAW.value, Status.SINGULAR_PLANT.value
    diverged, completed = Status.DIVERGED.value, Status.COMPLETED.value
    undefined_input = Status.UNDEFINED_INPUT.value

    # Wrenches come from a table with a row for each step, if disturbed, or else from pushes, if
    # there are some: they write the one row that there is.
    def loop(
        steps: int,
        stride: int,
        disturbed: int,
        pushes: int,
        recorded: int,
        h: float,
        control_period: float,
        x_: int,
        memory_: int,
        law_: int,
        plant_: int,
        wrench_: int,
        pushes_: int,
        xs_: int,
        us_: int,
        memories_: int,
        end_: int,
    ) -> None:
        rows = steps if recorded else 1
        x = array_at(x_, (n,), np.float64)
        memory = array_at(memory_, (1,), memory_dtype)[0]
        memory_row = array_at(memory_, (nm,), np.float64)
        p = array_at(law_, (1,), law_dtype)[0]
        plant = array_at(plant_, (1,), plant_dtype)[0]
        wrenches = array_at(wrench_, (steps if disturbed else 1, nw), np.float64)
        xs = array_at(xs_, (rows, n), np.float64)
        us = array_at(us_, (rows, m), np.float64)
        memories = array_at(memories_, (rows, nm), np.float64)
        end = array_at(end_, (2,), np.int64)
        slope, stage, total = np.empty(n), np.empty(n), np.empty(n)
        u = np.zeros(m)
        for i in range(steps):
            if i % stride == 0:
                if singular(x):
                    end[0], end[1] = i, singular_plant
                    return
                finite = inputs(u, law(i // stride * control_period, x, memory, p))
                if memory.undefined != 0.0:
                    end[0], end[1] = i, undefined_law
                    return
                if not finite:
                    end[0], end[1] = i, undefined_input
                    return
            write(pushes, pushes_, wrench_, i * h)
            step(x, u, wrenches[i if disturbed else 0], plant, h, slope, stage, total)
            for j in range(n):
                if not abs(x[j]) < largest:
                    end[0], end[1] = i, diverged
                    return
            # A memory that holds much of the past is not copied at every step for nothing.
            if recorded or i == steps - 1:
                row = i if recorded else 0
                for j in range(m):
                    us[row, j] = u[j]
                for j in range(n):
                    xs[row, j] = x[j]
                for j in range(nm):
                    memories[row, j] = memory_row[j]
        end[0], end[1] = steps, completed

    return compile_c(loop, *_SIGNATURE).ctypes
