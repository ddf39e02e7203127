"""Finished rows of a study, a file each, so that a killed study goes on where it was."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from pydantic import BaseModel

from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.files import atomic_write
from grosmc_mj.results.document import json_text
from grosmc_mj.studies.studied import Condition
from grosmc_mj.versions import source_digest, versions

Key = tuple[str | bool, ...]


class _Row(Protocol):
    """Row of a study, a pydantic model.

    Attributes:
        key: Key among all rows of the study.
    """

    @property
    def key(self) -> Key: ...


AnyRow = TypeVar("AnyRow", bound=_Row)


def study_key(configuration: Any, conditions: Sequence[Condition]) -> str:
    """Return all that the rows of a study depend on, as JSON: cases, versions and code.

    Args:
        configuration: Configuration of the study.
        conditions: Its conditions: their loads stand in files of other cases.
    """
    cases = []
    for condition in conditions:
        experiment = condition.experiment
        cases.append([case_document(experiment), experiment.document()])
    return json_text([configuration, cases, versions(), source_digest()])


@dataclass(frozen=True)
class Cells(Generic[AnyRow]):
    """Finished rows of one kind; the name of a file is a hash of all that its row depends on.

    Attributes:
        folder: Folder of the files.
        kind: Class of the rows, a pydantic model.
        study: Everything that the rows depend on, see ``study_key``.
    """

    folder: Path
    kind: type[AnyRow]
    study: str

    def read(self, *key: str | bool) -> AnyRow | None:
        """Return the row with a key; None if it is missing or cannot be read."""
        model: Any = self.kind
        try:
            content = json.loads(self._path(key).read_text(encoding="utf-8"))
            return model.model_validate(content)
        except (OSError, ValueError):
            return None

    def write(self, row: AnyRow) -> None:
        """Write a row aside and rename it.

        Raises:
            SetupError: If it cannot be written.
        """
        assert isinstance(row, BaseModel)
        with atomic_write(self._path(row.key)) as part:
            # Not by `json_text`, which writes infinite numbers as null.
            part.write_text(json.dumps(row.model_dump()), encoding="utf-8")

    def _path(self, key: Key) -> Path:
        name = hashlib.sha256(json.dumps([self.study, key]).encode()).hexdigest()
        return self.folder / f"{name[:32]}.json"
