"""Films as commands write them: film itself, and those of validate and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grosmc_mj.cli import screen
from grosmc_mj.errors import SetupError

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.experiments.case import Case
    from grosmc_mj.experiments.runs import RunResult, Settings
    from grosmc_mj.films.film import Film

FOLDER = "films"


def write_with_progress(
    console: Console, case: Case, film: Film, path: Path, settings: Settings, **options: Any
) -> None:
    """Write the film of a case, and say how large it is and where it and its pictures are.

    Args:
        console: Where it is said.
        case: What was run.
        film: Of its runs.
        path: The MP4.
        settings: How it was run.
        options: Of ``write_case_film``.

    Raises:
        SetupError: If it cannot be rendered or written.
    """
    from grosmc_mj.experiments.films import write_case_film

    with screen.progress(len(film.times), "frames") as advance:
        written = write_case_film(
            case, film, path, settings=settings, advance=lambda: advance(path.name), **options
        )
    console.print(
        f"{written.frames} frames, {written.frames / film.format.fps:.1f} s, "
        f"{path.stat().st_size / 1e6:.1f} MB ({written.backend}, ffmpeg {written.ffmpeg.version})",
        markup=False,
    )
    screen.say_files(console, *filter(None, (path, written.poster, written.gif)))


def film_results(
    console: Console, results: Sequence[RunResult], settings: Settings, folder: Path
) -> None:
    """Film every case of a validation, or say in one line why not; what is there is kept."""
    from grosmc_mj.experiments.films import films_of

    films = {
        folder / FOLDER / f"{case.system}_{case.name}.mp4": (case, film)
        for case, film in films_of(results)
    }
    _write_missing(console, films, settings)


def film_runs(
    console: Console, results: Sequence[RunResult], settings: Settings, path: Path
) -> None:
    """Film runs in MuJoCo, side by side, or say in one line why not; what is there is kept."""
    from grosmc_mj.experiments.films import film_of
    from grosmc_mj.films.film import MOST_TAKES

    shown = [result for result in results if result.plant == "physics"][-MOST_TAKES:]
    films = {path: (shown[0].case, film_of(shown))} if shown else {}
    _write_missing(console, films, settings)


def _write_missing(
    console: Console, films: Mapping[Path, tuple[Case, Film]], settings: Settings
) -> None:
    """Write the films that are not there yet, or say in one line why not."""
    from grosmc_mj.experiments.films import is_current
    from grosmc_mj.films.pool import open_pool

    missing = {path: shown for path, shown in films.items() if not is_current(shown[1], path)}
    try:
        if missing:
            with open_pool() as pool:
                for path, (case, film) in missing.items():
                    write_with_progress(console, case, film, path, settings, pool=pool)
    except SetupError as error:
        console.print(f"No films: {error}", style="yellow", soft_wrap=True)

    if not films:
        console.print("No film: there is no run in MuJoCo.", style="yellow")
    kept = len(films) - len(missing)
    if kept:
        console.print(f"Kept {kept} films drawn from the same data")
