"""The fast engine: a whole run, or thousands, without coming back to Python."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from grosmc_mj.plants import AnalyticPlant
from grosmc_mj.simulation.native_analytic import analytic_kernel
from grosmc_mj.simulation.native_physics import NativeBatch
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.records import pack
from grosmc_mj.simulation.trajectory import Status


def run_native(problem: Problem) -> Record:
    """Run every simulation of the problem on all threads that it allows."""
    if isinstance(problem.plants[0], AnalyticPlant):
        return _run_analytic(problem)
    return NativeBatch(problem).run()


def _run_analytic(problem: Problem) -> Record:
    """Run analytic plants: one compiled call a simulation, which releases Python's lock."""
    kernel, record = analytic_kernel(problem), Record.empty(problem)
    nothing = np.zeros(6 * len(problem.system.bodies))

    def run_one(run: int) -> None:
        wrench = problem.wrench(run)
        w = np.ascontiguousarray(nothing if wrench is None else wrench)
        x = problem.x0[run].copy()
        memory = pack(problem.controllers[run].memory())
        end = np.array([problem.steps, Status.COMPLETED.value], np.int64)
        kernel(
            problem.steps,
            problem.stride,
            int(wrench is not None),
            int(problem.record),
            problem.timestep,
            problem.control_period,
            x.ctypes.data,
            memory.ctypes.data,
            pack(problem.controllers[run].parameters).ctypes.data,
            pack(problem.plants[run].parameters).ctypes.data,  # pyright: ignore
            w.ctypes.data,
            record.x[run].ctypes.data,
            record.u[run].ctypes.data,
            record.memory[run].ctypes.data,
            end.ctypes.data,
        )
        record.valid[run], record.status[run] = end

    threads = problem.threads or os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run_one, range(len(problem.x0))))
    return record
