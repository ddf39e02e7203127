"""This package's version, and those of the packages that its numbers depend on."""

from __future__ import annotations

import functools
import hashlib
import platform
from collections.abc import Iterable
from pathlib import Path

__version__ = "0.1.0"

# Packages whose version may change a bit of a run.
DECISIVE = ("grosmc_mj", "mujoco", "numba", "numpy", "scipy")
_REPORTED = (
    "python", "grosmc_mj", "mujoco", "dm_control", "numpy", "scipy", "control", "numba",
    "matplotlib",
)  # fmt: skip


def versions(of: Iterable[str] = _REPORTED) -> dict[str, str]:
    """Versions of Python, this package and others; ``not installed`` where there is none.

    Args:
        of: Names of packages, or ``python``; by default what every document records.
    """
    return {name: _version(name) for name in of}


@functools.cache
def source_digest() -> str:
    """SHA-256 of this package's own Python, which a checkout changes without another version."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


@functools.cache
def _version(name: str) -> str:
    """The version of one."""
    # Here, for it loads slowly, and the number of this package is asked for first.
    from importlib.metadata import PackageNotFoundError, version

    own = {"python": platform.python_version(), "grosmc_mj": __version__}
    try:
        return own.get(name) or version(name)
    except PackageNotFoundError:
        return "not installed"
