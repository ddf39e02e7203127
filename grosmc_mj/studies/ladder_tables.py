"""What a ladder says: its answer, tables, charts, document and film."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.films import film_of
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.films.film import MOST_TAKES, Film, Format
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.result import (
    KEPT,
    NOT_KEPT,
    OPEN,
    Answer,
    CellChart,
    Sheet,
    Standing,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, names, number, numbers, table, text, words
from grosmc_mj.studies.figures import write_cells
from grosmc_mj.studies.ladder import ENDED, Climb, Climbs, Ladder, fallen, first_failed, run_of
from grosmc_mj.studies.studied import StudiedLaw

STANDS = "stands"
LEGEND = (
    "How much of the tightest limit is used; above 1 it is not kept. ended: the run ended early; "
    "never: it does not settle; -: there is no such law."
)
_TITLES = {
    True: "Each rung on top of the others",
    False: "Each alone on the sampled plant",
}
# Decades beyond a limit in a chart.
_MOST = 2.0


def share_text(row: Climb | None) -> str:
    """How much of the tightest limit is used, or why there is no number; empty for no row."""
    if row is None:
        return ""
    if row.impossible:
        return "-"
    if row.tightest == ENDED:
        return "ended"
    used = row.share_of_the_tightest_limit
    if math.isinf(used):
        return "never"
    return f"{number(used)}x" if used > 1 else number(used)


def reason(row: Climb) -> str:
    """What breaks on a rung, in words."""
    if row.impossible or row.tightest == ENDED:
        return row.impossible or ENDED
    used = row.share_of_the_tightest_limit
    often = "never" if math.isinf(used) else f"{number(used)} times"
    if number(used) == "1":
        often = "at its limit"
    return f"{row.tightest.replace('_', ' ')}: {often}"


def verdict(study: Climbs, condition: str) -> str:
    """How many laws pass, and what breaks most of them."""
    ways = study.ways(condition)
    stand = [law for law, way in ways.items() if study.complete(way)]
    failed = {law: row.rung for law, way in ways.items() if (row := first_failed(way))}
    every = sum(law not in failed for law in stand)
    said = f"{every} of {len(ways)} laws pass every rung, {len(stand)} the complete machine"
    breaks = Counter(failed.values()).most_common(3)
    return (
        "; ".join([said, *([", ".join(f"{x} breaks {n}" for x, n in breaks)] if breaks else [])])
        + "."
    )


def answer_table(study: Climbs, condition: str) -> Table:
    """Which laws pass every rung and which the complete machine, and where each breaks first."""
    cells = []
    ways = study.ways(condition)

    def height(law: str) -> int:
        row = first_failed(ways[law])
        return len(ways[law]) if row is None else ways[law].index(row)

    for law in sorted(ways, key=height, reverse=True):
        way, row = ways[law], first_failed(ways[law])
        shown = row or way[-1]
        numbers_there = (shown.amplitude, shown.frequency, shown.variation)
        top = way[-1] if way[-1].rung == study.climbing[-1].name else None
        cells.append(
            [
                law,
                "yes" if row is None and top else "no" if row else "",
                "" if top is None else f"{'yes' if top.kept else 'no'} ({share_text(top)})",
                f"{row.rung}: {reason(row)}" if row else "",
                *("" if x is None else number(x) for x in numbers_there),
            ]
        )
    columns = [
        *names("law"),
        *words("passes\nevery rung", "passes the\ncomplete\nmachine"),
        *text("breaks first at"),
        *numbers(
            f"swings by\n[{study.output_unit}]", "at\n[Hz]", f"variation\n[{study.input_unit}/s]"
        ),
    ]
    title = next(c.title for c in study.conditions if c.name == condition)
    return table(title, columns, cells)


def _by_rung(study: Climbs, condition: str, *, together: bool) -> dict[tuple[str, str], Climb]:
    own = (x for x in study.climbs if (x.condition, x.together) == (condition, together))
    return {(row.law, row.rung): row for row in own}


def share_table(study: Climbs, condition: str, *, together: bool) -> Table:
    """Laws by rungs: how much of the tightest limit is used."""
    rows = _by_rung(study, condition, together=together)
    rungs = study.climbing if together else study.alone
    cells = [
        [law.name, *(share_text(rows.get((law.name, rung.name))) for rung in rungs)]
        for law in study.laws
    ]
    return table(_TITLES[together], [*words("law"), *numbers(*(r.title for r in rungs))], cells)


def load_table(study: Climbs) -> Table:
    """Laws by conditions: the complete machine."""
    conditions, top = [c.name for c in study.conditions], study.climbing[-1].name
    rows = {
        (row.law, row.condition): row for row in study.climbs if row.together and row.rung == top
    }
    cells = [
        [law.name, *(share_text(rows.get((law.name, name))) for name in conditions)]
        for law in study.laws
    ]
    loads = "; ".join(f"{c.name}: {c.title}" for c in study.conditions[1:])
    title = f"The whole machine, nominally and under load ({loads})"
    return table(title, [*words("law"), *numbers(*conditions)], cells)


def deviation_table(study: Climbs, condition: str) -> Table:
    """How far each law that follows the nominal optimum is from it, climbing."""
    rows, unit = _by_rung(study, condition, together=True), study.output_unit
    shown, scale = (f"m{unit}", 1e3) if unit in ("rad", "m") else (unit, 1.0)

    def cell(row: Climb | None) -> str:
        if row is None or row.deviation is not None:
            return "" if row is None else number((row.deviation or 0.0) * scale)
        return "ended" if row.tightest == ENDED else "-"

    cells = [
        [law.name, *(cell(rows.get((law.name, rung.name))) for rung in study.climbing)]
        for law in study.laws
        if law.follows_optimum
    ]
    title = f"Largest distance from the nominal optimum [{shown}], of the laws that follow it"
    return table(title, [*words("law"), *numbers(*(r.name for r in study.climbing))], cells)


def claims_table(study: Climbs, condition: str) -> Table | None:
    """On which rung each claim falls for each law that it is about; None without a claim."""
    ways = study.ways(condition)
    claims = list(dict.fromkeys(x for way in ways.values() for row in way for x in row.claims))
    if not claims:
        return None

    def cell(way: Sequence[Climb], claim: str) -> str:
        if not any(claim in row.claims for row in way):
            return ""
        row = fallen(way, claim)
        return STANDS if row is None else row.rung

    cells = [
        [law, *(cell(way, claim) for claim in claims)]
        for law, way in ways.items()
        if any(row.claims for row in way)
    ]
    columns = words("law", *(f"`{claim}`" for claim in claims))
    statements = {each.claim: each.statement for each in study.claims}
    said = "; ".join(f"`{claim}`: {statements[claim]}" for claim in claims)
    return table("Which claim falls, and on which rung", columns, cells, legend=f"{said}.")


def assumed_text(study: Climbs) -> str:
    """Which numbers nobody has published, by the rung that adds them; empty if there is none."""
    rungs = [f"{x.name} ({'; '.join(x.assumed)})" for x in study.climbing if x.assumed]
    return f"* rests on numbers that are assumed: {', '.join(rungs)}." if rungs else ""


def charts(study: Climbs) -> dict[tuple[str, bool], CellChart]:
    """A map for each condition, climbing and alone: blue is kept, the redder the further beyond."""
    found = {}
    for condition in study.conditions:
        for together in (True, False):
            rows = _by_rung(study, condition.name, together=together)
            titles = {rung.name: rung.title for rung in (*study.climbing, *study.alone)}
            cells = {
                (law, titles[rung]): (_redness(row), share_text(row), reason(row))
                for (law, rung), row in rows.items()
                if not row.impossible
            }
            if cells:
                name = f"{_TITLES[together]} ({condition.name}: {condition.title})"
                found[condition.name, together] = CellChart.of(name, cells, _MOST)
    return found


def _redness(row: Climb) -> float:
    """Below zero for what is kept; decades beyond the limit for what is not."""
    if row.kept:
        return -0.5 * _MOST
    beyond = math.log10(max(row.share_of_the_tightest_limit, 1.0))
    return 0.1 * _MOST + 0.9 * min(beyond, _MOST)


def write_ladder_figure(study: Climbs, path: Path) -> Path:
    """Draw the maps of all conditions; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    note = f"{LEGEND} Blue: all is kept; the redder, the further beyond. *: rests on assumptions."
    title = f"{study.target}: where each law breaks"
    return write_cells(path, title, list(charts(study).values()), note)


