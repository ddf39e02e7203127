"""Tables and charts of studies, sweeps and premises."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import TypeVar

from pydantic import BaseModel

from grosmc_mj.page.sheets import (
    Line,
    Sheet,
    cells_chart,
    grid_chart,
    lines_chart,
)
from grosmc_mj.page.studies.documents import (
    StoredAudit,
    StoredPremises,
    StoredReading,
    StoredRegion,
    StoredSample,
    StoredSweep,
    StoredSweeps,
    StoredSwitching,
    StoredSwitchingCase,
)
from grosmc_mj.page.studies.searches import search_sheets
from grosmc_mj.results.palette import BLACK, BLUE, ORANGE, PURPLE, YELLOW
from grosmc_mj.results.tables import number, shown_unit

Row = TypeVar("Row", bound=BaseModel)

# As the figure of the study has them.
_OUTCOMES = {"c": BLUE, "l": ORANGE, "s": PURPLE, "n": YELLOW, "d": BLACK}
_OTHER = "#888888"
# Such as: declared reaching rate = 0.02 A.
_CHOICE = re.compile(r".*= (?P<number>[-+]?\d[\d.]*(?:e[-+]?\d+)?)(?P<unit> .*)?", re.DOTALL)


def study_sheets(content: BaseModel | None) -> Sequence[Sheet]:
    """The sheets of a document; none of one of another kind."""
    match content:
        case StoredRegion():
            return [_region(content)]
        case StoredSwitching():
            return [_scalar(content), _switching(content.cases)]
        case StoredSweeps():
            return [_sweeps(content.sweeps)]
        case StoredPremises():
            return [_premises(content.premises)]
        case _:
            return search_sheets(content)


def _region(content: StoredRegion) -> Sheet:
    """What became of the starts."""
    axes = []
    for axis in content.configuration.axes:
        unit, factor = shown_unit(axis.unit)
        axes.append((f"start {axis.name} [{unit}]", axis.limit * factor, factor, unit))
    legend = {
        letter: (each.name, _OUTCOMES.get(letter, _OTHER))
        for letter, each in content.outcomes.items()
        if any(letter in row for found in content.maps for row in found.grid)
    }
    names = [name for name, _ in legend.values()]
    rows = []
    for each in content.maps:
        starts = sum(each.counts.values())
        rest = each.converges_on_first_axis
        ends = [end for end in (rest.start, rest.stop) if end is not None]
        rows.append(
            [
                f"{each.case}, {each.controller}",
                *(_share(each.counts.get(name, 0), starts) for name in names),
                " to ".join(f"{number(x * axes[0][2])} {axes[0][3]}" for x in ends) or "none",
            ]
        )
    return Sheet(
        f"Region of {content.system}: what becomes of each start",
        "At rest: the widest interval of starts of the first axis alone that all converge.",
        ["map", *names, "converges at rest"],
        rows,
        [
            grid_chart(f"{each.case}, {each.controller}", [x[:2] for x in axes], each.grid, legend)
            for each in content.maps
        ],
    )


def _share(count: int, of: int) -> str:
    return f"{count} ({number(count / of * 100)} %)" if of > 0 else str(count)


def _scalar(content: StoredSwitching) -> Sheet:
    """The switching laws on the scalar benchmark."""
    found = content.benchmark
    times = sorted({each.h for each in found.sample_times}, reverse=True)
    rows = []
    for law, own in _by(found.sample_times, "law"):
        at = {each.h: each.max_sliding for each in own}
        values = ["diverges" if h in at and at[h] is None else number(at.get(h)) for h in times]
        rows.append([law, number(found.orders.get(law)), *values])
    return Sheet(
        f"Switching laws on {found.equation}",
        "Order: of max |s| in the sample time h. What diverges has no point.",
        ["law", "order", *(f"max |s| at {h * 1e3:.4g} ms" for h in times)],
        rows,
        [
            _over("over the sample time", "sample time h [s]", "h", found.sample_times),
            _over("over the input gain", "true over nominal gain r", "gain_ratio",
                  found.gain_ratios),
        ],
    )  # fmt: skip


def _over(name: str, title: str, key: str, samples: Sequence[StoredSample]) -> dict[str, object]:
    """The largest |s| of each law over something."""
    lines = [
        Line(law, [getattr(each, key) for each in own], [each.max_sliding for each in own])
        for law, own in _by(samples, "law")
    ]
    return dict(lines_chart(name, (title, "max |s|"), lines))


def _switching(cases: Sequence[StoredSwitchingCase]) -> Sheet:
    """How far each switching law strays in the cases, over the control period."""
    periods = sorted({each.control_period for each in cases})
    rows, charts = [], []
    for named, own in _by(cases, "system", "case", "surface"):
        lines = []
        for law, found in _by(own, "law"):
            lines.append(Line(law, [x.control_period for x in found], [x.deviation for x in found]))
            at = {each.control_period: _deviation(each) for each in found}
            rows.append([named, law, *(at.get(period, "-") for period in periods)])
        titles = ("control period [s]", "deviation [m or rad]")
        charts.append(lines_chart(f"{named} surface", titles, lines))
    return Sheet(
        "Switching laws in the cases, in MuJoCo",
        "Deviation: max |x1 - x1*| in the unit of x1, m or rad.",
        ["case, surface", "law", *(f"deviation at {x * 1e3:.4g} ms" for x in periods)],
        rows,
        charts,
    )


def _deviation(each: StoredSwitchingCase) -> str:
    return f"ended: {each.ended}" if each.ended else number(each.deviation)


def _sweeps(sweeps: Sequence[StoredSweep]) -> Sheet:
    """What each claim turns on, what turns an answer first."""
    ordered = sorted(sweeps, key=lambda each: not each.flips)
    rows, charts = [], []
    for each in ordered:
        values = [trial.measured for trial in each.values if trial.measured is not None]
        ends = f"{number(min(values))} to {number(max(values))}" if values else "-"
        held = sum(trial.holds is True for trial in each.values)
        rows.append(
            [
                each.claim, each.choice, "printed" if each.printed else "not printed", ends,
                f"{held} of {len(each.values)}", each.flips or "nowhere",
            ]
        )  # fmt: skip
        charts.append(_sweep_chart(each))
    return Sheet(
        "Claims over what the chapter leaves open",
        "Filled: the claim holds; cross: it does not; open: nothing can be told. Dotted: where "
        "its answer turns.",
        ["claim", "choice", "in the chapter", "measured", "holds", "its answer turns"],
        rows,
        charts,
    )


def _sweep_chart(each: StoredSweep) -> dict[str, object]:
    """What was measured over a choice: over its numbers, if it has any."""
    read = [_number_of(trial.choice) for trial in each.values]
    units = {unit for x, unit in read if x is not None}
    numeric = len(units) == 1 and all(x is not None for x, _ in read)
    short = [trial.choice.removeprefix(f"{each.choice} = ") for trial in each.values]
    x: list[float | str] = [x for x, _ in read if x is not None] if numeric else [*short]
    unit = f" [{units.pop()}]" if numeric and units != {""} else ""
    turns = [_number_of(part)[0] for part in each.flips.split("; ") if part.startswith("at ")]
    line = Line(
        each.claim,
        x,
        [trial.measured for trial in each.values],
        short,
        [trial.holds for trial in each.values],
    )
    return dict(
        lines_chart(
            f"{each.claim}: {each.choice}" + (", turns" if each.flips else ""),
            (each.choice + unit, "measured"),
            [line],
            marks=[turn for turn in turns if turn is not None] if numeric else (),
        )
    )


def _number_of(choice: str) -> tuple[float | None, str]:
    """The number and the unit of a choice as it is written."""
    found = _CHOICE.fullmatch(choice)
    try:
        value = float(found["number"]) if found else math.inf
    except ValueError:
        return None, ""
    if not (found and math.isfinite(value)):
        return None, ""
    return value, (found["unit"] or "").strip()


def _premises(audits: Sequence[StoredAudit]) -> Sheet:
    """Which premises hold in which case, with their margins."""
    cells, rows = {}, []
    for audit in audits:
        named = f"{audit.case}, {audit.controller}"
        for each in audit.premises:
            readings = [x for x in (each.region, each.along_run) if x is not None]
            margins = [x.margin for x in readings if x.margin is not None]
            text = "✓" if each.holds else f"✗ {number(min(margins, default=None))}"
            why = each.restored_by and f"restored by {each.restored_by}"
            cells[named, each.name] = (-1.0 if each.holds else 1.0, text, why or each.requirement)
            rows.append(
                [
                    named, each.name, "holds" if each.holds else "FAILS",
                    _reading(each.region, each.unit), _reading(each.along_run, each.unit),
                    each.restored_by, each.source,
                ]
            )  # fmt: skip
    rows.sort(key=lambda row: row[2] == "holds")
    return Sheet(
        "Premises of the theorems",
        "Margins are positive where a premise holds; in brackets the share that violates it.",
        ["case, law", "premise", "", "in the region", "along the run", "restored by", "source"],
        rows,
        [cells_chart("premises", cells, 2.0)],
    )


def _reading(reading: StoredReading | None, unit: str) -> str:
    if reading is None:
        return "-"
    share = "" if not reading.violated else f" ({number(100 * reading.violated)} %)"
    return number(reading.margin) + ("" if unit == "1" else f" {unit}") + share


def _by(rows: Iterable[Row], *keys: str) -> list[tuple[str, list[Row]]]:
    """Rows by what they have in common, in words."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(", ".join(str(getattr(row, key)) for key in keys), []).append(row)
    return list(found.items())
