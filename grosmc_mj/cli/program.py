"""From the arguments to the command: parsing, and wrong use in one line."""

from __future__ import annotations

import difflib
import functools
import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Annotated, Any, get_type_hints

import tyro

# The parser's reports of what is wrong, as values: only here, and its versions are bounded.
from tyro import _errors as reports
from tyro.conf import subcommand

from grosmc_mj.cli.command import Command
from grosmc_mj.cli.commands import ABOUT, CLAIMS, COMMANDS, GROUPS, Studies
from grosmc_mj.cli.output import PROGRAM
from grosmc_mj.errors import ArgumentError, SetupError, shown, unknown_name
from grosmc_mj.films.offscreen import without_graphics

# A subcommand of ``claims`` that is gone: its name is not taken for a claim.
_REMOVED = "self-test"
# Earlier spellings of --laws.
_OLD_LAWS = ("--controller", "--controllers")
# The format of ``run --save`` without one.
_FORMAT = "parquet"


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
    from grosmc_mj.physics.hooks import warnings_counted_only
    from grosmc_mj.results.document import carried_out

    carried_out(PROGRAM, arguments)
    with warnings_counted_only():
        return command.execute()


def parse(arguments: Sequence[str]) -> Command:
    """The command that the arguments describe.

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


def _refuse(words: Sequence[str], report: reports.ParseErrorEvent) -> None:
    """Refuse arguments in one line; what the parser may report in future, it says itself.

    Raises:
        ArgumentError: What is wrong, and the command that shows the options.
    """
    path, command = _command_of(words)
    match report:
        case reports.UnrecognizedArgs(tokens=[token, *_]):
            wrong = _unknown(path, command, token)
        case reports.MissingArgs(missing_arguments=missing):
            wrong = f"missing: {', '.join(_named(one.arg) for one in missing)}"
        case reports.MissingSubcommand(subcommand_spec=spec):
            wrong = f"missing: one of {', '.join(spec.parser_from_name)}"
        case reports.InvalidChoice(argument=argument, value=value, choices=choices):
            wrong = unknown_name(_named(argument), value, [x for x in choices if x != "None"])
        case reports.BadValue(argument=argument):
            wrong = f"{_named(argument)}: a value is missing"
        case reports.InstantiationFailure(argument=argument, message=message):
            wrong = f"{_named(argument) if argument else 'arguments'}: {message}"
        case _:
            return
    raise ArgumentError(f"{wrong}; for help: {' '.join([PROGRAM, *path])} --help")


def _named(argument: Any) -> str:
    """An option, or what stands in the help for an argument without one."""
    return argument.lowered.metavar if argument.is_positional() else argument.display_name()


def _command_of(words: Sequence[str]) -> tuple[list[str], type[Command] | Mapping[str, Any]]:
    """The names that lead to a command, and the command or the group that they name."""
    path, command = list[str](), COMMANDS
    for word in words:
        if not isinstance(command, Mapping) or word not in command:
            break
        path.append(word)
        command = command[word]
    return path, command


def _unknown(path: list[str], command: type[Command] | Mapping[str, Any], token: str) -> str:
    """What is wrong about a word that the parser does not know."""
    if not token.startswith("-"):
        unknown = isinstance(command, Mapping)
        return (
            unknown_name("command", token, command)
            if unknown
            else f"unexpected argument {shown(token)}"
        )
    options = [] if isinstance(command, Mapping) else list(_options(command))
    removed = {} if isinstance(command, Mapping) else command.removed
    if (option := token.partition("=")[0]) in removed:
        return f"{option} is gone: {removed[option]}"
    if option in _OLD_LAWS and "--laws" in options:
        return f"{option} is gone: the option is --laws"
    near = difflib.get_close_matches(token, options, n=1, cutoff=0.7)
    return f"unknown option {shown(token, str)}" + (f": did you mean {near[0]}?" if near else "")


def _options(command: type[Command]) -> Iterator[str]:
    """The options of a command."""
    hints = get_type_hints(command, include_extras=True)
    for option in fields(command):
        marks = getattr(hints[option.name], "__metadata__", ())
        names = [mark.name for mark in marks if getattr(mark, "name", None)]
        name = (names or [option.name])[0].replace("_", "-")
        yield from (f"--{name}", f"--no-{name}") if option.default is True else (f"--{name}",)


def _one_of(commands: Mapping[str, type[Command] | Studies], *, brief: bool) -> Any:
    """The type of any of these commands."""
    kinds = []
    for name, kind in commands.items():
        if isinstance(kind, Mapping):
            group = subcommand(name, description=GROUPS[name])
            kinds.append(Annotated[_one_of(kind, brief=False), group])
        else:
            words = (kind.__doc__ or "").partition("\n")[0] if brief else None
            kinds.append(Annotated[kind, subcommand(name, description=words)])
    return functools.reduce(operator.or_, kinds)


def _with_judge(arguments: Sequence[str]) -> list[str]:
    """The arguments with the subcommand that ``claims`` alone stands for."""
    words = list(arguments)
    no_claims = {*CLAIMS, _REMOVED, "-h", "--help"}
    if words[:1] == ["claims"] and no_claims.isdisjoint(words[1:2]):
        words.insert(1, "judge")
    return words


def _with_format(arguments: Sequence[str]) -> list[str]:
    """The arguments with the format that ``--save`` alone stands for."""
    words = list(arguments)
    for at, word in enumerate(words):
        if word == "--save" and (at + 1 == len(words) or words[at + 1].startswith("-")):
            return [*words[: at + 1], _FORMAT, *words[at + 1 :]]
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
