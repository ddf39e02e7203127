"""Drawing a film's frames in spawned processes, in order, a few at a time.

Nothing here imports MuJoCo: a worker can say what is wrong before it does so itself.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Generator
from multiprocessing.util import Finalize
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

from grosmc_mj.child_processes import interrupts_held, worker_pool
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from grosmc_mj.films.board import Storyboard
    from grosmc_mj.films.frames import FrameMaker

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
        executor = worker_pool(workers, variables, _start, given, backend)
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


def _start(given: Path, backend: str) -> None:
    """Make a worker ready to draw."""
    global _maker, _failure
    try:
        from grosmc_mj.films.frames import FrameMaker

        _maker = FrameMaker(pickle.loads(given.read_bytes()))
    except Exception as error:
        _failure = (
            f"MUJOCO_GL={backend} does not render here ({type(error).__name__}: {error}); "
            "run grosmc-mj doctor"
        )
        return
    # Later than at this point the interpreter would print a traceback for an open renderer.
    Finalize(None, _maker.close, exitpriority=100)


def _draw(index: int) -> np.ndarray:
    """One frame, in a worker."""
    if _maker is None:
        raise SetupError(_failure)
    return _maker.frame(index)
