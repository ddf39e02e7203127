"""validation.json: everything that was measured, and all that is needed to measure it again."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.requirements import Judgement
from grosmc_mj.results.document import origin

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
    """What a case file led to.

    Args:
        experiment: The case file, as resolved.
        results: Its runs, in order.
        judgements: What it requires, and whether that was kept.
        complete: Whether all its runs are there.
        premises: Those of its laws, as plain values; left out if there are none.
    """
    return {
        **origin(seed_of(experiment.case)),
        "complete": complete,
        "configuration": {
            **asdict(experiment.settings),
            "cases": [case_document(experiment.case)],
            "file": experiment.document(),
        },
        "kept": complete and all(each.kept for each in judgements),
        "requirements": [
            {
                "requirement": each.limit.kind,
                "limit": {"value": each.limit.value, "unit": each.limit.unit},
                "after": each.limit.after,
                "controller": each.controller,
                "plant": each.plant,
                "measured": each.measured,
                "margin": each.margin,
                "kept": each.kept,
                "note": each.note,
            }
            for each in judgements
        ],
        **({"premises": list(premises)} if premises else {}),
        "runs": [run_document(result) for result in results],
    }


def seed_of(case: Case) -> int | None:
    """The seed of what the loop of a case draws; None without a loop."""
    return None if case.loop is None else case.loop.seed


def case_document(case: Case) -> dict[str, Any]:
    """A case as plain values."""
    return {
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "source": case.source,
        "x0": list(case.x0),
        "duration": case.duration,
        "edits": [asdict(edit) for edit in case.edits],
        "disturbances": [
            {"body": d.body, "wrench": list(d.wrench), "profile": _named(d.profile)}
            for d in case.disturbances
        ],
    }


def _named(profile: Any) -> str:
    """A profile as its numbers, or as the function that it is."""
    if inspect.isfunction(profile):
        return f"{profile.__module__}:{profile.__qualname__}"
    return repr(profile)


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
