"""Executor of Dask's workers: those of a running scheduler, or of a cluster on this machine."""

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
from functools import partial
from pathlib import Path
from typing import Any

import dask
from distributed import Client, LocalCluster, Security
from distributed.client import ClosedClientError
from distributed.comm import connect
from distributed.utils import silence_logging_cmgr
from distributed.versions import VersionMismatchWarning

from grosmc_mj.ground.child_processes import shielded_from_interrupts
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.executors.pools import (
    ATTEMPTS,
    Finished,
    Notice,
    Pool,
    Work,
    WorkOutcome,
    attempt,
    error_line,
    run_in,
)
from grosmc_mj.ground.versions import DECISIVE, versions

# Time within which a scheduler must answer [s].
_PATIENCE = 10.0

# Key of the environment that a worker starts with.
_ENVIRONMENT = "distributed.nanny.pre-spawn-environ"
_SETTINGS = {
    # Number of workers that may die while they run one shard.
    "distributed.scheduler.allowed-failures": ATTEMPTS - 1,
    # A worker holds no shard but the one that it runs: its death counts against all that it holds.
    "distributed.scheduler.worker-saturation": 1.0,
}
# Parts that the scheduler holds for each thread of its workers: enough to keep them busy while
# reports travel, and not all parts of a large campaign.
_AHEAD = 4


@dataclass(frozen=True)
class DaskWorkers:
    """Executor of a Dask cluster; Dask replaces workers that die, and moves their parts.

    Attributes:
        workers: Number of processes on this machine, if there is no scheduler.
        scheduler: Address of a running scheduler, or its file; None for a cluster of its own.
    """

    workers: int
    scheduler: str | None = None

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use: one, for each core of a cluster is a worker."""
        return 1

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index; see `Executor.run`."""
        yield from run_in(partial(self._pool, work, len(indices), notice), indices, notice)

    @contextlib.contextmanager
    def _pool(
        self,
        work: Work,
        parts: int,
        notice: Notice,
    ) -> Iterator[Pool]:
        """Open Dask's own executor of a client; it lasts as long as the context."""
        with cluster_client(min(self.workers, parts), self.scheduler) as client:
            address = client.scheduler and client.scheduler.address
            connection = _Connection(client, notice)
            connection.require()

            # Any: the client's methods are typed for its blocking and its asynchronous use.
            executor: Any = client.get_executor(pure=False)
            threads: Any = client.nthreads()
            submit = partial(executor.submit, _attempt, work, needed=decisive_versions())
            ahead = _AHEAD * max(1, sum(threads.values()))
            try:
                yield Pool(submit, ahead, connection.require)
            except (CancelledError, ClosedClientError, OSError):
                raise SetupError(
                    f"the Dask scheduler at {address} has gone: finished parts are kept, start "
                    "it again and resume"
                ) from None
            finally:
                executor.shutdown(wait=False)


class _Connection:
    """Connection of a client to its scheduler."""

    def __init__(self, client: Client, notice: Notice) -> None:
        self._client = client
        self._notice = notice
        self._noticed = False

    def require(self) -> None:
        """Raise an error without a scheduler; notice once if it has no workers."""
        if self._client.status != "running":
            raise ClosedClientError
        # This call also finds a scheduler that no longer answers.
        threads = self._client.nthreads()
        if not threads and not self._noticed:
            self._noticed = True
            self._notice("no Dask worker is connected to the scheduler: waiting for one")


def decisive_versions() -> dict[str, str]:
    """Return the versions that results depend on; of Python 3.11, not 3.11.2."""
    python = platform.python_version().rpartition(".")[0]
    return {"python": python, **versions(DECISIVE)}


def _attempt(work: Work, index: int, needed: dict[str, str]) -> WorkOutcome:
    """Run a part on a worker; refuse if the worker has other versions than this machine."""
    installed = decisive_versions()
    differences = [
        f"{name} {installed.get(name, 'not installed')} instead of {version}"
        for name, version in needed.items()
        if installed.get(name) != version
    ]
    if differences:
        message = (
            f"the Dask worker on {socket.gethostname()} has {', '.join(differences)}: its results "
            "would not be those of this machine, install the same versions there"
        )
        return WorkOutcome(error=SetupError, message=message)
    return attempt(work, index)


@contextlib.contextmanager
def cluster_client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """Yield a client of the scheduler, or of a cluster on this machine that ends with it.

    Args:
        workers: Number of processes of one thread each, if there is no scheduler.
        scheduler: Address or file of a running scheduler, or None.

    Raises:
        SetupError: If no scheduler answers there.
    """
    with contextlib.ExitStack() as stack:
        # The user gets notices about workers, without Dask's own lines.
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        if scheduler is None:
            cluster = stack.enter_context(_local_cluster(workers))
            client = Client(cluster, set_as_default=False)
        else:
            client = _connect(_address(scheduler))
        yield stack.enter_context(client)


def _local_cluster(workers: int) -> LocalCluster:
    """Start workers on this machine.

    Who reaches a scheduler's port can run code in its workers, and loopback is open to every user
    of the machine: both sides show certificates that were made for this cluster alone.
    """
    try:
        security = Security.temporary()
    except ImportError:
        raise SetupError(
            "workers on this machine need cryptography: pip install 'grosmc_mj[dask]'"
        ) from None
    # Workers then import no modules from the working folder.
    environment = {**dask.config.get(_ENVIRONMENT), "PYTHONSAFEPATH": "1"}
    try:
        with dask.config.set({**_SETTINGS, _ENVIRONMENT: environment}), shielded_from_interrupts():
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
    """Return a client of a running scheduler."""
    try:
        # In another thread, because a notebook has an event loop in this one.
        with ThreadPoolExecutor(1) as thread:
            thread.submit(asyncio.run, _greet(address)).result()

        # `_attempt` compares the versions that matter, also those of workers that come later.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VersionMismatchWarning)
            return Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise SetupError(
            f"no Dask scheduler answers at {address}: start one with `dask scheduler`, "
            "or leave --scheduler out for workers on this machine"
        ) from error


async def _greet(address: str) -> None:
    """Connect to a scheduler within a time limit, which a client does not have."""
    arguments = Security().get_connection_args("client")
    greeting = connect(address, timeout=_PATIENCE, **arguments)
    comm = await asyncio.wait_for(greeting, _PATIENCE)
    await comm.close()


def _address(scheduler: str) -> str:
    """Return the address of a scheduler, which its file holds."""
    if not scheduler.endswith(".json"):
        return scheduler
    try:
        return json.loads(Path(scheduler).read_text())["address"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SetupError(
            f"{scheduler} is not a file that `dask scheduler --scheduler-file` has written"
        ) from error
