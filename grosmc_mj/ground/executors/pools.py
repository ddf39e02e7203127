"""Executors that run parts as tasks of a pool; a pool that a worker breaks is replaced."""

from __future__ import annotations

import contextlib
import itertools
import re
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

from loky import cpu_count

from grosmc_mj.ground.child_processes import shielded_from_interrupts, worker_pool
from grosmc_mj.ground.errors import GrosmcError, SetupError

# Number of times that a part may be under way while its pool breaks.
ATTEMPTS = 3
# Interval at which a pool without news is checked [s].
_CHECK_INTERVAL = 2.0
# Variables that limit the threads of numerical libraries: by default each worker has one a core.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

# Function that is called with one line about workers that died or are missing.
Notice = Callable[[str], None]

# Function that runs the part of a number: a module-level function or a `functools.partial` of one.
# It keeps its results in storage and returns a small report. It may run a part again after an
# unfinished attempt, so its results must not depend on that.
Work = Callable[[int], Any]


@dataclass(frozen=True)
class WorkOutcome:
    """Report or error of a part.

    An error is kept as its type and its message: an exception may hold an object that cannot be
    pickled, and libraries that transport exceptions log tracebacks.

    Attributes:
        report: Report of the work; None after an error.
        error: Type of the error; None without one.
        message: Message of the error.
    """

    report: Any = None
    error: type[GrosmcError] | None = None
    message: str = ""

    def result(self) -> Any:
        """Return the report.

        Raises:
            GrosmcError: The error, of its type and with its message.
        """
        if self.error is None:
            return self.report
        # Without a call of the type: some types take more arguments than a message.
        raise self.error.__new__(self.error, self.message)


def attempt(work: Work, index: int) -> WorkOutcome:
    """Run a part and return its report or its error; an interrupt is raised."""
    try:
        return WorkOutcome(work(index))
    except GrosmcError as error:
        return WorkOutcome(error=type(error), message=str(error))
    except Exception as error:
        return WorkOutcome(error=SetupError, message=unexpected(error, index))


def unexpected(error: BaseException, index: int) -> str:
    """Write one line about an error that is not one of this package."""
    return f"shard {index} failed: {error_line(error)}"


def error_line(error: BaseException) -> str:
    """Write the type of an error and the first line of its message."""
    name = type(error).__name__
    lines = str(error).strip().splitlines()
    if not lines:
        return name
    return f"{name}: {lines[0].strip()}"


@dataclass(frozen=True)
class Finished:
    """A finished part.

    Attributes:
        index: Number of the part.
        report: Report of the work.
        attempts: Number of times it was submitted; more than 1 if a pool broke meanwhile.
    """

    index: int
    report: Any
    attempts: int


class Pool(NamedTuple):
    """Workers that wait for parts.

    Attributes:
        submit: Function that submits a part to a worker; its future has an ``WorkOutcome``.
        ahead: Number of parts that are submitted at a time.
        require: Function that raises an error if the workers can no longer be reached.
    """

    submit: Callable[[int], Future]
    ahead: int
    require: Callable[[], object]


class Executor(Protocol):
    """Runner of parts, in any order."""

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use, so that all workers together use each core once."""
        ...

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index, and yield each part as it finishes.

        Closing the iterator, an error and Ctrl-C stop the workers; parts under way are given up.

        Args:
            work: The work.
            indices: Numbers of the parts; a long range is never copied to a list.
            notice: Function that is called with a line about workers that died.

        Raises:
            GrosmcError: An error of this package, as the work raised it; another error of the
                work is a SetupError that names the part.
            SetupError: If a part has used up its attempts, or the workers cannot be reached.
        """
        ...


@dataclass(frozen=True)
class InProcess:
    """Executor of this process: one part after another, each on all cores."""

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use: one for each core."""
        return cpu_count()

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index, in their order; see `Executor.run`."""
        for index in indices:
            yield Finished(index, attempt(work, index).result(), 1)


