"""The results in files and folders; a file that cannot be read is named, and stops nothing."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError

from grosmc_mj.errors import ArgumentError, one_line
from grosmc_mj.results.result import Number, Part, Provenance, Result, Text

# Kinds of results that have claims of the chapter with their measurements.
_WITH_CLAIMS = ("claims", "validation")
# Bytes of a document, and of all of them; letters of a reason.
_LARGEST, _ALL, _REASON = 40 * 2**20, 200 * 2**20, 160


class Measured(Part):
    """A claim's value on one plant."""

    value: Number = None
    note: Text = ""
    verdict: Text


class Expected(Part):
    """The verdicts that are expected of a claim."""

    verdicts: dict[str, Text] = Field(default={})
    reason: Text = ""


class Claim(Part):
    """A claim of the chapter with its measurements."""

    id: Text
    system: Text
    source: Text = ""
    statement: Text
    equation: Text = ""
    criterion: Text = ""
    sense: Text = "at most"
    threshold: Number = None
    unit: Text = "1"
    why: Text = ""
    cause: Text = ""
    verdict: Text
    because: Text = ""
    untested: Text = ""
    plants: dict[str, Measured] = Field(default={})
    expected: Expected = Expected()


class ClaimsResult(Result):
    """A result with claims of the chapter."""

    claims: Sequence[Claim] = ()


class Line(Part):
    """Values over time [s]."""

    t: list[float]
    y: list[float]


class Limit(Line):
    """The limit of a requirement."""

    words: Text


class Curve(Line):
    """A curve of a run; ``range`` is of one that jumps, which y is the mean of then."""

    law: Text
    plant: Text
    name: Text = ""
    range: tuple[list[float], list[float]] | None = None


class Panel(Part):
    """One quantity over time; ``play`` is a gear's backlash."""

    label: Text
    curves: list[Curve]
    reference: Line | None = None
    limits: Sequence[Limit] = ()
    play: float = 0.0


class Window(Part):
    """When a disturbance acts [s]."""

    start: float
    stop: float
    label: Text = ""


class LawStyle(Part):
    """How a law is drawn."""

    label: Text
    colour: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class Curves(Provenance):
    """The curves of a case."""

    system: Text
    case: Text
    title: Text = ""
    duration: float
    disturbances: Sequence[Window] = ()
    laws: dict[str, LawStyle] = Field(default={})
    panels: list[Panel]


class FilmedCase(Part):
    """The case of a film."""

    system: Text = ""
    case: Text = ""


class FilmClock(Part):
    """A film's time: ``start`` [s] of the run, and run seconds in a second of the film."""

    speed: Annotated[float, Field(gt=0)] = 1.0
    start: float = 0.0


class FilmConfiguration(Part):
    """What a film was made from."""

    case: FilmedCase = FilmedCase()
    film: FilmClock = FilmClock()


class Film(Provenance):
    """The document beside a film."""

    configuration: FilmConfiguration = FilmConfiguration()
    drawn_from: Text
    sha256: Text


class Document(NamedTuple):
    """A document of results.

    Attributes:
        path: Its file.
        content: Its fields that are shown.
        sha256: Of its file.
        modified: When its file was written [s].
    """

    path: Path
    content: Result | Curves | Film
    sha256: str
    modified: float

    @property
    def kind(self) -> str:
        """The kind of result."""
        content = self.content
        return content.kind if isinstance(content, Result) else type(content).__name__.lower()


class Results(NamedTuple):
    """The documents, the newest last, and a line for each file that cannot be read."""

    documents: list[Document]
    notices: list[str]


def read_results(paths: Sequence[Path]) -> Results:
    """The results in files and folders, each once.

    Raises:
        ArgumentError: If a path is not there.
    """
    for path in paths:
        # A device is read without end.
        if not path.is_dir() and not path.is_file():
            raise ArgumentError(
                f"{path} {'is neither a file nor a folder' if path.exists() else 'does not exist'}"
            )
    results = Results([], [])
    size, seen = 0, set[Path]()
    for file in (file for path in paths for file in _files(path)):
        if (real := file.resolve()) in seen:
            continue
        seen.add(real)
        try:
            size += file.stat().st_size
            if size > _ALL:
                results.notices.append(f"{file} and the next ones: too much for one page")
                break
            if (document := _document(file)) is not None:
                results.documents.append(document)
        except (OSError, ValueError, RecursionError, ArithmeticError) as error:
            results.notices.append(f"{file}: {_reason(error)}")
    results.documents.sort(key=lambda document: document.modified)
    return results


def _files(path: Path) -> Iterator[Path]:
    """The JSON files of a path in order of their names; links to folders are not followed."""
    if not path.is_dir():
        yield path
        return
    for folder, folders, files in os.walk(path):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            file = Path(folder, name)
            if name.endswith(".json") and not name.startswith(".") and file.is_file():
                yield file


def _document(file: Path) -> Document | None:
    """A document; None for a file of another program, or one that only programs read.

    Raises:
        ValueError: If it is one of ours that cannot be read.
    """
    if file.stat().st_size > _LARGEST:
        raise ValueError(f"is larger than {_LARGEST >> 20} MB")
    text = file.read_bytes()
    content = json.loads(text)
    if not isinstance(content, dict) or "schema_version" not in content:
        return None
    if {"panels", "laws"} <= content.keys():
        model: type[Result | Curves | Film] = Curves
    elif {"drawn_from", "sha256"} <= content.keys():
        model = Film
    elif "answers" in content:
        model = ClaimsResult if content.get("kind") in _WITH_CLAIMS else Result
    else:
        return None
    shown = model.model_validate_json(text)
    return Document(file, shown, hashlib.sha256(text).hexdigest(), file.stat().st_mtime)


def _reason(error: Exception) -> str:
    """Why a document cannot be read, in short."""
    if isinstance(error, ValidationError):
        first: Any = error.errors(include_url=False, include_input=False)[0]
        reason = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    elif isinstance(error, UnicodeDecodeError | json.JSONDecodeError):
        reason = "is no whole JSON"
    elif isinstance(error, RecursionError):
        reason = "is nested too deeply"
    else:
        reason = str(error) or type(error).__name__
    return one_line(reason)[:_REASON]
