"""The fast engine: a whole run, or thousands, without coming back to Python."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import compile_c, laid_out_as, record_at
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.law import Law, innermost
from grosmc_mj.errors import ArgumentError
from grosmc_mj.jitable import is_own, jitable
from grosmc_mj.loop.controllers import ideal_loop
from grosmc_mj.loop.design_model import Advance
from grosmc_mj.loop.stages import ADVANCE, LoopRun
from grosmc_mj.physics.quiet import refuse_foreign_callback, warnings_counted_only
from grosmc_mj.plants import System
from grosmc_mj.records import pack, record_dtype
from grosmc_mj.simulation.guard import Guard, c_address, guard
from grosmc_mj.simulation.kernel import ANSWERED, LAW, NOTE, CompiledRun, kernel
from grosmc_mj.simulation.law_inputs import LawError, all_finite, compiling, write_inputs
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.python_engine import ClosedLoop, kernel_run, start
from grosmc_mj.simulation.steppers import Stepper, Steppers, shared_model
from grosmc_mj.simulation.trajectory import Status

# What is noted of a law that has raised an error, in place of a ``Status``.
_FAILED = -1
# How long compiled code runs until Python can act on Ctrl-C [s], and its first timesteps.
_PAUSE, _FIRST = 0.2, 100


def run_native(problem: Problem) -> Record:
    """Run every simulation of the problem on all threads that it allows.

    Raises:
        ArgumentError: If the law says that it can't be compiled, by an attribute ``python_only``.
        LawError: If it fails, with file and line where the Python engine finds them.
        ModelError: If MuJoCo cannot step the model.
        SetupError: If somebody else's callback is installed.
    """
    controller = problem.controller
    if getattr(controller.law, "python_only", False):
        raise ArgumentError(
            f"{controller.name} runs in Python only: use engine='python', not 'native'"
        )
    refuse_foreign_callback()
    with np.errstate(all="ignore"):
        if is_own(innermost(controller.law)):
            # Compiled code would take a truth value for a number, and says nothing of other kinds.
            (memory, _kept_alive), u = controller.begin(), np.zeros(len(problem.system.inputs))
            write_inputs(controller, 0.0, problem.x0[0].copy(), memory, u)
        record = _Runs(problem).run()
        failed = np.flatnonzero(record.status == _FAILED)
        if len(failed):
            with warnings_counted_only():
                ClosedLoop(problem, int(failed[0])).advance(problem.steps)  # Python says where
            raise LawError(
                f"{controller.name} raised an error in compiled code: run it with engine='python' "
                "to see where"
            )
    return record


class _Runs:
    """All simulations of a problem, which threads take one after the other."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._stopped = problem, threading.Event()
        controllers, meters = dict.fromkeys(problem.controllers), problem.meters[0]
        dtypes = problem.memory_dtype, record_dtype(problem.controller.parameters)
        models = [c.loop.model for c in controllers if c.loop and c.loop.model]
        self._numbers = {controller: pack(controller.parameters) for controller in controllers}
        self._memories: dict[Controller, Array] = {}
        # Plants of one model after each other: a thread has one at a time.
        places = [id(shared_model(plant)) for plant in problem.plants]
        self._order = iter(np.argsort(places, kind="stable").tolist())
        # All is compiled here, and not by several threads.
        with compiling():
            self._law = _compiled_law(problem.system, problem.controller.law, *dtypes).address
            self._advances = {
                advance: _compiled_advance(advance, *dtypes).address
                for advance in {model.advance for model in models}
            }
            self._note = 0
            if meters is not None:
                self._note = _compiled_note(meters.note, *dtypes, *meters.kind[1:]).address
        kernel(looped=problem.looped)
        self._first = Steppers(problem.timestep)
        stepper = self._first.of(problem.plants[0])
        stepper.addresses()
        self._record = Record.empty(problem, stepper.size)
        # Laid out once for all runs without a loop.
        self._nothing = ideal_loop(problem.x0.shape[1], len(problem.system.inputs))
        self._ideal = laid_out_as(LoopRun, self._nothing)

    def run(self) -> Record:
        """Run them all, until an error or Ctrl-C."""
        count = min(self._problem.threads or os.cpu_count() or 1, len(self._problem.x0))
        steppers = [self._first, *(Steppers(self._problem.timestep) for _ in range(count - 1))]
        with warnings_counted_only(), ThreadPoolExecutor(count) as pool:
            threads = [pool.submit(self._work, own) for own in steppers]
            try:
                wait(threads, return_when=FIRST_EXCEPTION)
            finally:
                self._stopped.set()
        for thread in threads:
            thread.result()
        return self._record

    def _work(self, steppers: Steppers) -> None:
        """Run one simulation after the other, in one thread, in the same room while it fits."""
        problem, fits, room = self._problem, None, None
        with guard() as thread_guard:
            for number in self._order:
                if self._stopped.is_set():
                    return
                loop, stepper = (
                    problem.controllers[number].loop,
                    steppers.of(problem.plants[number]),
                )
                needed = stepper, loop and loop.sizes
                if room is None or needed != fits:
                    fits, room = needed, self._room(number, stepper)
                self._start(room, number, stepper)
                self._advance(room, number, thread_guard)

    def _room(self, number: int, stepper: Stepper) -> CompiledRun:
        """Room for runs of this stepper, in a loop of these sizes."""
        step, model, data = stepper.addresses()
        controller = self._problem.controllers[number]
        r = kernel_run(
            self._problem, number, self._record, stepper,
            p=self._numbers[controller].copy(), law=self._law, note=self._note, step=step,
            model=model, data=data, read=c_address("mj_getState"), physics=0,
            width=8 * self._record.rows.shape[2] * bool(stepper.size),
        )  # fmt: skip
        loop, design_model = self._ideal[0], {}
        if controller.loop is not None:
            if (own := controller.loop.model) is not None:
                design_model = {"advance": self._advances[own.advance], "memory": r.memory,
                                "p": r.p, "own": own.own.copy()}  # fmt: skip
            seen = r.now[self._problem.columns["seen"]]
            loop = controller.loop.begin(seen, r.seen, **design_model)
        return CompiledRun(r._replace(loop=loop), looped=self._problem.looped)

    def _start(self, room: CompiledRun, number: int, stepper: Stepper) -> None:
        """Bring one simulation to its start."""
        problem, rows = self._problem, self._record.rows[number]
        controller, meters = problem.controllers[number], problem.meters[number]
        memory = self._memories.get(controller)
        if memory is None:
            begun, room.kept_alive = controller.begin()
            memory = pack(begun)
            if room.kept_alive is None:
                self._memories[controller] = memory
        start(room.r, problem, number, stepper, memory, rows[0])
        room.r.p[:] = self._numbers[controller]
        if controller.loop is not None:
            controller.loop.restart(room.r.loop)
        after = rows[1:]
        own: dict[str, Any] = {"rows": after, "physics": after.ctypes.data + 8 * problem.width}
        if len(problem.pushes) > 1:
            own["pushes"], own["values"] = problem.pushes_of(number)
        if meters is not None:
            room.r.meter_numbers[:] = pack(meters.numbers)
            own["meters"] = self._record.meters[number]
        room.put(**own)

    def _advance(self, room: CompiledRun, number: int, thread_guard: Guard) -> None:
        """Run one simulation, with a pause now and then."""
        record, clock, last, steps = self._record, room.r.clock, self._problem.steps, _FIRST
        while (first := int(clock[0])) < last and not self._stopped.is_set():
            began = time.perf_counter()
            if not room.advance(min(first + steps, last), thread_guard):
                break
            spent = max(time.perf_counter() - began, _PAUSE / 50)
            steps = max(1, int((clock[0] - first) * _PAUSE / spent))
        record.valid[number], record.status[number] = clock[0], clock[2] - ANSWERED
        if record.status[number] == _FAILED:
            self._stopped.set()