@dataclass(frozen=True)
class Processes:
    """Executor of spawned workers.

    Attributes:
        workers: Number of workers; each of them runs many parts.
    """

    workers: int

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use: the cores divided by the workers; at least 1."""
        return max(1, cpu_count() // self.workers)

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index; see `Executor.run`."""
        workers = min(self.workers, len(indices))
        yield from run_in(partial(self._pool, work, workers), indices, notice)

    @contextlib.contextmanager
    def _pool(self, work: Work, workers: int) -> Iterator[Pool]:
        """Open loky's pool; it lasts as long as the context."""
        threads = str(self.threads_per_worker)
        pool = worker_pool(workers, dict.fromkeys(_THREADS, threads))

        # Nested, for it needs the pool and the work.
        def submit(index: int) -> Future:
            with shielded_from_interrupts():
                return pool.submit(attempt, work, index)

        try:
            yield Pool(submit, workers, lambda: None)
        finally:
            pool.shutdown(kill_workers=True)


def run_in(
    opened: Callable[[], contextlib.AbstractContextManager[Pool]],
    indices: Sequence[int],
    notice: Notice,
) -> Generator[Finished, None, None]:
    """Run parts in a pool; if it breaks, run those that were under way again in a new pool.

    Args:
        opened: Function that opens a pool.
        indices: Numbers of the parts.
        notice: Function that is called with a line about each pool that broke.
    """
    waiting = iter(indices)
    attempts = Counter[int]()
    while True:
        # No pool is opened without a part.
        first = next(waiting, None)
        if first is None:
            return
        waiting = itertools.chain([first], waiting)

        under_way: dict[int, Future] = {}
        try:
            with opened() as pool:
                yield from _run_until_broken(pool, waiting, under_way, attempts)
        except BrokenExecutor as death:
            interrupted = sorted(under_way)
            fate = _fate(death)
            parts = f"shard {', '.join(map(str, interrupted))}"
            if max(attempts[index] for index in interrupted) >= ATTEMPTS:
                raise SetupError(
                    f"{fate}, the {ATTEMPTS}. time while {parts} ran: it may need more memory "
                    "than there is, or crash the engine"
                ) from None
            notice(f"{fate} while {parts} ran: the workers are replaced, {parts} is run again")
            waiting = itertools.chain(interrupted, waiting)


def _fate(death: BrokenExecutor) -> str:
    """Write how a worker ended, by the error of its pool."""
    # loky has the exit code in its message only: SIGKILL(-9) or EXIT(7).
    code = re.search(r"\w+\(-?\d+\)", str(death))
    if code is None:
        return "a worker ended without an exit code"
    return f"a worker ended by {code[0]}"


def _run_until_broken(
    pool: Pool,
    waiting: Iterator[int],
    under_way: dict[int, Future],
    attempts: Counter[int],
) -> Generator[Finished, None, None]:
    """Yield parts as they finish; if the pool breaks, ``under_way`` has the unfinished ones."""
    while True:
        for index in itertools.islice(waiting, max(0, pool.ahead - len(under_way))):
            attempts[index] += 1
            # The part is under way even if the pool breaks while it is submitted.
            under_way[index] = Future()
            under_way[index] = pool.submit(index)
        if not under_way:
            return

        done = wait(under_way.values(), _CHECK_INTERVAL, FIRST_COMPLETED).done
        if not done:
            pool.require()
        finished = [index for index, future in under_way.items() if future in done]

        # If the pool has broken, the parts that finished before come first.
        for index in sorted(finished, key=lambda index: bool(under_way[index].exception())):
            report = _report(under_way[index], index)
            del under_way[index]
            yield Finished(index, report, attempts.pop(index))


def _report(future: Future, index: int) -> Any:
    """Return the report of a part, or raise its error."""
    try:
        return future.result().result()
    except (GrosmcError, BrokenExecutor):
        raise
    except Exception as error:
        # The report cannot be pickled.
        raise SetupError(unexpected(error, index)) from None
