"""Python that a case file names, and whose fault it is when it fails."""

from __future__ import annotations

import importlib
import re
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core.errors import NumbaError

from grosmc_mj.errors import ArgumentError, unknown_name

_PACKAGE = Path(__file__).resolve().parents[1]
_NAMED = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")
# Where a compiler's message says that it stopped.
_COMPILED = re.compile(r'File "([^"]+)", line (\d+)')
# What it says of its own reasons, the last of which counts.
_REASON = re.compile(
    r"No implementation of function .* found|Unknown attribute .*|Untyped global .*|.*unsupported.*"
    r"|.*not supported.*|Cannot .*|Invalid .*"
)


def is_named(text: str) -> bool:
    """Whether a text has the form ``module:name``."""
    return ":" in text


def load_named(text: str, folder: Path) -> Any:
    """What ``module:name`` names: from a file in the folder, or from an installed package.

    Raises:
        ArgumentError: If it is not there, or the module cannot be imported.
    """
    if not _NAMED.fullmatch(text):
        raise ArgumentError(f"{text!r} must be module:name, such as my_module:my_law")
    name, attribute = text.split(":")
    if name.split(".")[0] in sys.stdlib_module_names:
        raise ArgumentError(f"{text!r}: {name} is a module of Python itself: take another name")
    with blamed(folder), _importable(name, folder):
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise
            raise ArgumentError(
                f"{text!r}: there is no {name.replace('.', '/')}.py in {folder or Path()} and no "
                f"package {error.name!r} is installed"
            ) from None
    if not hasattr(module, attribute):
        public = [each for each in vars(module) if not each.startswith("_")]
        raise ArgumentError(unknown_name(f"name in {name}", attribute, public))
    return getattr(module, attribute)


@contextmanager
def _importable(name: str, folder: Path) -> Iterator[None]:
    """Have the folder's modules found first, and forget another folder's of the same name."""
    place = str(folder.resolve())
    known = sys.modules.get(name)
    own = folder.resolve().joinpath(*name.split(".")).with_suffix(".py")
    if known is not None and own.is_file():
        there = Path(known.__file__ or "").resolve()
        if "site-packages" in there.parts:
            raise ArgumentError(f"{own.name} has the name of an installed package: take another")
        if there != own:
            del sys.modules[name]
    importlib.invalidate_caches()
    sys.path.insert(0, place)
    try:
        yield
    finally:
        sys.path.remove(place)


@contextmanager
def blamed(folder: Path) -> Iterator[None]:
    """Turn what fails inside the folder's own Python into one line with its file and line.

    Raises:
        ArgumentError: In place of any error that came from, or through, a file of the folder.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        place = _place(error, folder.resolve())
        if place is None and _compiling(error):
            said = f"{type(error).__name__}: {error}"
            raise ArgumentError(
                f'numba cannot compile the law: {said}; engine = "python" runs it uncompiled'
            ) from error
        if place is None:
            raise
        plain = isinstance(error, (ArgumentError, ValueError)) and str(error)
        raise ArgumentError(f"{place}: {error if plain else _named(error)}") from error


def _named(error: BaseException) -> str:
    """What went wrong: of a compiler's page the reason before the place, of others the class."""
    if isinstance(error, NumbaError):
        page = str(error)
        places = [found for found in _COMPILED.finditer(page) if Path(found[1]).suffix == ".py"]
        before = page[: places[0].start()] if places else page
        reason = (_REASON.findall(before) or page.splitlines())[-1]
        return f'numba cannot compile this: {reason}; engine = "python" runs it uncompiled'
    said = str(getattr(error, "msg", error))
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def _place(error: BaseException, folder: Path) -> str | None:
    """The last place in the folder's files that an error came through: ``file.py:12``."""
    places: list[tuple[str, int | None]] = [
        (frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)
    ]
    if isinstance(error, SyntaxError):
        places.append((error.filename or "", error.lineno))
    if isinstance(error, NumbaError):
        places += [(file, int(line)) for file, line in _COMPILED.findall(str(error))]
    for file, line in reversed(places):
        path = Path(file)
        if path.suffix == ".py" and path.resolve().is_relative_to(folder) and not _foreign(path):
            return f"{path.name}:{line}"
    return None


def _compiling(error: BaseException) -> bool:
    """Whether it was numba that failed, without saying where."""
    frames = traceback.extract_tb(error.__traceback__)
    return "numba" in Path(frames[-1].filename).parts


def _foreign(path: Path) -> bool:
    """Whether a file is this package's or an installed one's, which may lie in the folder too."""
    return path.resolve().is_relative_to(_PACKAGE) or "site-packages" in path.parts
