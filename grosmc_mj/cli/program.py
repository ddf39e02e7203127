"""From the arguments to the exit code: parsing, dispatch, and wrong use in one line."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Sequence
from typing import Any

import tyro

from grosmc_mj.cli.commands import ABOUT, Command
from grosmc_mj.cli.screen import DONE, WRONG
from grosmc_mj.errors import ArgumentError, GrosmcError, SetupError
from grosmc_mj.rendering.backends import without_graphics

PROGRAM = "grosmc-mj"

# Where each command is carried out: module and function.
_ACTIONS = {
    "Validate": ("validate", "validate"),
    "Run": ("run", "run"),
    "New": ("run", "new"),
    "Campaign": ("campaign", "campaign"),
    "Replay": ("replay", "replay"),
    "Claims": ("claims", "claims"),
    "Premises": ("claims", "premises"),
    "Film": ("films", "film"),
    "View": ("view", "view"),
    "List": ("show", "list_systems"),
    "Compare": ("measure", "compare"),
    "Region": ("region", "region"),
    "Switching": ("switching", "switching"),
    "Hold": ("hold", "hold"),
    "Bench": ("measure", "bench"),
    "Doctor": ("films", "doctor"),
    "Readme": ("show", "readme"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    try:
        command = _parse(arguments)
        _import_mujoco()
        code = _run(command)
        sys.stdout.flush()
    except GrosmcError as error:
        code = _complain(str(error))
    except KeyboardInterrupt:
        code = _complain("interrupted; run the same command again to start over")
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        code = DONE
    except OSError as error:
        code = _complain(f"{error.filename or 'output'}: {error.strerror}")
        # What is still buffered cannot be written either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(code)


def _import_mujoco() -> None:
    """Import MuJoCo without OpenGL: this process renders nothing, and must not need it.

    Raises:
        SetupError: If it cannot be imported.
    """
    try:
        with without_graphics():
            import mujoco  # noqa: F401
    except Exception as error:
        raise SetupError(f"MuJoCo cannot be imported: {error}") from error


def _complain(message: str) -> int:
    """Say in one line what was wrong."""
    print(f"{PROGRAM}: {' '.join(message.split())}", file=sys.stderr)
    return WRONG


def _parse(arguments: Sequence[str] | None) -> Any:
    """The command that the arguments describe, or one line about what is wrong with them."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    if not arguments:
        arguments = ["--help"]
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog=PROGRAM,
                description=ABOUT,
                args=arguments,
                config=(tyro.conf.OmitArgPrefixes,),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise ArgumentError(_condense(said.getvalue())) from None


def _condense(box: str) -> str:
    """What a framed message says, without its title and the help that it repeats.

    The frame is of line-drawing characters or, where the terminal lacks them, of ASCII ones.
    """
    lines = [line.strip("│| ") for line in box.splitlines()[1:]]
    parts = [part.strip("╰╯+─- ") for part in re.split(r"[─-]{5,}", " ".join(lines))]
    words = [part for part in parts if part and "helptext" not in part]
    return "; ".join([*words, f"for help: {PROGRAM} --help"])


def _run(command: Any) -> int:
    """Carry out a command."""
    module, action = _ACTIONS[type(command).__name__]
    return getattr(importlib.import_module(f"grosmc_mj.cli.{module}"), action)(command)
