"""Writing films: an MP4 that every browser plays, a poster, a small GIF."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Annotated, NamedTuple

import numpy as np
import pydantic
from PIL import Image

from grosmc_mj.errors import ArgumentError
from grosmc_mj.fields import Range, checked_call
from grosmc_mj.files import cannot_write, written_aside
from grosmc_mj.films.film import Film, Format
from grosmc_mj.films.frames import Storyboard
from grosmc_mj.films.offscreen import Ffmpeg, find_ffmpeg
from grosmc_mj.films.pool import RenderingPool, open_pool
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
    pool: pydantic.InstanceOf[RenderingPool] | None = None,
    gif: bool = False,
    advance: Callable[[], object] = lambda: None,
) -> Written:
    """Render a film and write it; every file is written aside and renamed when it is whole.

    Args:
        film: What to show.
        path: The MP4; poster and GIF lie beside it.
        backend: Value of MUJOCO_GL for the rendering processes; None for the first that works.
        workers: Rendering processes; None for one a core.
        pool: Processes that draw several films, in place of new ones.
        gif: Whether to write a small GIF too.
        advance: Called after each frame.

    Raises:
        ArgumentError: If the path is no ``.mp4``.
        SetupError: If there is no working backend or ffmpeg, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise ArgumentError(f"{path} must end in .mp4")
    if pool is not None:
        return _write(film, path, pool, gif, advance)

    with open_pool(backend, workers) as pool:
        return _write(film, path, pool, gif, advance)


def _write(
    film: Film, path: Path, pool: RenderingPool, gif: bool, advance: Callable[[], object]
) -> Written:
    """Draw a film with a pool and write its files."""
    program = find_ffmpeg()
    board = storyboard(film)
    poster = path.with_suffix(".png")
    encodings: dict[Path, Sequence[str]] = {path: _H264.split()}
    small = None
    if gif:
        small = path.with_suffix(".gif")
        encodings[small] = _GIF

    # All are opened before anything is drawn, and renamed together when all are whole.
    with contextlib.ExitStack() as files:
        aside = {name: files.enter_context(written_aside(name)) for name in (*encodings, poster)}
        with contextlib.ExitStack() as encoders, contextlib.closing(pool.frames(board)) as frames:
            pipes = []
            for name, options in encodings.items():
                encoder = _encoder(program, film.format, options, aside[name], name)
                pipes.append(encoders.enter_context(encoder))
            still = _pass_on(frames, pipes, len(board.times) // 2, advance)
        try:
            Image.fromarray(still).save(aside[poster], optimize=True)
        except OSError as error:
            raise cannot_write(poster, error) from error
    return Written(path, poster, small, len(board.times), pool.backend, program, board)


def _pass_on(
    frames: Iterable[np.ndarray],
    pipes: Sequence[IO[bytes]],
    chosen: int,
    advance: Callable[[], object],
) -> np.ndarray:
    """Write every frame to every pipe; return the frame of a chosen index."""
    still = np.zeros((1, 1, 3), np.uint8)
    for index, frame in enumerate(frames):
        for pipe in pipes:
            pipe.write(frame.data)
        if index == chosen:
            still = frame
        advance()
    return still


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
