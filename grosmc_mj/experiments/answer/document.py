"""NAME.json of a run: all measured values, and all settings needed to repeat the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.experiments.answer.tables import (
    LEGEND,
    gains_table,
    requirements_table,
    results_table,
)
from grosmc_mj.experiments.case_document import case_document, seed_of
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.measured import MeasuredResult
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.experiments.requirements.metrics import tolerance_of
from grosmc_mj.experiments.weights import named_gains, named_weights
from grosmc_mj.ground.wording import counted, counted_of, unit_after
from grosmc_mj.output.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    ReportTable,
    Result,
    Standing,
    Value,
    finite,
    result,
)
from grosmc_mj.output.results.tables import Table, number
from grosmc_mj.output.results.verdicts import (
    Verdict,
    standings,
    verdict_of,
    worst_failed,
    worst_of,
)


def experiment_result(
    experiment: Experiment,
    results: Sequence[RunResult],
    judgements: Sequence[Judgement],
    *,
    complete: bool,
    draws: int = 1,
    faults: Sequence[str] = (),
    notes: Sequence[str] = (),
    remarks: Sequence[str] = (),
    tables: Sequence[Table] = (),
    premises: Sequence[Mapping[str, Any]] = (),
) -> Result:
    """Return the result of a run.

    Args:
        experiment: The experiment of the case file.
        results: Its runs, in order.
        judgements: Judgements of these runs.
        complete: Whether all its runs are done.
        draws: Draws that simulated runs are judged over.
        faults: Runs that ended early and premises that fail, a line each.
        notes: Notes beside the verdict, a line each.
        remarks: Lines on loop and machine.
        tables: Further tables, for a full answer.
        premises: Premises of its laws, as plain values; left out if there are none.
    """
    target = experiment.target
    configuration = {
        **asdict(experiment.settings),
        "cases": [case_document(experiment)],
        "file": experiment.document(),
    }
    measured = [run for run in results if isinstance(run, MeasuredResult)]
    if measured:
        configuration["logs"] = [_log_document(run) for run in measured]

    sheets = []
    if judgements:
        sheets.append(ReportTable(table=requirements_table(judgements, draws), brief=True))
    if results:
        runs = results_table(results, draws).model_copy(update={"legend": LEGEND})
        sheets.append(ReportTable(table=runs, brief=True))
    simulated = [run for run in results if run.simulated]
    if simulated:
        sheets.append(ReportTable(table=gains_table(simulated)))
    sheets += [ReportTable(table=table) for table in tables]
    verdicts = verdicts_of(experiment.name, results, judgements)
    further: dict[str, Any] = {}
    if premises:
        further["premises"] = list(premises)

    return result(
        "run",
        configuration,
        seed=seed_of(experiment),
        complete=complete,
        answers=[
            _answer(
                target,
                results,
                judgements,
                faults,
                notes,
                complete=complete,
                unjudged=len(experiment.not_judged),
            )
        ],
        standings=run_standings(target, verdicts, complete=complete),
        sheets=sheets,
        remarks=remarks,
        values=[*_judged_values(target, results, judgements), *run_values(results)],
        kept=complete and all(item.kept for item in judgements),
        verdicts=[row.model_dump() for row in verdicts],
        requirements=[_judgement_document(item) for item in judgements],
        **further,
        runs=[run_document(run) for run in results],
    )


def _log_document(run: MeasuredResult) -> dict[str, Any]:
    """Return which part of a log is judged, as plain values."""
    return {
        "plant": run.plant,
        "file": run.log.name,
        "begin": {"value": run.begin, "unit": "s"},
        "signals": sorted(run.known),
        "not_judged": run.not_judged,
    }


def _answer(
    target: str,
    results: Sequence[RunResult],
    judgements: Sequence[Judgement],
    faults: Sequence[str],
    notes: Sequence[str],
    *,
    complete: bool,
    unjudged: int,
) -> Answer:
    """Return the verdict on a case, and the requirement that is the nearest to its limit.

    ``unjudged`` is the number of requirements that no run can decide.
    """
    count = len(judgements)
    failed = sum(not item.kept for item in judgements)
    ended = sum(bool(run.ended) for run in results)
    verdict = KEPT if complete else OPEN
    if failed:
        verdict = NOT_KEPT
        words = f"{counted_of(failed, count, 'requirement', 'is', 'are')} not kept"
    elif count == 1:
        words = "The requirement is kept"
    elif judgements:
        words = f"All {count} requirements are kept"
    else:
        words = f"Nothing is required; {ended} of {counted(len(results), 'run')} ended early"
        if ended:
            verdict = NOT_KEPT
    if judgements and unjudged:
        if not failed:
            verb = "is" if count == 1 else "are"
            words = f"{counted(count, 'requirement')} {verb} kept"
        words += f", {unjudged} not judged"

    tightest = ""
    if judgements:
        nearest = max(judgements, key=lambda item: item.share)
        by = f"{_outcome(nearest)} by {nearest.controller} on {nearest.plant}"
        tightest = f"tightest requirement: {nearest.requirement.words} ({by})"
    return Answer(
        question=f"Run of {target}",
        verdict=verdict,
        words=words,
        more=tightest,
        faults=faults,
        notes=notes,
    )


def verdicts_of(
    condition: str, results: Sequence[RunResult], judgements: Sequence[Judgement]
) -> list[Verdict]:
    """Return the verdict on each law on each plant that something is required of it on.

    Args:
        condition: Name of the case.
        results: Its runs.
        judgements: Judgements of these runs.
    """
    verdicts = []
    for run in results:
        law = run.controller.name
        of_run = [item for item in judgements if (item.controller, item.plant) == (law, run.plant)]
        if not of_run:
            continue
        worst = max(of_run, key=lambda item: item.share)
        row = verdict_of({item.requirement.words: item.share for item in of_run})
        row = row.changed(
            law=law,
            step=run.plant,
            condition=condition,
            ended=run.ended,
            words=_measured(worst),
        )
        verdicts.append(row)
    return verdicts


def run_standings(target: str, rows: Sequence[Verdict], *, complete: bool) -> Iterator[Standing]:
    """Return where each law stands by its worst run; a law without requirements has none.

    Args:
        target: The case, SYSTEM/CASE.
        rows: Verdicts on its runs.
        complete: Whether nothing was interrupted.
    """
    return standings(
        target, rows, worst_failed, lambda of_law: worst_of(of_law).words, complete=complete
    )


def _measured(item: Judgement) -> str:
    """Return a requirement with its measured value or margin, in the unit of the file."""
    return f"{item.requirement.words}: {_outcome(item)}"


def _outcome(item: Judgement) -> str:
    """Return the measured value or the margin of a requirement, in the unit of the file."""
    if item.margin is None:
        return item.note.partition(";")[0] or "not measured"

    noun = ""
    value = item.measured
    if value is None:
        noun = "margin "
        value = item.margin
    value, unit = item.requirement.in_file_unit(value)
    return f"{noun}{number(value)}{unit_after(unit)}"


def _judgement_document(item: Judgement) -> dict[str, Any]:
    """Return a judgement as plain values."""
    requirement = item.requirement
    return {
        "requirement": requirement.key,
        "limit": {"value": requirement.number, "unit": requirement.unit},
        "state": requirement.signal,
        "after": requirement.after,
        "controller": item.controller,
        "plant": item.plant,
        "measured": item.measured,
        "margin": item.margin,
        "kept": item.kept,
        "note": item.note,
    }


def _judged_values(
    target: str, results: Sequence[RunResult], judgements: Sequence[Judgement]
) -> Iterator[Value]:
    """Return verdict and margin of each requirement."""
    switched = {run.controller.name for run in results if run.switched}
    for item in judgements:
        requirement = item.requirement
        relative, absolute = tolerance_of(
            requirement.tolerated_as, switched=item.controller in switched
        )
        name = f"{target} {item.plant} {item.controller}: {requirement.words}"
        yield Value(name=name, value=KEPT if item.kept else NOT_KEPT)
        yield Value(
            name=f"{name}, margin",
            value=finite(item.margin),
            unit=requirement.unit,
            better=1,
            relative=relative,
            absolute=absolute,
            size=finite(item.measured),
        )


def run_values(results: Sequence[RunResult]) -> Iterator[Value]:
    """Return status and metrics of each run."""
    for run in results:
        name = f"{run.case.system}/{run.case.name} {run.plant} {run.controller.name}"
        yield Value(name=f"{name}: status", value=run.status.name.lower())
        for key, metric in run.metrics.items():
            relative, absolute = tolerance_of(key, switched=run.switched)
            yield Value(
                name=f"{name}: {key}",
                value=finite(metric.value),
                unit=metric.unit,
                relative=relative,
                absolute=absolute,
            )


def run_document(result: RunResult) -> dict[str, Any]:
    """Return one run as plain values."""
    design = result.controller.designed
    return {
        "system": result.case.system,
        "case": result.case.name,
        "plant": result.plant,
        "controller": result.controller.name,
        "equations": design.source,
        "gains": dict(design.gains),
        "named_gains": named_gains(design),
        "declared": design.declared,
        "switching": design.switching,
        "weights": _weights(result),
        "status": result.status.name.lower(),
        "ended": result.ended,
        "valid_until": {"value": float(result.trajectory.valid_until), "unit": "s"},
        "metrics": {name: metric._asdict() for name, metric in result.metrics.items()},
    }


def _weights(result: RunResult) -> dict[str, Any]:
    """Return the index that the law was designed for, and the poles of its closed loop.

    It is empty for a law without weights.
    """
    if not result.controller.designed.weighed:
        return {}
    optimum = result.controller.designed.lqr
    poles = sorted(optimum.poles.tolist(), key=lambda pole: (pole.real, pole.imag))
    return {
        "Q": optimum.Q.tolist(),
        "R": optimum.R.tolist(),
        "by_name": named_weights(result.controller.designed),
        "poles": [[pole.real, pole.imag] for pole in poles],
    }
