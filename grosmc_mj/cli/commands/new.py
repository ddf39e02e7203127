"""grosmc-mj new."""

from __future__ import annotations

import keyword
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.errors import ArgumentError, shown, unknown_name

_NAME = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class NewCommand(Command):
    """Write a case file to begin with: NAME.toml, every key explained.

    Attributes:
        name: Name of the case, and of its file.
        like: Copy this case of the package instead, such as cart_pendulum/case1.
        python: Write NAME.py too, with a plant, a law and a controller of your own, and a case
            file that uses them.
    """

    name: Annotated[Positional[str], arg(metavar="NAME", name="name")]
    like: Annotated[str | None, arg(metavar="SYSTEM/CASE", help_behavior_hint="")] = None
    python: Flag = False

    def execute(self) -> int:
        """Write a case file to begin with."""
        from grosmc_mj.experiments.file.shipped import own_plant, starter
        from grosmc_mj.files import written_aside

        name = self.name.removesuffix(".toml")
        if not _NAME.fullmatch(name) or keyword.iskeyword(name) or name in sys.stdlib_module_names:
            raise ArgumentError(
                f"{shown(self.name)} must be a name of letters, digits and underscores"
            )
        if self.like is not None and self.python:
            raise ArgumentError("--like copies a case, --python writes one: give one of them")
        if self.python:
            files = own_plant(name)
        else:
            files = {f"{name}.toml": starter() if self.like is None else _text_of(self.like)}
        for file in files:
            if Path(file).exists():
                raise ArgumentError(f"{file} is there already: take another name or remove it")
        for file, text in files.items():
            with written_aside(Path(file)) as part:
                part.write_text(text, encoding="utf-8")
        screen.console().print(
            f"{' and '.join(files)} written; run: grosmc-mj run {name}.toml", soft_wrap=True
        )
        return DONE


def _text_of(name: str) -> str:
    """The text of a case of the package."""
    from grosmc_mj.experiments.file.reading import resolved_text
    from grosmc_mj.experiments.file.shipped import shipped_files

    if name not in shipped_files():
        raise ArgumentError(unknown_name("case", name, shipped_files()))
    return resolved_text(shipped_files()[name])
