"""grosmc-mj doctor."""

from __future__ import annotations

import os
from dataclasses import dataclass

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
        from grosmc_mj.films.offscreen import (
            BACKENDS,
            find_backend,
            find_ffmpeg,
            has_display,
            probe,
        )
        from grosmc_mj.results.document import versions

        console, problems = screen.console(), list[str]()
        backend = ffmpeg = None
        try:
            backend = find_backend(os.environ.get("MUJOCO_GL"))
        except SetupError as error:
            problems.append(str(error))
        try:
            ffmpeg = find_ffmpeg()
        except SetupError as error:
            problems.append(str(error))
        words = "Films cannot be made; everything else works." if problems else "Films can be made."
        screen.say_verdict(console, words, good=not problems)
        parts = [problem.partition("; run: ") for problem in problems]
        for problem, _, _ in parts:
            console.print(f"missing: {problem}", style="red", soft_wrap=True, markup=False)
        for remedy in (remedy for _, _, remedy in parts if remedy):
            console.print(f"run: {remedy}", style="bold", soft_wrap=True)
        console.print("[bold]OpenGL, off-screen[/]")
        for name in BACKENDS:
            trial = probe(name)
            if trial.works:
                used = ", films use it" if trial == backend else ""
                words = f"  {name:<12} [green]works[/]{used}: {trial.renderer}"
            else:
                remedy = f"; run: {trial.remedy}" if trial.remedy else ""
                words = f"  {name:<12} no: {trial.reason}{remedy}"
            console.print(words, soft_wrap=True)
        console.print("[bold]ffmpeg[/]")
        if ffmpeg is not None:
            words = f"  {'ffmpeg':<12} [green]works[/]: {ffmpeg.version}, {ffmpeg.path}"
            console.print(words, soft_wrap=True)
        console.print(f"[bold]Machine[/]\n  cores        {len(os.sched_getaffinity(0))}")
        console.print(f"  display      {'yes' if has_display() else 'none (only glfw needs one)'}")
        console.print(f"  MUJOCO_GL    {os.environ.get('MUJOCO_GL') or 'not set'}")
        console.print("[bold]Versions[/]")
        for package, version in versions().items():
            console.print(f"  {package:<12} {version}")
        return screen.DIFFERS if problems else screen.DONE
