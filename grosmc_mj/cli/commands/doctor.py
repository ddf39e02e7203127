"""grosmc-mj doctor."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command
from grosmc_mj.errors import SetupError


@dataclass(frozen=True)
class DoctorCommand(Command):
    """Say what this machine has and, for each thing missing, the command that installs it.

    Versions, cores, the OpenGL backends (each is tried: it must render the right picture) and the
    ffmpeg that films are written with. Exit code 1 if films cannot be made.
    """

    def execute(self) -> int:
        """What is missing, then what there is."""
        from loky import cpu_count

        from grosmc_mj.films import offscreen
        from grosmc_mj.results.document import versions

        console, problems = screen.console(), list[str]()
        backend = _tried(lambda: offscreen.find_backend(os.environ.get("MUJOCO_GL")), problems)
        ffmpeg = _tried(offscreen.find_ffmpeg, problems)
        words = "Films cannot be made; everything else works." if problems else "Films can be made."
        screen.say_verdict(console, words, good=not problems)
        parts = [problem.partition("; run: ") for problem in problems]
        for problem, _, _ in parts:
            console.print(f"missing: {problem}", style="red", soft_wrap=True, markup=False)
        for remedy in (remedy for _, _, remedy in parts if remedy):
            console.print(f"run: {remedy}", style="bold", soft_wrap=True)
        console.print("[bold]OpenGL, off-screen[/]")
        for trial in map(offscreen.probe, offscreen.BACKENDS):
            used = ", films use it" if trial == backend else ""
            remedy = f"; run: {trial.remedy}" if trial.remedy else ""
            works = f"[green]works[/]{used}: {trial.renderer}"
            words = works if trial.works else f"no: {trial.reason}{remedy}"
            console.print(f"  {trial.backend:<12} {words}", soft_wrap=True)
        if ffmpeg is not None:
            # Inside the environment the path from its root says as much and fits on a line.
            path = ffmpeg.path.removeprefix(f"{sys.prefix}{os.sep}")
            words = f"  {'ffmpeg':<12} [green]works[/]: {ffmpeg.version},\n  {path}"
            console.print(f"[bold]ffmpeg[/]\n{words}", soft_wrap=True)
        display = "yes" if offscreen.has_display() else "none (only glfw needs one)"
        machine = {
            "cores": cpu_count(),
            "display": display,
            "MUJOCO_GL": os.environ.get("MUJOCO_GL") or "not set",
        }
        for title, rows in (("Machine", machine), ("Versions", versions())):
            console.print(f"[bold]{title}[/]")
            for name, value in rows.items():
                console.print(f"  {name:<12} {value}")
        return screen.DIFFERS if problems else screen.DONE


def _tried(find: Callable[[], Any], problems: list[str]) -> Any:
    """What is there, or None and one problem more."""
    try:
        return find()
    except SetupError as error:
        problems.append(str(error))
        return None
