"""Python that a case file names, and whose fault it is when it fails."""

from __future__ import annotations

import ast
import hashlib
import importlib
import re
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import machinery
from pathlib import Path
from typing import Any

from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.file.schema import CaseFile

_PACKAGE = Path(__file__).resolve().parents[2]
_NAMED = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def is_named(text: str) -> bool:
    """Whether a text has the form ``module:name``."""
    return ":" in text


def named_in(file: CaseFile) -> list[str]:
    """Each ``module:name`` of a case file, which running it under any of its laws would import."""
    reference = file.task.reference or []
    texts = [
        file.plant.plant or "",
        file.design.plant if file.design else "",
        *(table.profile for table in file.disturbance),
        *(reference if len(reference) == 1 else ()),
        file.task.outputs.of,
        *(table.law for table in (*file.controller, *file.laws.values())),
    ]
    return list(dict.fromkeys(filter(is_named, texts)))


def sources(named: Iterable[str], folder: Path) -> dict[str, str]:
    """SHA-256 of the folder's own files that importing what is named would run, by file.

    These are the modules, the packages that they are in, and what all of them import from the
    folder. Imports are read, not carried out: one that is computed while the module runs is
    not seen.

    Args:
        named: Texts of the form ``module:name``; modules of installed packages have no file here.
        folder: Where Python would look first.
    """
    folder = folder.resolve()
    unseen = [text.split(":")[0] for text in named if _NAMED.fullmatch(text)]
    seen, hashes = set(), {}
    while unseen:
        module = unseen.pop()
        if module in seen:
            continue
        seen.add(module)
        for name, file in _files(module, folder):
            content = file.read_bytes()
            hashes[file.relative_to(folder).as_posix()] = hashlib.sha256(content).hexdigest()
            unseen += _imports(content, name, package=file.name == "__init__.py")
    return dict(sorted(hashes.items()))


def _files(module: str, folder: Path) -> Iterator[tuple[str, Path]]:
    """The modules, with their files, that importing a module of the folder begins with."""
    places, parts = [str(folder)], module.split(".")
    for depth in range(1, len(parts) + 1):
        name = ".".join(parts[:depth])
        # As Python itself would find it, in its order: a package, a library, a file.
        if (spec := machinery.PathFinder.find_spec(name, places)) is None:
            return
        if spec.loader is not None and spec.origin is not None:
            yield name, Path(spec.origin)
        places = list(spec.submodule_search_locations or ())


def _imports(content: bytes, module: str, *, package: bool) -> list[str]:
    """Names that the text of a module imports, and that may be modules."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        # A library, or what Python will refuse as well.
        return []
    modules = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            # One dot is the package that a module is in.
            up = module.split(".")[: -node.level + package or None] if node.level else []
            base = ".".join([*up, *filter(None, [node.module])])
            modules += [base, *(f"{base}.{alias.name}".lstrip(".") for alias in node.names)]
    return [name for name in modules if name]


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
        public = [item for item in vars(module) if not item.startswith("_")]
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
        if place is None:
            raise
        plain = isinstance(error, (ArgumentError, ValueError)) and str(error)
        raise ArgumentError(f"{place}: {error if plain else _named(error)}") from error


def _named(error: BaseException) -> str:
    """What went wrong: the error's class and message."""
    message = str(getattr(error, "msg", error))
    return f"{type(error).__name__}: {message}" if message else type(error).__name__


def _place(error: BaseException, folder: Path) -> str | None:
    """The last place in the folder's files that an error came through: ``file.py:12``."""
    places: list[tuple[str, int | None]] = [
        (frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)
    ]
    if isinstance(error, SyntaxError):
        places.append((error.filename or "", error.lineno))
    for file, line in reversed(places):
        path = Path(file)
        if path.suffix == ".py" and path.resolve().is_relative_to(folder) and not _foreign(path):
            return f"{path.name}:{line}"
    return None


def _foreign(path: Path) -> bool:
    """Whether a file is this package's or an installed one's, which may lie in the folder too."""
    return path.resolve().is_relative_to(_PACKAGE) or "site-packages" in path.parts
