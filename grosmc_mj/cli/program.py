"""Command line parser: from the arguments to the command; wrong use is refused in one line."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

from cyclopts import (
    App,
    ArgumentCollection,
    CycloptsError,
    Group,
    MissingArgumentError,
    Parameter,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from grosmc_mj.cli.commands import ABOUT, COMMANDS, GROUPS, STUDIES, Entry, Subcommands
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.cli.streams import PROGRAM
from grosmc_mj.ground.errors import ArgumentError, SetupError, unknown_name, value_text
from grosmc_mj.ground.versions import __version__
from grosmc_mj.output.films.offscreen import without_graphics

if TYPE_CHECKING:
    from grosmc_mj.cli.command import Command

# Beginning of a negative number.
_NEGATIVE = re.compile(r"-\.?\d")
# The format of ``run --save`` without one.
_FORMAT = "parquet"

# The panel of options in a command's help.
_OPTIONS = Group("Options", sort_key=0)


def execute(arguments: Sequence[str]) -> int:
    """Carry out the command that the arguments describe.

    Returns:
        The exit code.

    Raises:
        GrosmcError: If something is wrong with them, or on the way.
    """
    command = parse(arguments)
    if command is None:
        return DONE
    # Before the libraries that simulate are imported, which takes most of a short command's time.
    command.require_target()
    command.require_outputs()
    if not command.simulates:
        return command.execute()

    _import_mujoco()
    from grosmc_mj.mechanics.physics.hooks import warnings_counted_only
    from grosmc_mj.output.results.document import carried_out

    carried_out(PROGRAM, arguments)
    with warnings_counted_only():
        return command.execute()


def parse(arguments: Sequence[str]) -> Command | None:
    """Return the command that the arguments describe; None after --help or --version.

    Raises:
        ArgumentError: If they describe none, in one line.
    """
    words = _with_negative_values(_with_format(arguments))
    app = _application(words)
    path, _, _ = app.parse_commands(words)
    try:
        return app(words)
    except CycloptsError as error:
        raise _refusal(_sentence(error), path) from None


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


def _with_negative_values(words: Sequence[str]) -> list[str]:
    """Return the words with each negative number joined to its option, which it else looks like."""
    joined: list[str] = []
    for word in words:
        follows = joined and joined[-1].startswith("--") and "=" not in joined[-1]
        if follows and _NEGATIVE.match(word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def _application(words: Sequence[str]) -> App:
    """Return the parser of all commands; it imports those that the words name."""
    app = App(
        name=PROGRAM,
        help=ABOUT,
        # Markdown would take a tenth of a second to import.
        help_format="plaintext",
        version=f"{PROGRAM} {__version__}",
        version_flags=("--version",),
        group_parameters=_OPTIONS,
        default_parameter=Parameter(
            allow_repeating=True,
            consume_multiple=True,
            json_list=False,
            negative_iterable=(),
        ),
        result_action="return_value",
        exit_on_error=False,
        print_error=False,
        suppress_keyboard_interrupt=False,
    )
    _add_commands(app, COMMANDS, words)

    app["study"].default(_refuse_study)
    if "claims" in words:
        from grosmc_mj.cli.commands.claims import JudgeCommand

        app["claims"].default(JudgeCommand)
    return app


def _add_commands(
    app: App,
    commands: Mapping[str, Entry | Subcommands],
    words: Sequence[str],
) -> None:
    """Add commands, and groups of them, in their order."""
    for place, (name, entry) in enumerate(commands.items()):
        if isinstance(entry, Entry):
            # A command that is named has its docstring as help.
            summary = None if name in words else entry.summary
            path = f"grosmc_mj.cli.commands.{entry.path}"
            app.command(path, name=name, help=summary, sort_key=place)
        else:
            group = App(name=name, help=GROUPS[name], group_parameters=_OPTIONS, sort_key=place)
            _add_commands(group, entry, words)
            app.command(group)


def _refuse_study(*words: Annotated[str, Parameter(show=False)]) -> None:
    """Refuse ``study`` without the name of one.

    Raises:
        ArgumentError: That names them.
    """
    wrong = f"missing: one of {', '.join(STUDIES)}"
    if words:
        wrong = unknown_name("command", words[0], STUDIES)
    raise _refusal(wrong, ["study"])


def _refusal(wrong: str, path: Sequence[str]) -> ArgumentError:
    """Return the error of wrong use, with the command that shows the options."""
    return ArgumentError(f"{wrong}; for help: {' '.join([PROGRAM, *path])} --help")


def _sentence(error: CycloptsError) -> str:
    """Return what is wrong with the arguments of a command, by the error of the parser."""
    match error:
        case UnknownCommandError(unused_tokens=[token, *_]):
            if token.startswith("-"):
                return f"unknown option {value_text(token, str)}"
            return unknown_name("command", token, COMMANDS)
        case UnusedCliTokensError(unused_tokens=[token, *_]):
            return f"unexpected argument {value_text(token)}"
        case MissingArgumentError(argument=argument) if argument is not None:
            if argument.is_positional_only():
                return f"missing: {argument.parameter.metavar or argument.name}"
            return f"{error.keyword or argument.name}: a value is missing"
        case UnknownOptionError(token=token, argument_collection=options):
            return _unknown_option(token.keyword or token.value, options)
    return str(error).removesuffix(".")


def _unknown_option(word: str, options: ArgumentCollection) -> str:
    """Return a sentence that refuses an option which a command does not have."""
    option = word.partition("=")[0]
    sentence = f"unknown option {value_text(option, str)}"
    names = [name for argument in options for name in argument.names]
    near = difflib.get_close_matches(option, names, n=1, cutoff=0.7)
    if near:
        sentence += f": did you mean {near[0]}?"
    return sentence


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
