"""Drawing a film's frames in spawned processes, in order, a few at a time.

Nothing here imports MuJoCo: a worker can say what is wrong before it does so itself.
"""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Generator
from functools import cache
from itertools import islice
from multiprocessing.util import Finalize
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from loky.process_executor import TerminatedWorkerError

from grosmc_mj.child_processes import interrupts_held, worker_pool
from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import rendering

if TYPE_CHECKING:
    from grosmc_mj.films.frames import FrameMaker, Storyboard

# Frames under way, for each worker: enough to keep it busy, few enough to keep memory flat.
_AHEAD = 3


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
    count = len(board.times)
    workers = min(workers, count)
    # Software rendering would start a thread for every core in each worker.
    threads = {"LP_NUM_THREADS": "1"} if workers > 1 else {}
    with TemporaryDirectory(prefix="grosmc_mj-") as folder:
        # By a file: a worker that dies at its start would leave a pipe that nobody reads.
        file = Path(folder) / "storyboard"
        file.write_bytes(pickle.dumps(board))
        executor = worker_pool(workers, rendering(backend) | threads)
        try:
            with interrupts_held():
                waiting = deque(executor.submit(_draw, file, index) for index in range(workers))
            left = iter(range(workers, count))
            while waiting:
                for index in islice(left, _AHEAD * workers - len(waiting)):
                    waiting.append(executor.submit(_draw, file, index))
                yield waiting.popleft().result()
        except TerminatedWorkerError as error:
            raise SetupError(
                f"a rendering process ended unexpectedly with MUJOCO_GL={backend}; "
                "run grosmc-mj doctor, or try fewer --workers"
            ) from error
        finally:
            executor.shutdown(wait=True, kill_workers=True)


def _draw(file: Path, index: int) -> np.ndarray:
    """One frame, in a worker."""
    try:
        maker = _frame_maker(file)
    except Exception as error:
        raise SetupError(
            f"MUJOCO_GL={os.environ['MUJOCO_GL']} does not render here "
            f"({type(error).__name__}: {error}); run grosmc-mj doctor"
        ) from None
    return maker.frame(index)


@cache
def _frame_maker(file: Path) -> FrameMaker:
    """What draws in a worker, made for its first frame."""
    from grosmc_mj.films.frames import FrameMaker

    maker = FrameMaker(pickle.loads(file.read_bytes()))
    # Later than at this point the interpreter would print a traceback for an open renderer.
    Finalize(None, maker.close, exitpriority=100)
    return maker
