"""Command line parser: from the arguments to the command; wrong use is refused in one line."""

from __future__ import annotations

import difflib
import functools
import operator
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields
from typing import Annotated, Any, get_type_hints

import tyro

# The parser's reports of what is wrong, as values: only here, and its versions are bounded.
from tyro import _errors as reports
from tyro.conf import subcommand

from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands import ABOUT, CLAIMS, COMMANDS, GROUPS, Studies
from grosmc_mj.cli.output import PROGRAM
from grosmc_mj.errors import ArgumentError, SetupError, unknown_name, value_text
from grosmc_mj.films.offscreen import without_graphics

# The format of ``run --save`` without one.
_FORMAT = "parquet"

_LAWS_NOW = {
    "--controller": "--controller is gone: the option is --laws",
    "--controllers": "--controllers is gone: the option is --laws",
}
# Removed options and subcommands of each command, with the words that refuse them.
_REMOVED: Mapping[str, Mapping[str, str]] = {
    "campaign": {
        **_LAWS_NOW,
        "--replay": "--replay is gone: --plant WHICH writes the case file of a run's plant, which "
        "grosmc-mj run takes",
    },
    "claims": {"self-test": unknown_name("command", "self-test", CLAIMS)},
    "claims premises": _LAWS_NOW,
    "film": _LAWS_NOW,
    "run": _LAWS_NOW,
    "study ladder": _LAWS_NOW,
    "study region": _LAWS_NOW,
    "study tolerance": _LAWS_NOW,
    "view": {
        **_LAWS_NOW,
        "--replay": "--replay is gone: view runs the case as you watch, and grosmc-mj film shows a "
        "recorded run",
    },
}

# A command, or a group of subcommands by name.
_Node = type[Command] | Mapping[str, Any]


def execute(arguments: Sequence[str]) -> int:
    """Carry out the command that the arguments describe.

    Returns:
        The exit code.

    Raises:
        GrosmcError: If something is wrong with them, or on the way.
    """
    command = parse(arguments)
    if not command.simulates:
        return command.execute()

    _import_mujoco()
    from grosmc_mj.physics.hooks import warnings_counted_only
    from grosmc_mj.results.document import carried_out

    carried_out(PROGRAM, arguments)
    with warnings_counted_only():
        return command.execute()


def parse(arguments: Sequence[str]) -> Command:
    """Return the command that the arguments describe.

    Raises:
        ArgumentError: If they describe none, in one line.
    """
    words = _with_format(_with_judge(arguments)) or ["--help"]
    # The first help has a line of each command, not its whole text.
    brief = words[0] in ("-h", "--help")
    with reports.on_parse_error(functools.partial(_refuse, words)):
        return tyro.cli(
            _one_of(COMMANDS, brief=brief),
            prog=PROGRAM,
            description=ABOUT,
            args=words,
            config=(tyro.conf.OmitArgPrefixes,),
        )


def _with_judge(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with the subcommand that ``claims`` alone stands for."""
    words = list(arguments)
    # A removed subcommand is refused: its name is not taken for a claim.
    subcommands = {*CLAIMS, *_REMOVED["claims"], "-h", "--help"}
    if words[:1] == ["claims"] and subcommands.isdisjoint(words[1:2]):
        words.insert(1, "judge")
    return words


def _with_format(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with the format that ``--save`` alone stands for."""
    words = list(arguments)
    for index, word in enumerate(words):
        following = words[index + 1 : index + 2]
        has_format = following and not following[0].startswith("-")
        if word == "--save" and not has_format:
            words.insert(index + 1, _FORMAT)
            break
    return words


def _one_of(commands: Mapping[str, type[Command] | Studies], *, brief: bool) -> Any:
    """Return the union type of commands, from which the parser is made.

    Args:
        commands: Commands and groups of commands by name.
        brief: True for a help that has the first line of each command alone.
    """
    kinds = []
    for name, kind in commands.items():
        if isinstance(kind, Mapping):
            group = subcommand(name, description=GROUPS[name])
            kinds.append(Annotated[_one_of(kind, brief=False), group])
        else:
            words = (kind.__doc__ or "").partition("\n")[0] if brief else None
            kinds.append(Annotated[kind, subcommand(name, description=words)])
    return functools.reduce(operator.or_, kinds)


def _refuse(words: Sequence[str], report: reports.ParseErrorEvent) -> None:
    """Refuse arguments in one line; reports of future versions are left to the parser.

    Raises:
        ArgumentError: What is wrong, and the command that shows the options.
    """
    path, command = _command_of(words)
    match report:
        case reports.UnrecognizedArgs(tokens=[token, *_]):
            wrong = _unknown(path, command, token)
        case reports.MissingArgs(missing_arguments=missing):
            names = [_argument_name(argument.arg) for argument in missing]
            wrong = f"missing: {', '.join(names)}"
        case reports.MissingSubcommand(subcommand_spec=spec):
            wrong = f"missing: one of {', '.join(spec.parser_from_name)}"
        case reports.InvalidChoice(argument=argument, value=value, choices=choices):
            # The parser hands over a set.
            valid = sorted(choice for choice in choices if choice != "None")
            wrong = unknown_name(_argument_name(argument), value, valid)
        case reports.BadValue(argument=argument):
            wrong = f"{_argument_name(argument)}: a value is missing"
        case reports.InstantiationFailure(argument=None, message=message):
            wrong = f"arguments: {message}"
        case reports.InstantiationFailure(argument=argument, message=message):
            wrong = f"{_argument_name(argument)}: {message}"
        case _:
            return
    raise ArgumentError(f"{wrong}; for help: {' '.join([PROGRAM, *path])} --help")


def _argument_name(argument: Any) -> str:
    """Return an option, or the metavariable of an argument without one."""
    if argument.is_positional():
        return argument.lowered.metavar
    return argument.display_name()


def _command_of(words: Sequence[str]) -> tuple[list[str], _Node]:
    """Return the names that lead to a command, and the command or the group that they name."""
    path: list[str] = []
    command: _Node = COMMANDS
    for word in words:
        if not isinstance(command, Mapping) or word not in command:
            break
        path.append(word)
        command = command[word]
    return path, command


def _unknown(path: Sequence[str], command: _Node, token: str) -> str:
    """Return a sentence that refuses a word which the parser does not know."""
    option = token.partition("=")[0]
    removed = _REMOVED.get(" ".join(path), {})
    if option in removed:
        return removed[option]

    if not token.startswith("-"):
        if isinstance(command, Mapping):
            return unknown_name("command", token, command)
        return f"unexpected argument {value_text(token)}"

    options = [] if isinstance(command, Mapping) else _options(command)
    sentence = f"unknown option {value_text(token, str)}"
    near = difflib.get_close_matches(token, options, n=1, cutoff=0.7)
    if near:
        sentence += f": did you mean {near[0]}?"
    return sentence


def _options(command: type[Command]) -> list[str]:
    """Return the options of a command."""
    hints = get_type_hints(command, include_extras=True)
    options: list[str] = []
    for field in fields(command):
        name = _option_name(field, hints[field.name])
        options.append(f"--{name}")
        if field.default is True:
            options.append(f"--no-{name}")
    return options


def _option_name(field: Field[Any], hint: Any) -> str:
    """Return the name of an option: the one that its type gives it, or its field's."""
    for mark in getattr(hint, "__metadata__", ()):
        name = getattr(mark, "name", None)
        if name:
            return name
    return field.name.replace("_", "-")


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