def _standings(study: Climbs, *, complete: bool) -> Iterator[Standing]:
    """The first rung on which each law breaks, under the first condition."""
    condition = study.conditions[0].name
    for law, way in study.ways(condition).items():
        row = first_failed(way)
        said = "stands on every rung" if complete else "stands on every rung so far"
        yield Standing(
            case=study.target,
            law=law,
            breaks_at=row.rung if row else "",
            words=f"{reason(row)} ({condition})" if row else said,
            complete=complete or row is not None,
        )


def _values(study: Climbs) -> Iterator[Value]:
    for row in study.climbs:
        if not row.impossible:
            how = "up to" if row.together else "alone"
            name = f"{study.target} {row.condition} {row.law}, {how} {row.rung}"
            yield Value(name=name, value="kept" if row.kept else "not kept")
            used = finite(row.share_of_the_tightest_limit)
            yield Value(name=f"{name}: share of the limit", value=used, better=-1, relative=0.1)


def ladder_document(studied: Ladder, study: Climbs, *, complete: bool) -> dict[str, Any]:
    """The content of ladder_NAME.json.

    Args:
        studied: The target.
        study: Its rows.
        complete: Whether nothing was interrupted.
    """
    settings, case = studied.experiment.settings, studied.machine.case
    conditions = [c.name for c in study.conditions if study.ways(c.name)]
    passed = all(study.complete(way) for name in conditions for way in study.ways(name).values())
    said = "; ".join(f"{name}: {verdict(study, name)}" for name in conditions)
    maps = charts(study)
    sheets = [
        Sheet(table=share_table(study, name, together=together), charts=[chart])
        for (name, together), chart in maps.items()
    ]
    claims = [found for name in conditions if (found := claims_table(study, name))]
    return result(
        "ladder",
        {
            "target": study.target,
            "title": study.title,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "integrator": settings.integrator,
            "file": studied.machine.document(),
        },
        seed=case.loop.seed if case.loop else None,
        complete=complete,
        answers=[
            Answer(
                question=f"Ladder of {study.target}",
                verdict=(KEPT if passed else NOT_KEPT) if complete else OPEN,
                words=said if complete else f"{said} Interrupted: not complete.",
            )
        ],
        standings=_standings(study, complete=complete),
        sheets=[*sheets, *(Sheet(table=found) for found in claims)],
        values=_values(study),
        **study.model_dump(),
    )


