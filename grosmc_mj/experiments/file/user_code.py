"""Python that a case file names: its sources, its import, and the place of its errors."""

from __future__ import annotations

import ast
import hashlib
import importlib
import re
import sys
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib import machinery
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

from grosmc_mj.ground.errors import ArgumentError, unknown_name, value_text
from grosmc_mj.ground.files import require_regular

_PACKAGE = Path(__file__).resolve().parents[2]
_NAMED = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def is_named(text: str) -> bool:
    """Whether a text has the form ``module:name``."""
    return ":" in text


def named_in(file: Any) -> list[str]:
    """Return each ``module:name`` that running a case file under any of its laws would import.

    Args:
        file: A ``CaseFile``.
    """
    texts = []
    if file.plant.plant:
        texts.append(file.plant.plant)
    if file.design:
        texts.append(file.design.plant)
    texts += [str(table.values.get("profile", "")) for table in file.disturbance]
    reference = file.task.reference or []
    if isinstance(reference, dict):
        reference = list(reference.values())
    # Several references are formulas.
    if len(reference) == 1:
        texts += reference
    texts.append(file.task.outputs.of)
    texts += [table.law for table in (*file.controller, *file.laws.values())]
    return list(dict.fromkeys(filter(is_named, texts)))


def sources(named: Iterable[str], folder: Path) -> dict[str, str]:
    """Return SHA-256 of the folder's own files that importing some names would run, by file.

    These are the modules, the packages that they are in, and all that these import from the
    folder. Imports are read, not carried out: one that is computed while the module runs is
    not found.

    Args:
        named: Texts of the form ``module:name``; modules of installed packages have no file here.
        folder: The folder in which Python would look first.
    """
    folder = folder.resolve()
    pending = [text.split(":")[0] for text in named if _NAMED.fullmatch(text)]
    visited = set()
    hashes = {}
    while pending:
        module = pending.pop()
        if module in visited:
            continue
        visited.add(module)
        for name, file in _files(module, folder):
            require_regular(file)
            content = file.read_bytes()
            hashes[file.relative_to(folder).as_posix()] = hashlib.sha256(content).hexdigest()
            package = name if file.name == "__init__.py" else name.rpartition(".")[0]
            pending += _imports(content, package)
    return dict(sorted(hashes.items()))


def _files(module: str, folder: Path) -> Iterator[tuple[str, Path]]:
    """Return the packages of a module of the folder and the module itself, with their files."""
    places = [str(folder)]
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        name = ".".join(parts[:depth])
        # As Python itself would find it, in its order: a package, a library, a file.
        spec = machinery.PathFinder.find_spec(name, places)
        if spec is None:
            return
        if spec.loader is not None and spec.origin is not None:
            yield name, Path(spec.origin)
        places = list(spec.submodule_search_locations or ())


def _imports(content: bytes, package: str) -> list[str]:
    """Return the names that the text of a module of a package imports, and that may be modules."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError):
        # A library, or a file that Python will refuse as well.
        return []
    modules = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                # An import from above the folder fails when the module runs.
                with suppress(ImportError):
                    base = resolve_name("." * node.level + base, package)
            modules.append(base)
            modules += [f"{base}.{alias.name}".lstrip(".") for alias in node.names]
    return list(filter(None, modules))


def load_named(text: str, folder: Path) -> Any:
    """Import ``module:name`` from a file in the folder, or from an installed package.

    Raises:
        ArgumentError: If it is missing, or the module cannot be imported.
    """
    if not _NAMED.fullmatch(text):
        raise ArgumentError(
            f"'{value_text(text, str)}' must be module:name, such as my_module:my_law of the file "
            "my_module.py beside the case file"
        )
    name, attribute = text.split(":")
    if name.endswith(".py"):
        raise ArgumentError(
            f"{text!r}: a module is named without .py: write {name.removesuffix('.py')}:{attribute}"
        )
    if name.split(".")[0] in sys.stdlib_module_names:
        raise ArgumentError(f"{text!r}: {name} is a module of Python itself: take another name")

    with blamed(folder), _importable(name, folder):
        try:
            module = importlib.import_module(name)
        except ModuleNotFoundError as error:
            # The module is there, and imports another one that is missing.
            if error.name is None or not f"{name}.".startswith(f"{error.name}."):
                raise
            raise ArgumentError(
                f"{text!r}: there is no {name.replace('.', '/')}.py in {folder or Path()} and no "
                f"package {error.name!r} is installed"
            ) from None

        except RecursionError as error:
            # Of the module as it runs, the place is told; Python's parser has none.
            if _place(error, folder.resolve()) is not None:
                raise
            raise ArgumentError(
                f"{text!r}: {name.replace('.', '/')}.py is nested too deep for Python: write its "
                "longest expressions as several statements"
            ) from None

    if not hasattr(module, attribute):
        public = [item for item in vars(module) if not item.startswith("_")]
        raise ArgumentError(unknown_name(f"name in {name}", attribute, public))
    return getattr(module, attribute)


@contextmanager
def _importable(name: str, folder: Path) -> Iterator[None]:
    """Have the folder's modules found first, and forget another folder's of the same name."""
    folder = folder.resolve()
    file = folder.joinpath(*name.split(".")).with_suffix(".py")
    imported = sys.modules.get(name)
    if imported is not None and file.is_file():
        imported_file = Path(imported.__file__ or "").resolve()
        if "site-packages" in imported_file.parts:
            raise ArgumentError(f"{file.name} has the name of an installed package: take another")
        if imported_file != file:
            del sys.modules[name]

    importlib.invalidate_caches()
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        sys.path.remove(str(folder))


@contextmanager
def blamed(folder: Path) -> Iterator[None]:
    """Turn an error inside the folder's own Python into one line with its file and line.

    Raises:
        ArgumentError: In place of any error that came from, or through, a file of the folder.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        place = _place(error, folder.resolve())
        if place is None:
            raise
        message = str(error)
        if not isinstance(error, (ArgumentError, ValueError)) or not message:
            message = _class_and_message(error)
        raise ArgumentError(f"{place}: {message}") from error


def _class_and_message(error: BaseException) -> str:
    """Return the error's class and message."""
    message = str(getattr(error, "msg", error))
    if not message:
        return type(error).__name__
    return f"{type(error).__name__}: {message}"


def _place(error: BaseException, folder: Path) -> str | None:
    """Return the last place in the folder's files that an error came through: ``file.py:12``."""
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
