"""Entry point of the program: every error becomes one line and an exit code.

Nothing is imported here that takes long, so that Ctrl-C and errors of imports are answered too.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import logging
import os
import shutil
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.cli.exit_codes import INTERRUPTED, WRONG
from grosmc_mj.cli.screen import AGAIN
from grosmc_mj.cli.streams import PROGRAM, Output
from grosmc_mj.ground.errors import (
    MISTAKE_SEPARATOR,
    GrosmcError,
    ImplausibleWarning,
    one_line,
    value_text,
)

_DEBUG = "--debug"
# Characters of the one line; a message may list valid names, or have somebody's text in it.
_LONGEST = 1000
# Columns that help is written for, at least.
_NARROWEST = 40


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Exit codes: 0 done and kept, 1 a verdict that something is not kept, 2 anything else that is
    wrong, 130 interrupted by Ctrl-C or SIGTERM. A reader of the output that has gone changes none
    of them.
    """
    is_program = arguments is None
    if arguments is None:
        arguments = sys.argv[1:]
    if is_program:
        _tune_process()
    _open_closed_streams()

    debug = _DEBUG in arguments
    words = [word for word in arguments if word != _DEBUG]
    with Output.standard() as output:
        with _libraries_quiet(debug or not is_program), _terminable():
            code = _exit_code(words, debug)
        output.finish()

    if output.lost is not None:
        code = _complain(f"standard output: {output.lost}")
    sys.exit(code)


def _exit_code(arguments: Sequence[str], debug: bool) -> int:
    """Carry out a command, and say each of its errors in one line; returns the exit code."""
    try:
        from grosmc_mj.cli.program import execute

        return execute(arguments)
    except KeyboardInterrupt as stop:
        _complain(str(stop) or AGAIN)
        return INTERRUPTED
    except GrosmcError as error:
        _trace(debug)
        return _complain(str(error))
    except (FileExistsError, NotADirectoryError) as error:
        _trace(debug)
        name = value_text(error.filename or "output", str)
        return _complain(f"{name} is a file, and a folder is needed: name another one")
    except OSError as error:
        _trace(debug)
        return _complain(
            f"{value_text(error.filename or 'output', str)}: {error.strerror or error}"
        )
    # A defect of ours: one line too, for whoever runs this in a script.
    except Exception as error:
        _trace(debug)
        message = f"unforeseen {type(error).__name__}: {value_text(error, str)}"
        if not debug:
            message += f"; {_DEBUG} shows where"
        return _complain(message)


def _complain(message: str) -> int:
    """Say in one line what was wrong, or each mistake in a line; returns the exit code."""
    lines = [_printable(line) for line in message.split(MISTAKE_SEPARATOR)]
    # Whoever closed standard error does not want to know.
    with contextlib.suppress(OSError, ValueError):
        print(f"{PROGRAM}: {MISTAKE_SEPARATOR.join(lines)}", file=sys.stderr, flush=True)
    return WRONG


def _printable(text: str) -> str:
    """Return a text on one line, cut off if it is too long."""
    line = one_line(text)
    if len(line) > _LONGEST:
        return f"{line[: _LONGEST - 3]}..."
    return line


def _trace(debug: bool) -> None:
    """Print where an error came from, if that is asked for."""
    if debug:
        import traceback

        traceback.print_exc()


def _tune_process() -> None:
    """Switch off what costs a short program of small matrices time and gains it nothing.

    Imported modules live to the end: the garbage collector looks through them less often, and not
    once more at the exit. Threads of a BLAS cost more than matrices of ten rows gain by them.
    """
    gc.set_threshold(100_000, 50, 100)
    atexit.register(gc.freeze)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Figures are files: no window is opened for them, and no backend is asked for.
    os.environ["MPLBACKEND"] = "agg"
    # Help in columns of a letter never ends.
    if shutil.get_terminal_size().columns < _NARROWEST:
        os.environ["COLUMNS"] = str(_NARROWEST)


@contextlib.contextmanager
def _libraries_quiet(loud: bool) -> Iterator[None]:
    """Print our own warnings as lines, and those of libraries not at all.

    Args:
        loud: Print those of libraries too, as Python does.
    """
    with warnings.catch_warnings():
        if not loud and not sys.warnoptions:
            logging.disable(logging.WARNING)
            warnings.simplefilter("ignore")
        warnings.simplefilter("always", ImplausibleWarning)
        warnings.showwarning = functools.partial(_show_warning, warnings.showwarning)
        yield


def _show_warning(
    default: Callable[..., None],
    message: Warning | str,
    category: type[Warning],
    *where: Any,
) -> None:
    """Show a warning of ours in a line, and one of a library as Python shows it."""
    if issubclass(category, ImplausibleWarning):
        _complain(str(message))
    else:
        default(message, category, *where)


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
            null = Path(os.devnull).open("w")  # noqa: SIM115  open for as long as we run
            setattr(sys, name, null)
