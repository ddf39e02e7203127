"""Answer of a region: table, charts, figure and result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from grosmc_mj.experiments.case_document import case_document
from grosmc_mj.ground.wording import plural, unit_after
from grosmc_mj.output.charts.chart import in_lines
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.charts.of_results import panels_chart
from grosmc_mj.output.results.result import (
    MEASURED,
    OPEN,
    Answer,
    GridChart,
    Letter,
    ReportTable,
    Result,
    Value,
    result,
)
from grosmc_mj.output.results.tables import Table, number, numbers, table, words
from grosmc_mj.studies.region.axes import Axis, ascii_symbol, shown
from grosmc_mj.studies.region.region import RegionMap, RegionStudy
from grosmc_mj.studies.region.runs import Outcome
from grosmc_mj.studies.sweep.confirmation import confirmation_words
from grosmc_mj.theory.plants import System


def region_table(region: RegionStudy, maps: Sequence[RegionMap]) -> Table:
    """Return the table of the maps, from the fewest starts that converge on."""
    failures = [outcome for outcome in _outcomes_of(maps) if outcome is not Outcome.CONVERGED]
    rows = []
    for law_map in sorted(maps, key=lambda law_map: law_map.converged):
        counts = [str(law_map.counts[outcome]) for outcome in failures]
        converged = f"{law_map.converged:.1f}"
        rows.append([law_map.case, law_map.controller, converged, *counts])

    headers = ["\n".join(outcome.title.rsplit(" ", 1)) for outcome in failures]
    columns = [*words("plant", "law"), *numbers("converged\n%", *headers)]
    title = f"{region.system.title}: outcomes of the starts"
    return table(title, columns, rows)


def _outcomes_of(maps: Sequence[RegionMap]) -> list[Outcome]:
    """Return the outcomes that maps can have: without draws none varies."""
    drawn = any(law_map.over_draws is not None for law_map in maps)
    return [outcome for outcome in Outcome if drawn or outcome is not Outcome.VARIES]


def _remarks(region: RegionStudy, maps: Sequence[RegionMap]) -> Iterator[str]:
    """Yield which engine judged the starts, and the meaning of the table's words."""
    bounds = set()
    for loop in region.loops:
        for symbol, (value, unit) in loop.tolerances.items():
            bounds.add(f"|error of {symbol}| <= {value:.3g}{unit_after(unit)}")
    yield (
        f"converged: {' and '.join(sorted(bounds))} after {region.duration:g} s; left the "
        f"region: a sample of the law not in the region ({region.system.region})."
    )

    drawn = [law_map.over_draws for law_map in maps if law_map.over_draws is not None]
    if drawn:
        over_draws = sum(starts.confirmed for starts in drawn)
        yield (
            f"{over_draws:,} {plural(over_draws, 'start')} judged over {region.draws} draws of "
            "noise, timing and encoders' phases, all beside another outcome among them; all draws "
            "must converge."
        )

    screened = [law_map.by_equations for law_map in maps if law_map.by_equations is not None]
    if not screened:
        return
    starts = sum(law_map.size for law_map in maps)
    confirmed = sum(law_map.confirmed for law_map in maps)
    overturned = sum(law_map.overturned for law_map in maps)
    at_random = sum(checked.drawn for checked in screened)
    wrong = sum(checked.wrong for checked in screened)
    yield (
        f"{starts - confirmed:,} of {starts:,} {plural(starts, 'start')} judged by the equations, "
        f"{confirmed:,} in MuJoCo, all beside another outcome among them; it overturned "
        f"{overturned}, and {confirmation_words(at_random, wrong)}."
    )


def charts(region: RegionStudy, maps: Sequence[RegionMap]) -> list[list[GridChart]]:
    """Return a row of charts for each plant, a map for each law."""
    first, second = region.plane
    across = (first.title, shown(first.signal, first.limit)[0])
    up = (second.title, shown(second.signal, second.limit)[0])
    legend = [Letter(letter=x.letter, name=x.title, colour=x.colour) for x in _outcomes_of(maps)]

    rows: dict[str, list[GridChart]] = {}
    for law_map in maps:
        law = f"{law_map.controller}, {law_map.case}"
        chart = GridChart(
            name=f"{law}: {law_map.converged:.1f} % converge",
            axes=(across, up),
            grid=law_map.rows,
            legend=legend,
        )
        rows.setdefault(law_map.case, []).append(chart)
    return list(rows.values())


