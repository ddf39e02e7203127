"""Writing films: an MP4 that every browser plays, a poster, a small GIF."""

from __future__ import annotations

import contextlib
import errno
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import mediapy
import numpy as np
from PIL import Image

from grosmc_mj.arguments import require, require_whole
from grosmc_mj.child_processes import interrupts_held
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.films.board import Storyboard
from grosmc_mj.films.film import Film
from grosmc_mj.films.offscreen.backends import find_backend, forget
from grosmc_mj.films.offscreen.ffmpeg import Ffmpeg, find_ffmpeg
from grosmc_mj.films.storyboard import storyboard
from grosmc_mj.films.workers import draw_frames

# Browsers take the colours of an HD film for BT.709, and begin to play before its end is there.
# Two threads on any machine: their number changes the bytes.
_ARGUMENTS = (
    "-vf scale=out_color_matrix=bt709:out_range=tv "
    "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv "
    "-xerror -preset veryfast -tune animation -threads 2 -fflags +bitexact -flags:v +bitexact "
    "-movflags +faststart"
)
_CRF = 23
_MOST_WORKERS = 1024
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
    """

    film: Path
    poster: Path
    gif: Path | None
    frames: int
    backend: str
    ffmpeg: Ffmpeg


def write_film(
    film: Film,
    path: Path | str,
    *,
    backend: str | None = None,
    workers: int | None = None,
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
    require("film", film, Film, "a Film")
    require("path", path, (str, Path), "a path that ends in .mp4")
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise ArgumentError(f"{path} must end in .mp4")
    wanted = f"a whole number up to {_MOST_WORKERS}, or None"
    asked = require_whole("workers", 0 if workers is None else workers, 0, _MOST_WORKERS, wanted)
    workers = asked or len(os.sched_getaffinity(0))
    program = find_ffmpeg()
    wish = os.environ.get("MUJOCO_GL")
    backend = backend or find_backend(wish).backend
    board = storyboard(film)
    poster = path.with_suffix(".png")
    mediapy.set_ffmpeg(program.path)
    small = path.with_suffix(".gif") if gif else None
    # All are opened before anything is drawn, and renamed together when all are whole.
    with contextlib.ExitStack() as files:
        aside = {
            name: files.enter_context(written_aside(name)) for name in (path, poster, small) if name
        }
        with contextlib.closing(draw_frames(board, backend, workers)) as frames:
            best = _encode(aside[path], path, board, film.format.fps, frames, advance, wish)
        try:
            Image.fromarray(best).save(aside[poster], optimize=True)
        except OSError as error:
            raise cannot_write(poster, error) from error
        if small is not None:
            _write_gif(program, aside[path], aside[small], small, film.format.width)
    return Written(path, poster, small, len(board.times), backend, program)


def _encode(
    part: Path,
    path: Path,
    board: Storyboard,
    fps: int,
    frames: Iterator[np.ndarray],
    advance: Callable[[], object],
    wish: str | None,
) -> np.ndarray:
    """Stream the frames to ffmpeg; returns the poster."""
    best = board.chart.empty
    shape = (board.layout.height, board.layout.width)
    writer = mediapy.VideoWriter(
        part, shape, fps=fps, crf=_CRF, encoded_format="yuv420p", ffmpeg_args=_ARGUMENTS
    )
    try:
        with interrupts_held():
            writer.__enter__()
        for index, frame in enumerate(frames):
            writer.add_image(frame)
            advance()
            if index == board.telling:
                best = frame
        writer.close()
    except SetupError:
        # The backend has failed since it was tried.
        forget(wish)
        raise
    except (OSError, RuntimeError) as error:
        raise _ffmpeg_stopped(path, _last_words(writer) or str(error)) from error
    finally:
        _stop(writer)
    return best


def _last_words(writer: mediapy.VideoWriter) -> str:
    """What ffmpeg has said, or which signal ended it."""
    process = writer._proc
    if process is None or process.stderr is None or process.stderr.closed:
        return ""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(1.0)
    ended = process.poll()
    process.kill()
    said = process.stderr.read().decode(errors="replace")
    if not said and ended is not None and ended < 0:
        return f"it was ended by signal {-ended}"
    return said


def _ffmpeg_stopped(path: Path, said: str) -> SetupError:
    """One line about why ffmpeg did not finish a file."""
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    full = [line for line in lines if "No space left" in line]
    if full:
        return cannot_write(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    return SetupError(f"{path}: ffmpeg stopped: {lines[-1] if lines else 'it does not say why'}")


def _stop(writer: mediapy.VideoWriter) -> None:
    """End an ffmpeg that is still there."""
    process = writer._proc
    if process is not None:
        process.kill()
        with contextlib.suppress(OSError):
            process.__exit__(None, None, None)
        writer._popen = writer._proc = None


def _write_gif(program: Ffmpeg, film: Path, gif: Path, path: Path, width: int) -> None:
    """A small GIF of a finished film, in two passes, so that memory stays flat."""
    scale = f"fps={_GIF_FPS},scale={min(width, _GIF_WIDTH)}:-2:flags=area"
    palette = gif.with_suffix(".palette.png")
    options = f"max_colors={_GIF_COLOURS}:stats_mode=full"
    passes = (
        ["-i", str(film), "-vf", f"{scale},palettegen={options}", str(palette)],
        [
            *("-i", str(film), "-i", str(palette)),
            *("-lavfi", f"{scale}[x];[x][1:v]paletteuse=dither=none:diff_mode=rectangle"),
            str(gif),
        ],
    )
    try:
        for arguments in passes:
            subprocess.run(
                [program.path, "-v", "error", "-xerror", "-y", *arguments],
                check=True,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
            )
    except subprocess.CalledProcessError as error:
        raise _ffmpeg_stopped(path, error.stderr or str(error)) from error
    finally:
        palette.unlink(missing_ok=True)
