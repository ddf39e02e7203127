"""The ffmpeg program that films are written with."""

from __future__ import annotations

import shutil
import subprocess
from typing import NamedTuple

from grosmc_mj.errors import SetupError

REMEDY = "apt-get install ffmpeg"


class Ffmpeg(NamedTuple):
    """A working ffmpeg.

    Attributes:
        path: Of the program.
        origin: ``system`` or ``imageio-ffmpeg``.
        version: As it says itself.
    """

    path: str
    origin: str
    version: str


def find_ffmpeg() -> Ffmpeg:
    """The system's ffmpeg, else the one that imageio-ffmpeg carries; it must have H.264.

    Raises:
        SetupError: If there is none that works, saying why and what mends it.
    """
    reasons = []
    for origin, path in (("system", shutil.which("ffmpeg")), ("imageio-ffmpeg", _carried())):
        if path is None:
            reasons.append(f"{origin}: not installed")
            continue
        try:
            said = subprocess.run(
                [path, "-hide_banner", "-encoders"],
                capture_output=True,
                text=True,
                check=True,
                timeout=60,
                stdin=subprocess.DEVNULL,
            ).stdout
            if "libx264" not in said:
                reasons.append(f"{origin}: {path} cannot write H.264 (libx264)")
                continue
            version = subprocess.run(
                [path, "-version"], capture_output=True, text=True, check=True, timeout=60
            ).stdout.split()[2]
        except (OSError, subprocess.SubprocessError, IndexError) as error:
            reasons.append(f"{origin}: {path} does not run ({error})")
            continue
        return Ffmpeg(path, origin, version)
    raise SetupError(f"no ffmpeg ({'; '.join(reasons)}); run: {REMEDY}")


def _carried() -> str | None:
    """Path of imageio-ffmpeg's program, if it is there."""
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return None
