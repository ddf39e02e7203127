"""The fast engine: a whole run, or thousands, in compiled code."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from functools import cache
from typing import Any

import numba
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.compilation.compiler import compile_c, fingerprint
from grosmc_mj.ground.compilation.jitable import is_users_function, jitable
from grosmc_mj.ground.compilation.records import pack, record_dtype
from grosmc_mj.ground.compilation.structures import laid_out, local_copy, record_at, structure_of
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.mechanics.physics.hooks import (
    clock_suspended,
    refuse_foreign_callback,
    warnings_counted_only,
)
from grosmc_mj.simulation.guard import Guard, guard
from grosmc_mj.simulation.kernel import (
    ANSWER,
    ANSWERED,
    LAST_STEP,
    LAW,
    NEXT_STEP,
    NOTE,
    advance_members_at,
    kernel,
    law_members_at,
    note_members_at,
)
from grosmc_mj.simulation.law_inputs import LawError, all_finite, compiling, sample_law
from grosmc_mj.simulation.loop.applied import ideal_loop
from grosmc_mj.simulation.loop.software import ADVANCE
from grosmc_mj.simulation.problem import Accumulator, Problem, Record
from grosmc_mj.simulation.python_engine import ClosedLoop
from grosmc_mj.simulation.run_memory import RunMemory
from grosmc_mj.simulation.steppers import Stepper, Steppers, shared_model
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.design_model import Advance
from grosmc_mj.theory.control.law import Law, innermost
from grosmc_mj.theory.plants import System

# Status of a run whose law raised an exception.
_FAILED = -1
# Time that compiled code runs until Python can act on Ctrl-C [s].
_PAUSE = 0.2
# Timesteps before the first pause of a thread, which has not yet measured their time.
_FIRST_STEPS = 100


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
    if numba.config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]
        raise SetupError(
            "NUMBA_DISABLE_JIT is set, and the native engine runs compiled laws: unset it, or take "
            'engine = "python"'
        )

    with np.errstate(all="ignore"):
        if is_users_function(innermost(controller.law)):
            _require_numbers(problem)

        record = _Batch(problem).run()
        failed = np.flatnonzero(record.status == _FAILED)
        if len(failed):
            with warnings_counted_only():
                # Python raises the error with its file and line.
                ClosedLoop(problem, int(failed[0])).advance(problem.steps)
            raise LawError(
                f"{controller.name} raised an error in compiled code: run it with engine='python' "
                "to see where"
            )
    return record


def _require_numbers(problem: Problem) -> None:
    """Refuse a law whose inputs are no numbers: compiled code would take a truth value for one."""
    controller = problem.controller
    memory = controller.memory()
    u = np.zeros(len(problem.system.inputs))
    sample_law(controller, 0.0, problem.x0[0].copy(), memory, u)


class _Batch:
    """All simulations of a problem; threads take one after the other.

    Attributes:
        problem: Simulations.
        record: Results.
        stopped: Set where threads must not begin another simulation.
        order: Numbers of the simulations that no thread has taken yet.
        law: Address of the compiled law.
        note: Address of the compiled metrics; 0 without any.
        advances: Addresses of the compiled design models.
        numbers: Numbers of each controller, flat.
        constants: Constants of the metrics, flat.
        no_loop: Structure of an ideal loop.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.stopped = threading.Event()

        controllers = dict.fromkeys(problem.controllers)
        self.numbers = {controller: pack(controller.parameters) for controller in controllers}
        self.constants: dict[Accumulator | None, Array] = {}
        for accumulator in dict.fromkeys(problem.accumulators):
            if accumulator is not None:
                self.constants[accumulator] = pack(accumulator.numbers)

        self._compile(problem)
        self._first_steppers = Steppers(problem.timestep)
        stepper = self._first_steppers.of(problem.plants[0])
        stepper.compiled()
        self.record = Record.empty(problem, stepper.recorded_size)
        # The arrays of an ideal loop are empty and serve all runs.
        self._ideal_loop = ideal_loop(problem.x0.shape[1], len(problem.system.inputs))
        self.no_loop = structure_of(self._ideal_loop)[0]

        # A thread has the model of one plant at a time: plants of one model come after each other.
        models = [id(shared_model(plant)) for plant in problem.plants]
        self.order: Iterator[int] = iter(np.argsort(models, kind="stable").tolist())

    def _compile(self, problem: Problem) -> None:
        """Compile everything here, and not in several threads."""
        system = problem.system
        controller = problem.controller
        dtypes = problem.memory_dtype, record_dtype(controller.parameters)
        with compiling():
            self.law = _compiled_law(system, controller.law, *dtypes).address

            self.advances: dict[Advance, int] = {}
            for loop in dict.fromkeys(problem.loops):
                if loop is not None and loop.model is not None:
                    advance = loop.model.advance
                    self.advances[advance] = _compiled_advance(system, advance, *dtypes).address

            self.note = 0
            accumulator = problem.accumulators[0]
            if accumulator is not None:
                note, *metric_dtypes = accumulator.kind
                self.note = _compiled_note(system, note, *dtypes, *metric_dtypes).address
        kernel(looped=problem.looped)

    def run(self) -> Record:
        """Run all simulations, until an error or Ctrl-C."""
        problem = self.problem
        threads = min(problem.threads or os.cpu_count() or 1, len(problem.x0))
        workers = [_Worker(self, self._first_steppers)]
        workers += [_Worker(self, Steppers(problem.timestep)) for _ in range(threads - 1)]

        with warnings_counted_only(), clock_suspended():
            if threads == 1:
                workers[0].work()
            else:
                self._run_threads(workers)
        return self.record

    def _run_threads(self, workers: list[_Worker]) -> None:
        """Run each worker in a thread; the first error or Ctrl-C stops all of them."""
        with ThreadPoolExecutor(len(workers)) as pool:
            threads = [pool.submit(worker.work) for worker in workers]
            try:
                wait(threads, return_when=FIRST_EXCEPTION)
            finally:
                self.stopped.set()
        for thread in threads:
            thread.result()


