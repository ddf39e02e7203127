"""What became of a shard, as a value that travels between processes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grosmc_mj.campaign.runs.executors.interface import Work
from grosmc_mj.errors import GrosmcError, SetupError


@dataclass(frozen=True)
class ShardOutcome:
    """A report, or the error that took its place.

    An error is kept as its type and its message: an exception may hold what cannot be pickled,
    and a library that carries exceptions logs tracebacks on the way.

    Attributes:
        report: What the work returned; None after an error.
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
        # Not by a call: some types take more than a message. What they take is left behind.
        raise self.error.__new__(self.error, self.message)


def attempt(work: Work, index: int) -> ShardOutcome:
    """Run a shard; its error is data, an interrupt is not."""
    try:
        return ShardOutcome(work(index))
    except Exception as error:
        return failure(error, index)


def failure(error: Exception, index: int) -> ShardOutcome:
    """The outcome of an error: an error of ours as it is, any other in one line."""
    if isinstance(error, GrosmcError):
        return ShardOutcome(error=type(error), message=str(error))
    return ShardOutcome(error=SetupError, message=unexpected(error, index))


def unexpected(error: BaseException, index: int) -> str:
    """One line about an error that is not ours."""
    return f"shard {index} failed: {one_line(error)}"


def one_line(error: BaseException) -> str:
    """Type of an error and the last line of its message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[-1:]])
