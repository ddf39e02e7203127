"""Writing films: an MP4 that every browser plays, a poster, a small GIF.

Frames are drawn in processes of their own, which begin anew: nothing is ever forked after
rendering, and MUJOCO_GL is set before any of them imports MuJoCo.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Annotated, Any, NamedTuple

import numpy as np
from loky import cpu_count
from PIL import Image

from grosmc_mj.child_processes import interrupts_held, worker_pool
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.fields import Range, checked_call
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.films.film import Film, Format
from grosmc_mj.films.frames import Storyboard, begin, draw
from grosmc_mj.films.offscreen import Ffmpeg, find_ffmpeg, find_film_tools, rendering
from grosmc_mj.films.storyboard import storyboard

# Browsers take the colours of an HD film for BT.709, and begin to play before its end is there.
# Two threads on any machine: their number changes the bytes.
_H264 = (
    "-an -vcodec h264 -pix_fmt yuv420p -crf 23 -preset veryfast -tune animation -threads 2 "
    "-vf scale=out_color_matrix=bt709:out_range=tv,"
    "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv "
    "-fflags +bitexact -flags:v +bitexact -movflags +faststart"
)
_GIF = [
    "-vf",
    "fps=10,scale='min(640,iw)':-2:flags=area,split[a][b];[a]palettegen=max_colors=128[p];"
    "[b][p]paletteuse=dither=none:diff_mode=rectangle",
]


class Written(NamedTuple):
    """The files of a film.

    Attributes:
        film: MP4.
        poster: PNG.
        gif: GIF, if there is one.
        frames: How many the film has.
        backend: What rendered it.
        ffmpeg: What wrote it.
        board: What it was drawn from.
    """

    film: Path
    poster: Path
    gif: Path | None
    frames: int
    backend: str
    ffmpeg: Ffmpeg
    board: Storyboard


@checked_call
def write_film(
    film: Film,
    path: Path | str,
    *,
    backend: str | None = None,
    workers: Annotated[int, Range(1, 256, whole=True)] | None = None,
    gif: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> Written:
    """Render a film and write it; every file is written aside and renamed when it is whole.

    Args:
        film: What to show.
        path: The MP4; poster and GIF lie beside it.
        backend: Value of MUJOCO_GL for the rendering processes; None for the first that works.
        workers: Rendering processes; None for one a core.
        gif: Whether to write a small GIF too.
        advance: Called after each frame.

    Raises:
        ArgumentError: If the path is no ``.mp4``.
        SetupError: If there is no working backend or ffmpeg, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise ArgumentError(f"{path} must end in .mp4")
    if backend is None:
        backend, program = find_film_tools(os.environ.get("MUJOCO_GL"))
    else:
        program = find_ffmpeg()
    board, poster = storyboard(film), path.with_suffix(".png")
    small = path.with_suffix(".gif") if gif else None
    encodings = {path: _H264.split()} | ({small: _GIF} if small else {})
    drawing = draw_frames(board, backend, workers or cpu_count())
    # All are opened before anything is drawn, and renamed together when all are whole.
    with contextlib.ExitStack() as files:
        aside = {name: files.enter_context(written_aside(name)) for name in (*encodings, poster)}
        with contextlib.ExitStack() as encoders, contextlib.closing(drawing) as frames:
            pipes = [
                encoders.enter_context(_encoder(program, film.format, options, aside[name], name))
                for name, options in encodings.items()
            ]
            still = board.chart.empty
            for index, frame in enumerate(frames):
                for pipe in pipes:
                    pipe.write(frame.data)
                if index == len(board.times) // 2:
                    still = frame
                advance()
        try:
            Image.fromarray(still).save(aside[poster], optimize=True)
        except OSError as error:
            raise cannot_write(poster, error) from error
    return Written(path, poster, small, len(board.times), backend, program, board)


@contextlib.contextmanager
def _encoder(
    program: Ffmpeg, form: Format, options: Sequence[str], part: Path, path: Path
) -> Iterator[IO[bytes]]:
    """The standard input of an ffmpeg that writes raw frames to a file.

    Raises:
        SetupError: If it does not finish the file.
    """
    source = f"-f rawvideo -pix_fmt rgb24 -s {form.width}x{form.height} -r {form.fps} -i -".split()
    command = [program.path, "-v", "error", "-xerror", "-y", *source, *options, str(part)]
    # A group of its own: a terminal's Ctrl-C does not reach it.
    with (
        TemporaryFile("w+") as messages,
        subprocess.Popen(command, stdin=subprocess.PIPE, stderr=messages, process_group=0) as run,
    ):
        assert run.stdin is not None
        try:
            with contextlib.suppress(BrokenPipeError), run.stdin as pipe:
                yield pipe
            code = run.wait()
        finally:
            run.kill()
        messages.seek(0)
        lines = [f"exit code {code}", *messages.read().replace(str(part), str(path)).splitlines()]
    if code:
        reason = next((line for line in lines if "No space left" in line), lines[-1])
        raise cannot_write(path, OSError(f"ffmpeg stopped: {reason}"))


def draw_frames(board: Storyboard, backend: str, workers: int) -> Generator[np.ndarray]:
    """Every frame of a film in order, (height, width, 3) each, drawn by worker processes.

    Closing the iterator, or an interrupt, ends the workers; without a parent they end as well.

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
    pool = worker_pool(workers, rendering(backend) | threads, begin, board)
    frames: deque[Any] = deque()
    try:
        with interrupts_held():
            frames.extend(pool.submit(draw, index) for index in range(min(2 * workers, count)))
        for index in range(count):
            yield frames.popleft().result()
            if index + 2 * workers < count:
                frames.append(pool.submit(draw, index + 2 * workers))
    except Exception as error:
        reason = " ".join(str(error).split()[:12]) or type(error).__name__
        raise SetupError(
            f"a rendering process ended unexpectedly with MUJOCO_GL={backend} ({reason}); "
            "try fewer --workers, or another MUJOCO_GL"
        ) from error
    finally:
        pool.shutdown(kill_workers=True)
