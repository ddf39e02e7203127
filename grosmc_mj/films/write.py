"""Writing films: an MP4 that every browser plays, a poster, a small GIF."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import Annotated, NamedTuple

import numpy as np
from PIL import Image

from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.fields import Range, checked_call
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.films.film import Film
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.offscreen import Ffmpeg, ended, find_backend, find_ffmpeg
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.workers import child, draw_frames, feed, lines_of

# Browsers take the colours of an HD film for BT.709, and begin to play before its end is there.
# Two threads on any machine: their number changes the bytes.
_H264 = (
    "-an -vcodec h264 -pix_fmt yuv420p -crf 23 -preset veryfast -tune animation -threads 2 "
    "-vf scale=out_color_matrix=bt709:out_range=tv "
    "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv "
    "-fflags +bitexact -flags:v +bitexact -movflags +faststart"
)
_GIF_WIDTH, _GIF_FPS, _GIF_COLOURS = 640, 10, 128


class Written(NamedTuple):
    """The files of a film.

    Attributes:
        film: MP4.
        poster: PNG.
        gif: GIF, if it was asked for.
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
    workers: Annotated[int, Range(1, 1024, whole=True)] | None = None,
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
    program, backend = find_ffmpeg(), backend or find_backend(os.environ.get("MUJOCO_GL")).backend
    board, size = storyboard(film), f"{film.format.width}x{film.format.height}"
    poster, small = path.with_suffix(".png"), path.with_suffix(".gif") if gif else None
    # All are opened before anything is drawn, and renamed together when all are whole.
    with contextlib.ExitStack() as files:
        aside = {
            name: files.enter_context(written_aside(name)) for name in (path, poster, small) if name
        }
        best = board.chart.empty

        def drawn() -> Iterator[np.ndarray]:
            """The frames; the one for the poster is kept."""
            nonlocal best
            for index, frame in enumerate(frames):
                yield frame
                advance()
                best = frame if index == board.poster else best

        drawing = draw_frames(board, backend, workers or len(os.sched_getaffinity(0)))
        with contextlib.closing(drawing) as frames:
            source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", film.format.fps]
            _run_ffmpeg(program, [*source, "-i", "-", *_H264.split(), aside[path]], path, drawn())
        try:
            Image.fromarray(best).save(aside[poster], optimize=True)
        except OSError as error:
            raise cannot_write(poster, error) from error
        if small is not None:
            _write_gif(program, aside[path], aside[small], small, film.format.width)
    return Written(path, poster, small, len(board.times), backend, program, board)


def _write_gif(program: Ffmpeg, film: Path, gif: Path, path: Path, width: int) -> None:
    """A small GIF of a finished film, in two passes, so that memory stays flat."""
    scale = f"fps={_GIF_FPS},scale={min(width, _GIF_WIDTH)}:-2:flags=area"
    colours = f"palettegen=max_colors={_GIF_COLOURS}:stats_mode=full"
    use = "paletteuse=dither=none:diff_mode=rectangle"
    palette = gif.with_suffix(".palette.png")
    try:
        _run_ffmpeg(program, ["-i", film, "-vf", f"{scale},{colours}", palette], path)
        filters = ["-lavfi", f"{scale}[x];[x][1:v]{use}"]
        _run_ffmpeg(program, ["-i", film, "-i", palette, *filters, gif], path)
    finally:
        palette.unlink(missing_ok=True)


def _run_ffmpeg(
    program: Ffmpeg, arguments: Iterable[object], path: Path, frames: Iterable[np.ndarray] = ()
) -> None:
    """Run ffmpeg on frames that it reads from its standard input.

    Args:
        program: ffmpeg.
        arguments: Its own.
        path: The file that is written, as the user knows it.
        frames: In order.

    Raises:
        SetupError: If it does not finish the file.
    """
    command = [program.path, "-v", "error", "-xerror", "-y", *map(str, arguments)]
    with TemporaryFile("w+") as messages:
        with child(command, stdin=subprocess.PIPE, stderr=messages) as process:
            feed(process, (frame.data for frame in frames))
            code = process.wait()
        lines = lines_of(messages)
    if any("No space left" in line for line in lines):
        raise cannot_write(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    if code:
        raise SetupError(f"{path}: ffmpeg stopped: {[ended(code), *lines][-1]}")
