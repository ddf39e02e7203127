"""In this process, one shard after another; each uses every core through `mujoco.batch`."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass

from loky import cpu_count

from grosmc_mj.errors import GrosmcError, SetupError
from grosmc_mj.executors.interface import Finished, Notice, Work, unexpected


@dataclass(frozen=True)
class Batch:
    """The executor of this process: nothing to configure, nobody who could die alone."""

    @property
    def threads_per_worker(self) -> int:
        """As many as there are cores for this process."""
        return cpu_count()

    def run(
        self, work: Work, indices: Sequence[int], notice: Notice
    ) -> Generator[Finished, None, None]:
        """Run the work on each index, in their order; see `Executor.run`."""
        for index in indices:
            try:
                report = work(index)
            except GrosmcError:
                raise
            except Exception as error:
                raise SetupError(unexpected(error, index)) from error
            yield Finished(index, report, attempts=1)
