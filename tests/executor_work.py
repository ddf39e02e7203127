"""Work that the tests give to executors; a module of its own, so that workers can import it."""

import os
import signal
import threading
import time
from pathlib import Path

from grosmc_mj.ground.errors import GainError, SetupError


def square(index: int) -> int:
    return index * index


def die_once(folder: Path, index: int) -> int:
    """Kill the worker the first time that shard 3 is run."""
    marker = folder / "killed"
    if index == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return index * index


def exit_always(index: int) -> int:
    os._exit(7)


def refuse(index: int) -> int:
    raise GainError(f"G B is singular in shard {index}")


def divide(index: int) -> float:
    return 1 / index


def leave_pid(folder: Path, seconds: float, index: int) -> int:
    """Leave a file named by shard and process, and take some time."""
    (folder / f"{index}.{os.getpid()}").touch()
    time.sleep(seconds)
    return index * index


def pid_and_threads(index: int) -> tuple[int, str]:
    return os.getpid(), os.environ.get("OMP_NUM_THREADS", "")


def unpicklable(index: int) -> object:
    return threading.Lock()


# Work, a shard of it, and the type and message of the error that it raises in every executor.
REFUSALS = [
    (refuse, 2, GainError, r"^G B is singular in shard 2$"),
    (divide, 0, SetupError, r"^shard 0 failed: ZeroDivisionError: division by zero$"),
]
