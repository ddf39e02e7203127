"""JSON documents: versions, infinities, schema, written whole or not at all."""

from __future__ import annotations

import functools
import json
import platform
import subprocess
from pathlib import Path
from typing import Any

import grosmc_mj
from grosmc_mj.files import written_aside
from grosmc_mj.versions import installed

SCHEMA_VERSION = 1


_PACKAGES = ("mujoco", "dm_control", "numpy", "scipy", "control", "numba", "matplotlib")


def origin(seed: int | None) -> dict[str, Any]:
    """What a document needs to be understood and repeated; no seed where nothing is random."""
    return {
        "schema_version": SCHEMA_VERSION,
        "versions": versions(),
        "git_revision": git_revision(),
        "seed": seed,
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the numbers depend on."""
    return {"python": platform.python_version(), **installed(_PACKAGES)}


@functools.cache
def git_revision() -> str | None:
    """The checkout's revision, with ``-dirty`` if it has changes; None outside a checkout.

    As it was when this process first asked: that is the code that it runs.
    """
    folder = Path(__file__).parent
    try:
        top = _git(folder, "rev-parse", "--show-toplevel")
        if Path(top).resolve() != Path(grosmc_mj.__file__).resolve().parents[1]:
            return None
        return _git(folder, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    """One line that git answers."""
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def write_json(path: Path, content: Any) -> None:
    """Write JSON aside and rename it, so that a file is either whole or not there.

    Raises:
        SetupError: If it cannot be written.
    """
    with written_aside(path) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
