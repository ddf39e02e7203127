"""The maps of one system as a document, to compute them again, and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.document import case_document
from grosmc_mj.results.document import origin
from grosmc_mj.results.tables import Table, numbers, table, words
from grosmc_mj.studies.region.axes import Axis
from grosmc_mj.studies.region.measure import Region
from grosmc_mj.studies.region.outcome import Outcome
from grosmc_mj.studies.region.region_map import RegionMap


def region_document(region: Region, maps: Sequence[RegionMap]) -> dict[str, Any]:
    """The content of region_SYSTEM.json.

    A grid has one string for each value of the second axis, from the lowest; each of its letters
    is the outcome at one value of the first axis, from the lowest.
    """
    question = region.question
    return {
        **origin(None),
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
        "judged_in_mujoco": each.confirmed,
        "overturned": each.overturned,
        "grid": ["".join(row) for row in each.grid.tolist()],
    }


def region_table(region: Region, maps: Sequence[RegionMap]) -> Table:
    """One row a map: its counts, and how far on the first axis alone it converges."""
    axis = region.axes[0]
    rows = []
    for each in maps:
        interval = each.rest_interval()
        whole = interval == (float(each.line_starts[0]), float(each.line_starts[-1]))
        ends = [f"{axis.shown(end):+.1f}" for end in interval or ()]
        converged, *others = (str(count) for count in each.counts().values())
        share = f"{100 * each.fractions()[Outcome.CONVERGED]:.1f} %"
        rows.append(
            (
                each.case.name, each.controller, f"{converged} ({share})", *others,
                "all of them" if whole else " to ".join(ends) or "none", f"{each.seconds:.1f} s",
            )
        )  # fmt: skip
    outcomes = ("\n".join(outcome.title.rsplit(" ", 1)) for outcome in Outcome)
    return table(
        f"{region.system.title}: outcomes of the starts",
        [
            *words("plant", "controller"),
            *numbers(*outcomes, f"at rest [{axis.shown_unit}]", "time"),
        ],
        rows,
        grouped=True,
    )


def judged(maps: Sequence[RegionMap]) -> str:
    """Who judged the starts of all maps; empty where it was MuJoCo alone."""
    starts = sum(each.grid.size + each.line.size for each in maps)
    confirmed = sum(each.confirmed for each in maps)
    if confirmed == starts:
        return ""
    return (
        f"{starts - confirmed:,} of {starts:,} starts judged by the equations, {confirmed:,} in "
        f"MuJoCo, all beside another outcome among them; it overturned "
        f"{sum(each.overturned for each in maps)}."
    )


def legend(region: Region) -> str:
    """What the words of the table mean."""
    axis = region.axes[0]
    bounds = {
        f"|error of {symbol}| <= {value:.3g} {unit}"
        for controller in region.controllers
        for symbol, (value, unit) in region.tolerances(controller).items()
    }
    return (
        f"converged: {' and '.join(sorted(bounds))} after {region.question.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region}); at rest: the "
        f"widest interval of starts of {axis.symbol} alone, about zero, that all converge."
    )
