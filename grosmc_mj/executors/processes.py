"""In worker processes of this machine, which are replaced when they die."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from loky import cpu_count
from loky.backend.reduction import dumps

from grosmc_mj.errors import SetupError
from grosmc_mj.executors.interface import ATTEMPTS, Finished, Notice, Work
from grosmc_mj.executors.worker import Worker


@dataclass(frozen=True)
class Processes:
    """The executor of spawned workers: a crash in one costs its shard's time, nothing else.

    Process pools of the libraries give up all that is under way when one worker is killed.

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
        pickled = bytes(dumps(work))
        unseen = iter(indices)
        again: deque[int] = deque()
        attempts: Counter[int] = Counter()
        workers: list[Worker] = []
        # By the pipe that brings its news: a worker and the shard that it has.
        busy: dict[Any, tuple[Worker, int]] = {}

        def employ(worker: Worker) -> None:
            """Give a worker the next shard, if there is one."""
            index = again.popleft() if again else next(unseen, None)
            if index is not None:
                attempts[index] += 1
                busy[worker.pipe] = worker, index
                worker.give(index)

        try:
            for _ in range(min(self.workers, len(indices))):
                workers.append(Worker(pickled, self.threads_per_worker))
                employ(workers[-1])
            while busy:
                for pipe in wait(list(busy)):
                    worker, index = busy.pop(pipe)
                    outcome = worker.take()
                    if outcome is None:
                        _report(worker, index, attempts[index], notice)
                        again.append(index)
                        workers.remove(worker)
                        workers.append(Worker(pickled, self.threads_per_worker))
                        employ(workers[-1])
                    else:
                        report = outcome.result()
                        employ(worker)
                        yield Finished(index, report, attempts.pop(index))
        finally:
            for worker in workers:
                worker.dismiss(at_once=worker.pipe in busy)
            for worker in workers:
                worker.end()


def _report(worker: Worker, index: int, attempts: int, notice: Notice) -> None:
    """Say that a worker has died; if its shard has no attempt left, by an error."""
    fate = worker.fate()
    if attempts >= ATTEMPTS:
        raise SetupError(
            f"shard {index} was tried {attempts} times and each time its worker died, "
            f"the last one {fate}: it may need more memory than there is, or crash the engine"
        )
    notice(
        f"worker {worker.pid} {fate} while it had shard {index}: "
        f"replaced, shard {index} is run again"
    )