@cache
def _compiled_law(system: System, law: Law, memory_dtype: Any, numbers_dtype: Any) -> Any:
    """A sample of a law as a C function, which the kernel calls."""
    law, singular, answered, failed = jitable(law), system.singular, ANSWERED, ANSWERED + _FAILED
    undefined_law, singular_plant, undefined_input = (
        ANSWERED + status.value
        for status in (Status.UNDEFINED_LAW, Status.SINGULAR_PLANT, Status.UNDEFINED_INPUT)
    )

    def sample(t: float, x: Any, seen: Any, memory: Any, p: Any, u: Any) -> int:
        if singular(x):
            return singular_plant
        remembered = record_at(memory, memory_dtype)
        try:
            law(t, seen, remembered, record_at(p, numbers_dtype), u)
        except Exception:
            return failed
        if remembered.undefined != 0.0:
            return undefined_law
        return answered if all_finite(u) else undefined_input

    return compile_c(sample, *LAW.args, returns=LAW.return_type)


@cache
def _compiled_advance(advance: Advance, memory_dtype: Any, numbers_dtype: Any) -> Any:
    """The step of a design model as a C function, which the kernel calls."""
    step = jitable(advance)

    def moved(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        remembered, numbers = record_at(memory, memory_dtype), record_at(p, numbers_dtype)
        step(t, x, u, h, remembered, numbers, own)

    return compile_c(moved, *ADVANCE.args)


@cache
def _compiled_note(
    note: Any, memory_dtype: Any, numbers_dtype: Any, meters_dtype: Any, known_dtype: Any
) -> Any:
    """The accumulation of metrics as a C function, which the kernel calls."""
    note = jitable(note)

    def noted(t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, known: Any) -> None:
        remembered, numbers = record_at(memory, memory_dtype), record_at(p, numbers_dtype)
        kept, constants = record_at(meters, meters_dtype), record_at(known, known_dtype)
        note(t, x, u, remembered, numbers, kept, constants)

    return compile_c(noted, *NOTE.args)
