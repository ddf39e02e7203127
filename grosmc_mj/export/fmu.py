"""An exported law as a source FMU, for co-simulation by FMI 2.0.

The FMU has the same C. It samples the law at k T; its parameters are the start of the estimators.
"""

from __future__ import annotations

import uuid
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from grosmc_mj.export.law import LawInC
from grosmc_mj.export.templates import rendered
from grosmc_mj.ground.files import atomic_write
from grosmc_mj.ground.versions import versions


class _Variable(NamedTuple):
    """A variable of the FMU.

    Attributes:
        name: Its name.
        unit: Its unit.
        causality: ``input``, ``parameter`` or ``output``.
        start: Value to begin with.
    """

    name: str
    unit: str
    causality: str
    start: float = 0.0


def write_fmu(law: LawInC, x0: Sequence[float], folder: Path) -> Path:
    """Write NAME.fmu into a folder, and return its path.

    Args:
        law: The exported law.
        x0: State that estimators begin with, unless the importer sets another one, (n,).
        folder: The folder.
    """
    values: dict[str, Any] = {
        "law": law,
        "variables": _variables(law, x0),
        "guid": f"{{{uuid.uuid5(uuid.NAMESPACE_URL, law.header + law.source)}}}",
        "program": f"grosmc_mj {versions(('grosmc_mj',))['grosmc_mj']}",
    }
    files = {
        "modelDescription.xml": rendered("modelDescription.xml", **values),
        "sources/fmu.c": rendered("fmu.c", **values),
        f"sources/{law.name}.c": law.source,
        f"sources/{law.name}.h": law.header,
    }
    path = folder / f"{law.name}.fmu"
    with atomic_write(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def _variables(law: LawInC, x0: Sequence[float]) -> list[_Variable]:
    """Signals that the step reads, the state that a run begins with, and inputs of the plant."""
    variables = [_Variable(signal.name, signal.unit, "input") for signal in law.signals]
    if law.loop is not None:
        variables += [_Variable(f"new {signal.name}", "1", "input", 1.0) for signal in law.signals]
        for signal, start in zip(law.system.states, x0, strict=True):
            name = f"start {signal.name}"
            variables.append(_Variable(name, signal.unit, "parameter", float(start)))
    outputs = [_Variable(signal.name, signal.unit, "output") for signal in law.system.inputs]
    return variables + outputs
