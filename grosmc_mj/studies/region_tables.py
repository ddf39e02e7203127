"""What region maps say: their table, charts, figure and document."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.case import case_document
from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.palette import label_of
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    GridChart,
    Letter,
    Sheet,
    Value,
    result,
)
from grosmc_mj.results.tables import Table, number, numbers, table, words
from grosmc_mj.studies.figures import write_panels
from grosmc_mj.studies.region import Axis, Outcome, Region, RegionLoop, RegionMap


def region_table(region: Region, maps: Sequence[RegionMap]) -> Table:
    """A row a map, from the fewest starts that converge on; how far at rest it converges."""
    axis, rows = region.axes[0], []
    for found in sorted(maps, key=lambda found: found.converged):
        ends = [f"{axis.shown(end):+.1f}" for end in found.rest_interval() or ()]
        _, *others = found.counts.values()
        share = f"{found.converged:.1f}"
        at_rest = " to ".join(ends) or "none"
        rows.append([found.case.name, found.controller, share, *map(str, others), at_rest])
    outcomes = ("\n".join(outcome.title.rsplit(" ", 1)) for outcome in list(Outcome)[1:])
    columns = [
        *words("plant", "law"),
        *numbers("converged\n%", *outcomes, f"at rest\n[{axis.shown_unit}]"),
    ]
    return table(f"{region.system.title}: outcomes of the starts", columns, rows)


def legend(region: Region, maps: Sequence[RegionMap]) -> str:
    """Which engine judged the starts, and what the words of the table mean."""
    starts = sum(found.grid.size + found.line.size for found in maps)
    confirmed = sum(found.confirmed for found in maps)
    loops = [RegionLoop.of(region.experiments[0], name) for name in region.controllers]
    bounds = sorted(
        {
            f"|error of {symbol}| <= {value:.3g} {unit}"
            for loop in loops
            for symbol, (value, unit) in loop.tolerances.items()
        }
    )
    judged = (
        f"{starts - confirmed:,} of {starts:,} starts judged by the equations, {confirmed:,} in "
        f"MuJoCo, all beside another outcome among them; it overturned "
        f"{sum(found.overturned for found in maps)}. "
    )
    return (judged if confirmed < starts else "") + (
        f"converged: {' and '.join(bounds)} after {region.question.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region}); at rest: the "
        f"widest interval of starts of {region.axes[0].symbol} alone, about zero, that all "
        "converge."
    )


def charts(region: Region, maps: Sequence[RegionMap]) -> list[list[GridChart]]:
    """A row for each plant, a map for each law."""
    across, up = ((axis.label, axis.shown(axis.limit)) for axis in region.axes)
    letters = [Letter(letter=x.value, name=x.title, colour=x.colour) for x in Outcome]

    def chart(found: RegionMap) -> GridChart:
        name = f"{label_of(found.controller)}, {found.case.name}: {found.converged:.1f} % converge"
        return GridChart(name=name, axes=(across, up), grid=_grid(found), legend=letters)

    cases = dict.fromkeys(found.case.name for found in maps)
    return [[chart(found) for found in maps if found.case.name == case] for case in cases]


def _grid(found: RegionMap) -> list[str]:
    """A string for each value of the second axis, from the lowest."""
    return ["".join(row) for row in found.grid.tolist()]


def write_region_figure(region: Region, maps: Sequence[RegionMap], path: Path) -> Path:
    """Draw the maps, plants below each other; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    how = f"{region.question.settings.switching} switching"
    title = f"{region.system.title}: from where each law converges ({how})"
    return write_panels(path, in_lines(title, 60), charts(region, maps))


def region_document(region: Region, maps: Sequence[RegionMap]) -> dict[str, Any]:
    """The content of region_SYSTEM.json."""
    question, settings, cases = region.question, region.question.settings, {}
    for experiment in region.experiments:
        content = case_document(experiment.case)
        keys = ("case", "title", "source", "edits", "disturbances")
        cases[experiment.case.name] = {key: content[key] for key in keys}
    least: dict[str, RegionMap] = {}
    for found in maps:
        other = least.get(found.controller, found)
        least[found.controller] = min(other, found, key=lambda each: each.converged)
    said = [
        f"{law} converges from "
        + (
            f"{number(x.converged)} % of the starts in {x.case.name}"
            if x.converged < 100
            else "every start"
        )
        for law, x in least.items()
    ]
    system = region.system.name
    return result(
        "region",
        {
            "duration": {"value": question.duration, "unit": "s"},
            "points": question.points,
            "control_period": settings.control_period,
            "timestep": settings.timestep,
            "integrator": settings.integrator,
            "switching": settings.switching,
            "surface": settings.surface,
            "region": region.system.region,
            "axes": [_axis(axis) for axis in region.axes],
            "cases": list(cases.values()),
        },
        answers=[
            Answer(
                question=f"Region of {system}",
                verdict=MEASURED,
                words="; ".join(said),
                more=f"the worst of {', '.join(cases)}",
            )
        ],
        sheets=[
            Sheet(
                table=region_table(region, maps).model_copy(
                    update={"legend": legend(region, maps)}
                ),
                charts=[chart for row in charts(region, maps) for chart in row],
            )
        ],
        values=[
            Value(
                name=f"{system}/{found.case.name} {found.controller}: starts that converge",
                value=found.converged, unit="%", better=1, relative=0.1,
            )
            for found in maps
        ],
        system=system,
        outcomes={x.value: {"name": x.title, "meaning": x.meaning} for x in Outcome},
        maps=[_map(region, found) for found in maps],
    )  # fmt: skip


def _axis(axis: Axis) -> dict[str, Any]:
    """An axis as plain values."""
    names = ("name", "unit", "limit", "direction", "origin")
    return {
        "state": axis.key,
        "measures": "error" if axis.is_error else "state",
        **{name: getattr(axis, name) for name in names},
    }


def _map(region: Region, found: RegionMap) -> dict[str, Any]:
    """One map as plain values."""
    low, high = found.rest_interval() or (None, None)
    return {
        "case": found.case.name,
        "controller": found.controller,
        "counts": {outcome.title: count for outcome, count in found.counts.items()},
        "converges_on_first_axis": {
            "from": low,
            "to": high,
            "spacing": float(found.line_starts[1] - found.line_starts[0]),
            "unit": region.axes[0].unit,
        },
        "seconds": found.seconds,
        "judged_in_mujoco": found.confirmed,
        "overturned": found.overturned,
        "grid": _grid(found),
    }
