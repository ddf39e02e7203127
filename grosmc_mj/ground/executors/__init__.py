"""Executors run parts of some work: in this process, in worker processes, on a Dask cluster."""

from importlib.util import find_spec
from typing import Annotated

from loky import cpu_count

from grosmc_mj.ground.errors import ArgumentError, SetupError
from grosmc_mj.ground.executors.pools import Executor, Finished, InProcess, Notice, Processes, Work
from grosmc_mj.ground.fields import Known, Range, checked_call

__all__ = [
    "EXECUTORS",
    "Executor",
    "Finished",
    "InProcess",
    "Notice",
    "Processes",
    "Work",
    "executor_for",
    "make_executor",
]

EXECUTORS = ("batch", "processes", "dask")


def executor_for(parts: int) -> Executor:
    """Return the executor for so many parts: this process for one, processes for several."""
    if parts == 1:
        return InProcess()
    return Processes(cpu_count())


@checked_call
def make_executor(
    name: Annotated[str, Known("executor", EXECUTORS)],
    *,
    workers: Annotated[int, Range(1, 1024, whole=True)] | None = None,
    scheduler: str | None = None,
) -> Executor:
    """Return the executor of a name.

    Args:
        name: `batch`: this process, on all cores. `processes`: spawned workers. `dask`: the
            workers of a Dask scheduler, or of a cluster on this machine.
        workers: Number of processes, for `processes` and for `dask` without a scheduler; None for
            one a core.
        scheduler: Address of a running Dask scheduler, for instance `tcp://10.0.0.1:8786`, or the
            file that `dask scheduler --scheduler-file` writes.

    Raises:
        ArgumentError: If there is no such executor, or it does not take one of the arguments.
        SetupError: If `dask` is not installed.
    """
    if scheduler is not None and name != "dask":
        raise ArgumentError(f"executor {name!r} takes no scheduler; only 'dask' does")
    if name == "batch":
        if workers is not None:
            raise ArgumentError("executor 'batch' is one process on all cores: leave workers out")
        return InProcess()
    if scheduler is not None and workers is not None:
        raise ArgumentError("a scheduler has workers of its own: leave workers out")

    count = workers or cpu_count()
    if name == "processes":
        return Processes(count)

    if find_spec("distributed") is None:
        raise SetupError("executor 'dask' needs Dask: pip install 'grosmc_mj[dask]'")
    # Imported here because Dask is optional and loads slowly.
    from grosmc_mj.ground.executors.dask_cluster import DaskWorkers

    return DaskWorkers(count, scheduler)
