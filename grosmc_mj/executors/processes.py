"""In worker processes of this machine, which are replaced when they die."""

from __future__ import annotations

import gc
import re
from collections import Counter, deque
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from functools import cache

from loky import cpu_count
from loky.backend.reduction import dumps, loads
from loky.process_executor import BrokenProcessPool, ProcessPoolExecutor

from grosmc_mj.child_processes import interrupts_held, worker_pool
from grosmc_mj.errors import GrosmcError, SetupError
from grosmc_mj.executors.interface import (
    ATTEMPTS,
    Finished,
    Notice,
    ShardOutcome,
    Work,
    attempt,
    unexpected,
)

# The numerical libraries would start a thread for every core in every worker.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Processes:
    """The executor of spawned workers: a crash in one costs its shard's time, nothing else.

    Each worker is a pool of one process, since a pool gives up all that is under way when one of
    its processes is killed.

    Attributes:
        workers: How many; each is kept from shard to shard.
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
        pickled, unseen = bytes(dumps(work)), iter(indices)
        environment = {name: str(self.threads_per_worker) for name in _THREADS}
        again: deque[int] = deque()
        attempts: Counter[int] = Counter()
        busy: dict[Future, tuple[ProcessPoolExecutor, int]] = {}
        pools = [worker_pool(1, environment) for _ in range(min(self.workers, len(indices)))]

        def employ(pool: ProcessPoolExecutor) -> None:
            """Give a worker the next shard, if there is one."""
            index = again.popleft() if again else next(unseen, None)
            if index is not None:
                attempts[index] += 1
                busy[_submit(pool, pickled, index)] = pool, index

        try:
            for pool in pools:
                employ(pool)
            while busy:
                for future in wait(busy, return_when=FIRST_COMPLETED).done:
                    pool, index = busy.pop(future)
                    try:
                        report = future.result().result()
                    except GrosmcError:
                        raise
                    except BrokenProcessPool as death:
                        _report(death, index, attempts[index], notice)
                        again.append(index)
                        pools[pools.index(pool)] = replacement = worker_pool(1, environment)
                        employ(replacement)
                    except Exception as error:  # the report cannot travel
                        raise SetupError(unexpected(error, index)) from None
                    else:
                        employ(pool)
                        yield Finished(index, report, attempts.pop(index))
        finally:
            for pool in pools:
                pool.shutdown(kill_workers=True)


def _submit(pool: ProcessPoolExecutor, pickled: bytes, index: int) -> Future:
    """The shard's outcome, pickled; a worker that has died while it was idle breaks it too."""
    try:
        with interrupts_held():
            return pool.submit(_run, pickled, index)
    except BrokenProcessPool as death:
        future: Future = Future()
        future.set_exception(death)
        return future


def _run(pickled: bytes, index: int) -> ShardOutcome:
    """In a worker: run a shard."""
    return attempt(_unpickled(pickled), index)


@cache
def _unpickled(pickled: bytes) -> Work:
    """In a worker: the work. Modules that it imports stay: collecting them would be in vain."""
    work = loads(pickled)
    gc.freeze()
    return work


def _report(death: Exception, index: int, attempts: int, notice: Notice) -> None:
    """Say that a worker has died; if its shard has no attempt left, by an error."""
    # loky tells the exit code in its message only: SIGKILL(-9) or EXIT(7).
    code = re.search(r"\w+\(-?\d+\)", str(death))
    fate = f"ended by {code[0]}" if code else "ended without an exit code"
    if attempts >= ATTEMPTS:
        raise SetupError(
            f"shard {index} was tried {attempts} times and each time its worker died, "
            f"the last one {fate}: it may need more memory than there is, or crash the engine"
        )
    notice(f"a worker {fate} while it had shard {index}: replaced, shard {index} is run again")
