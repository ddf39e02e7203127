"""Standard output that no command has to fear: its verdict does not depend on who reads it."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any

PROGRAM = "grosmc-mj"


class Output:
    """Standard output, of which nothing is expected once it has failed.

    A reader that has gone, such as ``head``, is no error; a full disk is told at the end.

    Attributes:
        lost: Why not everything was printed, apart from a reader that has gone; or None.
    """

    def __init__(self, stream: Any) -> None:
        self._stream, self._failed = stream, False
        self.lost: str | None = None

    @classmethod
    @contextlib.contextmanager
    def standard(cls) -> Iterator[Output]:
        """Have everything that is printed in this block go through one."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                # What the terminal's encoding lacks becomes a question mark.
                stream.reconfigure(errors="replace")
        output = cls(sys.stdout)
        with contextlib.redirect_stdout(output):
            yield output

    def write(self, text: str) -> int:
        """Write what can be written."""
        if not self._failed:
            with self._noticing():
                self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush what can be flushed."""
        if not self._failed:
            with self._noticing():
                self._stream.flush()

    def finish(self) -> None:
        """Flush; what is left after a failure goes nowhere, not to the interpreter's end."""
        self.flush()
        if self._failed:
            with contextlib.suppress(OSError, ValueError):
                null = os.open(os.devnull, os.O_WRONLY)
                os.dup2(null, self._stream.fileno())
                os.close(null)

    @contextlib.contextmanager
    def _noticing(self) -> Iterator[None]:
        """Notice a failure."""
        try:
            yield
        except BrokenPipeError:
            self._failed = True
        except (OSError, ValueError) as error:
            self._failed, self.lost = True, getattr(error, "strerror", None) or str(error)

    def __getattr__(self, name: str) -> Any:
        # isatty, encoding, fileno: as the stream has them.
        return getattr(self._stream, name)