class _CompiledMemory(RunMemory):
    """Memory for runs in compiled code; it keeps their arrays alive.

    Args:
        batch: Simulations.
        number: Number of the first one.
        stepper: Stepper of their plants.
    """

    def __init__(self, batch: _Batch, number: int, stepper: Stepper) -> None:
        problem = batch.problem
        record = batch.record
        super().__init__(
            problem,
            number,
            record,
            stepper,
            stepper.compiled(),
            law=batch.law,
            note=batch.note,
            p=batch.numbers[problem.controllers[number]].copy(),
            physics=record.rows.ctypes.data + 8 * problem.width,
            width=record.rows.strides[1] if stepper.recorded_size else 0,
        )
        self._batch = batch
        self._room = self._needed(number)
        self.run = self.run._replace(loop=self._loop(number))

        self._structure = structure_of(self.run)
        self._address = self._structure.ctypes.data
        self._structure["address"] = self._address
        software = self._structure["loop"]["software"]
        software["address"] = software.ctypes.data
        self._kernel = kernel(looped=problem.looped).address

    def _needed(self, number: int) -> Any:
        """Sizes of the loop of a simulation."""
        loop = self.problem.loops[number]
        return loop and loop.sizes

    def fits(self, number: int, stepper: Stepper) -> bool:
        """Whether there is room for a simulation on a stepper."""
        return stepper is self.stepper and self._needed(number) == self._room

    def _loop(self, number: int) -> Any:
        """Loop of the first simulation."""
        applied = self.problem.loops[number]
        if applied is None:
            return self._batch.no_loop

        run = self.run
        design_model = {}
        if applied.model is not None:
            design_model["advance"] = self._batch.advances[applied.model.advance]
            design_model["memory"] = run.memory
            design_model["p"] = run.p
            design_model["own"] = applied.model.own.copy()
        seen = run.now[self.problem.columns["seen"]]
        return applied.begin(self.problem.x0[number], seen, run.seen, **design_model)

    def begin(self, number: int, memory: Array) -> None:
        """Bring one simulation to its start, with the numbers of its law and metrics."""
        super().begin(number, memory)
        batch = self._batch
        problem = self.problem
        run = self.run
        run.p[:] = batch.numbers[problem.controllers[number]]

        loop = problem.loops[number]
        if loop is not None:
            loop.restart(run.loop, problem.x0[number])
        if len(problem.packed_disturbances) > 1:
            # The caller keeps the arrays alive; those of ``run`` are the first simulation's.
            numbers, values = problem.disturbances_of(number)
            self._structure["disturbances"]["numbers"][0] = laid_out(numbers)
            self._structure["disturbances"]["values"][0] = laid_out(values)
        accumulator = problem.accumulators[number]
        if accumulator is not None:
            run.accumulator_numbers[:] = batch.constants[accumulator]
            run.accumulated[:] = self.record.accumulated[number]

    def advance(self, last: int, thread_guard: Guard) -> bool:
        """Make timesteps up to ``last`` without Python's lock; False if the run has ended."""
        self.run.progress[LAST_STEP] = last
        thread_guard.call(self._kernel, self._address)
        return bool(self.run.progress[ANSWER] == ANSWERED)


