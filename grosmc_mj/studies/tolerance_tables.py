"""What the tolerances of a target say: its answer, its table, its charts and its document."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.cells import cell_len

from grosmc_mj.results.figure import in_lines
from grosmc_mj.results.result import (
    MEASURED,
    OPEN,
    Answer,
    CellChart,
    Sheet,
    Standing,
    Value,
    result,
)
from grosmc_mj.results.tables import (
    WIDTH,
    Table,
    names,
    number,
    numbers,
    table,
    text,
    words,
)
from grosmc_mj.studies.figures import write_cells
from grosmc_mj.studies.search import BEYOND, LEAST, MOST, RESOLUTION
from grosmc_mj.studies.tolerance import Level, Setting, Tolerance, Tolerances

LEGEND = (
    "The largest amount up to which all is kept, of the first part. no: not kept without it; "
    "none: only without it; ≥ and ≤: kept up to the last that was tried; *: kept again beyond; "
    "!: MuJoCo differs from the equations, and counts."
)
# Letters in a line of a header, and octaves of a chart's colours.
_LETTERS, _OCTAVES = 12, 6.0


def cell_text(study: Tolerances, row: Tolerance | None) -> str:
    """A tolerance in a cell of a table, without its unit; empty for none."""
    if row is None:
        return ""
    kind = study.kind(row)
    if row.impossible:
        shown = "-"
    elif not kind.graded:
        shown = "yes" if row.kept_ideally and row.smallest_failed is None else "no"
    elif not row.kept_ideally:
        shown = "no"
    elif row.none:
        shown = "none"
    else:
        shown = number(row.largest_kept.shown * kind.scale)
        if row.smallest_failed is None:
            shown = f"{'≤' if kind.limits else '≥'} {shown}"
    return shown + "*" * bool(row.kept_again) + "!" * (row.physics_agrees is False)


def reason(row: Tolerance) -> str:
    """The requirement that fails, in words."""
    return (row.breaks or "").replace("_", " ")


def verdict(study: Tolerances) -> str:
    """Which law breaks first, at how much of what."""
    single = {kind.name for kind in study.imperfections if kind.graded and not kind.whole}
    broken = [
        row
        for row in study.tolerances
        if row.kept_ideally and row.smallest_failed and row.imperfection in single
    ]
    if not broken:
        return "No single imperfection that was tried breaks what a law keeps without it."
    worst = min(broken, key=lambda row: row.weakness)
    assert worst.smallest_failed is not None

    def amount(level: Level) -> str:
        return f"{study.kind(worst).text(level)} ({number(level.factor)} times the bench's)"

    kept = "only without it" if worst.none else f"up to {amount(worst.largest_kept)}"
    where = "" if worst.condition == "nominal" else f" under {worst.condition}"
    return (
        f"{worst.law} breaks first, by {worst.imperfection}{where}: all is kept {kept}, and "
        f"no longer at {amount(worst.smallest_failed)}: {reason(worst)}."
    )


def notes(study: Tolerances) -> Iterator[str]:
    """Which laws keep the bench, which keep nothing, and how often MuJoCo was asked."""
    rows, whole = study.tolerances, {kind.name for kind in study.imperfections if kind.whole}
    for condition in dict.fromkeys(row.condition for row in rows):
        own = [row for row in rows if row.condition == condition]
        kept = [
            row.law
            for row in own
            if row.imperfection in whole and row.kept_ideally and not row.impossible
            and row.largest_kept.factor >= 1.0
        ]  # fmt: skip
        yield f"The whole bench, {condition}: {'; '.join(kept) or 'no law'}."
        laws = dict.fromkeys(row.law for row in own)
        if never := [law for law in laws if not study.stands_ideally(law, condition)]:
            yield f"Not kept even ideally, {condition}: {'; '.join(never)}."


def confirmed(study: Tolerances) -> tuple[int, int]:
    """How many answers MuJoCo confirmed or not, and how many of them differ."""
    agrees = [x.physics_agrees for x in study.tolerances if x.physics_agrees is not None]
    return len(agrees), agrees.count(False)


def least_table(study: Tolerances, title: str = "") -> Table:
    """Laws by imperfections: the least over the conditions that a law keeps ideally.

    The strongest law stands first, and the imperfection of which the least is stood.
    """
    rows = {(row.law, row.imperfection): row for row in study.least()}
    stands = {
        law: [c.name for c in study.conditions if study.stands_ideally(law, c.name)]
        for law, _ in rows
    }

    def weakest(kind: str) -> float:
        own = (row for (_, name), row in rows.items() if name == kind and row.kept_ideally)
        return min((row.weakness for row in own), default=0.0)

    present = dict.fromkeys(name for _, name in rows)
    kinds = sorted(
        (kind for name in present for kind in study.imperfections if kind.name == name),
        key=lambda kind: weakest(kind.name),
    )

    def strength(law: str) -> tuple[int, float]:
        whole = (rows[law, k.name].weakness for k in kinds if k.whole and (law, k.name) in rows)
        return len(stands[law]), next(whole, 0.0)

    headings = [in_lines(kind.heading, _LETTERS) for kind in kinds]
    cells = [
        [law, ", ".join(stands[law]), *(cell_text(study, rows.get((law, k.name))) for k in kinds)]
        for law in sorted(stands, key=strength, reverse=True)
    ]
    columns = [*words("law", "keeps ideally"), *numbers(*headings)]
    return table(title, columns, cells, legend=LEGEND)


def in_width(wide: Table, width: int = WIDTH) -> tuple[Table, list[str]]:
    """The first columns of a table that fit into a width, and the headers of the others."""
    cells = zip([column.header for column in wide.columns], *wide.rows, strict=True)
    widths = [max(cell_len(x) for text in own for x in text.split("\n")) + 2 for own in cells]
    room = sum(sum(widths[: i + 1]) <= width for i in range(len(widths)))
    left = [column.header.replace("\n", " ") for column in wide.columns[room:]]
    rows = [row[:room] for row in wide.rows]
    return wide.model_copy(update={"columns": wide.columns[:room], "rows": rows}), left


def every_answer(study: Tolerances) -> Table:
    """Every tolerance, the smallest factor first."""
    rows = []
    for row in sorted(study.tolerances, key=lambda row: row.weakness):
        kind, kept = study.kind(row), row.largest_kept
        amount = kept.factor > 0 and kind.graded
        rows.append(
            (
                row.condition,
                row.law,
                row.imperfection,
                kind.text(kept) if amount else cell_text(study, row),
                number(kept.factor) if row.kept_ideally and kind.graded else "",
                reason(row),
                "; ".join(
                    f"{number(low.factor)} to {number(high.factor)}" for low, high in row.kept_again
                ),
                {None: "", True: "agrees", False: "differs"}[row.physics_agrees],
            )
        )
    columns = [
        *words("condition"), *names("law"), *text("imperfection"), *numbers("kept up to", "factor"),
        *words("breaks", "again", "physics"),
    ]  # fmt: skip
    return table("Every answer", columns, rows)


def charts(study: Tolerances) -> list[CellChart]:
    """A map for each condition: octaves below what the bench has, blue for more of it."""
    maps = []
    for condition in study.conditions:
        cells = {}
        for row in study.tolerances:
            if row.condition == condition.name and not row.impossible:
                factor = row.largest_kept.factor if row.kept_ideally and not row.none else 0.0
                octaves = math.log2(factor) if factor > 0 else -_OCTAVES
                octaves = _OCTAVES if math.isinf(row.weakness) else octaves
                why = f"then breaks: {reason(row)}" if row.breaks else ""
                value = -max(-_OCTAVES, min(_OCTAVES, octaves))
                cells[row.law, study.kind(row).heading] = (value, cell_text(study, row), why)
        if cells:
            maps.append(CellChart.of(f"{condition.name}: {condition.title}", cells, _OCTAVES))
    return maps


def write_tolerance_figure(study: Tolerances, path: Path) -> Path:
    """Draw the maps of all conditions; the SVG lies beside the PNG.

    Raises:
        SetupError: If a file cannot be written.
    """
    note = f"{LEGEND} Blue: more than the bench has; red: less."
    return write_cells(
        path, f"{study.target}: what of the loop each law stands", charts(study), note
    )


def _standings(study: Tolerances, *, complete: bool) -> Iterator[Standing]:
    """Of what each law stands the least."""
    for law in dict.fromkeys(row.law for row in study.tolerances):
        own = [row for row in study.tolerances if row.law == law and row.kept_ideally]
        failed = [row for row in own if row.smallest_failed is not None]
        at, said = "", "stands all that was tried"
        if not own:
            at, said = "ideal loop", "not kept even in an ideal loop"
        elif failed:
            least = min(failed, key=lambda row: row.largest_kept.factor)
            at = "all of them" if study.kind(least).whole else least.imperfection
            kept = "only without it"
            if not least.none:
                kept = f"up to {study.kind(least).text(least.largest_kept)}"
            said = f"kept {kept}, then {reason(least)} ({least.condition})"
        yield Standing(case=study.target, law=law, breaks_at=at, words=said, complete=complete)


def _values(study: Tolerances) -> Iterator[Value]:
    for row in study.tolerances:
        if not row.impossible:
            name = f"{study.target} {row.condition} {row.law}, {row.imperfection}"
            yield Value(name=f"{name}: ideally", value="kept" if row.kept_ideally else "not kept")
            most = row.largest_kept.factor
            yield Value(name=f"{name}: largest kept", value=most, better=1, relative=0.1)


def tolerance_document(
    studied: Setting, study: Tolerances, seeds: int, *, complete: bool
) -> dict[str, Any]:
    """The content of tolerance_NAME.json.

    Args:
        studied: The target.
        study: Its tolerances.
        seeds: Runs where something is random.
        complete: Whether nothing was interrupted.
    """
    settings, rows = studied.experiment.settings, study.tolerances
    laws = dict.fromkeys(row.law for row in rows)
    weak = {row.law for row in rows if not row.kept_ideally}
    said = f"{len(laws) - len(weak)} of {len(laws)} laws keep all in every ideal loop"
    checked, differing = confirmed(study)
    maps = charts(study)
    return result(
        "tolerance",
        {
            "target": study.target,
            "bench": studied.bench_of,
            "control_period": {"value": settings.control_period, "unit": "s"},
            "timestep": {"value": settings.timestep, "unit": "s"},
            "runs_where_random": seeds,
            "factors": {
                "least": LEAST, "most": MOST, "grid": 2.0, "beyond_the_last_kept": BEYOND,
                "resolution": RESOLUTION,
            },
        },
        seed=studied.bench.seed,
        complete=complete,
        answers=[
            Answer(
                question=f"Tolerance of {study.target}",
                verdict=MEASURED if complete else OPEN,
                words=said if complete else f"{said}, so far",
                more=verdict(study),
            )
        ],
        standings=_standings(study, complete=complete),
        sheets=[Sheet(table=least_table(study, f"{study.target}: tolerances"), charts=maps)],
        values=_values(study),
        laws=[
            {
                "name": law.name,
                "predicts": law.predict,
                "sampled": law.settings,
                "requirements": {
                    condition.name: [limit.words for limit in studied.limits(law, condition)]
                    for condition in studied.conditions
                },
            }
            for law in studied.laws
        ],
        physics={"answers_checked": checked, "answers_that_differ": differing},
        **study.model_dump(),
    )  # fmt: skip


def tolerances_text(documents: Iterable[Mapping[str, Any]]) -> str:
    """A heading and a table for each document, for ``docs/as_built.md``."""
    parts = []
    for study in map(Tolerances.model_validate, documents):
        lines = [line.replace("\n", " ") for line in least_table(study).markdown()]
        checked, differing = confirmed(study)
        said = f"MuJoCo was asked about {checked} of the answers, and differs on {differing}."
        parts.append("\n".join([f"**{study.target}**", "", *lines, "", said]))
    return "\n\n".join(parts)
