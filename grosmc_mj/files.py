"""Files that are either whole or not there."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

from grosmc_mj.errors import SetupError


@contextlib.contextmanager
def written_aside(path: Path, aside: str = "") -> Iterator[Path]:
    """A path to write to, renamed to the real one at the end and removed if that is not reached.

    Args:
        path: The real one.
        aside: Name of the other, where several may write the same file at once.

    Raises:
        SetupError: If it cannot be written.
    """
    part = path.with_name(aside or f".{path.stem}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        part.touch()
        yield part
        part.replace(path)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def cannot_write(path: Path, error: OSError) -> SetupError:
    """One line about a file that cannot be written."""
    return SetupError(
        f"cannot write {path}: {error.strerror}; free the disk or choose another place"
    )
