"""The result of an export: its document, and the head comment of the C."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.user_code import named_in, sources
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.export.law import LawInC
from grosmc_mj.export.processor.on_processor import OnProcessor
from grosmc_mj.export.proof import Proof, Verdict
from grosmc_mj.ground.versions import versions
from grosmc_mj.ground.wording import counted, plural, unit_after
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

_COST_LEGEND = (
    "Measured by counting instructions in an emulator: no wait states, caches, interrupts. The "
    "time counts a cycle for each instruction."
)
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
        return f"{number(judgement.measured)}{unit_after(unit)}"
    if judgement.margin is not None:
        return f"margin {number(judgement.margin)}{unit_after(unit)}"
    return "-"


def _verdict(proof: Proof) -> Literal["not kept", "not decided", "measured", "kept"]:
    """Verdict on a proof."""
    if proof.overturned:
        return NOT_KEPT
    if proof.blind:
        return OPEN
    return KEPT if proof.equal else MEASURED


def cost_table(on: OnProcessor) -> Table:
    """Cost of a call on a processor."""
    processor = on.processor
    rows = [
        ("instructions a call, mean and most", f"{on.mean:.0f}, {on.most:.0f}"),
        ("code with constants and what it needs of the C library", f"{on.size.code} bytes"),
        ("memory of the law, variables of the C library", f"{on.memory}, {on.size.data} bytes"),
        ("stack below its caller", f"{on.stack} bytes"),
    ]
    if on.seconds is not None and on.clock is not None:
        share = on.seconds / on.period
        time = f"{1e6 * on.seconds:.3g} us, {100 * share:.2g} % of the control period"
        rows.append((f"estimated longest time at {on.clock / 1e6:g} MHz", time))
    title = f"Cost on {processor.title} ({processor.about})"
    return table(title, [*words("of"), *words("measured")], rows, legend=_COST_LEGEND)


def delay_table(on: OnProcessor) -> Table:
    """Requirements of the case with the computing time as a delay."""
    columns = [*names("plant"), *words("requirement"), *numbers("measured"), *words("kept")]
    rows = []
    for judged in on.delayed:
        kept = "yes" if judged.kept else "no"
        rows.append((judged.plant, judged.requirement.words, _measured(judged), kept))
    return table(f"With a computing time of {1e3 * on.delay:g} ms", columns, rows)


def _processor_answer(law: LawInC, on: OnProcessor) -> Answer:
    """Answer to the question whether a law is the same on a processor."""
    verdict = _verdict(on.proof)
    more = f"A call takes {on.mean:.0f} instructions, at most {on.most:.0f}."
    if on.seconds is not None:
        share = 100 * on.seconds / on.period
        more += f" That is about {1e6 * on.seconds:.3g} us, {share:.2g} % of the control period"
        more += ": an estimate without wait states, caches and interrupts."
    if on.delayed and not on.lost:
        more += f" With {1e3 * on.delay:g} ms more delay the verdicts of the case are the same."
    faults = [
        f"with {1e3 * on.delay:g} ms of computing time no longer kept: {judged.requirement.words}, "
        f"{_measured(judged)} on {judged.plant}"
        for judged in on.lost
    ]
    if on.lost:
        verdict = NOT_KEPT
    return Answer(
        question=f"{law.controller.name} on {on.processor.title}",
        verdict=verdict,
        words=on.words,
        more=more,
        faults=faults,
    )


def export_result(
    experiment: Experiment, law: LawInC, proof: Proof | None, on: OnProcessor | None = None
) -> Result:
    """Return the result of an export.

    Args:
        experiment: The case.
        law: The exported law.
        proof: Its proof; None without a compiler.
        on: The law on a processor; None if it was not asked for.
    """
    verdict = OPEN
    proven = NOT_PROVEN
    sheets = []
    if proof is not None:
        proven = proof.words
        verdict = _verdict(proof)
        if proof.verdicts:
            sheets.append(ReportTable(table=verdict_table(proof.verdicts), brief=True))
    words_ = f"{law.name}.c: {proven}"
    if proof is not None and proof.overturned:
        overturned = len(proof.overturned)
        words_ += f"; {counted(overturned, 'verdict')} {plural(overturned, 'differs', 'differ')}"
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
    answers = [answer]
    cost = None
    if on is not None:
        answers.append(_processor_answer(law, on))
        sheets.append(ReportTable(table=cost_table(on), brief=True))
        if on.delayed:
            sheets.append(ReportTable(table=delay_table(on), brief=True))
        cost = {
            "processor": on.processor.title,
            "instructions": {"mean": on.mean, "most": on.most},
            "code_bytes": on.size.code,
            "data_bytes": on.size.data,
            "stack_bytes": on.stack,
            "samples": on.proof.samples,
            "different": on.proof.different,
            "clock": on.clock,
            "delay": on.delay,
        }
    memory = len(law.memory.places) * (4 if law.real == "float" else 8)
    return result(
        "export",
        configuration,
        answers=answers,
        sheets=sheets,
        memory_bytes=memory,
        samples=proof.samples if proof else 0,
        different=proof.different if proof else None,
        on_processor=cost,
    )
