"""Writing films: an MP4 that every browser plays, a poster, a small GIF."""

from __future__ import annotations

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import mediapy
import numpy as np
from PIL import Image

from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.rendering.backends import find_backend
from grosmc_mj.rendering.ffmpeg import Ffmpeg, find_ffmpeg
from grosmc_mj.rendering.film import Film
from grosmc_mj.rendering.frames import Storyboard, storyboard
from grosmc_mj.rendering.workers import draw_frames, interrupts_held

# Browsers take the colours of an HD film for BT.709, and begin to play before its end is there.
# Two threads on any machine: their number changes the bytes.
_ARGUMENTS = (
    "-vf scale=out_color_matrix=bt709:out_range=tv "
    "-colorspace bt709 -color_primaries bt709 -color_trc bt709 -color_range tv "
    "-preset veryfast -tune animation -threads 2 -fflags +bitexact -flags:v +bitexact "
    "-movflags +faststart"
)
_CRF = 23
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
    path: Path,
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
    if path.suffix.lower() != ".mp4":
        raise ArgumentError(f"{path} must end in .mp4")
    workers = workers or len(os.sched_getaffinity(0))
    program = find_ffmpeg()
    backend = backend or find_backend(os.environ.get("MUJOCO_GL")).backend
    board = storyboard(film)
    poster = path.with_suffix(".png")
    mediapy.set_ffmpeg(program.path)
    with _aside(path) as part:
        with contextlib.closing(draw_frames(board, backend, workers)) as frames:
            best = _encode(part, board, film.format.fps, frames, advance)
        with _aside(poster) as picture:
            Image.fromarray(best).save(picture, optimize=True)
        if gif:
            with _aside(path.with_suffix(".gif")) as small:
                _write_gif(program, part, small, film.format.width)
    return Written(
        path,
        poster,
        path.with_suffix(".gif") if gif else None,
        len(board.times),
        backend,
        program,
    )


def _encode(
    path: Path,
    board: Storyboard,
    fps: int,
    frames: Iterator[np.ndarray],
    advance: Callable[[], object],
) -> np.ndarray:
    """Stream the frames to ffmpeg; returns the poster."""
    best = board.chart.empty
    shape = (board.layout.height, board.layout.width)
    writer = mediapy.VideoWriter(
        path, shape, fps=fps, crf=_CRF, encoded_format="yuv420p", ffmpeg_args=_ARGUMENTS
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
    except (OSError, RuntimeError) as error:
        raise SetupError(f"{path.name}: ffmpeg stopped: {_why(writer, error)}") from error
    finally:
        _stop(writer)
    return best


def _why(writer: mediapy.VideoWriter, error: Exception) -> str:
    """ffmpeg's own last words, if it has said any."""
    process = writer._proc
    said = ""
    if process is not None and process.stderr is not None and not process.stderr.closed:
        process.kill()
        said = process.stderr.read().decode(errors="replace")
    lines = [line for line in (said or str(error)).splitlines() if line.strip()]
    return lines[-1] if lines else type(error).__name__


def _stop(writer: mediapy.VideoWriter) -> None:
    """End an ffmpeg that is still there."""
    process = writer._proc
    if process is not None:
        process.kill()
        with contextlib.suppress(OSError):
            process.__exit__(None, None, None)
        writer._popen = writer._proc = None


def _write_gif(program: Ffmpeg, film: Path, gif: Path, width: int) -> None:
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
                [program.path, "-v", "error", "-y", *arguments],
                check=True,
                capture_output=True,
                text=True,
                stdin=subprocess.DEVNULL,
            )
    except subprocess.CalledProcessError as error:
        said = error.stderr.strip().splitlines() or [str(error)]
        raise SetupError(f"{gif.name}: ffmpeg stopped: {said[-1]}") from error
    finally:
        palette.unlink(missing_ok=True)


@contextlib.contextmanager
def _aside(path: Path) -> Iterator[Path]:
    """A path to write to, renamed to the real one at the end and removed if that is not reached.

    Raises:
        SetupError: If it cannot be written.
    """
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise SetupError(
            f"cannot write {path}: {error.strerror}; free the disk or choose another place"
        ) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