def ladders_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """Headings and tables for each document, for ``docs/ladder.md``."""
    return "\n\n".join(_text(Climbs.model_validate(document)) for document in documents)


def _text(study: Climbs) -> str:
    """How much each law uses of the tightest limit, climbing and with each rung alone."""
    first = study.conditions[0].name
    tables = [share_table(study, first, together=together) for together in (True, False)]
    if len(study.conditions) > 1:
        tables.append(load_table(study))
    tables.append(deviation_table(study, first))
    claims, assumed = claims_table(study, first), assumed_text(study)
    parts = [f"**{study.target}**: {study.title}", *map(_titled, tables)]
    # A star would begin a list.
    parts += [f"\\{assumed}"] if assumed else []
    return "\n\n".join([*parts, *([_titled(claims), claims.legend] if claims else [])])


def _titled(shown: Table) -> str:
    return "\n".join([f"{shown.title}:", "", *shown.markdown()])


# The film


def ladder_film(
    studied: Ladder, law: StudiedLaw, study: Climbs, form: Format | None = None
) -> Film:
    """A law on MuJoCo's ideal plant, around where it breaks first, and on the whole machine.

    The rigid machine is drawn: motors behind their transmissions are not seen.

    Args:
        studied: The target.
        law: One of its laws.
        study: Its rows.
        form: How the film is cut.

    Raises:
        ArgumentError: If nothing of it runs in MuJoCo.
    """
    condition = studied.conditions[0]
    rungs = [rung for rung in studied.climbing if rung.plant == "physics"]
    if not rungs:
        raise ArgumentError("a film is of runs in MuJoCo: this target has none")
    failed, last = first_failed(study.way(law.name, condition.name)), len(rungs) - 1
    at = next((i for i, rung in enumerate(rungs) if failed and rung.name == failed.rung), last)
    chosen = [rungs[i] for i in sorted({0, max(at - 1, 0), at, last})[:MOST_TAKES]]
    results = [_rigid(run_of(studied, law, rung, condition)) for rung in chosen]
    return film_of(results, form, [rung.name for rung in chosen])


def _rigid(run: RunResult) -> RunResult:
    """The same run, without the states that the rigid plant does not have."""
    plant, trajectory = run.true, run.trajectory
    assert isinstance(plant, MujocoPlant)
    assert trajectory.physics is not None
    n, model, rigid = plant.system.degrees_of_freedom, plant.undrawn_model, plant.rigid
    columns = [0, *range(1, 1 + n), *range(1 + model.nq, 1 + model.nq + n)]
    size = mujoco.mj_stateSize(rigid.undrawn_model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    assert len(columns) == size
    seen = np.ascontiguousarray(trajectory.physics[:, columns])
    return replace(run, true=rigid, trajectory=replace(trajectory, physics=seen))
