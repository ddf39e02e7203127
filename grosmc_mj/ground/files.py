"""Files that are written whole or not at all, and the private cache folder."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import secrets
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from grosmc_mj.ground.errors import ArgumentError, SetupError, value_text

_CACHE_NAME = "grosmc_mj"
# Mode of a folder that only its owner may enter.
_PRIVATE = 0o700
# Bits of a mode that let other users change a folder.
_WRITABLE_BY_OTHERS = 0o022
# Errors of a full or broken disk; the system raises them without the name of a file.
_DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)


# Largest files that are read: a text or a model, and a log or a table [bytes].
LARGEST_TEXT = 256 << 20
LARGEST_TABLE = 4 << 30


def require_regular(path: Path, largest: int = LARGEST_TEXT) -> None:
    """Refuse a file that reading would not end with, or that does not fit into the memory.

    Where there is no file, nothing is refused: whoever reads it says so.

    Args:
        path: The file.
        largest: Its size at most [bytes].

    Raises:
        ArgumentError: If it is a folder, a pipe, a socket or a device, or too large.
    """
    try:
        status = path.stat()
    except OSError:
        return
    name = value_text(str(path), str)
    if not stat.S_ISREG(status.st_mode):
        raise ArgumentError(
            f"{name} is a folder, a pipe, a socket or a device: give a regular file"
        )
    if status.st_size > largest:
        raise ArgumentError(
            f"{name} has {status.st_size >> 20} MB: at most {largest >> 20} MB are read"
        )


def is_there(path: Path) -> bool:
    """Whether there is a file or folder; a name that none can have is not there."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def name_in_files(name: str) -> str:
    """Return a name as it stands in the names of files: letters, digits and ``_+-.``."""
    return re.sub(r"[^\w.+-]+", "_", name)


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path; rename it to ``path`` after the block, remove it after an error.

    The temporary file is new and its name is random, so no link that another user has put there
    is followed. Several processes may write the same file: the last one to end counts.
    A link at ``path`` is replaced; a folder, a device, a pipe or a socket there is not.

    Raises:
        SetupError: If the file cannot be written. Other errors of the block pass unchanged.
    """
    part = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.part{path.suffix}")
    opened = False
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            raise FileExistsError(errno.EEXIST, "is a folder, a device, a pipe or a socket")
        os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666))
        opened = True

        yield part
        part.replace(path)
    except OSError as error:
        if opened and not _is_from_writing(part, error):
            raise
        raise cannot_write(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def write_whole(path: Path, text: str) -> None:
    """Write a text to a file, whole or not at all; raises as ``atomic_write``."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")


def require_writable(*paths: Path) -> None:
    """Refuse paths where no file can be written, before the work that is to fill them.

    Folders are not made: wrong use, which is found later, leaves nothing behind.

    Raises:
        SetupError: If a folder cannot be made or written, or a path is no regular file.
    """
    for path in paths:
        require_folder(path.parent)
        try:
            if path.exists() and not path.is_file():
                raise FileExistsError(errno.EEXIST, "is a folder, a device, a pipe or a socket")
            if path.parent.is_dir():
                with tempfile.TemporaryFile(dir=path.parent):
                    pass
        except OSError as error:
            raise cannot_write(path, error) from error


def require_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made or written; it is not made.

    Raises:
        SetupError: If it is a file, lies below one, or may not be written.
    """
    # The folder itself or, before it is made, the one that it will lie in.
    for place in (folder, *folder.parents):
        try:
            mode = place.stat().st_mode
        except (FileNotFoundError, NotADirectoryError):
            continue
        except OSError as error:
            raise cannot_write(folder, error) from error
        if not stat.S_ISDIR(mode):
            raise SetupError(f"{place} is a file, and a folder is needed: name another one")
        if not os.access(place, os.W_OK | os.X_OK):
            raise cannot_write(folder, PermissionError(errno.EACCES, os.strerror(errno.EACCES)))
        return


def _is_from_writing(part: Path, error: OSError) -> bool:
    """True if an error of the block is about this file, and not about another one."""
    if error.filename is None:
        return error.errno in _DISK_ERRORS
    return str(error.filename) == str(part)


def cannot_write(path: Path, error: OSError) -> SetupError:
    """Return the error of a file that cannot be written."""
    return SetupError(
        f"cannot write {path}: {error.strerror or error}; free the disk or choose another place"
    )


def private_cache(base: str | None = None) -> Path | None:
    """Return the package's cache folder, which only this user may enter; None if impossible.

    Args:
        base: Folder that it lies in; by default ``XDG_CACHE_HOME`` or ``~/.cache``.

    Raises:
        SetupError: If it belongs to another user, is a link, or is writable by other users.
    """
    base = base or os.environ.get("XDG_CACHE_HOME")
    try:
        parent = Path(base) if base else Path.home() / ".cache"
        folder = parent / _CACHE_NAME
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)

        status = folder.lstat()
        mode = stat.S_IMODE(status.st_mode)
        is_own_folder = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
        if is_own_folder and not mode & _WRITABLE_BY_OTHERS:
            folder.chmod(_PRIVATE)
            return folder
    except (OSError, RuntimeError):
        # A user without a home, or a place that cannot be written: there is no cache.
        return None

    raise SetupError(
        f"{folder} must be a folder of your own with mode 700, since what lies there is executed: "
        f"its owner is user {status.st_uid} and its mode {mode:o}; remove it, or name another "
        "place with XDG_CACHE_HOME or NUMBA_CACHE_DIR"
    )
