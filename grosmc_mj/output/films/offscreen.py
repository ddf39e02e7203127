"""Off-screen OpenGL and ffmpeg: which of them work on this machine, and why others do not.

MuJoCo reads MUJOCO_GL once, when it is imported, and may crash with a backend that is not there:
each backend is tried in a child process of its own.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from grosmc_mj.ground.errors import SetupError, unknown_name

# Shared library of a backend, and the command that installs it; MuJoCo brings glfw.
BACKENDS = {
    "egl": ("libEGL.so.1", "apt-get install libegl1 libgl1-mesa-dri"),
    "osmesa": ("libOSMesa.so.8", "apt-get install libosmesa6"),
    "glfw": (None, ""),
}
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
    """A working ffmpeg: path of the program and its version."""

    path: str
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


def find_backend(wish: str | None = None) -> Probe:
    """Return the trial of the first backend that works.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any: this one alone is tried.

    Raises:
        SetupError: If none works, with the reasons and the command that installs one, or the wish
            is not a backend.
    """
    name = (wish or "").strip().lower()
    if name and name not in BACKENDS:
        unknown = unknown_name("backend", name, BACKENDS)
        raise SetupError(f"MUJOCO_GL: {unknown}; run: unset MUJOCO_GL")
    names = [name] if name else ["egl", "osmesa"]
    if not name and has_display():
        names.append("glfw")

    failed = []
    for name in names:
        trial = probe(name)
        if trial.works:
            return trial
        failed.append(trial)

    reasons = "; ".join(f"{trial.backend}: {trial.reason}" for trial in failed)
    message = f"no OpenGL backend renders off-screen ({reasons})"
    remedies = [trial.remedy for trial in failed if trial.remedy]
    if remedies:
        message += f"; run: {remedies[0]}"
    raise SetupError(message)


def render_here() -> None:
    """Have MuJoCo render in this process, with the first backend that works.

    MuJoCo has read MUJOCO_GL when it was imported, and without a display it would open none: its
    module of contexts is made to read it again. A backend that the user has named stays.

    Raises:
        SetupError: If none works, as ``find_backend``.
    """
    if os.environ.get("MUJOCO_GL") or has_display() or sys.platform != "linux":
        return
    os.environ |= rendering(find_backend().backend)
    importlib.reload(importlib.import_module("mujoco.rendering.classic.gl_context"))


# A trial takes a second.
@cache
def probe(name: str) -> Probe:
    """Render one small picture with a backend, in a child process; each is tried once."""
    library, remedy = BACKENDS[name]
    if name == "glfw" and not has_display():
        return Probe(name, reason="no display (DISPLAY and WAYLAND_DISPLAY are not set)")

    # -P: no module of the user's own folder is taken for one of the libraries.
    command = [sys.executable, "-P", str(Path(__file__).with_name("probe.py"))]
    try:
        trial = subprocess.run(
            command,
            env=os.environ | rendering(name),
            timeout=_TIMEOUT,
            check=False,
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return Probe(name, reason=f"no answer within {_TIMEOUT} s")

    _, answered, renderer = trial.stdout.rpartition("renderer: ")
    if answered and trial.returncode == 0:
        return Probe(name, renderer.strip())
    try:
        ctypes.CDLL(library)
    except OSError:
        return Probe(name, "", f"{library} is not installed", remedy)

    reason = f"the test program ended with exit code {trial.returncode} and no answer"
    # A program that was killed by a signal has not said why.
    lines = [line.strip() for line in trial.stderr.split("\n") if line.strip()]
    if trial.returncode > 0 and lines:
        reason = lines[-1]
    return Probe(name, "", reason, remedy)


def find_film_tools(wish: str | None = None) -> tuple[str, Ffmpeg]:
    """Return the name of a backend that renders here, and the ffmpeg.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any.

    Raises:
        SetupError: All that is missing, with the commands that install it.
    """
    missing = []
    backend, ffmpeg = None, None
    try:
        backend = find_backend(wish).backend
    except SetupError as error:
        missing.append(str(error))
    try:
        ffmpeg = find_ffmpeg()
    except SetupError as error:
        missing.append(str(error))

    if backend is None or ffmpeg is None:
        raise SetupError("; ".join(missing))
    return backend, ffmpeg


def find_ffmpeg() -> Ffmpeg:
    """Return the ffmpeg that imageio-ffmpeg carries, else the system's.

    Raises:
        SetupError: If there is none that works.
    """
    try:
        import imageio_ffmpeg

        return Ffmpeg(imageio_ffmpeg.get_ffmpeg_exe(), imageio_ffmpeg.get_ffmpeg_version())
    except (ImportError, RuntimeError, OSError) as error:
        raise SetupError(f"no ffmpeg ({error}); run: apt-get install ffmpeg") from error
