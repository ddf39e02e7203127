"""On Dask's workers: of a scheduler that is running already, or of a cluster on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import platform
import socket
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster, Security
from distributed.client import ClosedClientError
from distributed.comm import connect
from distributed.utils import silence_logging_cmgr
from distributed.versions import VersionMismatchWarning

from grosmc_mj.child_processes import interrupts_held
from grosmc_mj.errors import SetupError
from grosmc_mj.executors.pools import (
    ATTEMPTS,
    Finished,
    Notice,
    Outcome,
    Pool,
    Work,
    attempt,
    error_line,
    run_in,
)
from grosmc_mj.versions import DECISIVE, versions

# How long a scheduler may take to answer [s].
_PATIENCE = 10.0

_ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
_SETTINGS = {
    # Deaths that a shard survives.
    "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
    # Once there are many shards a worker holds the one that it runs and no other: the death of a
    # worker counts against all that it holds.
    "distributed.scheduler.worker-saturation": 1.0,
}
# Parts with the scheduler, for each thread of its workers: enough to keep them busy while reports
# travel, few enough that a million of them do not sit there.
_AHEAD = 4


@dataclass(frozen=True)
class DaskWorkers:
    """The executor of a Dask cluster; Dask replaces workers and moves their parts.

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
        yield from run_in(partial(self._pool, work, len(indices), notice), indices, notice)

    @contextlib.contextmanager
    def _pool(self, work: Work, parts: int, notice: Notice) -> Iterator[Pool]:
        """Dask's own executor of a client; it lasts as long as the context."""
        with cluster_client(min(self.workers, parts), self.scheduler) as client:
            scheduler = client.scheduler and client.scheduler.address
            # Any: the client's methods are typed for its blocking and its asynchronous face.
            executor: Any = client.get_executor(pure=False)
            threads: Any = client.nthreads()
            submit = partial(executor.submit, _attempt, work, needed=decisive_versions())

            def require() -> None:
                if client.status != "running":
                    raise ClosedClientError
                if not client.nthreads():
                    warn_once("no Dask worker is connected to the scheduler: waiting for one")

            warn_once = cache(notice)
            require()
            try:
                yield Pool(submit, _AHEAD * max(1, sum(threads.values())), require)
            except (CancelledError, ClosedClientError, OSError):
                raise SetupError(
                    f"the Dask scheduler at {scheduler} has gone: finished parts are kept, start "
                    "it again and resume"
                ) from None
            finally:
                executor.shutdown(wait=False)


@cache
def decisive_versions() -> dict[str, str]:
    """Versions on which results depend, here and on a worker; of Python 3.11, not 3.11.2."""
    return {"python": platform.python_version().rpartition(".")[0], **versions(DECISIVE)}


def _attempt(work: Work, index: int, needed: dict[str, str]) -> Outcome:
    """On a worker: run a part, if this worker computes as the others do."""
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
        return Outcome(error=SetupError, message=message)
    return attempt(work, index)


@contextlib.contextmanager
def cluster_client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of the scheduler, or of a cluster on this machine that lasts as long as it.

    Args:
        workers: Processes of one thread each, without a scheduler.
        scheduler: Its address or its file, or None.

    Raises:
        SetupError: If no scheduler answers there.
    """
    with contextlib.ExitStack() as stack:
        # What happens to workers is told by notices; Dask's own lines would come between.
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        if scheduler is None:
            cluster = stack.enter_context(_local_cluster(workers))
            client = Client(cluster, set_as_default=False)
        else:
            client = _connect(_address(scheduler))
        yield stack.enter_context(client)


def _local_cluster(workers: int) -> LocalCluster:
    """Workers on this machine.

    Whoever reaches a scheduler's port can run code in its workers, and loopback is open to every
    user of the machine: both sides show certificates that were made for this cluster alone.
    """
    try:
        security = Security.temporary()
    except ImportError:
        raise SetupError(
            "workers on this machine need cryptography: pip install 'grosmc_mj[dask]'"
        ) from None
    # Before they start, so that no module of the folder that they start in comes before others.
    environment = {**dask.config.get(_ENVIRONMENT), "PYTHONSAFEPATH": "1"}
    try:
        with dask.config.set({**_SETTINGS, _ENVIRONMENT: environment}), interrupts_held():
            return LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                security=security,
                # None would still take port 8787, if it were free.
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
    except (OSError, RuntimeError) as error:
        raise SetupError(
            f"Dask cannot start workers on this machine ({error_line(error)})"
        ) from error


def _connect(address: str) -> Client:
    """A client of a running scheduler."""
    try:
        # In a thread: a notebook has an event loop of its own in this one.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(asyncio.run, _greet(address)).result()
        # Versions that matter are compared shard by shard, so that workers may come later.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)
            return Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SetupError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler`, "
            "or leave --scheduler out for workers on this machine"
        ) from error


async def _greet(address: str) -> None:
    """Shake hands with a scheduler in bounded time, which a client does not."""
    arguments = Security().get_connection_args("client")
    greeting = connect(address, timeout=_PATIENCE, **arguments)
    comm = await asyncio.wait_for(greeting, _PATIENCE)
    await comm.close()


def _address(scheduler: str) -> str:
    """The address that is meant; a scheduler's file holds it."""
    if not scheduler.endswith(".json"):
        return scheduler
    try:
        return json.loads(Path(scheduler).read_text())["address"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SetupError(
            f"{scheduler} is not a file that `dask scheduler --scheduler-file` has written"
        ) from error
