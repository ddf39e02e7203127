"""grosmc-mj film and doctor, and the films of grosmc-mj validate."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from grosmc_mj.cli import screen
from grosmc_mj.cli.commands import Doctor, Film
from grosmc_mj.errors import ArgumentError, SetupError

if TYPE_CHECKING:
    from grosmc_mj.experiments.runs import RunResult, Settings
    from grosmc_mj.films.write import Written

FOLDER = "films"
_MOST_WORKERS = 256
# Of the runs of a film [s].
_LONGEST = 120.0


def film(command: Film) -> int:
    """Run, render, write."""
    from grosmc_mj.experiments.experiment import find_experiment
    from grosmc_mj.experiments.films import check_request, film_of, write_case_film
    from grosmc_mj.experiments.runs import Settings
    from grosmc_mj.films.film import Format
    from grosmc_mj.films.offscreen.backends import find_backend
    from grosmc_mj.films.offscreen.ffmpeg import find_ffmpeg

    width, height = _size(command.size)
    form = Format(
        width, height, command.fps, command.speed, command.camera, command.start, command.stop
    )
    if command.workers is not None and not 1 <= command.workers <= _MOST_WORKERS:
        raise ArgumentError(f"--workers {command.workers} must be from 1 to {_MOST_WORKERS}")
    experiment = find_experiment(command.system, command.case)
    if command.duration is not None:
        if not 0 < command.duration <= _LONGEST:
            raise ArgumentError(
                f"--duration {command.duration:g} s must be positive and at most {_LONGEST:g} s"
            )
        experiment = experiment.varied(duration=command.duration)
    settings = Settings(
        switching=command.switching,
        surface=command.surface,  # pyright: ignore[reportArgumentType]  checked by Settings
    )
    names = tuple(dict.fromkeys(command.controllers))
    experiment, case = experiment.with_settings(**settings.changes()), experiment.case
    check_request(experiment, names, form)
    path = command.output or Path("renders") / FOLDER / f"{case.system}_{case.name}.mp4"
    if path.suffix.lower() != ".mp4":
        raise ArgumentError(f"-o {path} must end in .mp4")
    find_ffmpeg()
    backend = find_backend(os.environ.get("MUJOCO_GL"), fresh=command.probe).backend
    results = [experiment.run("physics", name) for name in names]
    shown = film_of(results, form, names)
    with screen.progress(len(shown.times), "frames") as advance:
        written = write_case_film(
            case,
            shown,
            path,
            settings=experiment.settings,
            backend=backend,
            workers=command.workers,
            gif=command.gif,
            advance=lambda: advance(path.name),
        )
    console = screen.console()
    for result in results:
        if result.ended:
            console.print(f"{result.key}: {result.ended}", style="red", soft_wrap=True)
    say(console, written, form.fps)
    return screen.DONE


def _size(text: str) -> tuple[int, int]:
    """Width and height of WxH."""
    found = re.fullmatch(r"(\d+)[x×](\d+)", text.strip().lower())
    if found is None:
        raise ArgumentError(f"--size {text} must be WIDTHxHEIGHT in pixels, such as 1280x720")
    return int(found[1]), int(found[2])


def say(console: Console, written: Written, fps: int) -> None:
    """One line about a film."""
    size = written.film.stat().st_size / 1e6
    files = [written.film, written.poster, *([written.gif] if written.gif else [])]
    console.print(
        f"{', '.join(map(str, files))}: {written.frames} frames, {written.frames / fps:.1f} s, "
        f"{size:.1f} MB ({written.backend}, ffmpeg {written.ffmpeg.version})",
        soft_wrap=True,
    )


def film_results(
    console: Console, results: Sequence[RunResult], settings: Settings, folder: Path
) -> None:
    """Film every case of a validation, or say in one line why not; what is there is kept."""
    from grosmc_mj.experiments.films import SMALL, films_of, is_current, write_case_film
    from grosmc_mj.films.offscreen.backends import find_backend
    from grosmc_mj.films.offscreen.ffmpeg import find_ffmpeg

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
            say(console, written, SMALL.fps)
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
    from grosmc_mj.films.offscreen.backends import find_backend
    from grosmc_mj.films.offscreen.ffmpeg import find_ffmpeg

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
        say(console, written, film.format.fps)
    except SetupError as error:
        console.print(f"No film: {error}", style="yellow", soft_wrap=True)


def doctor(_: Doctor) -> int:
    """What there is, and what is missing."""
    from grosmc_mj.films.offscreen.doctor import diagnose
    from grosmc_mj.report.document import versions

    found, console = diagnose(os.environ.get("MUJOCO_GL")), screen.console()
    console.print("[bold]Versions[/]")
    for package, version in versions().items():
        console.print(f"  {package:<12} {version}")
    console.print(f"[bold]Machine[/]\n  cores        {found.cores}")
    console.print(f"  display      {'yes' if found.display else 'none (only glfw needs one)'}")
    console.print(f"  MUJOCO_GL    {os.environ.get('MUJOCO_GL') or 'not set'}")
    console.print("[bold]OpenGL, off-screen[/]")
    for probe in found.backends:
        if probe.works:
            used = ", films use it" if probe.backend == found.chosen else ""
            words = f"  {probe.backend:<12} [green]works[/]{used}: {probe.renderer}"
            console.print(words, soft_wrap=True)
        else:
            remedy = f"; run: {probe.remedy}" if probe.remedy else ""
            console.print(f"  {probe.backend:<12} no: {probe.reason}{remedy}", soft_wrap=True)
    console.print("[bold]ffmpeg[/]")
    if found.ffmpeg is not None:
        tool = found.ffmpeg
        words = f"  {tool.origin:<12} [green]works[/]: {tool.version}, {tool.path}"
        console.print(words, soft_wrap=True)
    for problem in found.problems:
        console.print(f"missing: {problem}", style="red", soft_wrap=True)
    for remedy in found.remedies:
        console.print(f"run: {remedy}", style="bold", soft_wrap=True)
    if not found.films_can_be_made:
        console.print("Films cannot be made; everything else works.", style="bold red")
        return screen.DIFFERS
    console.print("Films can be made.", style="bold green")
    return screen.DONE