class _Worker:
    """One thread of a batch: it makes simulations in the same memory while they fit into it.

    Args:
        batch: Simulations, of which it takes one after the other.
        steppers: Steppers of this thread.
    """

    def __init__(self, batch: _Batch, steppers: Steppers) -> None:
        self._batch = batch
        self._steppers = steppers
        # Controller of the last run, and its memory as a run begins.
        self._controller: Controller | None = None
        self._memory: Any = None
        self._steps_before_pause = _FIRST_STEPS

    def work(self) -> None:
        """Make simulations until none is left or the batch is stopped."""
        batch = self._batch
        memory: _CompiledMemory | None = None
        with guard() as thread_guard:
            for number in batch.order:
                if batch.stopped.is_set():
                    return

                stepper = self._steppers.of(batch.problem.plants[number])
                if memory is None or not memory.fits(number, stepper):
                    memory = _CompiledMemory(batch, number, stepper)
                memory.begin(number, self._memory_of_law(number))
                self._advance(memory, number, thread_guard)

    def _memory_of_law(self, number: int) -> Array:
        """Memory of the law of a simulation as it begins, flat."""
        controller = self._batch.problem.controllers[number]
        if controller is not self._controller:
            memory = controller.memory()
            self._controller = controller
            self._memory = pack(memory)
        return self._memory

    def _advance(self, memory: _CompiledMemory, number: int, thread_guard: Guard) -> None:
        """Make one simulation, with pauses for Ctrl-C."""
        batch = self._batch
        record = batch.record
        progress = memory.run.progress
        last = batch.problem.steps
        while progress[NEXT_STEP] < last and not batch.stopped.is_set():
            first = int(progress[NEXT_STEP])
            began = time.perf_counter()
            if not memory.advance(min(first + self._steps_before_pause, last), thread_guard):
                break
            # Of a short run the clock tells little.
            elapsed = max(time.perf_counter() - began, _PAUSE / 50)
            steps = int(progress[NEXT_STEP]) - first
            self._steps_before_pause = max(1, int(steps * _PAUSE / elapsed))

        record.valid[number] = progress[NEXT_STEP]
        record.status[number] = progress[ANSWER] - ANSWERED
        record.accumulated[number] = memory.run.accumulated
        if record.status[number] == _FAILED:
            batch.stopped.set()


# Compiled functions of this process by what they reach.
_compiled: dict[tuple[str, Any], Any] = {}


def _compile_once(function: Callable[..., Any], signature: Any) -> Any:
    """Compile a function to a C function, once for all equal closures.

    To load the code of an equal closure from the disk once more takes 4 ms and 0.1 MB.
    """
    key = fingerprint(function), signature
    if key not in _compiled:
        _compiled[key] = compile_c(function, *signature.args, returns=signature.return_type)
    return _compiled[key]


# A fingerprint takes as long as a short run, 0.7 ms: a law that is known is found by itself.
@cache
def _compiled_law(
    system: System,
    law: Law,
    memory_dtype: Any,
    numbers_dtype: Any,
) -> Any:
    """Compile a sample of a law to a C function that the kernel calls."""
    law = jitable(law)
    singular = system.singular
    n = len(system.states)
    m = len(system.inputs)
    answered = ANSWERED
    failed = ANSWERED + _FAILED
    undefined_law = ANSWERED + Status.UNDEFINED_LAW.value
    singular_plant = ANSWERED + Status.SINGULAR_PLANT.value
    undefined_input = ANSWERED + Status.UNDEFINED_INPUT.value

    def sample(t: float, address: Any) -> int:
        x, seen, command, memory, p = law_members_at(address)
        if singular(local_copy(x, n)):
            return singular_plant

        u = local_copy(command, m)
        memory_record = record_at(memory, memory_dtype)
        try:
            law(t, local_copy(seen, n), memory_record, record_at(p, numbers_dtype), u)
        except Exception:
            return failed
        memory_record.begun = 1.0
        for i in range(m):
            command[i] = u[i]

        if memory_record.undefined != 0.0:
            return undefined_law
        return answered if all_finite(u) else undefined_input

    return _compile_once(sample, LAW)


@cache
def _compiled_advance(
    system: System, advance: Advance, memory_dtype: Any, numbers_dtype: Any
) -> Any:
    """Compile a step of a design model to a C function that the kernel calls."""
    advance = jitable(advance)
    n = len(system.states)
    m = len(system.inputs)

    def step(t: float, state: Any, u: Any, h: float, address: Any) -> None:
        memory, p, own = advance_members_at(address)
        x = local_copy(state, n)
        memory_record = record_at(memory, memory_dtype)
        advance(t, x, local_copy(u, m), h, memory_record, record_at(p, numbers_dtype), own)
        for i in range(n):
            state[i] = x[i]

    return _compile_once(step, ADVANCE)


@cache
def _compiled_note(
    system: System,
    note: Any,
    memory_dtype: Any,
    numbers_dtype: Any,
    values_dtype: Any,
    constants_dtype: Any,
) -> Any:
    """Compile the accumulation of metrics to a C function that the kernel calls."""
    note = jitable(note)
    n = len(system.states)
    m = len(system.inputs)

    def accumulate(t: float, address: Any) -> None:
        x, u, memory, p, values, constants = note_members_at(address)
        note(
            t,
            local_copy(x, n),
            local_copy(u, m),
            record_at(memory, memory_dtype),
            record_at(p, numbers_dtype),
            record_at(values, values_dtype),
            record_at(constants, constants_dtype),
        )

    return _compile_once(accumulate, NOTE)
