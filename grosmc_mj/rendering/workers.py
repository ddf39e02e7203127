"""Drawing a film's frames in spawned processes, in order, a few at a time."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator
from multiprocessing.util import Finalize

import numpy as np
from loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

from grosmc_mj.errors import SetupError
from grosmc_mj.rendering.frames import FrameMaker, Storyboard

# Frames under way, for each worker: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 3
_maker: FrameMaker | None = None


def draw_frames(board: Storyboard, backend: str, workers: int) -> Generator[np.ndarray, None, None]:
    """Every frame of a film in order, (height, width, 3) each, drawn by worker processes.

    Closing the iterator, or an interrupt, ends the workers.

    Args:
        board: The film.
        backend: Value of MUJOCO_GL for them.
        workers: How many.

    Raises:
        SetupError: If a worker cannot render or dies.
    """
    # Software rendering would start a thread for every core in each worker.
    variables = {"MUJOCO_GL": backend, "LP_NUM_THREADS": "1" if workers > 1 else ""}
    if workers == 1:
        variables.pop("LP_NUM_THREADS")
    executor = ProcessPoolExecutor(
        workers, initializer=_start, initargs=(board, os.getpid()), env=variables
    )
    waiting: deque = deque()
    frames = iter(range(len(board.times)))
    try:
        with interrupts_held():
            for index in range(min(workers, len(board.times))):
                waiting.append(executor.submit(_draw, next(frames, index)))
        while waiting:
            while len(waiting) < _AHEAD * workers and (index := next(frames, None)) is not None:
                waiting.append(executor.submit(_draw, index))
            yield waiting.popleft().result()
    except TerminatedWorkerError as error:
        raise SetupError(
            f"a rendering process ended unexpectedly with MUJOCO_GL={backend}; "
            "run grosmc-mj doctor, or try fewer --workers"
        ) from error
    finally:
        executor.shutdown(wait=True, kill_workers=True)


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes that Ctrl-C in the terminal does not reach; ours arrives afterwards.

    A process inherits the blocked signal, so that it cannot print a traceback of its own while
    this one ends it.
    """
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _start(board: Storyboard, parent: int) -> None:
    """Make a worker ready to draw; it ends when its parent does."""
    global _maker
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    _maker = FrameMaker(board)
    # Later than at this point the interpreter would print a traceback for an open renderer.
    Finalize(None, _maker.close, exitpriority=100)


def _end_with(parent: int) -> None:
    """End this process once its parent has gone."""
    waiting = threading.Event()
    while os.getppid() == parent:
        waiting.wait(1.0)
    os._exit(1)


def _draw(index: int) -> np.ndarray:
    """One frame, in a worker."""
    assert _maker is not None
    return _maker.frame(index)
