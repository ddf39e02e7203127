"""From the arguments to the command: parsing, dispatch, and wrong use in one line."""

from __future__ import annotations

import contextlib
import importlib
import io
import re
from collections.abc import Sequence
from typing import Any

import tyro

from grosmc_mj.cli.commands import ABOUT, Command
from grosmc_mj.cli.entry import PROGRAM
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.films.offscreen.backends import without_graphics

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


def execute(arguments: Sequence[str]) -> int:
    """Carry out what the arguments describe.

    Returns:
        The exit code.

    Raises:
        GrosmcError: If something is wrong with them, or on the way.
    """
    command = _parse(arguments)
    _import_mujoco()
    from grosmc_mj.simulation.quiet import warnings_counted_only

    module, action = _ACTIONS[type(command).__name__]
    with warnings_counted_only():
        return getattr(importlib.import_module(f"grosmc_mj.cli.{module}"), action)(command)


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


def _parse(arguments: Sequence[str]) -> Any:
    """The command that the arguments describe, or one line about what is wrong with them."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                Command,
                prog=PROGRAM,
                description=ABOUT,
                args=list(arguments) or ["--help"],
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
