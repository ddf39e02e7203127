"""Drawing a film's frames in spawned processes, in order, a few at a time.

Nothing here imports MuJoCo: a worker can say what is wrong before it does so itself.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Generator, Iterator
from multiprocessing import resource_tracker
from multiprocessing.util import Finalize
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from loky.backend import resource_tracker as loky_resource_tracker
from loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from grosmc_mj.rendering.board import Storyboard
    from grosmc_mj.rendering.frames import FrameMaker

# Frames under way, for each worker: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 3
# In a worker: what draws, or why nothing does.
_maker: FrameMaker | None = None
_failure = ""


def draw_frames(board: Storyboard, backend: str, workers: int) -> Generator[np.ndarray, None, None]:
    """Every frame of a film in order, (height, width, 3) each, drawn by worker processes.

    Closing the iterator, or an interrupt, ends the workers.

    Args:
        board: The film.
        backend: Value of MUJOCO_GL for them.
        workers: How many; no more than there are frames are started.

    Raises:
        SetupError: If a worker cannot render or dies.
    """
    workers = min(workers, len(board.times))
    # PyOpenGL's own setting would contradict MuJoCo's.
    variables = {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": ""}
    if workers > 1:
        # Software rendering would start a thread for every core in each worker.
        variables["LP_NUM_THREADS"] = "1"
    with TemporaryDirectory(prefix="grosmc_mj-") as folder:
        # By a file: a worker that dies at its start would leave a pipe that nobody reads.
        given = Path(folder) / "storyboard"
        given.write_bytes(pickle.dumps(board))
        executor = ProcessPoolExecutor(
            workers, initializer=_start, initargs=(given, backend, os.getpid()), env=variables
        )
        try:
            yield from _in_order(executor, len(board.times), workers)
        except TerminatedWorkerError as error:
            raise SetupError(
                f"a rendering process ended unexpectedly with MUJOCO_GL={backend}; "
                "run grosmc-mj doctor, or try fewer --workers"
            ) from error
        finally:
            executor.shutdown(wait=True, kill_workers=True)


def _in_order(
    executor: ProcessPoolExecutor, count: int, workers: int
) -> Generator[np.ndarray, None, None]:
    """The frames, a few of them under way at any time."""
    waiting: deque = deque()
    frames = iter(range(count))
    with interrupts_held():
        for _ in range(workers):
            waiting.append(executor.submit(_draw, next(frames)))
    while waiting:
        while len(waiting) < _AHEAD * workers and (index := next(frames, None)) is not None:
            waiting.append(executor.submit(_draw, index))
        yield waiting.popleft().result()


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes that Ctrl-C in the terminal does not reach; ours arrives afterwards.

    A process inherits the blocked signal, so that it cannot print a traceback of its own while
    this one ends it. Blocking alone would not hold ours back: threads of the numerical libraries
    take the signal too, and Python then interrupts the main thread between any two instructions.
    """
    # These are started with the first process, and unblock the signal when they are.
    resource_tracker.ensure_running()
    loky_resource_tracker.ensure_running()
    held: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    # A handler that C code has installed reads as None and could not be put back.
    handler = signal.getsignal(signal.SIGINT) if in_main_thread else None
    if handler is not None:
        signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    if held:
        signal.raise_signal(signal.SIGINT)


def _start(given: Path, backend: str, parent: int) -> None:
    """Make a worker ready to draw; it ends when its parent does."""
    global _maker, _failure
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    try:
        from grosmc_mj.rendering.frames import FrameMaker

        _maker = FrameMaker(pickle.loads(given.read_bytes()))
    except Exception as error:
        _failure = (
            f"MUJOCO_GL={backend} does not render here ({type(error).__name__}: {error}); "
            "run grosmc-mj doctor"
        )
        return
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
    if _maker is None:
        raise SetupError(_failure)
    return _maker.frame(index)
