"""The reference engine: an ordinary loop over any callable law, easy to step through."""

from __future__ import annotations

import numpy as np

from grosmc_mj.records import pack
from grosmc_mj.simulation.engines.control_callback import refuse_foreign_callback
from grosmc_mj.simulation.engines.python_step import ClosedLoop
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.quiet import warnings_counted_only
from grosmc_mj.simulation.trajectory import Status


def run_python(problem: Problem) -> Record:
    """Run every simulation of the problem, one after the other.

    Raises:
        SetupError: If somebody else's control callback is installed.
    """
    refuse_foreign_callback()
    record = Record.empty(problem)
    # A diverging run overflows quietly, as in C; its state tells.
    with np.errstate(all="ignore"), warnings_counted_only():
        for run in range(len(problem.x0)):
            _run_one(problem, run, record)
    return record


def _run_one(problem: Problem, run: int, record: Record) -> None:
    """Run one simulation and write its rows."""
    loop = ClosedLoop(
        problem.plants[run],
        problem.controllers[run],
        problem.x0[run],
        timestep=problem.timestep,
        stride=problem.stride,
        control_period=problem.control_period,
    )
    wrenches, w = problem.wrench(run), np.zeros(6 * len(problem.system.bodies))
    state = loop.physics()
    if state is not None and record.physics is None:
        record.physics = np.zeros((*record.u.shape[:2], len(state)))
        record.start = np.zeros((len(record.u), len(state)))
    if state is not None and record.start is not None:
        record.start[run] = state
    for i in range(problem.steps):
        status = loop.advance(w if wrenches is None else wrenches[i])
        if status is not Status.COMPLETED:
            record.status[run], record.valid[run] = status.value, i
            return
        row = i if problem.record else 0
        record.x[run, row], record.u[run, row] = loop.x, loop.u
        record.memory[run, row] = pack(loop.memory)
        if record.physics is not None:
            record.physics[run, row] = loop.physics()
