"""Where parts of some work are done: in this process, in worker processes, on a Dask cluster."""

from grosmc_mj.executors.make import EXECUTORS, executor_for, make_executor
from grosmc_mj.executors.outcome import Work
from grosmc_mj.executors.pools import Batch, Executor, Finished, Notice, Processes

__all__ = [
    "EXECUTORS",
    "Batch",
    "Executor",
    "Finished",
    "Notice",
    "Processes",
    "Work",
    "executor_for",
    "make_executor",
]
