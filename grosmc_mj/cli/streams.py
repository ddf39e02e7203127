"""Standard output whose failures change no verdict."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator
from typing import Any

PROGRAM = "grosmc-mj"


class Output:
    """Standard output that drops what is printed after a failure.

    A reader that has gone, such as ``head``, is no error; a full disk is reported at the end.

    Attributes:
        lost: Why some output could not be written, apart from a reader that has gone; or None.
    """

    def __init__(self, stream: Any) -> None:
        self.lost: str | None = None
        self._stream = stream
        self._failed = False

    @classmethod
    @contextlib.contextmanager
    def standard(cls) -> Iterator[Output]:
        """Redirect everything that is printed in this block through one output."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):
                # What the terminal's encoding lacks becomes a question mark.
                stream.reconfigure(errors="replace")

        output = cls(sys.stdout)
        with contextlib.redirect_stdout(output):
            yield output

    def write(self, text: str) -> int:
        """Write a text, unless the stream has failed.

        Returns:
            Length of the text, written or not.
        """
        if not self._failed:
            with self._failure_noted():
                self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream, unless it has failed."""
        if not self._failed:
            with self._failure_noted():
                self._stream.flush()

    def finish(self) -> None:
        """Flush the stream; one that has failed is put on the null device.

        Otherwise the interpreter would try once more to write at its exit, and fail.
        """
        self.flush()
        if not self._failed:
            return

        with contextlib.suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self._stream.fileno())
            os.close(null)

    @contextlib.contextmanager
    def _failure_noted(self) -> Iterator[None]:
        """Note a failure of what is done in this block."""
        try:
            yield
        except BrokenPipeError:
            self._failed = True
        except (OSError, ValueError) as error:
            self._failed = True
            self.lost = getattr(error, "strerror", None) or str(error)

    def __getattr__(self, name: str) -> Any:
        # The other attributes, such as isatty, encoding and fileno, are the stream's.
        return getattr(self._stream, name)
