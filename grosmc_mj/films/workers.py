"""Drawing a film's frames in processes of their own, and running ffmpeg.

Run as a program, it is such a process: ``python -m grosmc_mj.films.workers FIRST STEP``. Nothing
here imports MuJoCo before MUJOCO_GL is set, and nothing is ever forked after rendering.
"""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import ended, rendering

if TYPE_CHECKING:
    from grosmc_mj.films.frames import Storyboard


@contextlib.contextmanager
def child(command: list[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A process that a terminal's Ctrl-C does not reach, and that ends with the block."""
    with subprocess.Popen(command, process_group=0, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def feed(process: subprocess.Popen[Any], blocks: Iterator[Any]) -> None:
    """Write to a process's standard input and close it; one that has ended is not an error here."""
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError), process.stdin as pipe:
        for block in blocks:
            pipe.write(block)


def lines_of(messages: IO[str]) -> list[str]:
    """The lines that processes have written to a file."""
    messages.seek(0)
    return [line.strip() for line in messages if line.strip()]


def draw_frames(board: Storyboard, backend: str, workers: int) -> Generator[np.ndarray, None, None]:
    """Every frame of a film in order, (height, width, 3) each, drawn by worker processes.

    Each draws every so many frames, and waits with the next one until its last has been taken.
    Closing the iterator, or an interrupt, ends the workers; without a parent they end as well.

    Args:
        board: The film.
        backend: Value of MUJOCO_GL for them.
        workers: How many; no more than there are frames are started.

    Raises:
        SetupError: If a worker cannot render or dies.
    """
    shape, count = (board.layout.height, board.layout.width, 3), len(board.times)
    workers = min(workers, count)
    # Software rendering would start a thread for every core in each worker.
    threads = {"LP_NUM_THREADS": "1"} if workers > 1 else {}
    # This very package, wherever it was imported from.
    places = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | rendering(backend) | threads
    environment["PYTHONPATH"] = os.pathsep.join(places)
    with TemporaryFile("w+") as messages, contextlib.ExitStack() as ends:
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        processes = []
        for first in range(workers):
            # -P: no module of the user's own folder is taken for one of the libraries.
            command = [sys.executable, "-P", "-m", __name__, str(first), str(workers)]
            worker = child(command, env=environment, stderr=messages, **pipes)
            processes.append(ends.enter_context(worker))
        for process in processes:
            feed(process, iter([pickle.dumps(board)]))
        for index in range(count):
            pixels = processes[index % workers].stdout.read(math.prod(shape))
            if len(pixels) < math.prod(shape):
                code = processes[index % workers].wait()
                reason = [ended(code), *lines_of(messages)][-1]
                raise SetupError(
                    f"a rendering process ended unexpectedly with MUJOCO_GL={backend} ({reason}); "
                    "run grosmc-mj doctor, or try fewer --workers"
                )
            yield np.frombuffer(pixels, np.uint8).reshape(shape)


def main() -> None:
    """Draw frames of the storyboard on standard input, onto standard output."""
    # What libraries print must not be taken for pixels.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    from grosmc_mj.films.frames import FrameMaker

    board: Storyboard = pickle.load(sys.stdin.buffer)
    first, step = map(int, sys.argv[1:])
    with contextlib.closing(FrameMaker(board)) as maker:
        for index in range(first, len(board.times), step):
            output.write(maker.frame(index).tobytes())
            output.flush()


if __name__ == "__main__":
    main()
