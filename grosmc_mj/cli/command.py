"""Base class of the commands, and types of options that several of them have."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, TypeVar, dataclass_transform

from cyclopts import Group, Parameter, Token

from grosmc_mj.cli.targets import TARGET, require_target
from grosmc_mj.ground.errors import value_text

AnyCommand = TypeVar("AnyCommand", bound="Command")

# Panels of a command's help: of the options of a search, and the last one.
SEARCH = Group("Search", sort_key=1)
OUTPUT = Group("Output", sort_key=9)

# A line break within a paragraph of a docstring, or within the text of an attribute.
_LINE_BREAK = re.compile(r"(?<=\S)\n( {8})?(?=\S)")


def _whole_number(_: type[int], tokens: Sequence[Token]) -> int:
    """Convert the text of a whole number; the parser alone would round 30.5.

    Raises:
        ValueError: If it is none.
    """
    text = tokens[0].value
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{value_text(text)} is no whole number") from None


WholeNumber = Annotated[int, Parameter(metavar="N", converter=_whole_number)]
# An option without a value: on if it is present.
Flag = Annotated[bool, Parameter(negative=(), show_default=False)]
Out = Annotated[Path, Parameter(metavar="DIR", group=OUTPUT)]
Figures = Annotated[bool, Parameter(group=OUTPUT, show_default="--figures")]
Target = Annotated[str, Parameter(metavar=TARGET)]

# Options whose default comes from the case file or from the command.
OptionalName = Annotated[str | None, Parameter(metavar="NAME")]
OptionalSurface = Annotated[str | None, Parameter(metavar="printed|discrete")]

# Names of laws: of the file's controllers, or of its [laws].
Laws = Annotated[
    tuple[str, ...],
    Parameter(
        name="--laws",
        metavar="NAME...",
        show_default="all controllers of the file",
    ),
]
# Names of laws of a study: of its own, too.
StudiedLaws = Annotated[
    tuple[str, ...],
    Parameter(metavar="NAME...", show_default="all but the rivals"),
]


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command whose docstring is its help; ``command`` makes one of a class.

    Its fields are its options, those above ``KW_ONLY`` its arguments, in their order. Modules of
    commands import what they need when they are carried out: --help is quick.

    Attributes:
        verbose: Print every table after the answer.
    """

    verbose: Annotated[Flag, Parameter(group=OUTPUT)] = False

    # Signature from which the parser is made.
    __signature__: ClassVar[inspect.Signature]

    @property
    def simulates(self) -> bool:
        """True if the command needs MuJoCo."""
        return True

    @property
    def case_target(self) -> str | None:
        """The case or the case file that the command is about; None if it is about none."""
        return getattr(self, "target", None)

    def require_target(self) -> None:
        """Refuse a target that is no case, or a file that cannot be read, before all work.

        Raises:
            ArgumentError: As for ``cli.targets.require_target``.
        """
        if self.case_target:
            require_target(self.case_target)

    def require_outputs(self) -> None:
        """Refuse places of results where nothing can be written, before all work.

        Raises:
            SetupError: If the folder or the file that an option names cannot be written.
        """
        from grosmc_mj.ground.files import require_folder

        folder = getattr(self, "out", None)
        if folder is not None:
            require_folder(folder)
        file = getattr(self, "output", None)
        if file is not None:
            require_folder(file.parent)

    def execute(self) -> int:
        """Carry out the command.

        Returns:
            The exit code.

        Raises:
            GrosmcError: If something is wrong.
        """
        raise NotImplementedError


@dataclass_transform(frozen_default=True)
def command(kind: type[AnyCommand]) -> type[AnyCommand]:
    """Make a class a frozen dataclass, with the signature and the docstring that the parser reads.

    An argument has no option beside it: TARGET, and no --target. Paragraphs are lines: help is
    wrapped to the width of the terminal.
    """
    kind = dataclass(frozen=True)(kind)
    signature = inspect.signature(kind)
    parameters = []
    for parameter in signature.parameters.values():
        if parameter.kind is parameter.POSITIONAL_OR_KEYWORD:
            parameter = parameter.replace(kind=parameter.POSITIONAL_ONLY)
        parameters.append(parameter)
    kind.__signature__ = signature.replace(parameters=parameters)
    kind.__doc__ = _LINE_BREAK.sub(" ", inspect.cleandoc(kind.__doc__ or ""))
    return kind
