"""Worker processes that neither outlive this one nor answer Ctrl-C in its place.

Nor do they import from the folder that the user happens to be in.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import resource_tracker
from typing import Any

from loky.backend import resource_tracker as loky_resource_tracker
from loky.process_executor import ProcessPoolExecutor

# Of the interpreters that are started. When this process is killed there is nobody left who could
# clean up, and no user wants to read that loky's resource tracker does.
_ENVIRONMENT = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": "ignore:resource_tracker"}

# loky starts a worker again that has grown by more than this [bytes]. A worker of claims keeps the
# runs that several of them share: that is no leak.
_KEPT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "2e9"}


def worker_pool(
    workers: int,
    environment: Mapping[str, str],
    start: Callable[..., None] | None = None,
    *arguments: Any,
) -> ProcessPoolExecutor:
    """A pool of fresh interpreters, which end when this process does.

    Its first task starts them: hand it in within ``interrupts_held``.

    Args:
        workers: How many processes.
        environment: Variables that they get.
        start: Called first in each of them.
        arguments: Its arguments.
    """
    with interrupts_held():  # for loky's resource tracker, which it starts first
        return ProcessPoolExecutor(
            workers,
            initializer=_begin,
            initargs=(os.getpid(), start, arguments),
            env={**_KEPT, **environment},
        )


def _begin(parent: int, start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """In a worker: end within a second or so of the parent, and get ready."""
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with(parent: int) -> None:
    """End this process once its parent has gone."""
    waiting = threading.Event()
    while os.getppid() == parent:
        waiting.wait(1.0)
    os._exit(1)


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes that Ctrl-C in the terminal does not reach; ours arrives afterwards.

    A ``json.py`` in the working folder is not what they import as ``json``.

    A process inherits the blocked signal, so that it cannot print a traceback of its own while
    this one ends it. Blocking alone would not hold ours back: threads of the numerical libraries
    take the signal too, and Python then interrupts the main thread between any two instructions.
    """
    held: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    # A handler that C code has installed reads as None and could not be put back.
    handler = signal.getsignal(signal.SIGINT) if in_main_thread else None
    with contextlib.ExitStack() as undo:
        for name, value in _ENVIRONMENT.items():
            undo.callback(_set_variable, name, os.environ.get(name))
            _set_variable(name, value)
        # These are started with the first process, and unblock the signal when they are.
        resource_tracker.ensure_running()
        loky_resource_tracker.ensure_running()
        if handler is not None:
            signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
            undo.callback(signal.signal, signal.SIGINT, handler)
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        undo.callback(signal.pthread_sigmask, signal.SIG_SETMASK, blocked)
        yield
    if held:
        signal.raise_signal(signal.SIGINT)


def _set_variable(name: str, value: str | None) -> None:
    """Set an environment variable, or take it away."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value
