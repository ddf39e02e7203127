"""From the arguments to the command: parsing, and wrong use in one line."""

from __future__ import annotations

import contextlib
import functools
import io
import operator
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

import tyro
from tyro.conf import subcommand

from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands import ABOUT, CLAIMS, COMMANDS, GROUPS, Studies
from grosmc_mj.cli.output import PROGRAM
from grosmc_mj.errors import ArgumentError, SetupError
from grosmc_mj.films.offscreen import without_graphics

# Of ``run --save``, what it stands for alone first.
_FORMATS = ("parquet", "csv", "npz")
# What the parser says of an option that another command may have.
_APPLIED = re.compile(r" \(applied to [^)]*\)|Arguments are applied to .*", re.DOTALL)


def execute(arguments: Sequence[str]) -> int:
    """Carry out what the arguments describe.

    Returns:
        The exit code.

    Raises:
        GrosmcError: If something is wrong with them, or on the way.
    """
    command = parse(arguments)
    if not command.simulates:
        return command.execute()
    _import_mujoco()
    from grosmc_mj.physics.quiet import warnings_counted_only
    from grosmc_mj.results.document import carried_out

    carried_out(PROGRAM, arguments)
    with warnings_counted_only():
        return command.execute()


def parse(arguments: Sequence[str]) -> Command:
    """The command that the arguments describe.

    Raises:
        ArgumentError: If they describe none, in one line.
    """
    given, said = _with_format(_with_judge(arguments)) or ["--help"], io.StringIO()
    # The first help has a line of each command, not its whole text.
    brief = given[0] in ("-h", "--help")
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                _one_of(COMMANDS, brief=brief),
                prog=PROGRAM,
                description=ABOUT,
                args=given,
                config=(tyro.conf.OmitArgPrefixes,),
            )
    except SystemExit as stop:
        if not stop.code:
            raise
        raise ArgumentError(_condense(said.getvalue())) from None


def _one_of(commands: Mapping[str, type[Command] | Studies], *, brief: bool) -> Any:
    """The type of any of these commands."""
    kinds = []
    for name, each in commands.items():
        if isinstance(each, Mapping):
            kinds.append(
                Annotated[_one_of(each, brief=False), subcommand(name, description=GROUPS[name])]
            )
        else:
            words = (each.__doc__ or "").partition("\n")[0] if brief else None
            kinds.append(Annotated[each, subcommand(name, description=words)])
    return functools.reduce(operator.or_, kinds)


def _with_judge(arguments: Sequence[str]) -> list[str]:
    """The arguments with the subcommand that ``claims`` alone stands for."""
    words = list(arguments)
    if words[:1] == ["claims"] and not {*words[1:2]} & {*CLAIMS, "-h", "--help"}:
        words.insert(1, "judge")
    return words


def _with_format(arguments: Sequence[str]) -> list[str]:
    """The arguments with the format that ``--save`` alone stands for."""
    words = list(arguments)
    for at, word in enumerate(words):
        if word == "--save" and words[at + 1 : at + 2] and words[at + 1] in _FORMATS:
            return words
        if word == "--save":
            return [*words[: at + 1], _FORMATS[0], *words[at + 1 :]]
    return words


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


def _condense(box: str) -> str:
    """What a framed message says, without its title and the help that it repeats.

    The frame is of line-drawing characters or, where the terminal lacks them, of ASCII ones.
    """
    lines = "\n".join(line.strip("│|").rstrip() for line in box.splitlines()[1:])
    parts = [part.strip("╰╯+─-\n ") for part in re.split(r"[─-]{5,}", lines)]
    words = [
        _meant(part) if part.startswith("Perhaps") else " ".join(_APPLIED.sub("", part).split())
        for part in parts
        if part and "helptext" not in part
    ]
    return "; ".join([*words, f"for help: {PROGRAM} --help"])


def _meant(part: str) -> str:
    """The options that may be meant, each with the first command that has it."""
    # Help stands further in than the options that it is of.
    option = rf"^( +)(-.*)\n(?:\1 +.*\n)*? +in {PROGRAM} (.+) --help"
    found = [f"{each[2]} of {each[3]}" for each in re.finditer(option, part, re.MULTILINE)]
    return f"perhaps you meant {', or '.join(found)}"
