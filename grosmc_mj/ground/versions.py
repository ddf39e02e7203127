"""Versions of this package and of the packages that its numbers depend on."""

from __future__ import annotations

import functools
import hashlib
import platform
from collections.abc import Iterable
from pathlib import Path

__version__ = "0.1.0"

# Packages whose version may change a bit of a run.
DECISIVE = ("grosmc_mj", "mujoco", "numba", "numpy", "scipy")
# Packages whose version every document records.
_REPORTED = (
    "python",
    "grosmc_mj",
    "mujoco",
    "dm_control",
    "numpy",
    "scipy",
    "control",
    "numba",
    "matplotlib",
)


def versions(of: Iterable[str] = _REPORTED) -> dict[str, str]:
    """Return versions by name; ``not installed`` for a package that is missing.

    Args:
        of: Names of packages, or ``python``; by default those that every document records.
    """
    return {name: _version(name) for name in of}


# It reads every file of the package.
@functools.cache
def source_digest() -> str:
    """Return the SHA-256 of this package's source, which a checkout changes between versions.

    Cached: it reads every file of the package.
    """
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


@functools.cache
def _version(name: str) -> str:
    """Return the version of one package; cached, since it reads the package's metadata."""
    if name == "python":
        return platform.python_version()
    if name == "grosmc_mj":
        return __version__

    # Imported here because it loads slowly.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
