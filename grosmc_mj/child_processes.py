"""Worker processes that neither outlive this one nor answer Ctrl-C in its place.

Nor do they import from the folder that the user happens to be in.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Iterator
from multiprocessing import resource_tracker

from loky.backend import resource_tracker as loky_resource_tracker

_SAFE_PATH = "PYTHONSAFEPATH"


@contextlib.contextmanager
def interrupts_held() -> Iterator[None]:
    """Start processes that Ctrl-C in the terminal does not reach; ours arrives afterwards.

    A ``json.py`` in the working folder is not what they import as ``json``.

    A process inherits the blocked signal, so that it cannot print a traceback of its own while
    this one ends it. Blocking alone would not hold ours back: threads of the numerical libraries
    take the signal too, and Python then interrupts the main thread between any two instructions.
    """
    with _safe_path():
        # These are started with the first process, and unblock the signal when they are.
        resource_tracker.ensure_running()
        loky_resource_tracker.ensure_running()
        with _sigint_held():
            yield


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Have interpreters that are started in this block leave the working folder alone."""
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before


@contextlib.contextmanager
def _sigint_held() -> Iterator[None]:
    """Have SIGINT arrive at the end of the block, if it was sent in it."""
    held: list[int] = []
    in_main_thread = threading.current_thread() is threading.main_thread()
    # A handler that C code has installed reads as None and could not be put back.
    handler = signal.getsignal(signal.SIGINT) if in_main_thread else None
    if handler is not None:
        signal.signal(signal.SIGINT, lambda number, frame: held.append(number))
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if handler is not None:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    if held:
        signal.raise_signal(signal.SIGINT)


def end_with(parent: int) -> None:
    """Called in a worker process: end it within a second or so of its parent, whatever it does.

    Args:
        parent: Process id of the parent.
    """
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    """End this process once its parent has gone."""
    waiting = threading.Event()
    while os.getppid() == parent:
        waiting.wait(1.0)
    os._exit(1)
