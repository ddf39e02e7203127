"""What every command of the command line is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from tyro.conf import Positional

from grosmc_mj.cli.targets import TARGET

# An option that is on if it is there.
Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
Out = Annotated[Path, tyro.conf.arg(metavar="DIR")]
Target = Annotated[Positional[str], tyro.conf.arg(metavar=TARGET, name="target")]
# Laws and settings of which the file, or the command, has the default.
OptionalName = Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")]
OptionalSurface = Annotated[
    str | None, tyro.conf.arg(metavar="printed|discrete", help_behavior_hint="")
]

# Laws of a file by their names, of its controllers or of its [laws].
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
        removed: Options that are gone, with a clause that says what takes their place.
    """

    removed: ClassVar[Mapping[str, str]] = {}

    verbose: Flag = False

    @property
    def simulates(self) -> bool:
        """Whether it needs MuJoCo."""
        return True

    # No abstract class: tyro would import typeguard to see that a command is none.
    def execute(self) -> int:
        """Carry it out; returns the exit code.

        Raises:
            GrosmcError: If something is wrong.
        """
        raise NotImplementedError
