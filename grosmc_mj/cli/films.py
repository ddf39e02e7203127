"""Films that the commands film, validate and run write."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from grosmc_mj.cli import screen
from grosmc_mj.ground.errors import SetupError

if TYPE_CHECKING:
    from rich.console import Console

    from grosmc_mj.experiments.experiment import Experiment, RunResult
    from grosmc_mj.output.films.film import Film
    from grosmc_mj.output.films.pool import RenderingPool

FOLDER = "films"


def write_with_progress(
    console: Console,
    case: Experiment,
    film: Film,
    path: Path,
    *,
    pool: RenderingPool | None = None,
    workers: int | None = None,
    gif: bool = False,
) -> None:
    """Write the film of a case, and print its size and the paths of its files.

    Args:
        console: Where they are printed.
        case: The case.
        film: Film of its runs.
        path: The MP4.
        pool: Rendering processes, if they are open already.
        workers: Number of rendering processes otherwise; by default one a core.
        gif: True to write a small GIF too.

    Raises:
        SetupError: If it cannot be rendered or written.
    """
    from grosmc_mj.experiments.films import write_case_film

    with screen.progress(len(film.times), "frames") as advance:
        written = write_case_film(
            case,
            film,
            path,
            workers=workers,
            pool=pool,
            gif=gif,
            advance=lambda: advance(path.name),
        )

    seconds = written.frames / film.format.fps
    megabytes = path.stat().st_size / 1e6
    console.print(
        f"{written.frames} frames, {seconds:.1f} s, "
        f"{megabytes:.1f} MB ({written.backend}, ffmpeg {written.ffmpeg.version})",
        markup=False,
    )
    files = [file for file in (path, written.poster, written.gif) if file is not None]
    screen.say_files(console, *files)


def film_results(console: Console, results: Sequence[RunResult], folder: Path) -> None:
    """Film every case of a validation, or say in one line why not; current films are kept."""
    from grosmc_mj.experiments.films import films_of

    films = {}
    for case, film in films_of(results):
        path = folder / FOLDER / f"{case.system}_{case.name}.mp4"
        films[path] = case, film
    _write_missing(console, films)


def film_runs(console: Console, results: Sequence[RunResult], path: Path) -> None:
    """Film runs side by side, in MuJoCo if there are some; a current film is kept.

    A line says why there is no film.
    """
    from grosmc_mj.experiments.films import film_of
    from grosmc_mj.output.films.film import MOST_TAKES

    plants = [result.plant for result in results]
    plant = "physics" if "physics" in plants else plants[-1]
    filmed = [result for result in results if result.plant == plant][-MOST_TAKES:]
    _write_missing(console, {path: (filmed[0].case, film_of(filmed))})


def _write_missing(console: Console, films: Mapping[Path, tuple[Experiment, Film]]) -> None:
    """Write the films whose files are missing or older, or say in one line why not."""
    from grosmc_mj.experiments.films import is_current
    from grosmc_mj.output.films.pool import NO_GRAPHICS, open_pool

    missing = {path: item for path, item in films.items() if not is_current(item[1], path)}

    try:
        if missing:
            pictures = any(film.model is not None for _, film in missing.values())
            with open_pool(None if pictures else NO_GRAPHICS) as pool:
                for path, (case, film) in missing.items():
                    write_with_progress(console, case, film, path, pool=pool)
    except SetupError as error:
        console.print(f"No films: {error}", style="yellow", soft_wrap=True)

    kept = len(films) - len(missing)
    if kept:
        console.print(f"Kept {kept} films drawn from the same data")


def write_film_of_log(film: Film, path: Path) -> None:
    """Write the film of a log, and print the paths of its files."""
    from grosmc_mj.output.films.write import write_film

    with screen.progress(len(film.times), "frames") as advance:
        written = write_film(film, path, advance=lambda: advance("film"))
    screen.say_files(screen.console(), written.film, written.poster)
