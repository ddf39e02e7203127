"""grosmc-mj report."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.errors import ArgumentError, SetupError, together

if TYPE_CHECKING:
    from rich.console import Console

# In the folder of the results.
REPORT = "report.html"
# Of a film that is made smaller: pixels across, and the worst quality that still shows a curve.
_ACROSS, _QUALITIES = 640, ("30", "36")
_PATIENCE = 120.0


@dataclass(frozen=True)
class ReportCommand(Command):
    """Write one HTML page of results, which opens offline and begins with the answer.

    It has what lies in files and folders of results: answers, where each law breaks, curves beside
    their film, claims, campaigns, ladders, tolerances, and where each comes from. What cannot be
    read is named on the page, and stops nothing.

    Attributes:
        paths: Files and folders of results.
        output: The page; by default report.html in the first folder.
    """

    paths: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="[PATH ...]", name="path", help_behavior_hint="(default: renders)"),
    ] = ()
    output: Annotated[
        Path | None, arg(aliases=("-o",), metavar="FILE.html", help_behavior_hint="")
    ] = None

    def execute(self) -> int:
        """Read, write, say."""
        paths = self.paths or (Path("renders"),)
        first = paths[0] if paths[0].is_dir() else paths[0].parent
        path = self.output or first / REPORT
        if path.suffix.lower() not in (".html", ".htm"):
            raise ArgumentError(f"-o {path} must end in .html")
        report_on(screen.console(), paths, path, full=self.verbose)
        return screen.DONE


def report_on(console: Console, paths: Sequence[Path], path: Path, *, full: bool = False) -> None:
    """Write the page of what lies in paths, and say so."""
    from grosmc_mj.page.reading import read_results
    from grosmc_mj.page.write import write_page

    reading = read_results(paths)
    if not reading.documents:
        words = f"no results in {', '.join(map(str, paths))}"
        raise ArgumentError(together([words, *(f"unreadable: {x}" for x in reading.notices)]))
    with screen.progress(1) as advance:
        advance(path.name, 0)
        written = write_page(reading, paths, path, _shrunk)
        advance(path.name)
    console.print(f"{len(reading.documents)} documents in {written.size / 1e6:.1f} MB")
    screen.say_lines(console, [f"left out: {each}" for each in written.notices], "dim", all=full)
    screen.say_files(console, path)


def _shrunk(film: Path, most: int) -> bytes | None:
    """A film in at most so many bytes, or None."""
    from grosmc_mj.films.offscreen import find_ffmpeg

    try:
        ffmpeg = find_ffmpeg().path
    except SetupError:
        return None
    with tempfile.TemporaryDirectory() as folder:
        for quality in _QUALITIES:
            made = Path(folder, f"{quality}.mp4")
            command = [
                str(ffmpeg), "-v", "error", "-nostdin", "-i", str(film.absolute()),
                "-vf", f"scale={_ACROSS}:-2", "-crf", quality, "-preset", "slow",
                "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(made),
            ]  # fmt: skip
            try:
                subprocess.run(command, check=True, capture_output=True, timeout=_PATIENCE)
            except (OSError, subprocess.SubprocessError):
                return None
            if (content := made.read_bytes()) and len(content) <= most:
                return content
    return None
