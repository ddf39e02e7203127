"""What this machine has for films, and what is missing."""

from __future__ import annotations

import os
from typing import NamedTuple

from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen.backends import (
    BACKENDS,
    Probe,
    candidates,
    forget,
    has_display,
    probe,
)
from grosmc_mj.films.offscreen.ffmpeg import REMEDY, Ffmpeg, find_ffmpeg


class Diagnosis(NamedTuple):
    """What was found.

    Attributes:
        backends: Every backend, tried just now.
        chosen: The one that films use; empty if none works.
        ffmpeg: The program that writes them, or None.
        cores: Cores of this process.
        display: Whether there is a display.
        problems: What keeps films from being made, in words.
        remedies: The command that mends each thing missing.
    """

    backends: tuple[Probe, ...]
    chosen: str
    ffmpeg: Ffmpeg | None
    cores: int
    display: bool
    problems: tuple[str, ...]
    remedies: tuple[str, ...]

    @property
    def films_can_be_made(self) -> bool:
        """Whether a backend and ffmpeg work."""
        return bool(self.chosen) and self.ffmpeg is not None


def diagnose(wish: str | None = None) -> Diagnosis:
    """Try every backend and look for ffmpeg.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any.
    """
    problems, remedies = [], []
    probes = {name: probe(name) for name in BACKENDS}
    chosen = ""
    try:
        wanted = candidates(wish)
        forget(wish)
        chosen = next((name for name in wanted if probes[name].works), "")
        if not chosen:
            problems.append(f"no OpenGL backend works of those to try: {', '.join(wanted)}")
            remedies += [probes[name].remedy for name in wanted[:1]]
    except SetupError as error:
        problems.append(str(error))
        remedies.append("unset MUJOCO_GL")
    ffmpeg = None
    try:
        ffmpeg = find_ffmpeg()
    except SetupError as error:
        problems.append(str(error))
        remedies.append(REMEDY)
    return Diagnosis(
        tuple(probes.values()),
        chosen,
        ffmpeg,
        len(os.sched_getaffinity(0)),
        has_display(),
        tuple(problems),
        tuple(dict.fromkeys(each for each in remedies if each)),
    )
