"""Commands run in this process: their exit codes, and the one line of a mistake."""

from __future__ import annotations

import signal

import pytest

from grosmc_mj import cli

# Types of pytest's fixtures.
Screen = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch


def run(*arguments: object) -> int:
    """Run a command; returns its exit code."""
    with pytest.raises(SystemExit) as stop:
        cli.main([str(argument) for argument in arguments])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def assert_one_line(error: str) -> None:
    """Assert that standard error is one printable line about a mistake that was foreseen."""
    assert error.startswith("grosmc-mj: ")
    assert error.count("\n") == 1
    assert error[:-1].isprintable()
    assert "unforeseen" not in error


def hear_interrupts() -> None:
    """The ``preexec_fn`` of every child that a test interrupts: Ctrl-C ends it.

    A process that was started in the background ignores SIGINT, and so do its children: Python
    raises KeyboardInterrupt only where it finds the default handler.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
