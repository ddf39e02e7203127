"""Executors: parts of some work as tasks of a pool, which is rebuilt if a worker breaks it."""

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

from grosmc_mj.child_processes import interrupts_held, worker_pool
from grosmc_mj.errors import GrosmcError, SetupError

# How often a part is under way while its pool breaks, before that is no accident any more.
ATTEMPTS = 3
# How often to look whether a pool that reports nothing is still there [s].
_LOOK = 2.0
# The numerical libraries would start a thread for every core in every worker.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

# Called with one line about workers that died or are not there.
Notice = Callable[[str], None]


# The work, by the number of a part: a module-level function or a `functools.partial` of one, which
# leaves its results in storage and returns a small report. It may be run again, even if a part of
# it was done, so that its results must not depend on that.
Work = Callable[[int], Any]


@dataclass(frozen=True)
class Outcome:
    """A report, or the error that took its place.

    An error is kept as its type and its message: an exception may hold an object that cannot be
    pickled, and libraries that carry exceptions log tracebacks.

    Attributes:
        report: Of the work; None after an error.
        error: Type of the error; None without one.
        message: Its message.
    """

    report: Any = None
    error: type[GrosmcError] | None = None
    message: str = ""

    def result(self) -> Any:
        """The report.

        Raises:
            GrosmcError: Of the type and with the message of the error.
        """
        if self.error is None:
            return self.report
        # Not by a call: some types take more arguments than a message.
        raise self.error.__new__(self.error, self.message)


def attempt(work: Work, index: int) -> Outcome:
    """Run a part; its error is data, an interrupt is not."""
    try:
        return Outcome(work(index))
    except GrosmcError as error:
        return Outcome(error=type(error), message=str(error))
    except Exception as error:
        return Outcome(error=SetupError, message=unexpected(error, index))


def unexpected(error: BaseException, index: int) -> str:
    """One line about an error that is not the package's own."""
    return f"shard {index} failed: {error_line(error)}"


def error_line(error: BaseException) -> str:
    """Type of an error and the first line of its message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[:1]])


@dataclass(frozen=True)
class Finished:
    """A part that is done.

    Attributes:
        index: Number of the part.
        report: Of the work.
        attempts: How often it was submitted; more than 1 if a pool broke meanwhile.
    """

    index: int
    report: Any
    attempts: int


class Pool(NamedTuple):
    """Workers that wait for parts.

    Attributes:
        submit: Submits a part to a worker; its future has an ``Outcome``.
        ahead: Parts that are submitted at a time.
        require: Raises a ``SetupError`` if the workers can no longer be reached.
    """

    submit: Callable[[int], Future]
    ahead: int
    require: Callable[[], object]


class Executor(Protocol):
    """Runs parts, in an order of its own."""

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use, so that all workers together use each core once."""
        ...

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index once, and yield each as it finishes.

        Closing the iterator, an error and Ctrl-C stop the workers; parts under way are given up.

        Args:
            work: The work.
            indices: Numbers of the parts; a range of any length is never unrolled.
            notice: Called with a line about workers that died.

        Raises:
            GrosmcError: As the work raised it, with its type and message; other errors of the
                work are a SetupError that names the part.
            SetupError: If a part has cost its last attempt, or the workers cannot be reached.
        """
        ...


@dataclass(frozen=True)
class Batch:
    """The executor of this process: one part after another, each on all cores."""

    @property
    def threads_per_worker(self) -> int:
        """As many as there are cores for this process."""
        return cpu_count()

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index, in their order; see `Executor.run`."""
        for index in indices:
            yield Finished(index, attempt(work, index).result(), 1)


@dataclass(frozen=True)
class Processes:
    """The executor of spawned workers.

    Attributes:
        workers: How many; each is kept from part to part.
    """

    workers: int

    @property
    def threads_per_worker(self) -> int:
        """The cores of this machine, divided among the workers; at least 1."""
        return max(1, cpu_count() // self.workers)

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index; see `Executor.run`."""
        workers = min(self.workers, len(indices))
        yield from run_in(partial(self._pool, work, workers), indices, notice)

    @contextlib.contextmanager
    def _pool(self, work: Work, workers: int) -> Iterator[Pool]:
        """loky's pool; it lasts as long as the context."""
        pool = worker_pool(workers, dict.fromkeys(_THREADS, str(self.threads_per_worker)))

        def submit(index: int) -> Future:
            with interrupts_held():
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
    """Run parts in a pool; if it breaks, in a new one all those that were under way again.

    Args:
        opened: Opens a pool.
        indices: Numbers of the parts.
        notice: Called with a line about each pool that broke.
    """
    left, attempts = iter(indices), Counter[int]()
    while (first := next(left, None)) is not None:
        left, under_way = itertools.chain([first], left), dict[int, Future]()
        try:
            with opened() as pool:
                yield from _run_until_broken(pool, left, under_way, attempts)
        except BrokenExecutor as death:
            # loky has the exit code in its message only: SIGKILL(-9) or EXIT(7).
            code = re.search(r"\w+\(-?\d+\)", str(death))
            fate = f"a worker ended by {code[0]}" if code else "a worker ended without an exit code"
            parts = f"shard {', '.join(map(str, sorted(under_way)))}"
            if max(attempts[index] for index in under_way) >= ATTEMPTS:
                raise SetupError(
                    f"{fate}, the {ATTEMPTS}. time while {parts} ran: it may need more memory "
                    "than there is, or crash the engine"
                ) from None
            notice(f"{fate} while {parts} ran: the workers are replaced, {parts} is run again")
            left = itertools.chain(sorted(under_way), left)


def _run_until_broken(
    pool: Pool, left: Iterator[int], under_way: dict[int, Future], attempts: Counter[int]
) -> Generator[Finished, None, None]:
    """Parts as they finish; those that have not are left in ``under_way`` if the pool breaks."""
    while True:
        for index in itertools.islice(left, max(0, pool.ahead - len(under_way))):
            attempts[index] += 1
            under_way[index] = Future()
            under_way[index] = pool.submit(index)
        if not under_way:
            return
        done = wait(under_way.values(), _LOOK, FIRST_COMPLETED).done
        if not done:
            pool.require()
        finished = [index for index, future in under_way.items() if future in done]
        # Of a pool that breaks, the parts that were finished before come first.
        for index in sorted(finished, key=lambda index: bool(under_way[index].exception())):
            try:
                report = under_way[index].result().result()
            except (GrosmcError, BrokenExecutor):
                raise
            except Exception as error:  # the report cannot travel
                raise SetupError(unexpected(error, index)) from None
            del under_way[index]
            yield Finished(index, report, attempts.pop(index))
