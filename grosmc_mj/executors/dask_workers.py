"""On Dask's workers: this machine's, or those of a cluster."""

from __future__ import annotations

import contextlib
import functools
import itertools
import platform
import queue
import socket
import uuid
from collections import Counter
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any

from distributed import Client, Future, KilledWorker

from grosmc_mj.errors import SetupError
from grosmc_mj.executors.dask_cluster import cluster_client
from grosmc_mj.executors.interface import (
    Finished,
    Notice,
    ShardOutcome,
    Work,
    attempt,
    one_line,
)
from grosmc_mj.versions import DECISIVE, versions

# Shards with the scheduler, for each thread of its workers: enough to keep them busy while
# reports travel, few enough that a million of them do not sit there.
_AHEAD = 4
# How often to look whether the scheduler is still there [s].
_LOOK = 2.0


@dataclass(frozen=True)
class DaskWorkers:
    """The executor of a Dask cluster; Dask replaces workers and moves their shards.

    Attributes:
        workers: Processes on this machine, without a scheduler.
        scheduler: Address of a running one, or its file.
    """

    workers: int
    scheduler: str | None = None

    @property
    def threads_per_worker(self) -> int:
        """One: a cluster is divided into cores, not machines."""
        return 1

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index; see `Executor.run`."""
        if not indices:
            return
        workers = min(self.workers, len(indices))
        with cluster_client(workers, self.scheduler) as client:
            yield from _Flow(client, work, notice).run(indices)


class _Flow:
    """The shards on their way through one client."""

    def __init__(self, client: Client, work: Work, notice: Notice) -> None:
        # Any: the client's methods are typed for its blocking and its asynchronous face at once.
        self._client: Any = client
        self._work, self._notice = work, notice
        # A name for all: Dask keeps a record for each name that it sees.
        self._name = f"shard-{uuid.uuid4().hex}"
        # Finished futures, and what happened to workers, in the order in which we hear of it.
        self._news: queue.SimpleQueue[Future | dict[str, Any]] = queue.SimpleQueue()
        # By key. Dask drops a shard whose future nobody holds.
        self._under_way: dict[Any, tuple[int, Future]] = {}
        self._attempts: Counter[int] = Counter()
        self._warned: set[str] = set()

    def run(self, indices: Sequence[int]) -> Generator[Finished, None, None]:
        """All of them, a few for each worker at a time."""
        unseen = iter(indices)
        self._client.subscribe_topic("all", self._hear)
        try:
            room = self._room()
            while True:
                free = max(0, room - len(self._under_way))
                for index in itertools.islice(unseen, free):
                    self._submit(index)
                if not self._under_way:
                    return
                futures = []
                for news in self._next_news():
                    if isinstance(news, Future):
                        futures.append(news)
                    else:
                        self._tell(news)
                        room = self._room()
                yield from self._finish(futures)
        finally:
            self._client.unsubscribe_topic("all")

    def _hear(self, event: tuple[float, dict[str, Any]]) -> None:
        """In Dask's thread: keep what concerns workers."""
        _, message = event
        if message.get("action") in ("add-worker", "remove-worker"):
            self._news.put(message)

    def _room(self) -> int:
        """How many shards may be under way."""
        threads = self._threads()
        if any(count > 1 for count in threads):
            self._warn(
                "a Dask worker has several threads, but shards of one process wait for each other: "
                "start workers with --nthreads 1"
            )
        return _AHEAD * max(1, sum(threads))

    def _threads(self) -> list[int]:
        """Of each worker."""
        try:
            return list(self._client.nthreads().values())
        except OSError as error:
            raise self._gone() from error

    def _warn(self, text: str) -> None:
        """A notice that is given once."""
        if text not in self._warned:
            self._warned.add(text)
            self._notice(text)

    def _submit(self, index: int) -> None:
        """Hand a shard to the scheduler."""
        key = (self._name, index)
        try:
            future = self._client.submit(
                _attempt, self._work, index, decisive_versions(), key=key, pure=False
            )
        except Exception as error:
            if self._client.status == "running":
                raise
            raise self._gone() from error
        self._under_way[key] = index, future
        self._attempts[index] += 1
        future.add_done_callback(self._news.put)

    def _next_news(self) -> list[Future | dict[str, Any]]:
        """What happens next, and what has happened until now."""
        while True:
            try:
                news = [self._news.get(timeout=_LOOK)]
                break
            except queue.Empty:
                if self._client.status != "running":
                    raise self._gone() from None
                if not self._threads():
                    self._warn("no Dask worker is connected to the scheduler: waiting for one")
        with contextlib.suppress(queue.Empty):
            while True:
                news.append(self._news.get_nowait())
        return news

    def _finish(self, futures: list[Future]) -> Generator[Finished, None, None]:
        """Shards that are done; their reports are fetched together, or fetching would be slow."""
        indices = [self._under_way.pop(future.key)[0] for future in futures]
        for future, index in zip(futures, indices, strict=True):
            if future.status == "error":
                raise _failure(future.exception(), index)
        try:
            outcomes: list[ShardOutcome] = self._client.gather(futures)
        except (CancelledError, OSError):
            raise self._gone() from None
        for index, outcome in zip(indices, outcomes, strict=True):
            yield Finished(index, outcome.result(), self._attempts.pop(index))

    def _tell(self, message: dict[str, Any]) -> None:
        """Say that a worker has gone, and what becomes of its shards."""
        if message["action"] != "remove-worker":
            return
        keys = {*message["processing-tasks"], *message["lost-computed-tasks"]}
        indices = sorted(self._under_way[key][0] for key in keys if key in self._under_way)
        self._attempts.update(indices)
        if indices:
            shards, them = ("shards", "them") if len(indices) > 1 else ("shard", "it")
            self._notice(
                f"Dask worker {message['worker']} was lost while it had {shards} "
                f"{', '.join(map(str, indices))}: Dask runs {them} again, a few times at most"
            )
        elif not message.get("expected", False):
            self._notice(f"Dask worker {message['worker']} was lost while it had no shard")

    def _gone(self) -> SetupError:
        """The scheduler does not answer any more."""
        return SetupError(
            f"the Dask scheduler at {self._client.scheduler.address} has gone: what is finished is "
            "kept, start it again and resume"
        )


