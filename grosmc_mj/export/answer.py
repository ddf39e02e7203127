"""The result of an export: its document, and the head comment of the C."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.proof import Proof, Verdict
from grosmc_mj.ground.versions import versions
from grosmc_mj.output.results.result import (
    KEPT,
    MEASURED,
    NOT_KEPT,
    OPEN,
    Answer,
    ReportTable,
    Result,
    result,
)
from grosmc_mj.output.results.tables import Table, names, number, numbers, table, words
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.kinds.pid import PidNumbers

NOT_PROVEN = "not proven: there is no C compiler here"


def case_hash(experiment: Experiment) -> str:
    """Return the SHA-256 of all values of a case, and of the user's own Python that it names.

    The values of the files that the case extends are among them.
    """
    file = experiment.file
    code = sources(named_in(file), experiment.path.parent)
    text = json.dumps([file.content, code], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def about(
    experiment: Experiment,
    controller: Controller,
    proven: str,
    real: str,
) -> list[str]:
    """Return the paragraphs of the head comment.

    Args:
        experiment: The case.
        controller: Its controller.
        proven: How the C was proven.
        real: ``double`` or ``float``.
    """
    design = controller.design
    source = design.source if design is not None and design.source else "a law of one's own"
    period = experiment.settings.control_period
    tools = versions(("grosmc_mj", "numpy", "sympy"))
    listed = ", ".join(f"{name} {version}" for name, version in tools.items())
    precision = "double" if real == "double" else "single"
    paragraphs = [
        f"{controller.name} of {experiment.target}: {experiment.title}. Its source: {source}.",
        f"Control period {period:g} s, {precision} precision. {_limits(controller)}",
        f"Written by {listed} from {experiment.path.name} and the files that it extends, whose "
        f"values have the SHA-256 {case_hash(experiment)}.",
        f"Proof: {proven}.",
    ]
    if real == "float":
        paragraphs.append(
            "In single precision the surface is integrated by the control period, not by the "
            "difference of two times."
        )
    return paragraphs


def _limits(controller: Controller) -> str:
    """Sentence on the limits that the law keeps its inputs within."""
    p = controller.parameters
    limit = getattr(p, "limit", None)
    if isinstance(limit, float) and math.isfinite(limit):
        return f"The law knows a limit of {limit:g} of its inputs."
    if isinstance(p, PidNumbers) and np.isfinite([p.low, p.high]).any():
        ranges = [f"{low:g} to {high:g}" for low, high in zip(p.low, p.high, strict=True)]
        return f"The law keeps its inputs within {' and '.join(ranges)}."
    return "The law knows no limit of its inputs: the actuator has to keep them."


def verdict_table(verdicts: Sequence[Verdict]) -> Table:
    """Requirements on the runs of the case, by the Python law and by the C."""
    columns = [*names("plant"), *words("requirement"), *numbers("Python", "C"), *words("kept")]
    rows = []
    for python, in_c in verdicts:
        kept = "yes" if in_c.kept else "no"
        if python.kept != in_c.kept:
            kept += ", by Python " + ("yes" if python.kept else "no")
        rows.append(
            (
                python.plant,
                python.requirement.words,
                _measured(python),
                _measured(in_c),
                kept,
            )
        )
    return table("Requirements", columns, rows)


def _measured(judgement: Judgement) -> str:
    """Measured value, or the margin of a formula that has no other, with its unit."""
    unit = judgement.requirement.unit
    if judgement.measured is not None:
        return f"{number(judgement.measured)} {unit}".strip()
    if judgement.margin is not None:
        return f"margin {number(judgement.margin)} {unit}".strip()
    return "-"


def export_result(experiment: Experiment, law: LawInC, proof: Proof | None) -> Result:
    """Return the result of an export.

    Args:
        experiment: The case.
        law: The exported law.
        proof: Its proof; None without a compiler.
    """
    verdict = OPEN
    proven = NOT_PROVEN
    sheets = []
    if proof is not None:
        proven = proof.words
        verdict = KEPT if proof.equal else MEASURED
        if proof.blind:
            verdict = OPEN
        if proof.overturned:
            verdict = NOT_KEPT
        if proof.verdicts:
            sheets.append(ReportTable(table=verdict_table(proof.verdicts), brief=True))
    words_ = f"{law.name}.c: {proven}"
    if proof is not None and proof.overturned:
        words_ += f"; {len(proof.overturned)} verdicts differ"
    configuration = {
        "case": str(experiment.path),
        "law": law.controller.name,
        "sha256": case_hash(experiment),
        "control_period": law.period,
        "real": law.real,
    }
    answer = Answer(
        question=f"{law.controller.name} of {experiment.target} as C",
        verdict=verdict,
        words=words_,
    )
    memory = len(law.memory.places) * (4 if law.real == "float" else 8)
    return result(
        "export",
        configuration,
        answers=[answer],
        sheets=sheets,
        memory_bytes=memory,
        samples=proof.samples if proof else 0,
        different=proof.different if proof else None,
    )