def write_region_figure(region: RegionStudy, maps: Sequence[RegionMap], path: Path) -> Path:
    """Draw the maps, plants below each other; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    title = in_lines(f"{region.system.title}: from where each law converges", 60)
    return write_chart(panels_chart(title, charts(region, maps)), path)


def region_result(
    region: RegionStudy, maps: Sequence[RegionMap], *, complete: bool = True
) -> Result:
    """Return the result of a region; ``complete`` if it has every map."""
    system = region.system
    sheet = ReportTable(
        table=region_table(region, maps),
        charts=[chart for row in charts(region, maps) for chart in row],
        brief=True,
    )
    return result(
        "region",
        _configuration(region),
        answers=[_answer(region, maps, complete=complete)],
        sheets=[sheet],
        remarks=_remarks(region, maps),
        values=_values(system, maps),
        system=system.name,
        complete=complete,
        maps=[_map_document(law_map) for law_map in maps],
    )


def _configuration(region: RegionStudy) -> dict[str, Any]:
    settings = region.experiments[1].settings
    keys = ("case", "title", "source", "edits", "disturbances")
    cases = []
    for experiment in region.experiments:
        document = case_document(experiment)
        cases.append({key: document[key] for key in keys})
    return {
        "duration": {"value": region.duration, "unit": "s"},
        "points": region.points,
        "draws": region.draws,
        "control_period": settings.control_period,
        "timestep": settings.timestep,
        "integrator": settings.integrator,
        "region": region.system.region,
        "axes": [_axis_document(axis) for axis in region.plane],
        "cases": cases,
    }


def _axis_document(axis: Axis) -> dict[str, Any]:
    return {
        "state": ascii_symbol(axis.signal),
        "unit": axis.signal.unit,
        "measures": "error" if axis.is_error else "state",
        "limit": axis.limit,
        "direction": axis.direction,
        "origin": axis.origin,
    }


def _answer(region: RegionStudy, maps: Sequence[RegionMap], *, complete: bool) -> Answer:
    """The share of the starts from which each law converges, on its worst plant."""
    by_law: dict[str, list[RegionMap]] = {}
    for law_map in maps:
        by_law.setdefault(law_map.controller, []).append(law_map)

    shares = []
    for law, maps_of_law in by_law.items():
        least = min(maps_of_law, key=lambda law_map: law_map.converged)
        share = f"{number(least.converged)} % of the starts in {least.case}"
        if least.converged == 100:
            share = "every start"
        shares.append(f"{law} converges from {share}")

    verdict = MEASURED
    words = "; ".join(shares)
    if not complete:
        verdict = OPEN
    plants = dict.fromkeys(law_map.case for law_map in maps)
    return Answer(
        question=f"Region of {region.system.name}",
        verdict=verdict,
        words=words,
        more=f"the worst of {', '.join(plants)}",
    )


def _values(system: System, maps: Sequence[RegionMap]) -> Iterator[Value]:
    for law_map in maps:
        name = f"{system.name}/{law_map.case} {law_map.controller}"
        yield Value(
            name=f"{name}: starts that converge",
            value=law_map.converged,
            unit="%",
            better=1,
            relative=0.1,
        )


def _map_document(law_map: RegionMap) -> dict[str, Any]:
    return {
        "case": law_map.case,
        "controller": law_map.controller,
        "counts": {outcome.title: count for outcome, count in law_map.counts.items()},
        "judged_in_mujoco": law_map.confirmed,
        "overturned": law_map.overturned,
        "wrong_at_most": law_map.by_equations and law_map.by_equations.wrong_at_most,
        "judged_over_draws": law_map.over_draws and law_map.over_draws.confirmed,
        "grid": law_map.rows,
    }
