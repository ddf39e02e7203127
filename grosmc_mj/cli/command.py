"""Base class of the commands, and types of options that several of them have."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from grosmc_mj.cli.targets import TARGET

# An option without a value: on if it is present.
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
Out = Annotated[Path, tyro.conf.arg(metavar="DIR")]
Target = Annotated[Positional[str], tyro.conf.arg(metavar=TARGET, name="target")]

# Options whose default comes from the case file or from the command.
OptionalName = Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")]
OptionalSurface = Annotated[
    str | None, tyro.conf.arg(metavar="printed|discrete", help_behavior_hint="")
]

# Names of laws: of the file's controllers, or of its [laws].
Laws = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        name="laws",
        metavar="NAME [NAME ...]",
        help_behavior_hint="(default: all controllers of the file)",
    ),
]


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command whose docstring is its help and whose fields are its options.

    Modules of commands import what they need when they are carried out: --help is quick.

    Attributes:
        verbose: Print every table after the answer.
    """

    verbose: Flag = False

    @property
    def simulates(self) -> bool:
        """True if the command needs MuJoCo."""
        return True

    # No abstract class: tyro would import typeguard to see that a command is none.
    def execute(self) -> int:
        """Carry out the command.

        Returns:
            The exit code.

        Raises:
            GrosmcError: If something is wrong.
        """
        raise NotImplementedError
