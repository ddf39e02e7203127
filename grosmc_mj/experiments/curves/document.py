"""curves/NAME.json: what the figure of a case shows, in numbers, beside the results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.case import seed_of
from grosmc_mj.experiments.curves.panels import Curve, Panel, judged_in, levels_of, panels_of
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.results.document import origin, write_json
from grosmc_mj.results.envelope import envelope, jumps
from grosmc_mj.results.palette import law_styles

# Beside the results.
FOLDER = "curves"
# How far a curve may be from what was recorded, as a share of its range.
_OFF = 5e-4
# Points of a curve; one that needs more is drawn as one that jumps.
_MOST = 800


def write_curves(results: Sequence[RunResult], name: str, out: Path) -> Path:
    """Write the curves of the runs of one case.

    Args:
        results: Its runs.
        name: Of their files.
        out: Where its other results are.

    Raises:
        SetupError: If it cannot be written.
    """
    path = out / FOLDER / f"{name}.json"
    write_json(path, curves_document(results))
    return path


def curves_document(results: Sequence[RunResult]) -> dict[str, Any]:
    """The curves of the runs of one case, with no more points than lines between them need.

    Of a signal that jumps all the time the range and the mean in short times stand side by
    side. Every other number is one of the run's, to seven digits.
    """
    case = results[0].case
    styles = law_styles(result.controller.name for result in results)
    return {
        **origin(seed_of(case)),
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "duration": case.duration,
        "disturbances": [
            {
                "start": each.window[0],
                "stop": min(each.window[1], case.duration),
                "label": each.label or f"disturbance on {each.body}",
            }
            for each in case.disturbances
        ],
        "laws": {
            name: {"label": style.label, "colour": style.colour} for name, style in styles.items()
        },
        "panels": [_panel(panel, results) for panel in panels_of(results)],
    }


def _panel(panel: Panel, results: Sequence[RunResult]) -> dict[str, Any]:
    """One panel."""
    limits = dict.fromkeys(item.limit for item in judged_in(panel, results))
    time, reference = results[0].comparison.time, panel.reference
    return {
        "label": panel.label.replace("\n", " "),
        "curves": [_curve(curve) for curve in panel.curves],
        "reference": None if reference is None else _drawn(time, reference),
        "limits": [
            {"words": limit.words, **_drawn(*level)}
            for limit in limits
            for level in levels_of(limit, panel)
        ],
        "play": panel.play,
    }


def _curve(curve: Curve) -> dict[str, Any]:
    """One curve, where it has values."""
    whose = {"law": curve.run.controller.name, "plant": curve.run.plant, "name": curve.name}
    there = np.isfinite(curve.values)
    time, values = curve.time[there], curve.values[there]
    if jumps(values) or (kept := _kept(time, values)).sum() > _MOST:
        found = envelope(time, values)
        limits = [_short(found.least), _short(found.largest)]
        return {**whose, **_points(found.time, found.mean), "range": limits}
    return {**whose, **_points(time[kept], values[kept]), "range": None}


def _drawn(time: Array, values: Array) -> dict[str, list[float]]:
    """Instants and values of a curve without those that a line between its others would give."""
    kept = _kept(time, values)
    return _points(time[kept], values[kept])


def _points(time: Array, values: Array) -> dict[str, list[float]]:
    """Points of a curve, in short numbers."""
    return {"t": _short(time), "y": _short(values)}


def _kept(time: Array, values: Array) -> NDArray[np.bool_]:
    """Which points a curve needs: Ramer, Douglas and Peucker's, by distances along y.

    Between two of them no value is further from their line than a small share of the range.
    """
    kept = np.zeros(len(values), bool)
    kept[:1] = kept[-1:] = True
    allowed = _OFF * float(np.ptp(values)) if len(values) else 0.0
    parts = [(0, len(values) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        slope = (values[last] - values[first]) / (time[last] - time[first])
        off = np.abs(values[inner] - values[first] - slope * (time[inner] - time[first]))
        worst = first + 1 + int(off.argmax())
        if off[worst - first - 1] > allowed:
            kept[worst] = True
            parts += [(first, worst), (worst, last)]
    return kept


def _short(values: Array) -> list[float]:
    """Numbers with seven digits."""
    return [float(f"{value:.7g}") for value in values.tolist()]
