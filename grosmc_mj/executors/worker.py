"""A worker process of the executor `processes`, seen from both of its ends."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection, Pipe

from loky.backend.process import LokyProcess
from loky.backend.reduction import dumps, loads

from grosmc_mj.child_processes import end_with, interrupts_held
from grosmc_mj.executors.interface import ShardOutcome, Work, attempt, failure

# How long an idle worker may take to end by itself [s].
_PATIENCE = 5.0
# The numerical libraries would start a thread for every core in every worker.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class Worker:
    """A process that runs shards, one at a time, until its pipe is closed.

    Each has a pipe of its own: a worker that dies while it writes spoils nobody else's messages,
    and its end of file is the news of its death.

    Args:
        pickled: The work, by `dumps`.
        threads: For each numerical library in it.
    """

    def __init__(self, pickled: bytes, threads: int) -> None:
        # Loky's processes are fresh interpreters: nothing is forked, and the main module of the
        # user's script is not run again as `multiprocessing` would do.
        self.pipe, theirs = Pipe()
        self._process = LokyProcess(
            target=_serve,
            args=(theirs, pickled, os.getpid()),
            daemon=True,
            env=dict.fromkeys(_THREADS, str(threads)),
        )
        with interrupts_held():
            self._process.start()
        # Ours was the last copy but the worker's: its death now ends the pipe.
        theirs.close()

    @property
    def pid(self) -> int:
        """Process id."""
        assert self._process.pid is not None  # It has been started.
        return self._process.pid

    def give(self, index: int) -> None:
        """Let it run a shard; to a worker that has died in the meantime this does nothing."""
        with contextlib.suppress(OSError):
            self.pipe.send(index)

    def take(self) -> ShardOutcome | None:
        """What became of the shard that it has; None if the worker has died instead."""
        try:
            return loads(self.pipe.recv_bytes())
        except (EOFError, OSError):
            return None

    def fate(self) -> str:
        """How a worker that has died came to its end, for instance `was killed by SIGKILL`."""
        self.end()
        code = self._process.exitcode
        if code is None:
            return "closed its pipe"
        if code >= 0:
            return f"ended with exit code {code}"
        with contextlib.suppress(ValueError):
            return f"was killed by {signal.Signals(-code).name}"
        return f"was killed by signal {-code}"

    def dismiss(self, *, at_once: bool) -> None:
        """Tell it to end, when idle or in the middle of its shard; does not wait."""
        self.pipe.close()
        if at_once:
            self._process.terminate()

    def end(self) -> None:
        """Wait for its end, not for ever."""
        self._process.join(_PATIENCE)
        if self._process.exitcode is None:
            os.kill(self.pid, signal.SIGKILL)
            self._process.join(_PATIENCE)


def _serve(pipe: Connection, pickled: bytes, parent: int) -> None:
    """In the process: run shard after shard until the parent closes the pipe or goes."""
    end_with(parent)
    run = _runner(pickled)
    # The parent reads to the end; if it cannot any more, there is nothing left to do.
    with contextlib.suppress(EOFError, OSError):
        while True:
            pipe.send_bytes(run(pipe.recv()))
    # All is told: what an interpreter does at its end takes most of a second here.
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(0)


def _runner(pickled: bytes) -> Callable[[int], bytes]:
    """What runs a shard and pickles its outcome, or says why it cannot."""
    # What is imported here stays: collecting it would be in vain, now and later.
    gc.disable()
    try:
        work: Work = loads(pickled)
    except Exception as error:
        unreadable = error
        return lambda index: bytes(dumps(failure(unreadable, index)))
    finally:
        gc.freeze()
        gc.enable()

    def run(index: int) -> bytes:
        try:
            return bytes(dumps(attempt(work, index)))
        except Exception as error:
            # The report cannot be pickled.
            return bytes(dumps(failure(error, index)))

    return run
