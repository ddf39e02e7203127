"""Worker processes that end with this process, and leave Ctrl-C to it.

They do not import modules from the working folder.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import os
import resource
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from loky.backend import resource_tracker as loky_resource_tracker
from loky.process_executor import ProcessPoolExecutor

# Variables of the interpreters that are started.
_ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",
    # If this process is killed, loky's resource tracker cleans up, and warns that it had to.
    "PYTHONWARNINGS": "ignore:resource_tracker",
}

# loky restarts a worker that has grown by more than this [bytes]. A worker of claims keeps the
# runs that several of them share, which is not a leak.
_MEMORY = {"LOKY_MAX_MEMORY_LEAK_SIZE": "2e9"}


def worker_pool(
    workers: int,
    environment: Mapping[str, str],
    start: Callable[..., None] | None = None,
    *arguments: Any,
) -> ProcessPoolExecutor:
    """Return a pool of new interpreters, which end when this process does.

    The first task starts them: submit it within ``shielded_from_interrupts``.

    Args:
        workers: Number of processes.
        environment: Variables of their environment.
        start: Function that each of them calls first.
        arguments: Arguments of ``start``.
    """
    # The pool starts loky's resource tracker, which must not receive Ctrl-C.
    with shielded_from_interrupts():
        return ProcessPoolExecutor(
            workers,
            initializer=_begin,
            initargs=(os.getpid(), start, arguments),
            env={**_MEMORY, **environment},
        )


def _begin(parent: int, start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """Prepare a worker: let it end within about a second of its parent, and call ``start``."""
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with(parent: int) -> None:
    """Wait until the parent has ended, then end this process."""
    waiting = threading.Event()
    while os.getppid() == parent:
        waiting.wait(1.0)
    os._exit(1)


@contextlib.contextmanager
def shielded_from_interrupts() -> Iterator[None]:
    """Start processes in the block that Ctrl-C does not reach; this one receives it afterwards.

    The processes do not import a ``json.py`` of the working folder in place of ``json``.

    A process inherits the blocked signal, so it prints no traceback of its own while this one
    ends it. Blocking alone would not protect the block here: threads of the numerical libraries
    receive the signal too, and Python then interrupts the main thread between two instructions.
    """
    with contextlib.ExitStack() as undo:
        for name, value in _ENVIRONMENT.items():
            undo.callback(_set_variable, name, os.environ.get(name))
            _set_variable(name, value)

        # The first process would start these trackers, and their start unblocks the signal.
        resource_tracker.ensure_running()
        loky_resource_tracker.ensure_running()

        interrupts: list[int] = []
        handler = _interrupt_handler()
        if handler is not None:
            signal.signal(signal.SIGINT, lambda number, frame: interrupts.append(number))
            undo.callback(signal.signal, signal.SIGINT, handler)

        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        undo.callback(signal.pthread_sigmask, signal.SIG_SETMASK, blocked)
        yield

    if interrupts:
        signal.raise_signal(signal.SIGINT)


def _interrupt_handler() -> Any:
    """Return the handler of Ctrl-C if this thread may replace it, else None.

    Only the main thread may. A handler that C code has installed is None, too: it could not be
    restored.
    """
    if threading.current_thread() is not threading.main_thread():
        return None
    return signal.getsignal(signal.SIGINT)


def _set_variable(name: str, value: str | None) -> None:
    """Set an environment variable; None removes it."""
    if value is None:
        os.environ.pop(name, None)
    else:
        os.environ[name] = value


def call_in_child(function: Callable[..., Any], *arguments: Any, memory: int, library: str) -> Any:
    """Call a function in a new interpreter, whose death or hunger does not harm this one.

    Args:
        function: Function of a module.
        arguments: Its arguments; they and the result are pickled.
        memory: Most memory that the process takes beside its modules [bytes].
        library: Module that the function imports; how much memory it takes depends on the machine.

    Raises:
        BrokenExecutor: If the process dies.
        MemoryError: If it needs more memory.
    """
    modules = (function.__module__, library)
    pool = worker_pool(1, {}, _limit_memory, memory, modules)
    try:
        with shielded_from_interrupts():
            future = pool.submit(function, *arguments)
        return future.result()
    finally:
        pool.shutdown(kill_workers=True)


def _limit_memory(memory: int, modules: tuple[str, ...]) -> None:
    """Limit the memory of this process beside these modules [bytes]; let it die in silence."""
    faulthandler.disable()
    for module in modules:
        importlib.import_module(module)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * resource.getpagesize() + memory
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
