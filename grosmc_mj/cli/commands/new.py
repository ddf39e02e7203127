"""grosmc-mj new."""

from __future__ import annotations

import json
import keyword
import re
import sys
from collections.abc import Mapping
from dataclasses import KW_ONLY
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from grosmc_mj.cli import screen
from grosmc_mj.cli.command import Command, Flag, command
from grosmc_mj.cli.exit_codes import DONE
from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text

_NAME = re.compile(r"[A-Za-z_]\w*")


@command
class NewCommand(Command):
    """Write a case file to begin with: NAME.toml, every key explained.

    Attributes:
        name: Name of the case, and of its file; with --schema the file that is written, and
            without it the schema is printed.
        like: Copy this case of the package instead, such as cart_pendulum/case1.
        python: Write NAME.py too, with a plant, a law and a controller of your own, and a case
            file that uses them.
        schema: Write a JSON schema of case files instead, from which editors of TOML take
            completion, help and checks of keys.
    """

    name: Annotated[str, Parameter(show_default=False)] = ""
    _: KW_ONLY
    like: Annotated[str | None, Parameter(metavar="SYSTEM/CASE")] = None
    python: Flag = False
    schema: Flag = False

    def execute(self) -> int:
        """Write a case file to begin with, or the schema of case files."""
        if self.schema:
            return self._write_schema()
        if not self.name:
            raise ArgumentError("give the case a name: grosmc-mj new NAME")
        texts = self._texts()
        self._write(texts)
        files = " and ".join(texts)
        screen.console().print(
            f"{files} written; run: grosmc-mj run {self._case_name()}.toml", soft_wrap=True
        )
        return DONE

    def _write_schema(self) -> int:
        """Print the schema of case files, or write it into the file of the name."""
        from grosmc_mj.experiments.file.json_schema import schema_of_case_files
        from grosmc_mj.experiments.file.schema import file_name

        if self.like is not None or self.python:
            raise ArgumentError("--schema writes no case: leave --like and --python out")
        text = json.dumps(schema_of_case_files(), indent=2, ensure_ascii=False)
        if not self.name:
            print(text)
            return DONE
        try:
            file = file_name(self.name)
        except ValueError as error:
            raise ArgumentError(str(error)) from None
        self._write({file: f"{text}\n"})
        screen.console().print(
            f"{file} written; begin a case file with: #:schema {file}", soft_wrap=True
        )
        return DONE

    def _write(self, texts: Mapping[str, str]) -> None:
        """Write texts into files that are not there yet.

        Args:
            texts: Texts by the names of their files.

        Raises:
            ArgumentError: If one of the files is there.
        """
        from grosmc_mj.ground.files import atomic_write

        for file in texts:
            if Path(file).exists():
                raise ArgumentError(f"{file} is there already: take another name or remove it")

        for file, text in texts.items():
            with atomic_write(Path(file)) as part:
                part.write_text(text, encoding="utf-8")

    def _case_name(self) -> str:
        """Return the name of the case.

        Raises:
            ArgumentError: If it is not one that a module of Python could have, too.
        """
        name = self.name.removesuffix(".toml")
        if not _NAME.fullmatch(name) or keyword.iskeyword(name) or name in sys.stdlib_module_names:
            raise ArgumentError(
                f"{value_text(self.name)} must be a name of letters, digits and underscores"
            )
        return name

    def _texts(self) -> Mapping[str, str]:
        """Return the texts to write by the names of their files."""
        from grosmc_mj.experiments.file.shipped import own_plant, starter

        name = self._case_name()
        if self.like is not None and self.python:
            raise ArgumentError("--like copies a case, --python writes one: give one of them")
        if self.python:
            return own_plant(name)
        if self.like is not None:
            return {f"{name}.toml": _case_text(self.like)}
        return {f"{name}.toml": starter()}


def _case_text(name: str) -> str:
    """Return the text of a case of the package."""
    from grosmc_mj.experiments.file.shipped import shipped_files
    from grosmc_mj.experiments.file.text import complete_text

    if name not in shipped_files():
        raise ArgumentError(unknown_name("case", name, shipped_files()))
    return complete_text(shipped_files()[name])
