"""Worker processes that draw the frames of films.

They begin anew: nothing is ever forked after rendering, and MUJOCO_GL is set before any of them
imports MuJoCo.
"""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Generator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from loky import cpu_count

from grosmc_mj.ground.child_processes import shielded_from_interrupts, worker_pool
from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.files import cannot_write
from grosmc_mj.output.films.frames import Storyboard, draw
from grosmc_mj.output.films.offscreen import find_film_tools, rendering


class RenderingPool:
    """Processes that draw one film after another; a context, whose end ends them.

    They start with the first frame. An interrupt ends them too, and so does the end of their
    parent.

    Args:
        backend: Value of MUJOCO_GL for them.
        workers: How many.

    Attributes:
        backend: Value of MUJOCO_GL for them.
    """

    def __init__(self, backend: str, workers: int) -> None:
        self.backend = backend
        self._workers = workers
        self._films = 0
        # A storyboard goes to the workers once, as a file, not with each of its frames.
        self._folder = TemporaryDirectory(prefix="grosmc_mj_films_")
        # Software rendering would start a thread for every core in each worker.
        threads = {"LP_NUM_THREADS": "1"} if workers > 1 else {}
        self._pool = worker_pool(workers, rendering(backend) | threads)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(kill_workers=True)
        self._folder.cleanup()

    def frames(self, board: Storyboard) -> Generator[np.ndarray]:
        """Draw every frame of a film, in order, (height, width, 3) each.

        Only a few frames are drawn ahead of the one that is asked for.

        Args:
            board: The film.

        Raises:
            SetupError: If a worker cannot render or dies, or the disk is full.
        """
        path = self._store(board)
        count = len(board.times)
        ahead = min(2 * self._workers, count)
        futures: deque[Any] = deque()
        try:
            # The first task starts the workers.
            with shielded_from_interrupts():
                futures.extend(self._pool.submit(draw, path, index) for index in range(ahead))
            for index in range(count):
                yield futures.popleft().result()
                if index + ahead < count:
                    futures.append(self._pool.submit(draw, path, index + ahead))
        except Exception as error:
            reason = " ".join(str(error).split()[:12]) or type(error).__name__
            raise SetupError(
                f"a rendering process ended unexpectedly with MUJOCO_GL={self.backend} ({reason}); "
                "try fewer --workers, or another MUJOCO_GL"
            ) from error
        finally:
            for future in futures:
                future.cancel()

    def _store(self, board: Storyboard) -> str:
        """Write a storyboard for the workers; return where it is."""
        path = Path(self._folder.name) / str(self._films)
        self._films += 1
        try:
            path.write_bytes(pickle.dumps(board))
        except OSError as error:
            raise cannot_write(path, error) from error
        return str(path)


# Value of MUJOCO_GL for films without pictures.
NO_GRAPHICS = "off"


def open_pool(backend: str | None = None, workers: int | None = None) -> RenderingPool:
    """Return processes for films, not started yet.

    Args:
        backend: Value of MUJOCO_GL for them; None for the first that works.
        workers: How many; None for one a core.

    Raises:
        SetupError: If there is no working backend or ffmpeg.
    """
    if backend is None:
        backend, _ = find_film_tools(os.environ.get("MUJOCO_GL"))
    return RenderingPool(backend, workers or cpu_count())
