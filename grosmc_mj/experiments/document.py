"""NAME.json of a run: everything that was measured, and all that is needed to measure it again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from grosmc_mj.experiments.case import case_document, seed_of
from grosmc_mj.experiments.metrics import tolerance_of
from grosmc_mj.experiments.requirements import Judgement
from grosmc_mj.experiments.tables import (
    LEGEND,
    gains_table,
    requirements_table,
    results_table,
)
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    Sheet,
    Standing,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import number

if TYPE_CHECKING:
    from grosmc_mj.experiments.experiment import Experiment
    from grosmc_mj.experiments.runs import RunResult


def experiment_document(
    experiment: Experiment,
    results: Sequence[RunResult],
    judgements: Sequence[Judgement],
    *,
    complete: bool,
    premises: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """The content of a run's JSON file.

    Args:
        experiment: The case file, as resolved.
        results: Its runs, in order.
        judgements: Its requirements of these runs, judged.
        complete: Whether all its runs are there.
        premises: Those of its laws, as plain values; left out if there are none.
    """
    target = f"{experiment.case.system}/{experiment.case.name}"
    tables = [requirements_table(judgements)] if judgements else []
    if results:
        runs = results_table(results).model_copy(update={"legend": LEGEND})
        tables += [runs, gains_table(results)]
    return result(
        "run",
        {
            **asdict(experiment.settings),
            "cases": [case_document(experiment.case)],
            "file": experiment.document(),
        },
        seed=seed_of(experiment.case),
        complete=complete,
        answers=[_answer(target, results, judgements, complete=complete)],
        standings=standings(target, results, judgements, complete=complete),
        sheets=[Sheet(table=table) for table in tables],
        values=[*_judged_values(target, results, judgements), *run_values(results)],
        kept=complete and all(item.kept for item in judgements),
        requirements=[_judged(item) for item in judgements],
        **({"premises": list(premises)} if premises else {}),
        runs=[run_document(run) for run in results],
    )


def _answer(
    target: str, results: Sequence[RunResult], judgements: Sequence[Judgement], *, complete: bool
) -> Answer:
    """Whether a case keeps its requirements, and the one that is the nearest to its limit."""
    failed = sum(not item.kept for item in judgements)
    ended = sum(bool(run.ended) for run in results)
    if failed:
        words = f"{failed} of {len(judgements)} requirements are not kept"
    elif judgements:
        count = len(judgements)
        words = "The requirement is kept" if count == 1 else f"All {count} requirements are kept"
    else:
        words = f"Nothing is required; {ended} of {len(results)} runs ended early"
    broken = failed or (ended and not judgements)
    verdict = NOT_KEPT if broken else KEPT if complete else OPEN
    nearest = max(judgements, key=lambda item: item.share, default=None)
    tightest = ""
    if nearest is not None:
        tightest = f"tightest: {_measured(nearest)} by {nearest.controller} on {nearest.plant}"
    return Answer(
        question=f"Run of {target}",
        verdict=verdict,
        words=words + ("" if complete else " (interrupted: not complete)"),
        more=tightest,
    )


def standings(
    target: str, results: Sequence[RunResult], judgements: Sequence[Judgement], *, complete: bool
) -> Iterator[Standing]:
    """Of each law the plant where it is furthest beyond a limit, or the limit it is nearest to.

    A law of which nothing is required has none: it keeps nothing.
    """
    for law in dict.fromkeys(run.controller.name for run in results):
        own = [item for item in judgements if item.controller == law]
        if not own:
            continue
        worst = max(own, key=lambda item: (not item.kept, item.share))
        yield Standing(
            case=target,
            law=law,
            breaks_at="" if worst.kept else worst.plant,
            words=_measured(worst),
            complete=complete,
        )


def _measured(item: Judgement) -> str:
    """A requirement with its measured value."""
    limit, unit = item.limit, f" {item.limit.unit}" if item.limit.unit not in ("", "1") else ""
    value = f"{number(item.measured)} of {number(limit.value)}{unit}"
    return f"{limit.kind.replace('_', ' ')}: {value}"


def _judged(item: Judgement) -> dict[str, Any]:
    """A judged requirement as plain values."""
    return {
        "requirement": item.limit.kind,
        "limit": {"value": item.limit.value, "unit": item.limit.unit},
        "after": item.limit.after,
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
    """The verdict of each requirement and its margin."""
    switched = {run.controller.name for run in results if run.controller.designed.switching}
    for item in judgements:
        limit, name = item.limit, f"{target} {item.plant} {item.controller}: {item.limit.words}"
        metric = "settling_time" if limit.kind == "settles_within" else limit.metric
        relative, absolute = tolerance_of(metric, switched=item.controller in switched)
        yield Value(name=name, value=KEPT if item.kept else NOT_KEPT)
        yield Value(
            name=f"{name}, margin", value=finite(item.margin), unit=limit.unit, better=1,
            relative=relative, absolute=absolute, size=finite(item.measured),
        )  # fmt: skip


def run_values(results: Sequence[RunResult]) -> Iterator[Value]:
    """How each run ended, and its metrics."""
    for run in results:
        name = f"{run.case.system}/{run.case.name} {run.plant} {run.controller.name}"
        switched = bool(run.controller.designed.switching)
        yield Value(name=f"{name}: status", value=run.status.name.lower())
        for key, metric in run.metrics.items():
            relative, absolute = tolerance_of(key, switched=switched)
            yield Value(
                name=f"{name}: {key}", value=finite(metric.value), unit=metric.unit,
                relative=relative, absolute=absolute,
            )  # fmt: skip


def run_document(result: RunResult) -> dict[str, Any]:
    """One run as plain values."""
    design = result.controller.designed
    return {
        "system": result.case.system,
        "case": result.case.name,
        "plant": result.plant,
        "controller": result.controller.name,
        "equations": design.source,
        "gains": dict(design.gains),
        "declared": design.declared,
        "switching": design.switching,
        "weights": _weights(result),
        "status": result.status.name.lower(),
        "ended": result.ended,
        "valid_until": {"value": float(result.trajectory.valid_until), "unit": "s"},
        "metrics": {name: metric._asdict() for name, metric in result.metrics.items()},
    }


def _weights(result: RunResult) -> dict[str, Any]:
    """The index that the law was designed for, and where it puts the poles."""
    optimum = result.controller.designed.lqr
    poles = sorted(optimum.poles.tolist(), key=lambda pole: (pole.real, pole.imag))
    return {
        "Q": optimum.Q.tolist(),
        "R": optimum.R.tolist(),
        "poles": [[pole.real, pole.imag] for pole in poles],
    }
