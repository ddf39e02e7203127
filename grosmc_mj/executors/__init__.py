"""Where the shards of a campaign are run: in this process, in worker processes, on a cluster."""

from grosmc_mj.executors.interface import Executor, Finished, Notice, Work
from grosmc_mj.executors.make import EXECUTORS, executor_for, make_executor

__all__ = ["EXECUTORS", "Executor", "Finished", "Notice", "Work", "executor_for", "make_executor"]
