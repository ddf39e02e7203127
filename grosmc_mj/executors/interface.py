"""What an executor is given and gives back; what became of a shard, as a value that travels."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from grosmc_mj.errors import GrosmcError, SetupError

# How often a shard is tried before the workers that die of it are no accident any more.
ATTEMPTS = 3

# Told in one line what happened to a worker, in the thread that iterates.
Notice = Callable[[str], None]


class Work(Protocol):
    """One shard of the whole, named by its index; picklable.

    A module-level function, or a `functools.partial` of one. It leaves its results in storage
    and returns only a small report. It may be run again, wholly or after a part of it, so what it
    leaves must not depend on that.
    """

    def __call__(self, index: int, /) -> Any:
        """Run the shard and return its report."""
        ...


@dataclass(frozen=True)
class Finished:
    """A shard that is done.

    Attributes:
        index: Which.
        report: What the work returned.
        attempts: How many workers were given it; more than 1 if some died.
    """

    index: int
    report: Any
    attempts: int


class Executor(Protocol):
    """Runs shards, in an order of its own."""

    @property
    def threads_per_worker(self) -> int:
        """Threads that the work may use, so that all workers together use each core once."""
        ...

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index once, and yield each as it finishes.

        Closing the iterator, an error and Ctrl-C stop the workers; shards under way are given up.

        Args:
            work: What to run.
            indices: On what; a range of any length is never unrolled.
            notice: Told of every worker that died.

        Yields:
            Each shard once, in the order in which they finish.

        Raises:
            GrosmcError: As the work raised it, with its type and message; other errors of the
                work are a SetupError that names the shard.
            SetupError: If a shard has cost its last attempt, or the workers cannot be reached.
        """
        ...


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
    except GrosmcError as error:
        return ShardOutcome(error=type(error), message=str(error))
    except Exception as error:
        return ShardOutcome(error=SetupError, message=unexpected(error, index))


def unexpected(error: BaseException, index: int) -> str:
    """One line about an error that is not ours."""
    return f"shard {index} failed: {one_line(error)}"


def one_line(error: BaseException) -> str:
    """Type of an error and the last line of its message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    return ": ".join([type(error).__name__, *lines[-1:]])
