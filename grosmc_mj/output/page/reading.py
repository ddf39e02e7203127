"""Reading of results in files and folders; a file that cannot be read is listed and left out."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import Field, ValidationError

from grosmc_mj.ground.errors import ArgumentError, one_line
from grosmc_mj.ground.refusals import RefusedPlace, line_of
from grosmc_mj.output.results.result import Part, Provenance, Result, Text

# Largest size of a document, and of all documents of a page [byte].
_LARGEST_DOCUMENT = 40 * 2**20
_LARGEST_PAGE = 200 * 2**20
# Ending of the name of a document that a later run set aside.
_SET_ASIDE = re.compile(r"\.previous\d*\.json$")
# Largest number of letters of the reason why a file cannot be read.
_LONGEST_REASON = 160


class RecordedLine(Part):
    """Values y over time t [s]."""

    t: list[float]
    y: list[float]


class LimitLine(RecordedLine):
    """Limit of a requirement over time."""

    words: Text


class RecordedCurve(RecordedLine):
    """Curve of a run; if it jumps at every sample, y is its mean and ``range`` its range."""

    law: Text
    plant: Text
    name: Text = ""
    range: tuple[list[float], list[float]] | None = None


class CurvePanel(Part):
    """One quantity over time; ``play`` is a gear's backlash."""

    label: Text
    curves: list[RecordedCurve]
    reference: RecordedLine | None = None
    limits: Sequence[LimitLine] = ()
    play: float = 0.0


class DisturbanceWindow(Part):
    """Time window of a disturbance [s]."""

    start: float
    stop: float
    label: Text = ""


class LawColour(Part):
    """Colour of a law in charts."""

    colour: Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]


class Curves(Provenance):
    """Curves of a case."""

    system: Text
    case: Text
    title: Text = ""
    duration: float
    disturbances: Sequence[DisturbanceWindow] = ()
    laws: dict[str, LawColour] = Field(default={})
    panels: list[CurvePanel]


class FilmedCase(Part):
    """Case that a film shows."""

    system: Text = ""
    case: Text = ""


class FilmClock(Part):
    """Time of a film: its ``start`` in the run [s], and seconds of the run in one of the film."""

    speed: Annotated[float, Field(gt=0)] = 1.0
    start: float = 0.0


class FilmConfiguration(Part):
    """Configuration of a film: its case and its time."""

    case: FilmedCase = FilmedCase()
    film: FilmClock = FilmClock()


class FilmDocument(Provenance):
    """Document beside a film."""

    configuration: FilmConfiguration = FilmConfiguration()
    drawn_from: Text
    sha256: Text


class Document(NamedTuple):
    """A document of results.

    Attributes:
        path: Path of its file.
        content: Fields of it that the page shows.
        sha256: SHA-256 of its file.
        modified: Time at which its file was written [s].
    """

    path: Path
    content: Result | Curves | FilmDocument
    sha256: str
    modified: float

    @property
    def kind(self) -> str:
        """Kind of document: that of its result, ``curves`` or ``film``."""
        return self.content.kind

    @property
    def earlier(self) -> bool:
        """True if it was set aside, see ``set_aside_other``: a later run was of something else."""
        return _SET_ASIDE.search(self.path.name) is not None


# Classes of the documents that are no results.
_MODELS: Mapping[str, type[Curves | FilmDocument]] = {"curves": Curves, "film": FilmDocument}


class Results(NamedTuple):
    """Documents, the newest last, and a line for each file that cannot be read."""

    documents: list[Document]
    notices: list[str]


def read_results(paths: Sequence[Path]) -> Results:
    """Read the results in files and folders, each file once.

    Raises:
        ArgumentError: If a path does not exist, or is a device.
    """
    for path in paths:
        if not path.exists():
            raise ArgumentError(f"{path} does not exist")
        # Reading a device may never end.
        if not path.is_dir() and not path.is_file():
            raise ArgumentError(f"{path} is neither a file nor a folder")

    documents: list[Document] = []
    notices: list[str] = []
    size = 0
    for file in _distinct_files(paths):
        try:
            size += file.stat().st_size
            if size > _LARGEST_PAGE:
                notices.append(f"{file} and the next ones: too much for one page")
                break
            document = _document(file)
            if document is not None:
                documents.append(document)
        except (OSError, ValueError, RecursionError, ArithmeticError) as error:
            notices.append(f"{file}: {_reason(error)}")

    documents.sort(key=lambda document: document.modified)
    return Results(documents, notices)


def _distinct_files(paths: Sequence[Path]) -> Iterator[Path]:
    """Yield the files of all paths; one that several paths lead to only once."""
    targets: set[Path] = set()
    for path in paths:
        for file in _files(path):
            target = file.resolve()
            if target not in targets:
                targets.add(target)
                yield file


def _files(path: Path) -> Iterator[Path]:
    """Yield the JSON files of a path by name; links to folders are not followed."""
    if not path.is_dir():
        yield path
        return

    for folder, folders, files in os.walk(path):
        # `os.walk` descends into the folders that remain in its list.
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            file = Path(folder, name)
            if name.endswith(".json") and not name.startswith(".") and file.is_file():
                yield file


def _document(file: Path) -> Document | None:
    """Read a document; None for a file of another program.

    Raises:
        ValueError: If a document of this package cannot be read.
    """
    if file.stat().st_size > _LARGEST_DOCUMENT:
        raise ValueError(f"is larger than {_LARGEST_DOCUMENT >> 20} MB")
    text = file.read_bytes()
    content = json.loads(text)
    if not isinstance(content, dict) or not {"kind", "schema_version"} <= content.keys():
        return None

    model = _MODELS.get(str(content["kind"]), Result)
    return Document(
        path=file,
        content=model.model_validate_json(text),
        sha256=hashlib.sha256(text).hexdigest(),
        modified=file.stat().st_mtime,
    )


def _reason(error: Exception) -> str:
    """Write in short why a document cannot be read."""
    if isinstance(error, ValidationError):
        mistake: Any = error.errors(include_url=False)[0]
        place = RefusedPlace(".".join(map(str, mistake["loc"])), "key", ())
        reason = line_of(mistake, place)
    elif isinstance(error, UnicodeDecodeError | json.JSONDecodeError):
        reason = "it is no whole JSON"
    elif isinstance(error, RecursionError):
        reason = "it is nested too deeply"
    else:
        reason = str(error) or type(error).__name__
    return one_line(reason)[:_LONGEST_REASON]
