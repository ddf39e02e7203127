"""Off-screen OpenGL and ffmpeg: which of them work on this machine, and why others do not.

MuJoCo reads MUJOCO_GL once, when it is imported, and may crash with a backend that is not there:
each backend is tried in a child process of its own.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from grosmc_mj.errors import SetupError, unknown_name

# Shared library of a backend, and the command that installs it; MuJoCo brings glfw.
BACKENDS = {
    "egl": ("libEGL.so.1", "apt-get install libegl1 libgl1-mesa-dri"),
    "osmesa": ("libOSMesa.so.8", "apt-get install libosmesa6"),
    "glfw": (None, ""),
}
# Values of MUJOCO_GL that leave the choice open.
_OPEN = ("", "enable", "enabled", "on", "true", "1")
# Of one trial [s].
_TIMEOUT = 120


class Probe(NamedTuple):
    """Outcome of the trial of a backend.

    Attributes:
        backend: Its name.
        renderer: OpenGL's name of its renderer; empty if it does not work.
        reason: Why it does not work; empty if it does.
        remedy: The command that mends it; empty if it works or no command would.
    """

    backend: str
    renderer: str = ""
    reason: str = ""
    remedy: str = ""

    @property
    def works(self) -> bool:
        """Whether it rendered the right picture."""
        return bool(self.renderer)


class Ffmpeg(NamedTuple):
    """A working ffmpeg: path of the program, ``system`` or ``imageio-ffmpeg``, its version."""

    path: str
    origin: str
    version: str


@contextlib.contextmanager
def without_graphics() -> Iterator[None]:
    """Import MuJoCo or dm_control in here, and no OpenGL library is loaded or missed.

    Both read MUJOCO_GL when they are imported, and fail if its library is not there.
    """
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        yield
    finally:
        del os.environ["MUJOCO_GL"]
        if before is not None:
            os.environ["MUJOCO_GL"] = before


def rendering(backend: str) -> dict[str, str]:
    """Variables of a process that renders with a backend."""
    # PyOpenGL's own setting would contradict MuJoCo's.
    return {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": ""}


def has_display() -> bool:
    """Whether there is a display that glfw could open a window on."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def candidates(wish: str | None) -> list[str]:
    """Backends to try, in order: the one wished for, or all those that could work here.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any.

    Raises:
        SetupError: If the wish is not a backend.
    """
    wish = (wish or "").strip().lower()
    if wish in _OPEN:
        return ["egl", "osmesa", *(["glfw"] if has_display() else [])]
    if wish not in BACKENDS:
        unknown = unknown_name("backend", wish, BACKENDS)
        raise SetupError(f"MUJOCO_GL: {unknown}; run: unset MUJOCO_GL")
    return [wish]


def find_backend(wish: str | None = None) -> Probe:
    """The trial of the first backend that works.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any.

    Raises:
        SetupError: If none works, saying why and what mends it.
    """
    trials = []
    for name in candidates(wish):
        trials.append(trial := probe(name))
        if trial.works:
            return trial
    reasons = "; ".join(f"{trial.backend}: {trial.reason}" for trial in trials)
    remedy = next((f"; run: {trial.remedy}" for trial in trials if trial.remedy), "")
    raise SetupError(f"no OpenGL backend renders off-screen ({reasons}){remedy}")


@cache
def probe(name: str) -> Probe:
    """Render one small picture with a backend, in a child process; each is tried once."""
    library, remedy = BACKENDS[name]
    if name == "glfw" and not has_display():
        return Probe(name, reason="no display (DISPLAY and WAYLAND_DISPLAY are not set)")
    # -P: no module of the user's own folder is taken for one of the libraries.
    command = [sys.executable, "-P", str(Path(__file__).with_name("probe.py"))]
    try:
        trial = _output(command, os.environ | rendering(name), check=False)
    except subprocess.TimeoutExpired:
        return Probe(name, reason=f"no answer within {_TIMEOUT} s")
    except OSError as error:
        return Probe(name, reason=f"{sys.executable} cannot be run: {error.strerror}")
    _, answered, renderer = trial.stdout.rpartition("renderer: ")
    if answered and trial.returncode == 0:
        return Probe(name, renderer.strip())
    try:
        ctypes.CDLL(library)
    except OSError:
        return Probe(name, "", f"{library} is not installed", remedy)
    lines = trial.stderr.split("\n") if trial.returncode > 0 else []
    silent = f"the test program ended with {ended(trial.returncode)} and no answer"
    last = next((line.strip() for line in reversed(lines) if line.strip()), silent)
    return Probe(name, "", last, remedy)


def ended(code: int) -> str:
    """How a process ended, in words, by its exit code."""
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def find_ffmpeg() -> Ffmpeg:
    """The system's ffmpeg, else the one that imageio-ffmpeg carries; it must have H.264.

    Raises:
        SetupError: If there is none that works, saying why and what mends it.
    """
    reasons = []
    for origin, path in (("system", shutil.which("ffmpeg")), ("imageio-ffmpeg", _carried())):
        try:
            if path is None:
                reasons.append(f"{origin}: not installed")
            elif "libx264" not in _output([path, "-hide_banner", "-encoders"]).stdout:
                reasons.append(f"{origin}: {path} cannot write H.264 (libx264)")
            else:
                return Ffmpeg(path, origin, _output([path, "-version"]).stdout.split()[2])
        except (OSError, subprocess.SubprocessError, IndexError) as error:
            reasons.append(f"{origin}: {path} does not run ({error})")
    raise SetupError(f"no ffmpeg ({'; '.join(reasons)}); run: apt-get install ffmpeg")


def _output(
    command: list[str], environment: dict[str, str] | None = None, *, check: bool = True
) -> subprocess.CompletedProcess[str]:
    """Run a program that reads nothing, within a time; returns what it has written."""
    return subprocess.run(
        command, env=environment, check=check, timeout=_TIMEOUT,
        capture_output=True, text=True, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def _carried() -> str | None:
    """Path of imageio-ffmpeg's program, if it is there."""
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return None
