"""A part of some work, done by a worker: its report or its error, as a value that travels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from grosmc_mj.errors import GrosmcError, SetupError

# The work, by the number of a part: a module-level function or a `functools.partial` of one, which
# leaves its results in storage and returns a small report. It may be run again, even if a part of
# it was done, so that its results must not depend on that.
Work = Callable[[int], Any]


@dataclass(frozen=True)
class Outcome:
    """A report, or the error that took its place.

    An error is kept as its type and its message: an exception may hold an object that cannot be
    pickled, and libraries that carry exceptions log tracebacks.

    Attributes:
        report: Of the work; None after an error.
        error: Type of the error; None without one.
        message: Its message.
    """

    report: Any = None
    error: type[GrosmcError] | None = None
    message: str = ""

    def result(self) -> Any:
        """The report.

        Raises:
            GrosmcError: Of the type and with the message of the error.
        """
        if self.error is None:
            return self.report
        # Not by a call: some types take more arguments than a message.
        raise self.error.__new__(self.error, self.message)


def attempt(work: Work, index: int) -> Outcome:
    """Run a part; its error is data, an interrupt is not."""
    try:
        return Outcome(work(index))
    except GrosmcError as error:
        return Outcome(error=type(error), message=str(error))
    except Exception as error:
        return Outcome(error=SetupError, message=unexpected(error, index))


def unexpected(error: BaseException, index: int) -> str:
    """One line about an error that is not the package's own."""
    return f"shard {index} failed: {error_line(error)}"


def error_line(error: BaseException) -> str:
    """Type of an error and the first line of its message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[:1]])
