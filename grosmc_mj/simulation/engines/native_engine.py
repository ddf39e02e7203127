"""The fast engine: a whole run, or thousands, without coming back to Python."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from grosmc_mj.errors import ArgumentError
from grosmc_mj.jitable import is_own
from grosmc_mj.own_law import innermost
from grosmc_mj.records import pack
from grosmc_mj.simulation.engines.inputs import ask
from grosmc_mj.simulation.engines.native_analytic import analytic_kernel
from grosmc_mj.simulation.engines.native_batch import NativeBatch
from grosmc_mj.simulation.engines.native_pushes import packed
from grosmc_mj.simulation.engines.python_engine import run_python
from grosmc_mj.simulation.law_errors import FailedInCompiledCodeError, compiling
from grosmc_mj.simulation.problem import FAILED, Problem, Record, refuse_failed
from grosmc_mj.simulation.quiet import callback_errors_ignored


def run_native(problem: Problem) -> Record:
    """Run every simulation of the problem on all threads that it allows.

    Raises:
        ArgumentError: If the law says that it can't be compiled, by an attribute ``python_only``.
        LawError: If it fails, with file and line where the Python engine finds them.
    """
    controller = problem.controller
    if getattr(controller.law, "python_only", False):
        raise ArgumentError(
            f"{controller.name} runs in Python only: use engine='python', not 'native'"
        )
    if is_own(innermost(controller.law)):
        # Compiled code would take a truth value for a number, and says nothing of other kinds.
        memory, _kept_alive = controller.begin()
        with np.errstate(all="ignore"):
            ask(controller, 0.0, problem.x0[0].copy(), memory, np.zeros(len(problem.system.inputs)))
    try:
        if problem.plants[0].kind == "physics":
            return NativeBatch(problem).run()
        return _run_analytic(problem)
    except FailedInCompiledCodeError as failed:
        # Python says where.
        run_python(problem.alone(failed.run))
        raise


def _run_analytic(problem: Problem) -> Record:
    """Run analytic plants: one compiled call a simulation, which releases Python's lock."""
    with compiling(problem.controller):
        kernel = analytic_kernel(problem)
    record = Record.empty(problem)
    pushed, bodies = problem.pushed_in_compiled_code, problem.system.bodies
    rows = {name: row for row, name in enumerate(bodies)}
    pushes = packed(problem.disturbances if pushed else [()], rows)

    def run_one(run: int) -> None:
        plant, controller = problem.plants[run], problem.controllers[run]
        wrench = None if pushed else problem.wrench(run)
        memory, _kept_alive = controller.begin()
        arrays = (
            problem.x0[run].copy(),
            pack(memory),
            pack(controller.parameters),
            pack(plant.parameters),
            np.zeros(6 * len(bodies)) if wrench is None else np.ascontiguousarray(wrench),
            pushes[min(run, len(pushes) - 1)],
            record.x[run],
            record.u[run],
            record.memory[run],
            np.array([0, FAILED], np.int64),
        )
        # ``arrays`` keeps the memory alive that the kernel gets by address.
        kernel(
            problem.steps,
            problem.stride,
            int(wrench is not None),
            pushes.shape[1],
            int(problem.record),
            problem.timestep,
            problem.control_period,
            *(array.ctypes.data for array in arrays),
        )
        record.valid[run], record.status[run] = arrays[-1].astype(np.int64)

    threads = problem.threads or os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool, callback_errors_ignored():
        list(pool.map(run_one, range(len(problem.x0))))
    refuse_failed(problem, record.status)
    return record
