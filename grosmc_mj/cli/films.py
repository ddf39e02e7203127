"""Films of results that a command has: those of validate, run and campaign --replay."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.experiments.runs import RunResult, Settings
    from grosmc_mj.films.write import Written

FOLDER = "films"


def say_film(console: Console, written: Written, fps: int) -> None:
    """Say how large a film is, and where it and its pictures are."""
    size = written.film.stat().st_size / 1e6
    console.print(
        f"{written.frames} frames, {written.frames / fps:.1f} s, {size:.1f} MB "
        f"({written.backend}, ffmpeg {written.ffmpeg.version})",
        markup=False,
    )
    screen.say_files(console, written.film, written.poster, *([written.gif] if written.gif else []))


def film_results(
    console: Console, results: Sequence[RunResult], settings: Settings, folder: Path
) -> None:
    """Film every case of a validation, or say in one line why not; what is there is kept."""
    from grosmc_mj.experiments.films import SMALL, films_of, is_current, write_case_film
    from grosmc_mj.films.offscreen import find_backend, find_ffmpeg

    kept = []
    try:
        find_ffmpeg()
        backend = find_backend(os.environ.get("MUJOCO_GL")).backend
        for case, shown in films_of(results):
            path = folder / FOLDER / f"{case.system}_{case.name}.mp4"
            if is_current(shown, path):
                kept.append(path)
                continue
            with screen.progress(len(shown.times), "frames") as advance:
                written = write_case_film(
                    case,
                    shown,
                    path,
                    settings=settings,
                    backend=backend,
                    advance=lambda: advance(path.name),  # noqa: B023  called in this turn only
                )
            say_film(console, written, SMALL.fps)
    except SetupError as error:
        console.print(f"No films: {error}", style="yellow", soft_wrap=True)
    if kept:
        console.print(f"Kept {len(kept)} films drawn from the same data: {folder / FOLDER}")


def film_runs(
    console: Console, results: Sequence[RunResult], settings: Settings, path: Path
) -> None:
    """Film runs in MuJoCo, side by side, or say in one line why not."""
    from grosmc_mj.experiments.films import film_of, write_case_film
    from grosmc_mj.films.film import MOST_TAKES, Format
    from grosmc_mj.films.offscreen import find_backend, find_ffmpeg

    shown = [result for result in results if result.plant == "physics"][-MOST_TAKES:]
    if not shown:
        console.print("No film: there is no run in MuJoCo.", style="yellow")
        return
    try:
        find_ffmpeg()
        backend = find_backend(os.environ.get("MUJOCO_GL")).backend
        film = film_of(shown, Format())
        with screen.progress(len(film.times), "frames") as advance:
            written = write_case_film(
                shown[0].case,
                film,
                path,
                settings=settings,
                backend=backend,
                advance=lambda: advance(path.name),
            )
        say_film(console, written, film.format.fps)
    except SetupError as error:
        console.print(f"No film: {error}", style="yellow", soft_wrap=True)
