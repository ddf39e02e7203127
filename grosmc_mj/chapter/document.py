"""validation.json: everything that was measured, and all that is needed to measure it again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.document import case_document, run_document
from grosmc_mj.experiments.runs import RunResult, Settings
from grosmc_mj.results.document import origin
from grosmc_mj.studies.agreement import Agreement


def document(
    results: Sequence[RunResult],
    agreements: Sequence[Agreement],
    settings: Settings,
    selected: Sequence[Case],
    seed: int,
    differences: Sequence[str] | None,
    failed: Sequence[str] = (),
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
        failed: What else is not as it must be.
        complete: Whether everything that was asked for is in it.
    """
    return {
        **origin(seed),
        "complete": complete,
        "configuration": {
            **asdict(settings),
            "cases": [case_document(case) for case in selected],
        },
        "as_recorded": None if differences is None else not (differences or failed),
        "differences": [*(differences or ()), *failed],
        "runs": [run_document(result) for result in results],
        "agreement": [agreement._asdict() for agreement in agreements],
    }
