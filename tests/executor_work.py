"""Work that the tests give to executors; a module of its own, so that workers can import it."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

from grosmc_mj.errors import GainError


def square(index: int) -> int:
    return index * index


def die_once(folder: Path, index: int) -> int:
    """Shard 3 kills its worker the first time."""
    marker = folder / "killed"
    if index == 3 and not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return index * index


def die_always(index: int) -> int:
    if index == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return index


def exit_always(index: int) -> int:
    os._exit(7)


def refuse(index: int) -> int:
    raise GainError(f"G B is singular in shard {index}")


def divide(index: int) -> float:
    return 1 / index


def leave_pid(folder: Path, seconds: float, index: int) -> int:
    """Says which process has begun which shard, and takes its time."""
    (folder / f"{index}.{os.getpid()}").touch()
    time.sleep(seconds)
    return index * index


def pid_and_threads(index: int) -> tuple[int, str]:
    return os.getpid(), os.environ["OMP_NUM_THREADS"]


def unpicklable(index: int) -> object:
    return threading.Lock()


def safe_path(index: int) -> tuple[bool, str]:
    return sys.flags.safe_path, os.environ["OMP_NUM_THREADS"]
