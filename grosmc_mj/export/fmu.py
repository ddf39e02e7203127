"""An exported law as a source FMU, for co-simulation by FMI 2.0.

The FMU has the same C. It samples the law at k T; its parameters are the start of the estimators.
"""

from __future__ import annotations

import uuid
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from grosmc_mj.export.law import LawInC
from grosmc_mj.export.loop import LoopInC
from grosmc_mj.export.templates import rendered
from grosmc_mj.plants import Signal
from grosmc_mj.versions import versions


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
    variables = _variables(law, x0)
    guid = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, law.header + law.source)}}}"
    files = {
        "modelDescription.xml": _description(law, variables, guid),
        "sources/fmu.c": _source(law, variables, guid),
        f"sources/{law.name}.c": law.source,
        f"sources/{law.name}.h": law.header,
    }
    path = folder / f"{law.name}.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return path


def _variables(law: LawInC, x0: Sequence[float]) -> list[_Variable]:
    """Signals that the step reads, the state that a run begins with, and inputs of the plant."""
    states = law.system.states
    variables = _signals(states, "input")
    if isinstance(law, LoopInC):
        measured = [states[j] for j in law.measured]
        variables = _signals(measured, "input")
        variables += [_Variable(f"new {signal.name}", "1", "input", 1.0) for signal in measured]
        for signal, start in zip(states, x0, strict=True):
            variables.append(_Variable(f"start {signal.name}", signal.unit, "parameter", start))
    return variables + _signals(law.system.inputs, "output")


def _signals(signals: Sequence[Signal], causality: str) -> list[_Variable]:
    """Variables of some signals."""
    return [_Variable(signal.name, signal.unit, causality) for signal in signals]


def _source(law: LawInC, variables: Sequence[_Variable], guid: str) -> str:
    """C of the FMU's functions."""
    measured = 0
    ticks = 0
    if isinstance(law, LoopInC):
        measured = len(law.measured)
        ticks = round(law.period / law.loop.timestep)
    return rendered(
        "fmu.c",
        law=law,
        guid=guid,
        variables=variables,
        settable=len(variables) - len(law.system.inputs),
        measured=measured,
        ticks=ticks,
    )


def _description(law: LawInC, variables: Sequence[_Variable], guid: str) -> bytes:
    """The model description, ``modelDescription.xml``."""
    element = ElementTree.SubElement
    program = f"grosmc_mj {versions(('grosmc_mj',))['grosmc_mj']}"
    attributes = {"fmiVersion": "2.0", "modelName": law.name, "guid": guid}
    root = ElementTree.Element("fmiModelDescription", attributes, generationTool=program)

    simulated = element(
        root,
        "CoSimulation",
        modelIdentifier=law.name,
        canHandleVariableCommunicationStepSize="true",
    )
    sources = element(simulated, "SourceFiles")
    for name in ("fmu.c", f"{law.name}.c"):
        element(sources, "File", name=name)

    units = element(root, "UnitDefinitions")
    for unit in dict.fromkeys(variable.unit for variable in variables):
        element(units, "Unit", name=unit)
    element(root, "DefaultExperiment", startTime="0", stepSize=repr(law.period))

    listed = element(root, "ModelVariables")
    structure = element(root, "ModelStructure")
    outputs = element(structure, "Outputs")
    initial = element(structure, "InitialUnknowns")
    for number, variable in enumerate(variables):
        is_output = variable.causality == "output"
        described = element(
            listed,
            "ScalarVariable",
            name=variable.name,
            valueReference=str(number),
            causality=variable.causality,
            variability="fixed" if variable.causality == "parameter" else "discrete",
        )
        real = element(described, "Real", unit=variable.unit)
        if is_output:
            element(outputs, "Unknown", index=str(number + 1))
            element(initial, "Unknown", index=str(number + 1))
        else:
            real.set("start", repr(float(variable.start)))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
