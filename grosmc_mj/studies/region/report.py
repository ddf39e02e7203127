"""region_SYSTEM.json: the maps, and all that is needed to compute them again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.document import case_document
from grosmc_mj.report.document import origin
from grosmc_mj.studies.region.axes import Axis
from grosmc_mj.studies.region.measure import Region, RegionMap
from grosmc_mj.studies.region.outcome import Outcome

REGION_SCHEMA_VERSION = 1


def region_document(region: Region, maps: Sequence[RegionMap]) -> dict[str, Any]:
    """The content of region_SYSTEM.json.

    A grid has one string for each value of the second axis, from the lowest; each of its letters
    is the outcome at one value of the first axis, from the lowest.
    """
    question = region.question
    return {
        **origin(None),
        "schema_version": REGION_SCHEMA_VERSION,
        "system": region.system.name,
        "configuration": {
            "duration": {"value": question.duration, "unit": "s"},
            "points": question.points,
            "control_period": question.settings.control_period,
            "timestep": question.settings.timestep,
            "integrator": question.settings.integrator,
            "switching": question.settings.switching,
            "surface": question.settings.surface,
            "region": region.system.region,
            "axes": [_axis(axis) for axis in region.axes],
            "cases": [_case(case) for case in region.cases],
        },
        "outcomes": {each.value: {"name": each.title, "meaning": each.meaning} for each in Outcome},
        "maps": [_map(region, each) for each in maps],
    }


def _axis(axis: Axis) -> dict[str, Any]:
    """An axis as plain values."""
    return {
        "state": axis.key,
        "name": axis.name,
        "unit": axis.unit,
        "limit": axis.limit,
        "measures": "error" if axis.is_error else "state",
        "direction": axis.direction,
        "origin": axis.origin,
    }


def _case(case: Case) -> dict[str, Any]:
    """What a case changes; its own start and duration play no part here."""
    content = case_document(case)
    return {key: content[key] for key in ("case", "title", "source", "edits", "disturbances")}


def _map(region: Region, each: RegionMap) -> dict[str, Any]:
    """One map as plain values."""
    interval = each.rest_interval()
    spacing = float(each.line_starts[1] - each.line_starts[0])
    return {
        "case": each.case.name,
        "controller": each.controller,
        "tolerances": {
            state: {"value": value, "unit": unit}
            for state, (value, unit) in region.tolerances(each.controller).items()
        },
        "counts": {outcome.title: count for outcome, count in each.counts().items()},
        "fractions": {outcome.title: part for outcome, part in each.fractions().items()},
        "converges_on_first_axis": {
            "from": None if interval is None else interval[0],
            "to": None if interval is None else interval[1],
            "spacing": spacing,
            "unit": region.axes[0].unit,
        },
        "seconds": each.seconds,
        "grid": ["".join(row) for row in each.grid.tolist()],
    }