def _failure(error: Any, index: int) -> SetupError:
    """A shard that Dask gave up; what the work raises comes as an outcome instead."""
    if isinstance(error, KilledWorker):
        return SetupError(
            f"shard {index} was with {error.allowed_failures + 1} Dask workers that died: "
            "it may need more memory than there is, or crash the engine"
        )
    return SetupError(
        f"Dask could not hand out shard {index} ({one_line(_root(error))}): "
        "install the same packages for its scheduler and workers as here"
    )


def _root(error: BaseException) -> BaseException:
    """The error that began it; Dask's own, on top of it, only says where to read on."""
    while error.__cause__ is not None:
        error = error.__cause__
    return error


@functools.cache
def decisive_versions() -> dict[str, str]:
    """What decides what a shard computes, here and on a worker; of Python 3.11, not 3.11.2."""
    return {"python": platform.python_version().rpartition(".")[0], **versions(DECISIVE)}


def _attempt(work: Work, index: int, wanted: dict[str, str]) -> ShardOutcome:
    """On a worker: run a shard, if this worker computes what the others do."""
    found = decisive_versions()
    differ = [
        f"{name} {found.get(name, 'not installed')} instead of {value}"
        for name, value in wanted.items()
        if found.get(name) != value
    ]
    if differ:
        message = (
            f"the Dask worker on {socket.gethostname()} has {', '.join(differ)}: its results would "
            "not be those of this machine, install the same versions there"
        )
        return ShardOutcome(error=SetupError, message=message)
    return attempt(work, index)
