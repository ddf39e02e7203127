"""The fast engine: a whole run, or thousands, without coming back to Python."""

from __future__ import annotations

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.compilation import array_at, compile_c, laid_out_as
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
from grosmc_mj.simulation.inputs import all_finite, ask
from grosmc_mj.simulation.kernel import ANSWERED, LAW, NOTE, CompiledRun, kernel
from grosmc_mj.simulation.law_errors import LawError, compiling
from grosmc_mj.simulation.problem import Problem, Record
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.steppers import Stepper, Steppers, kernel_run, start
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
    if is_own(innermost(controller.law)):
        # Compiled code would take a truth value for a number, and says nothing of other kinds.
        memory, _kept_alive = controller.begin()
        with np.errstate(all="ignore"):
            ask(controller, 0.0, problem.x0[0].copy(), memory, np.zeros(len(problem.system.inputs)))
    record = _Runs(problem).run()
    failed = np.flatnonzero(record.status == _FAILED)
    if len(failed):
        # Python says where.
        with np.errstate(all="ignore"), warnings_counted_only():
            ClosedLoop(problem, int(failed[0])).advance(problem.steps)
        raise LawError(
            f"{controller.name} raised an error in compiled code: run it with engine='python' to "
            "see where"
        )
    return record


class _Runs:
    """All simulations of a problem, which threads take one after the other."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._stopped = problem, threading.Event()
        self._dtypes = problem.memory_dtype, record_dtype(problem.controller.parameters)
        meters, self._note = problem.meters[0], 0
        with compiling(problem.controller):
            self._law = _compiled_law(problem.system, problem.controller.law, *self._dtypes)
            loops = [each.loop for each in problem.controllers if each.loop]
            for advance in {of.model.advance for of in loops if of.model}:
                _compiled_advance(advance, *self._dtypes)
            if meters is not None:
                self._note = _compiled_note(meters.note, *self._dtypes, *meters.kind[1:]).address
        several = dict.fromkeys(problem.controllers)
        self._numbers = {controller: pack(controller.parameters) for controller in several}
        self._memories: dict[Controller, Array] = {}
        # Plants of one model after each other: a thread has one at a time.
        places = [id(_model_of(plant)) for plant in problem.plants]
        self._order = iter(np.argsort(places, kind="stable").tolist())
        self._first = Steppers(problem.timestep)
        stepper = self._first.of(problem.plants[0])
        # Compiled here, and not by several threads.
        for looped in {controller.loop is not None for controller in several}:
            kernel(looped=looped)
        stepper.addresses()
        self._record = Record.empty(problem, stepper.size)
        self._rows_at = self._record.rows.ctypes.data
        # Laid out once for all runs without a loop.
        self._nothing = ideal_loop(problem.x0.shape[1], len(problem.system.inputs))
        self._ideal = laid_out_as(LoopRun, self._nothing)

    def run(self) -> Record:
        """Run them all, until an error or Ctrl-C."""
        threads = min(self._problem.threads or os.cpu_count() or 1, len(self._problem.x0))
        steppers = [self._first, *(Steppers(self._problem.timestep) for _ in range(threads - 1))]
        pool = ThreadPoolExecutor(threads)
        with warnings_counted_only(), pool:
            try:
                list(pool.map(self._work, steppers))
            finally:
                self._stopped.set()
        return self._record

    def _work(self, steppers: Steppers) -> None:
        """Run one simulation after the other, in one thread, in the same room while it fits."""
        problem, fits, room = self._problem, None, None
        with guard() as thread_guard:
            try:
                for number in self._order:
                    if self._stopped.is_set():
                        return
                    stepper, loop = steppers.of(problem.plants[number]), problem.loop_of(number)
                    needed = stepper, loop and loop.sizes
                    if room is None or needed != fits:
                        fits, room = needed, self._room(number, stepper)
                    self._start(room, number, stepper)
                    self._advance(room, number, thread_guard)
            except BaseException:
                self._stopped.set()
                raise

    def _room(self, number: int, stepper: Stepper) -> CompiledRun:
        """Room for runs of this stepper, in a loop of these sizes."""
        controller = self._problem.controllers[number]
        step, model, data = stepper.addresses()
        p = self._numbers[controller].copy()

        def loop_of(seen: Array, predicted: Array, memory: Array) -> Any:
            loop = controller.loop
            if loop is None:
                return self._ideal[0]
            if loop.model is None:
                return loop.begin(seen, predicted)
            advance = _compiled_advance(loop.model.advance, *self._dtypes).address
            own = loop.model.own.copy()
            return loop.begin(seen, predicted, advance=advance, memory=memory, p=p, own=own)

        r = kernel_run(
            self._problem, number, self._record, stepper, loop_of,
            p=p, law=self._law.address, note=self._note, step=step, model=model, data=data,
            read=c_address("mj_getState"), physics=0,
            width=8 * self._record.rows.shape[2] * bool(stepper.size),
        )  # fmt: skip
        return CompiledRun(r, looped=controller.loop is not None)

    def _start(self, room: CompiledRun, number: int, stepper: Stepper) -> None:
        """Bring one simulation to its start."""
        problem, rows = self._problem, self._record.rows[number]
        controller, loop, meters = (
            problem.controllers[number], problem.loop_of(number), problem.meters[number],
        )  # fmt: skip
        memory = self._memories.get(controller)
        if memory is None:
            begun, room.kept_alive = controller.begin()
            memory = pack(begun)
            if room.kept_alive is None:
                self._memories[controller] = memory
        start(room.r, problem, number, stepper, memory, rows[0])
        room.r.p[:] = self._numbers[controller]
        if loop is not None:
            loop.restart(room.r.loop)
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


def _model_of(plant: Any) -> Any:
    """The model shared by plants that a thread moves by one mjData."""
    if plant.kind != "physics":
        return None
    return plant.template if plant.changes is not None else plant.undrawn_model


@cache
def _compiled_law(
    system: System, law: Law, memory_dtype: np.dtype[Any], numbers_dtype: np.dtype[Any]
) -> Any:
    """A sample of a law as a C function, which the kernel calls."""
    law, singular = jitable(law), system.singular
    answered, failed = ANSWERED, ANSWERED + _FAILED
    undefined_law = ANSWERED + Status.UNDEFINED_LAW.value
    singular_plant = ANSWERED + Status.SINGULAR_PLANT.value
    undefined_input = ANSWERED + Status.UNDEFINED_INPUT.value

    def sample(t: float, x: Any, seen: Any, memory: Any, p: Any, u: Any) -> int:
        if singular(x):
            return singular_plant
        remembered = array_at(memory.ctypes.data, (1,), memory_dtype)[0]
        numbers = array_at(p.ctypes.data, (1,), numbers_dtype)[0]
        try:
            law(t, seen, remembered, numbers, u)
        except Exception:
            return failed
        if remembered.undefined != 0.0:
            return undefined_law
        return answered if all_finite(u) else undefined_input

    return compile_c(sample, *LAW.args, returns=LAW.return_type)


@cache
def _compiled_advance(advance: Advance, memory_dtype: Any, numbers_dtype: Any) -> Any:
    """The step of a design model as a C function, which the kernel calls."""
    advance = jitable(advance)

    def moved(t: float, x: Any, u: Any, h: float, memory: Any, p: Any, own: Any) -> None:
        remembered = array_at(memory.ctypes.data, (1,), memory_dtype)[0]
        numbers = array_at(p.ctypes.data, (1,), numbers_dtype)[0]
        advance(t, x, u, h, remembered, numbers, own)

    return compile_c(moved, *ADVANCE.args)


@cache
def _compiled_note(
    note: Any, memory_dtype: Any, numbers_dtype: Any, meters_dtype: Any, known_dtype: Any
) -> Any:
    """The accumulation of metrics as a C function, which the kernel calls."""
    note = jitable(note)

    def noted(t: float, x: Any, u: Any, memory: Any, p: Any, meters: Any, known: Any) -> None:
        remembered = array_at(memory.ctypes.data, (1,), memory_dtype)[0]
        numbers = array_at(p.ctypes.data, (1,), numbers_dtype)[0]
        kept = array_at(meters.ctypes.data, (1,), meters_dtype)[0]
        note(t, x, u, remembered, numbers, kept, array_at(known.ctypes.data, (1,), known_dtype)[0])

    return compile_c(noted, *NOTE.args)
