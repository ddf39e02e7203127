"""Files that are either whole or not there, and a folder that nobody else can write to."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

from grosmc_mj.errors import SetupError

_OWN = "grosmc_mj"
# What only its owner may enter, and what lets others change it.
_PRIVATE, _WRITABLE_BY_OTHERS = 0o700, 0o022
# What a write fails with that does not name its file.
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


@contextlib.contextmanager
def written_aside(path: Path) -> Iterator[Path]:
    """A path to write to, renamed to the real one at the end and removed if that is not reached.

    Its name cannot be foretold and it is a new file: no link that somebody has put there is
    followed, and several processes may write the same file, of which the last one to end counts.
    A link at the real path is replaced; a device, a pipe or a socket there is not.

    Raises:
        SetupError: If it cannot be written. Other errors of the block pass as they are.
    """
    opened = False
    part = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "is a folder, a device, a pipe or a socket")
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666))
        opened = True
        yield part
        part.replace(path)
    except OSError as error:
        own = error.errno in _DISK if error.filename is None else str(error.filename) == str(part)
        if opened and not own:
            raise
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def cannot_write(path: Path, error: OSError) -> SetupError:
    """One line about a file that cannot be written."""
    return SetupError(
        f"cannot write {path}: {error.strerror or error}; free the disk or choose another place"
    )


def private_cache(base: str | None = None) -> Path | None:
    """The package's own cache, which only this user may enter; None if there can be none.

    Args:
        base: Where it lies; by default in ``XDG_CACHE_HOME`` or ``~/.cache``.

    Raises:
        SetupError: If it is somebody else's, a link, or one that others could have written to.
    """
    base = base or os.environ.get("XDG_CACHE_HOME")
    try:
        folder = (Path(base) if base else Path.home() / ".cache") / _OWN
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
        status = folder.lstat()
        mode = stat.S_IMODE(status.st_mode)
        own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
        if own and not mode & _WRITABLE_BY_OTHERS:
            folder.chmod(_PRIVATE)
            return folder
    except (OSError, RuntimeError):
        # A user without a home, or a place that cannot be written: nothing is kept.
        return None
    raise SetupError(
        f"{folder} must be a folder of your own with mode 700, since what lies there is executed: "
        f"its owner is user {status.st_uid} and its mode {mode:o}; remove it, or name another "
        "place with XDG_CACHE_HOME or NUMBA_CACHE_DIR"
    )
