"""Results in files and folders, as documents; what cannot be read is said, and stops nothing."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from grosmc_mj.errors import ArgumentError, one_line
from grosmc_mj.page.documents import (
    StoredCampaignResults,
    StoredClaims,
    StoredCurves,
    StoredDiff,
    StoredFilm,
    StoredLadder,
    StoredPart,
    StoredProvenance,
    StoredRunResults,
    StoredTolerances,
    StoredValidation,
)
from grosmc_mj.page.studies.documents import (
    StoredPremises,
    StoredRegion,
    StoredSweeps,
    StoredSwitching,
)
from grosmc_mj.page.studies.searches import StoredSearch, StoredSelfTest

# By the keys that tell them, the more telling first.
KINDS: tuple[tuple[str, frozenset[str], type[StoredPart]], ...] = (
    ("validation", frozenset({"as_recorded", "runs"}), StoredValidation),
    ("run", frozenset({"requirements", "runs"}), StoredRunResults),
    ("curves", frozenset({"panels", "laws"}), StoredCurves),
    ("tolerance", frozenset({"tolerances"}), StoredTolerances),
    ("ladder", frozenset({"standings"}), StoredLadder),
    ("claims", frozenset({"claims"}), StoredClaims),
    ("campaign", frozenset({"pass_rates"}), StoredCampaignResults),
    ("diff", frozenset({"compared", "changes"}), StoredDiff),
    ("region", frozenset({"maps", "outcomes"}), StoredRegion),
    ("switching", frozenset({"benchmark", "cases"}), StoredSwitching),
    ("sweep", frozenset({"sweeps"}), StoredSweeps),
    ("premises", frozenset({"premises"}), StoredPremises),
    ("self-test", frozenset({"noticed_by"}), StoredSelfTest),
    ("search", frozenset({"controllers", "says"}), StoredSearch),
    ("film", frozenset({"drawn_from", "sha256"}), StoredFilm),
)
# What is told of the others: no more than where they come from.
OTHER = "other"
# Bytes of a document, and of all; how many documents; letters of a reason.
_LARGEST, _ALL, _MOST, _REASON = 40 * 2**20, 200 * 2**20, 400, 160


class Document(NamedTuple):
    """A document of results.

    Attributes:
        path: Its file.
        kind: One of those in ``KINDS``, or ``OTHER``.
        content: What the page reads of it; None of another kind.
        provenance: Where it comes from.
        sha256: Of its file.
        modified: When its file was written [s].
    """

    path: Path
    kind: str
    content: BaseModel | None
    provenance: StoredProvenance
    sha256: str
    modified: float


class Results(NamedTuple):
    """What was found, and what could not be read, a line each."""

    documents: list[Document]
    notices: list[str]


def read_results(paths: Sequence[Path]) -> Results:
    """The results in files and folders, each once.

    Raises:
        ArgumentError: If a path is not there.
    """
    for path in paths:
        if not path.exists():
            raise ArgumentError(f"{path} does not exist")
        # A device is read without end.
        if not path.is_dir() and not path.is_file():
            raise ArgumentError(f"{path} is neither a file nor a folder")
    found = Results([], [])
    size, seen = 0, set[Path]()
    for file in (file for path in paths for file in _files(path)):
        if (real := file.resolve()) in seen:
            continue
        seen.add(real)
        try:
            size += file.stat().st_size
            if size > _ALL or len(found.documents) >= _MOST:
                found.notices.append(f"{file} and what follows: too much for one page")
                break
            if (document := _document(file)) is not None:
                found.documents.append(document)
        except (OSError, ValueError, RecursionError, ArithmeticError) as error:
            found.notices.append(f"{file}: {_reason(error)}")
    return found


def _files(path: Path) -> Iterator[Path]:
    """The JSON files of a path, in order of their names; links to folders are not followed."""
    if not path.is_dir():
        yield path
        return
    for folder, folders, files in os.walk(path):
        folders[:] = sorted(each for each in folders if not each.startswith("."))
        for name in sorted(files):
            file = Path(folder, name)
            if name.endswith(".json") and not name.startswith(".") and file.is_file():
                yield file


def _document(file: Path) -> Document | None:
    """A document; None for a file of another program.

    Raises:
        ValueError: If it is none of ours that can be read.
    """
    if file.stat().st_size > _LARGEST:
        raise ValueError(f"is larger than {_LARGEST >> 20} MB")
    text = file.read_bytes()
    # What is no number stands for nothing, as our own documents have it.
    content = json.loads(text, parse_constant=lambda _: None)
    if not isinstance(content, dict):
        return None
    kind, model = next(
        (
            (kind, model)
            for kind, keys, model in KINDS
            # Every result of the one form has standings, most of them none.
            if keys <= content.keys() and (kind != "ladder" or content["standings"])
        ),
        (OTHER, None),
    )
    if model is None and "schema_version" not in content:
        return None
    return Document(
        file,
        kind,
        None if model is None else model.model_validate(content),
        StoredProvenance.model_validate(content),
        hashlib.sha256(text).hexdigest(),
        file.stat().st_mtime,
    )


def _reason(error: Exception) -> str:
    """Why a document cannot be read, in short."""
    if isinstance(error, ValidationError):
        first: Any = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(each) for each in first["loc"])
        said = f"{where}: {first['msg']}"
    elif isinstance(error, UnicodeDecodeError | json.JSONDecodeError):
        said = "is no whole JSON"
    elif isinstance(error, RecursionError):
        said = "is nested too deeply"
    else:
        said = str(error) or type(error).__name__
    return one_line(said)[:_REASON]
