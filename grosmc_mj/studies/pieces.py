"""Store of finished pieces of long work: cells of studies and parts of campaigns."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Generic, Protocol, TypeVar

from pydantic import BaseModel

from grosmc_mj.ground.errors import SetupError
from grosmc_mj.ground.files import atomic_write, cannot_write

AnyContent = TypeVar("AnyContent")
AnyRow = TypeVar("AnyRow", bound=BaseModel)

# Key of the checksum among the notes of a stored piece.
CHECKSUM = "sha256"
# Errors of reading a file that is not as it was written.
_UNREADABLE = (OSError, ValueError, TypeError, LookupError, RecursionError)
# Errors of a file system that has no locks.
_NO_LOCKS = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK)


@dataclass(frozen=True)
class Piece:
    """Piece of long work, which is done once.

    Attributes:
        name: Name of its file, without suffix.
        notes: Plain values that bind its content to all that it depends on: they are stored with
            it, and compared when it is read.
        words: The piece, in the error of a file that is another one.
    """

    name: str
    notes: Mapping[str, Any]
    words: str

    @classmethod
    def named_by(cls, depends_on: Any, words: str) -> Piece:
        """Return a piece whose file is named by a hash of all that it depends on, plain values."""
        digest = hashlib.sha256(json.dumps(depends_on).encode()).hexdigest()
        return cls(digest[:32], {"depends_on": digest}, words)


class Form(Protocol[AnyContent]):
    """Format of the files of pieces.

    Attributes:
        suffix: Their suffix.
    """

    suffix: str

    def save(self, file: BinaryIO, content: AnyContent, notes: Mapping[str, Any]) -> None:
        """Write a content with its notes and a checksum of both."""
        ...

    def load(self, path: Path) -> tuple[AnyContent, dict[str, Any]]:
        """Return a content and its notes.

        Raises:
            ValueError: If the checksum is another one.
        """
        ...


@dataclass(frozen=True)
class Rows(Generic[AnyRow]):
    """Rows of a study as JSON.

    Attributes:
        kind: Class of the rows.
    """

    kind: type[AnyRow]
    suffix = ".json"

    def save(self, file: BinaryIO, content: AnyRow, notes: Mapping[str, Any]) -> None:
        """Write a row with its notes and a checksum of both."""
        row = content.model_dump()
        stored = {**notes, CHECKSUM: _checksum(row, notes), "row": row}
        # Not by `json_text`, which writes infinite numbers as null.
        file.write(json.dumps(stored).encode())

    def load(self, path: Path) -> tuple[AnyRow, dict[str, Any]]:
        """Return a row and its notes; raises ValueError if the checksum is another one."""
        notes = json.loads(path.read_text(encoding="utf-8"))
        row = notes.pop("row")
        if notes.pop(CHECKSUM) != _checksum(row, notes):
            raise ValueError("another checksum")
        return self.kind.model_validate(row), notes


def _checksum(row: Any, notes: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps([notes, row]).encode()).hexdigest()


@dataclass(frozen=True)
class PieceStore(Generic[AnyContent]):
    """Folder of finished pieces; each is there whole, or not at all.

    Attributes:
        folder: Path of the folder.
        form: Format of its files.
    """

    folder: Path
    form: Form[AnyContent]

    def file(self, piece: Piece) -> Path:
        """Return the file of a piece."""
        return self.folder / f"{piece.name}{self.form.suffix}"

    def read(self, piece: Piece) -> AnyContent | None:
        """Return the content of a piece, verified; None if it is not there.

        Raises:
            SetupError: If its file is damaged, or depends on something else.
        """
        file = self.file(piece)
        if not file.exists():
            return None
        with contextlib.suppress(*_UNREADABLE):
            # A pipe would never end.
            if file.is_file():
                content, notes = self.form.load(file)
                if notes == piece.notes:
                    return content
        raise SetupError(
            f"{file} is damaged, or is not {piece.words}: remove it, and --resume runs it again"
        )

    def write(self, piece: Piece, content: AnyContent) -> None:
        """Write the content of a piece aside, and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        # A worker that was given up may still be at the same piece: each has a file of its own.
        with atomic_write(self.file(piece)) as part, part.open("wb") as file:
            self.form.save(file, content, piece.notes)
            file.flush()
            os.fsync(file.fileno())

    def remove_unfinished(self) -> None:
        """Remove files of pieces that were never finished; nobody else may add pieces."""
        for unfinished in self.folder.glob(f".*.part{self.form.suffix}"):
            with contextlib.suppress(OSError):
                unfinished.unlink()


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Keep other processes from adding pieces to a folder; it ends with the process, too.

    Raises:
        SetupError: If another process holds it, or it cannot be written.
    """
    path = folder / ".lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = path.open("a+b", buffering=0)
    except OSError as error:
        raise cannot_write(path, error) from error

    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SetupError(
                f"{folder}: another grosmc-mj adds to it: wait for its end, or take another --out"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise cannot_write(path, error) from error
        yield
