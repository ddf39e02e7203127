"""On Dask's workers: this machine's, or those of a cluster."""

from __future__ import annotations

import contextlib
import itertools
import platform
import queue
import socket
import uuid
from collections import Counter
from collections.abc import Generator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from functools import cache
from typing import Any

from distributed import Future, KilledWorker
from distributed.client import ClosedClientError

from grosmc_mj.errors import SetupError
from grosmc_mj.executors.dask_cluster import cluster_client
from grosmc_mj.executors.interface import Finished, Notice, ShardOutcome, Work, attempt, one_line
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
        with cluster_client(min(self.workers, len(indices)), self.scheduler) as client:
            try:
                yield from _reports(client, work, indices, notice)
            except (CancelledError, ClosedClientError, OSError):
                address = client.scheduler and client.scheduler.address
                raise SetupError(
                    f"the Dask scheduler at {address} has gone: what is finished "
                    "is kept, start it again and resume"
                ) from None


def _reports(
    # Any: the client's methods are typed for its blocking and its asynchronous face at once.
    client: Any,
    work: Work,
    indices: Sequence[int],
    notice: Notice,
) -> Generator[Finished, None, None]:
    """All shards as they finish, a few for each worker under way at a time."""
    unseen, versions_here = iter(indices), decisive_versions()
    # A name for all: Dask keeps a record for each name that it sees.
    name = f"shard-{uuid.uuid4().hex}"
    # By key. Dask drops a shard whose future nobody holds.
    under_way: dict[Any, tuple[int, Future]] = {}
    attempts: Counter[int] = Counter()
    # Finished futures and lost workers, in the order in which we hear of them.
    news: queue.SimpleQueue[Future | dict[str, Any]] = queue.SimpleQueue()
    warn_once = cache(notice)

    def hear(event: tuple[float, dict[str, Any]]) -> None:
        """In Dask's thread: keep what concerns lost workers."""
        if event[1].get("action") == "remove-worker":
            news.put(event[1])

    client.subscribe_topic("all", hear)
    while True:
        threads = client.nthreads().values()
        if max(threads, default=1) > 1:
            warn_once(
                "a Dask worker has several threads, but shards of one process wait for each other: "
                "start workers with --nthreads 1"
            )
        room = _AHEAD * max(1, sum(threads)) - len(under_way)
        for index in itertools.islice(unseen, max(0, room)):
            key = name, index
            future = client.submit(_attempt, work, index, versions_here, key=key, pure=False)
            under_way[key] = index, future
            attempts[index] += 1
            future.add_done_callback(news.put)
        if not under_way:
            return
        items, done = _next_news(news), []
        if not items and client.status != "running":
            raise ClosedClientError
        if not items and not threads:
            warn_once("no Dask worker is connected to the scheduler: waiting for one")
        for item in items:
            if isinstance(item, Future):
                done.append(item)
            else:
                keys = {*item["processing-tasks"], *item["lost-computed-tasks"]}
                lost = sorted(under_way[key][0] for key in keys if key in under_way)
                attempts.update(lost)
                _tell(item, lost, notice)
        places = [under_way.pop(future.key)[0] for future in done]
        for future, index in zip(done, places, strict=True):
            if future.status == "error":
                raise _failure(future.exception(), index)
        # Fetched together: one by one would be slow.
        for index, outcome in zip(places, client.gather(done), strict=True):
            yield Finished(index, outcome.result(), attempts.pop(index))


def _next_news(news: queue.SimpleQueue) -> list[Any]:
    """The next event and all that came with it; nothing after a while without news."""
    with contextlib.suppress(queue.Empty):
        items = [news.get(timeout=_LOOK)]
        while not news.empty():
            items.append(news.get())
        return items
    return []


def _tell(gone: dict[str, Any], lost: list[int], notice: Notice) -> None:
    """Say that a worker has gone, and what becomes of its shards."""
    worker, (shards, them) = gone["worker"], ("shards", "them") if lost[1:] else ("shard", "it")
    if lost:
        notice(
            f"Dask worker {worker} was lost while it had {shards} {', '.join(map(str, lost))}: "
            f"Dask runs {them} again, a few times at most"
        )
    elif not gone.get("expected", False):
        notice(f"Dask worker {worker} was lost while it had no shard")


def _failure(error: Any, index: int) -> SetupError:
    """A shard that Dask gave up; what the work raises comes as an outcome instead."""
    if isinstance(error, KilledWorker):
        return SetupError(
            f"shard {index} was with {error.allowed_failures + 1} Dask workers that died: "
            "it may need more memory than there is, or crash the engine"
        )
    # Dask's own error, on top of the one that began it, only says where to read on.
    while error.__cause__ is not None:
        error = error.__cause__
    return SetupError(
        f"Dask could not hand out shard {index} ({one_line(error)}): "
        "install the same packages for its scheduler and workers as here"
    )


@cache
def decisive_versions() -> dict[str, str]:
    """What decides what a shard computes, here and on a worker; of Python 3.11, not 3.11.2."""
    return {"python": platform.python_version().rpartition(".")[0], **versions(DECISIVE)}


def _attempt(work: Work, index: int, needed: dict[str, str]) -> ShardOutcome:
    """On a worker: run a shard, if this worker computes what the others do."""
    here = decisive_versions()
    differ = [
        f"{name} {here.get(name, 'not installed')} instead of {value}"
        for name, value in needed.items()
        if here.get(name) != value
    ]
    if differ:
        message = (
            f"the Dask worker on {socket.gethostname()} has {', '.join(differ)}: its results would "
            "not be those of this machine, install the same versions there"
        )
        return ShardOutcome(error=SetupError, message=message)
    return attempt(work, index)
