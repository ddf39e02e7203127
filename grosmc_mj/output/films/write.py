"""Writing films: an MP4 that every browser plays, a poster, a small GIF."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple, Self

import mediapy
import numpy as np
import pydantic

from grosmc_mj.ground.child_processes import shielded_from_interrupts
from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.ground.fields import Range, checked_call
from grosmc_mj.ground.files import atomic_write, cannot_write
from grosmc_mj.output.films.film import Film
from grosmc_mj.output.films.frames import Storyboard
from grosmc_mj.output.films.offscreen import Ffmpeg, find_ffmpeg
from grosmc_mj.output.films.pool import NO_GRAPHICS, RenderingPool, open_pool
from grosmc_mj.output.films.storyboard import storyboard

# Browsers take the colours of an HD film for BT.709, and begin to play before its end is there.
# Two threads on any machine: their number changes the bytes.
_H264 = (
    "-xerror -preset veryfast -tune animation -threads 2 "
    "-vf scale=out_color_matrix=bt709:out_range=tv,"
    "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv "
    "-fflags +bitexact -flags:v +bitexact -movflags +faststart"
)
_QUALITY = 23
_GIF = [
    "-xerror",
    "-vf",
    "fps=10,scale='min(640,iw)':-2:flags=area,split[a][b];[a]palettegen=max_colors=128[p];"
    "[b][p]paletteuse=dither=none:diff_mode=rectangle",
]


class WrittenFilm(NamedTuple):
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
) -> WrittenFilm:
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

    if film.model is None:
        backend = NO_GRAPHICS
    with open_pool(backend, workers) as pool:
        return _write(film, path, pool, gif, advance)


def _write(
    film: Film,
    path: Path,
    pool: RenderingPool,
    gif: bool,
    advance: Callable[[], object],
) -> WrittenFilm:
    """Draw a film with a pool and write its files."""
    program = find_ffmpeg()
    board = storyboard(film)
    poster = path.with_suffix(".png")
    small = path.with_suffix(".gif") if gif else None
    shape = (film.format.height, film.format.width)
    fps = film.format.fps

    # All are opened before anything is drawn, and renamed together when all are whole.
    with contextlib.ExitStack() as files:
        part = files.enter_context(atomic_write(path))
        poster_part = files.enter_context(atomic_write(poster))
        writer = mediapy.VideoWriter(
            part, shape, codec="h264", fps=fps, crf=_QUALITY, ffmpeg_args=_H264
        )
        encoders = [_Encoder(path, writer, program)]
        if small is not None:
            part = files.enter_context(atomic_write(small))
            writer = mediapy.VideoWriter(part, shape, codec="gif", fps=fps, ffmpeg_args=_GIF)
            encoders.append(_Encoder(small, writer, program))
        still = _write_frames(pool.frames(board), encoders, film.poster_frame, advance)
        try:
            mediapy.write_image(poster_part, still, optimize=True)
        except OSError as error:
            raise cannot_write(poster, error) from error
    return WrittenFilm(path, poster, small, len(board.times), pool.backend, program, board)


def _write_frames(
    drawing: Generator[np.ndarray],
    encoders: Sequence[_Encoder],
    chosen: int,
    advance: Callable[[], object],
) -> np.ndarray:
    """Write every frame to every file as it comes; return the frame of a chosen index."""
    still = np.zeros((1, 1, 3), np.uint8)
    with contextlib.ExitStack() as opened, contextlib.closing(drawing) as frames:
        for encoder in encoders:
            opened.enter_context(encoder)

        for index, frame in enumerate(frames):
            for encoder in encoders:
                encoder.write(frame)
            if index == chosen:
                still = frame
            advance()
    return still


class _Encoder:
    """mediapy's writer of one file, which lies under another name until it is whole.

    mediapy's writer was tried on full disks of several sizes, under a limit of the file's size,
    with an unknown codec, without ffmpeg and with one that was killed: it raised every error, with
    ffmpeg's message if there was one, and left no process. Left to itself it has three gaps. Ctrl-C
    in a terminal reaches ffmpeg, whose failure then hides the interrupt; so does the failure of a
    film that is broken off before its first frame; both are prevented here. And it would wait
    without end for an ffmpeg with more than 64 kB of messages: -xerror leaves a few lines.

    Args:
        path: The file, for messages.
        writer: Of the file under its other name.
        program: What mediapy starts.
    """

    def __init__(
        self,
        path: Path,
        writer: mediapy.VideoWriter,
        program: Ffmpeg,
    ) -> None:
        self._path = path
        self._writer = writer
        self._program = program
        self._closed = False

    def __enter__(self) -> Self:
        with shielded_from_interrupts(), _ffmpeg_of_mediapy(self._program):
            self._writer.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
            return
        with contextlib.suppress(SetupError):
            self.close()

    def write(self, frame: np.ndarray) -> None:
        """Write one frame.

        Raises:
            SetupError: If ffmpeg has stopped.
        """
        try:
            self._writer.add_image(frame)
        except BrokenPipeError as error:
            # It raises what ffmpeg has said.
            self.close()
            raise cannot_write(self._path, OSError("ffmpeg stopped")) from error

    def close(self) -> None:
        """Finish the file.

        Raises:
            SetupError: If ffmpeg does not finish it.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._writer.close()
        except (OSError, RuntimeError) as error:
            # mediapy leaves the pipe of an ffmpeg open that has failed.
            process = self._writer._popen
            if process is not None and process.stderr is not None:
                process.stderr.close()
            reason = f"ffmpeg stopped{_ffmpeg_message(error, self._writer.path, self._path)}"
            raise cannot_write(self._path, OSError(reason)) from error


@contextlib.contextmanager
def _ffmpeg_of_mediapy(program: Ffmpeg) -> Iterator[None]:
    """Let mediapy start this ffmpeg, and afterwards the user's again."""
    # The setting cannot be read otherwise; mediapy's version is bounded.
    before = mediapy._config.ffmpeg_name_or_path
    mediapy.set_ffmpeg(program.path)
    try:
        yield
    finally:
        mediapy.set_ffmpeg(before)


def _ffmpeg_message(error: Exception, part: Path, path: Path) -> str:
    """Return the line of ffmpeg's message that says most, after a colon; empty without one."""
    _, _, message = str(error).replace(str(part), str(path)).partition("': ")
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    for line in lines:
        if "No space left" in line:
            return f": {line}"
    return f": {lines[-1]}" if lines else ""
