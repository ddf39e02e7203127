"""Tolerances as a document, and read from one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from grosmc_mj.loop import Loop
from grosmc_mj.results.document import origin
from grosmc_mj.studies.tolerance.answers import disagreements
from grosmc_mj.studies.tolerance.imperfections import WHOLE, Amount, Imperfection
from grosmc_mj.studies.tolerance.measure import Tolerance
from grosmc_mj.studies.tolerance.search import BEYOND, LEAST, MOST, RESOLUTION, Span
from grosmc_mj.studies.tolerance.setting import Setting


def tolerance_document(
    studied: Setting, rows: Sequence[Tolerance], seeds: int, *, complete: bool
) -> dict[str, Any]:
    """The content of tolerance_NAME.json.

    Args:
        studied: The target.
        rows: What has been found.
        seeds: Runs where something is random.
        complete: Whether that is all; it is not after an interrupt.
    """
    settings = studied.experiment.settings
    asked, differing = disagreements(rows)
    return {
        **origin(studied.bench.seed),
        "configuration": {
            "target": studied.target,
            "bench": studied.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "runs_where_random": seeds,
            "factors": {
                "least": LEAST,
                "most": MOST,
                "grid": 2.0,
                "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        },
        "complete": complete,
        "conditions": [{"name": c.name, "title": c.title} for c in studied.conditions],
        "laws": [
            {
                "name": law.name,
                "predicts": law.predict,
                "sampled": law.settings,
                "requirements": {
                    each.name: [limit.words for limit in studied.limits(law, each)]
                    for each in studied.conditions
                },
            }
            for law in studied.laws
        ],
        "imperfections": [
            {
                "name": each.name,
                "most": each.most,
                "parts": [amount._asdict() for amount in each.amounts],
            }
            for each in studied.imperfections
        ],
        "tolerances": [_row(row) for row in rows],
        "physics": {"answers_checked": asked, "answers_that_differ": differing},
    }


def _row(row: Tolerance) -> dict[str, Any]:
    """One tolerance; what is not there is null."""
    return {
        "law": row.law,
        "imperfection": row.imperfection.name,
        "condition": row.condition,
        "kept_ideally": row.ideally,
        "largest_kept": _amounts(row.imperfection, row.largest),
        "smallest_failed": _amounts(row.imperfection, row.failed),
        "kept_again": [
            {"from": _amounts(row.imperfection, low), "to": _amounts(row.imperfection, high)}
            for low, high in row.again
        ],
        "tried_up_to": row.tried,
        "breaks": row.breaks or None,
        "margin_at_largest": row.margin,
        "plant": row.plant,
        "physics_agrees": row.agreed,
        "impossible": row.impossible or None,
    }


def _amounts(imperfection: Imperfection, factor: float | None) -> dict[str, Any] | None:
    """A factor with the amounts of each part that it makes."""
    if factor is None:
        return None
    parts = [
        {"of": f"{each.kind} {each.of}".strip(), "quantity": each.quantity, "unit": each.unit}
        | {"value": each.scaled(factor)}
        for each in imperfection.amounts
    ]
    return {"factor": factor, "shown": imperfection.shown(factor), "parts": parts}


def tolerances_in(document: Mapping[str, Any]) -> list[Tolerance]:
    """The tolerances of a document; their imperfections scale no loop any more.

    Raises:
        KeyError: If it is another kind of document.
    """
    timestep = document["configuration"]["timestep"]["value"]
    known = {each["name"]: _imperfection(each, timestep) for each in document["imperfections"]}
    return [_tolerance(row, known[row["imperfection"]]) for row in document["tolerances"]]


def _imperfection(content: Mapping[str, Any], timestep: float) -> Imperfection:
    """What is scaled."""
    amounts = [
        Amount(**{**part, "most": math.inf if part["most"] is None else part["most"]})
        for part in content["parts"]
    ]
    name, none = content["name"], Loop()
    return Imperfection(name, none, none, tuple(amounts), timestep, name == WHOLE)


def _tolerance(row: Mapping[str, Any], imperfection: Imperfection) -> Tolerance:
    """One of them."""
    failed, margin = row["smallest_failed"], row["margin_at_largest"]
    return Tolerance(
        law=row["law"],
        imperfection=imperfection,
        condition=row["condition"],
        ideally=row["kept_ideally"],
        largest=row["largest_kept"]["factor"],
        failed=None if failed is None else failed["factor"],
        again=tuple(
            Span(each["from"]["factor"], each["to"]["factor"]) for each in row["kept_again"]
        ),
        tried=row["tried_up_to"],
        breaks=row["breaks"] or "",
        margin=-math.inf if margin is None else margin,
        plant=row["plant"],
        agreed=row["physics_agrees"],
        impossible=row["impossible"] or "",
    )
