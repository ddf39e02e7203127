"""What every command of the command line is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated

import tyro


@dataclass(frozen=True, kw_only=True)
class Command(ABC):
    """A command whose docstring is its help and whose fields are its options.

    Modules of commands import what they need when they are carried out: --help is quick.

    Attributes:
        verbose: Print every table after the answer.
    """

    verbose: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False

    @abstractmethod
    def execute(self) -> int:
        """Carry it out; returns the exit code.

        Raises:
            GrosmcError: If something is wrong.
        """
