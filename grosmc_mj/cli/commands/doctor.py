"""grosmc-mj doctor."""

from __future__ import annotations

import os
from dataclasses import dataclass

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command


@dataclass(frozen=True)
class DoctorCommand(Command):
    """Say what this machine has and, for each thing missing, the command that installs it.

    Versions, cores, the OpenGL backends (each is tried: it must render the right picture) and the
    ffmpeg that films are written with. Exit code 1 if films cannot be made.
    """

    def execute(self) -> int:
        """What is missing, then what there is."""
        from grosmc_mj.films.offscreen import diagnose, has_display
        from grosmc_mj.report.document import versions

        found, console = diagnose(os.environ.get("MUJOCO_GL")), screen.console()
        good, words = not found.problems, "Films can be made."
        if not good:
            words = "Films cannot be made; everything else works."
        screen.say_verdict(console, words, good=good)
        for problem in found.problems:
            console.print(f"missing: {problem}", style="red", soft_wrap=True, markup=False)
        for remedy in found.remedies:
            console.print(f"run: {remedy}", style="bold", soft_wrap=True)
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
        console.print(f"[bold]Machine[/]\n  cores        {len(os.sched_getaffinity(0))}")
        console.print(f"  display      {'yes' if has_display() else 'none (only glfw needs one)'}")
        console.print(f"  MUJOCO_GL    {os.environ.get('MUJOCO_GL') or 'not set'}")
        console.print("[bold]Versions[/]")
        for package, version in versions().items():
            console.print(f"  {package:<12} {version}")
        return screen.DONE if good else screen.DIFFERS
