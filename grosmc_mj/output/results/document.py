"""JSON documents: their origin, numbers that JSON does not have, and how they are written."""

from __future__ import annotations

import functools
import json
import math
import os
import platform
import shlex
import subprocess
from collections.abc import Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from grosmc_mj.ground.files import atomic_write
from grosmc_mj.ground.versions import versions

SCHEMA_VERSION = 1
# The command line that this process carries out; None in a library call.
_COMMAND: ContextVar[str | None] = ContextVar("command", default=None)


def carried_out(program: str, arguments: Sequence[str]) -> None:
    """Record the command that the documents written from now on come from.

    ``--resume`` is left out: a resumed command gives the same result.
    """
    words = [word for word in arguments if word != "--resume"]
    command = shlex.join([program, *words])
    # A path may have bytes that are no UTF-8, and no document can have them.
    _COMMAND.set(command.encode("utf-8", "backslashreplace").decode("utf-8"))


def origin(seed: int | None, schema_version: int = SCHEMA_VERSION) -> dict[str, Any]:
    """Return the fields of a document that say how to repeat it.

    Args:
        seed: Seed of the random numbers; None if there are none.
        schema_version: Version of this kind of document.
    """
    return {
        "schema_version": schema_version,
        "versions": versions(),
        "git_revision": git_revision(),
        "machine": machine_words(),
        "command": _COMMAND.get(),
        "seed": seed,
    }


def machine_words() -> str:
    """Return system, processor and number of cores of this machine."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"


# It starts a process.
@functools.cache
def git_revision() -> str | None:
    """Return the checkout's revision, with ``-dirty`` if it has changes; None outside a checkout.

    Cached: the first call, not a later one, finds the revision of the code that is running.
    """
    package = Path(__file__).resolve().parents[2]
    try:
        checkout = Path(_git(package, "rev-parse", "--show-toplevel")).resolve()
        if checkout != package.parent:
            return None
        return _git(package, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    """Return the output of git, a line."""
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def json_text(content: Any) -> str:
    """Write values as JSON, with null for infinities and NaN, which JSON does not have.

    The meaning of a null stands beside it: a note, a status, or a count of runs that ended early.
    """
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file, whole or not at all.

    Raises:
        SetupError: If it cannot be written.
    """
    text = json_text(content)
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def set_aside_other(path: Path, part: str, value: Any) -> Path | None:
    """Rename an older document whose part is not this one, before a new document replaces it.

    It becomes NAME.previous.json or, if there is one, NAME.previous2.json and so on. A document
    that cannot be read is renamed, too.

    Args:
        path: Path of the new document.
        part: Key of the part to compare, such as ``configuration``.
        value: The part of the new document.

    Returns:
        New path of the older document; None if there is none, or it has the same part.
    """
    if not path.is_file():
        return None
    try:
        older = json.loads(path.read_text(encoding="utf-8"))
        if older[part] == json.loads(json_text(value)):
            return None
    except (OSError, ValueError, KeyError, TypeError):
        # An unreadable document is renamed.
        pass

    aside = path.with_name(f"{path.stem}.previous{path.suffix}")
    number = 2
    while aside.exists():
        aside = path.with_name(f"{path.stem}.previous{number}{path.suffix}")
        number += 1
    path.replace(aside)
    return aside


def plain(value: Any) -> Any:
    """Return values that JSON has, with None for infinities and NaN."""
    if isinstance(value, BaseModel):
        value = value.model_dump()
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
