"""validation.json: everything that was measured, and all that is needed to measure it again."""

from __future__ import annotations

import functools
import inspect
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import grosmc_mj
from grosmc_mj.files import written_aside
from grosmc_mj.validation.agreement import AGREEMENT_BOUND, Agreement
from grosmc_mj.validation.cases import Case
from grosmc_mj.validation.experiment import Experiment
from grosmc_mj.validation.requirements import Judgement
from grosmc_mj.validation.runs import RunResult, Settings
from grosmc_mj.versions import installed

SCHEMA_VERSION = 1
_PACKAGES = ("mujoco", "dm_control", "numpy", "scipy", "control", "numba", "matplotlib")


def document(
    results: Sequence[RunResult],
    agreements: Sequence[Agreement],
    settings: Settings,
    selected: Sequence[Case],
    seed: int,
    differences: Sequence[str] | None,
    *,
    complete: bool,
) -> dict[str, Any]:
    """The content of validation.json.

    Args:
        results: Runs, in order.
        agreements: Analytic against physics plant.
        settings: As resolved.
        selected: Cases that were asked for.
        seed: Of the random states of the agreements.
        differences: Results that are not as recorded; None if they could not be compared.
        complete: Whether everything that was asked for is in it.
    """
    return {
        **origin(seed),
        "complete": complete,
        "configuration": {
            **asdict(settings),
            "cases": [case_document(case) for case in selected],
        },
        "as_recorded": None if differences is None else not differences,
        "differences": list(differences or ()),
        "runs": [_run(result) for result in results],
        "agreement": [agreement._asdict() for agreement in agreements],
    }


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
        **origin(None),
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
        "runs": [_run(result) for result in results],
    }


def comparison_document(
    agreements: Sequence[Agreement], found: Sequence[str], seed: int
) -> dict[str, Any]:
    """The content of compare.json: the comparisons, and which are beyond the bound."""
    return {
        **origin(seed),
        "bound": AGREEMENT_BOUND,
        "disagreements": list(found),
        "agreement": [agreement._asdict() for agreement in agreements],
    }


def origin(seed: int | None) -> dict[str, Any]:
    """What a document needs to be understood and repeated; no seed where nothing is random."""
    return {
        "schema_version": SCHEMA_VERSION,
        "versions": versions(),
        "git_revision": git_revision(),
        "seed": seed,
    }


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that the numbers depend on."""
    return {"python": platform.python_version(), **installed(_PACKAGES)}


@functools.cache
def git_revision() -> str | None:
    """The checkout's revision, with ``-dirty`` if it has changes; None outside a checkout.

    As it was when this process first asked: that is the code that it runs.
    """
    folder = Path(__file__).parent
    try:
        top = _git(folder, "rev-parse", "--show-toplevel")
        if Path(top).resolve() != Path(grosmc_mj.__file__).resolve().parents[1]:
            return None
        return _git(folder, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")
    except (OSError, subprocess.CalledProcessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    """One line that git answers."""
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


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


def _run(result: RunResult) -> dict[str, Any]:
    """One run as plain values."""
    return {
        "system": result.case.system,
        "case": result.case.name,
        "plant": result.plant,
        "controller": result.controller.name,
        "equations": result.controller.source,
        "gains": dict(result.controller.gains),
        "declared": result.controller.declared,
        "switching": result.controller.switching,
        "weights": _weights(result),
        "status": result.status.name.lower(),
        "ended": result.ended,
        "valid_until": {"value": float(result.trajectory.valid_until), "unit": "s"},
        "metrics": {name: metric._asdict() for name, metric in result.metrics.items()},
    }


def _weights(result: RunResult) -> dict[str, Any]:
    """The index that the law was designed for, and where it puts the poles."""
    optimum = result.controller.lqr
    assert optimum is not None
    poles = sorted(optimum.poles.tolist(), key=lambda pole: (pole.real, pole.imag))
    return {
        "Q": optimum.Q.tolist(),
        "R": optimum.R.tolist(),
        "poles": [[pole.real, pole.imag] for pole in poles],
    }


def write_json(path: Path, content: Any) -> None:
    """Write JSON aside and rename it, so that a file is either whole or not there.

    Raises:
        SetupError: If it cannot be written.
    """
    with written_aside(path) as part:
        part.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
