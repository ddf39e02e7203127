"""The program: from its start to its exit code, whatever happens in between.

Nothing is imported here that takes long, so that Ctrl-C and errors of imports are answered too.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.cli.exit_codes import DONE, INTERRUPTED, WRONG
from grosmc_mj.cli.output import PROGRAM, Output
from grosmc_mj.errors import NEXT, GrosmcError, ImplausibleWarning, one_line, shown

_DEBUG = "--debug"
# Characters of the one line; a message may list valid names, or have somebody's text in it.
_LONGEST = 1000


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exit codes: 0 done and kept, 1 a verdict that something is not kept, 2 anything else that is
    wrong, 130 interrupted by Ctrl-C or SIGTERM. A reader of the output that has gone changes none
    of them.
    """
    if arguments is None:
        _settle()
    _open_closed_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = _DEBUG in words
    words = [word for word in words if word != _DEBUG]
    with Output.standard() as output:
        with _quiet(debug or arguments is not None), _terminable():
            code = _code(words, debug)
        output.finish()
    if output.lost is not None:
        code = _complain(f"standard output: {output.lost}")
    sys.exit(code)


def _code(arguments: Sequence[str], debug: bool) -> int:
    """The exit code of a command, all of whose errors are one line."""
    try:
        from grosmc_mj.cli.program import execute

        return execute(arguments)
    except SystemExit as stop:  # --help has been printed
        return int(stop.code or DONE)
    except KeyboardInterrupt as stop:
        _complain(str(stop) or "interrupted; run the same command again to start over")
        return INTERRUPTED
    except GrosmcError as error:
        _trace(debug)
        return _complain(str(error))
    except OSError as error:
        _trace(debug)
        return _complain(f"{shown(error.filename or 'output', str)}: {error.strerror or error}")
    # A defect of ours: one line too, for whoever runs this in a script.
    except Exception as error:
        _trace(debug)
        message = f"unforeseen {type(error).__name__}: {shown(error, str)}"
        return _complain(message if debug else f"{message}; {_DEBUG} shows where")


def _complain(message: str) -> int:
    """Say in one line what was wrong, or in one line a mistake."""
    lines = [one_line(line) for line in message.split(NEXT)]
    text = NEXT.join(f"{x[: _LONGEST - 3]}..." if len(x) > _LONGEST else x for x in lines)
    # Whoever closed standard error does not want to know.
    with contextlib.suppress(OSError, ValueError):
        print(f"{PROGRAM}: {text}", file=sys.stderr, flush=True)
    return WRONG


def _trace(debug: bool) -> None:
    """Print where an error came from, if that is asked for."""
    if debug:
        import traceback

        traceback.print_exc()


def _settle() -> None:
    """Have this process spend little on what a short program of small matrices has no use for.

    What imports make lives to the end: Python looks through it less often, and not once more at
    the exit. Threads of a BLAS cost more than matrices of ten rows could gain by them.
    """
    gc.set_threshold(100_000, 50, 100)
    atexit.register(gc.freeze)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@contextlib.contextmanager
def _quiet(loud: bool) -> Iterator[None]:
    """Keep what libraries warn of from coming between our lines; our own warnings are lines."""
    with warnings.catch_warnings():
        if not loud and not sys.warnoptions:
            logging.disable(logging.WARNING)
            warnings.simplefilter("ignore")
        warnings.simplefilter("always", ImplausibleWarning)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any) -> None:
            """Ours in a line, those of others as Python shows them."""
            if issubclass(category, ImplausibleWarning):
                _complain(str(message))
            else:
                others(message, category, *where)

        warnings.showwarning = show
        yield


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """End at SIGTERM, which ``timeout`` and batch systems send, as at Ctrl-C."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)


def _open_closed_streams() -> None:
    """Give standard streams that were closed to the null device.

    Otherwise the next file that is opened takes their number and gets what is printed, and what
    is for standard error is printed on standard output.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115  for as long as we run
