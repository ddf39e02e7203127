"""Which OpenGL backend renders off-screen here.

Child processes are asked, since MuJoCo reads MUJOCO_GL once, when it is imported, and may fail or
crash with a backend that is not there.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from grosmc_mj.errors import SetupError, unknown_name
from grosmc_mj.files import private_cache, written_aside
from grosmc_mj.versions import versions


@dataclass(frozen=True)
class Backend:
    """A way to OpenGL.

    Attributes:
        name: Value of MUJOCO_GL.
        library: Shared library that it needs; empty if its Python package carries it.
        remedy: The command that installs it; empty if MuJoCo brings it.
    """

    name: str
    library: str
    remedy: str


BACKENDS = {
    backend.name: backend
    for backend in (
        Backend("egl", "libEGL.so.1", "apt-get install libegl1 libgl1-mesa-dri"),
        Backend("osmesa", "libOSMesa.so.8", "apt-get install libosmesa6"),
        Backend("glfw", "", ""),
    )
}
# Values of MUJOCO_GL that leave the choice open.
_OPEN = ("", "enable", "enabled", "on", "true", "1")
# What a cached answer depends on, besides the packages.
_ENVIRONMENT = (
    "DISPLAY",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
    "__EGL_VENDOR_LIBRARY_DIRS",
    "LIBGL_DRIVERS_PATH",
    "GALLIUM_DRIVER",
    "LD_LIBRARY_PATH",
    "LD_PRELOAD",
    "LIBGL_ALWAYS_SOFTWARE",
    "MUJOCO_EGL_DEVICE_ID",
    "PYOPENGL_PLATFORM",
    "WAYLAND_DISPLAY",
)
_TIMEOUT = 120


@dataclass(frozen=True)
class Probe:
    """What a backend did when it was tried.

    Attributes:
        backend: Which one.
        renderer: What OpenGL calls its renderer; empty if it does not work.
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


@contextlib.contextmanager
def without_graphics() -> Iterator[None]:
    """Import MuJoCo or dm_control in here, and no OpenGL library is loaded or missed.

    Both read MUJOCO_GL when they are imported, and fail if its library is not there.
    """
    wish = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disabled"
    try:
        yield
    finally:
        if wish is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = wish


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
        raise SetupError(f"MUJOCO_GL: {unknown_name('backend', wish, BACKENDS)}")
    return [wish]


def has_display() -> bool:
    """Whether there is a display that glfw could open a window on."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def find_backend(wish: str | None = None, *, fresh: bool = False) -> Probe:
    """The first backend that works.

    A good answer is kept in the user's cache folder; a bad one never is, so that a library
    counts as soon as it is installed.

    Args:
        wish: Value of MUJOCO_GL that the user has set, if any.
        fresh: Refuse the kept answer and ask anew.

    Raises:
        SetupError: If none works, saying why and what mends it.
    """
    names = candidates(wish)
    kept = _cache_file(names)
    if not fresh and kept is not None and (found := _read(kept)) is not None:
        return found
    probes = []
    for name in names:
        probes.append(probe(name))
        if probes[-1].works:
            if kept is not None:
                _keep(kept, probes[-1])
            return probes[-1]
    reasons = "; ".join(f"{each.backend}: {each.reason}" for each in probes)
    remedy = next((each.remedy for each in probes if each.remedy), "")
    raise SetupError(
        f"no OpenGL backend renders off-screen ({reasons})" + (f"; run: {remedy}" if remedy else "")
    )


def forget(wish: str | None = None) -> None:
    """Drop the kept answer, for instance because the backend failed since."""
    if (kept := _cache_file(candidates(wish))) is not None:
        with contextlib.suppress(OSError):
            kept.unlink(missing_ok=True)


def probe(name: str) -> Probe:
    """Try one backend in a child process."""
    if name == "glfw" and not has_display():
        return Probe(name, reason="no display (DISPLAY and WAYLAND_DISPLAY are not set)")
    try:
        done = subprocess.run(
            # -P: no module of the user's own folder is taken for one of the libraries.
            [sys.executable, "-P", str(Path(__file__).with_name("probe.py"))],
            env=environment(name),
            capture_output=True,
            text=True,
            check=False,
            timeout=_TIMEOUT,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        return Probe(name, reason=f"no answer within {_TIMEOUT} s")
    except OSError as error:
        return Probe(name, reason=f"{sys.executable} cannot be run: {error.strerror}")
    try:
        answer: Mapping[str, str] = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"code {done.returncode}"
        answer = {"error": f"the test program ended with {how} and no answer"}
    if "renderer" in answer:
        return Probe(name, renderer=answer["renderer"])
    backend = BACKENDS[name]
    if backend.library and not _loads(backend.library):
        return Probe(name, reason=f"{backend.library} is not installed", remedy=backend.remedy)
    return Probe(name, reason=answer["error"], remedy=backend.remedy)


def environment(name: str) -> dict[str, str]:
    """The environment of a process that renders with a backend."""
    own = {**os.environ, "MUJOCO_GL": name}
    # PyOpenGL's own setting would contradict MuJoCo's.
    own.pop("PYOPENGL_PLATFORM", None)
    return own


def _loads(library: str) -> bool:
    """Whether the system finds a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _cache_file(names: list[str]) -> Path | None:
    """Where the answer for these candidates is kept, if anywhere: one file for each set-up."""
    setup = [names, [os.environ.get(each) for each in _ENVIRONMENT]]
    setup += [sys.prefix, versions(("mujoco", "PyOpenGL"))]
    digest = hashlib.sha256(json.dumps(setup).encode()).hexdigest()[:16]
    folder = private_cache()
    return None if folder is None else folder / f"backend-{digest}.json"


def _read(path: Path) -> Probe | None:
    """A kept answer, if it is there and can be read."""
    try:
        answer = json.loads(path.read_text(encoding="utf-8"))
        found = Probe(BACKENDS[answer["backend"]].name, renderer=answer["renderer"] or "")
        return found if found.works else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _keep(path: Path, found: Probe) -> None:
    """Keep an answer; without a place for it, the next film asks again."""
    answer = {"backend": found.backend, "renderer": found.renderer}
    with contextlib.suppress(SetupError), written_aside(path) as part:
        part.write_text(json.dumps(answer), encoding="utf-8")
