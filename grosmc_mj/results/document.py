"""JSON documents: where they come from, what stands for infinity, written whole or not at all."""

from __future__ import annotations

import functools
import itertools
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

from grosmc_mj.files import written_aside
from grosmc_mj.versions import versions

SCHEMA_VERSION = 1
# What this process carries out, if it is a command of the command line.
_COMMAND: ContextVar[str | None] = ContextVar("command", default=None)


def carried_out(program: str, arguments: Sequence[str]) -> None:
    """Note the command that the documents written from here on come from.

    Whether it went on with what was there makes no difference to a result.
    """
    _COMMAND.set(shlex.join([program, *(word for word in arguments if word != "--resume")]))


def origin(seed: int | None, schema_version: int = SCHEMA_VERSION) -> dict[str, Any]:
    """What a document needs to be understood and repeated; no seed where nothing is random.

    Args:
        seed: Of what is random.
        schema_version: Of this kind of document.
    """
    return {
        "schema_version": schema_version,
        "versions": versions(),
        "git_revision": git_revision(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "command": _COMMAND.get(),
        "seed": seed,
    }


@functools.cache
def git_revision() -> str | None:
    """The checkout's revision, with ``-dirty`` if it has changes; None outside a checkout.

    As it was when this process first asked: that is the code that it runs.
    """
    package = Path(__file__).resolve().parents[1]
    try:
        if Path(_git(package, "rev-parse", "--show-toplevel")).resolve() != package.parent:
            return None
        return _git(package, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    """One line that git answers."""
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def json_text(content: Any) -> str:
    """Values as JSON, which has neither infinities nor NaN: null stands for them.

    What a null means stands beside it: a note, a status, or a count of runs that ended early.
    """
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def write_json(path: Path, content: Any) -> None:
    """Write JSON aside and rename it, so that a file is either whole or not there.

    Raises:
        SetupError: If it cannot be written.
    """
    text = json_text(content)
    with written_aside(path) as part:
        part.write_text(text, encoding="utf-8")


def keep_other(path: Path, content: Mapping[str, Any], part: str) -> Path | None:
    """Put a document with another ``part`` aside before it is replaced.

    It becomes NAME.previous.json or, if there is one, NAME.previous2.json and so on. What cannot be
    read is another one, too.

    Args:
        path: Where the new document will be.
        content: The new document.
        part: Key of what tells one from another, such as ``configuration``.

    Returns:
        Where the older one is now; None if there is none, or it has the same part.
    """
    if not path.is_file():
        return None
    try:
        older = json.loads(path.read_text(encoding="utf-8"))
        same = older[part] == json.loads(json_text(content[part]))
    except (OSError, ValueError, KeyError, TypeError):
        same = False
    if same:
        return None
    ends = ("" if number == 1 else str(number) for number in itertools.count(1))
    names = (path.with_name(f"{path.stem}.previous{end}{path.suffix}") for end in ends)
    aside = next(name for name in names if not name.exists())
    path.replace(aside)
    return aside


def plain(value: Any) -> Any:
    """Values that JSON has: null stands for infinities and NaN."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
