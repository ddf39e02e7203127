"""The runs of a case over time: panels of curves, drawn as a figure or written as a document.

A panel is one quantity with its unit: outputs, distance from the optimum, s, input, what is unseen.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.case import Case, seed_of
from grosmc_mj.experiments.metrics import has_cart
from grosmc_mj.experiments.requirements import Judgement, Limit
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.loop.start import rate_positions
from grosmc_mj.results.document import origin, write_json
from grosmc_mj.results.envelope import envelope, jumps
from grosmc_mj.results.palette import (
    BLACK,
    FAILED,
    LINES,
    ORANGE,
    PLANTS,
    REFERENCE,
    LawStyle,
    label_of,
    law_styles,
)
from grosmc_mj.results.tables import prefixed
from grosmc_mj.simulation.trajectory import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Of what no law sees on a machine the most telling, and at most so many.
_TELLING, _MOST_UNSEEN = ("twist", "winding", "load", "temperature", "bristle"), 3


class Curve(NamedTuple):
    """A signal of a run, at its instants or at the beginnings of its intervals.

    Attributes:
        run: Whose.
        values: From t = 0 on; NaN where there is none.
        name: ``true`` and ``seen`` of a state as it is and as a law sees it; else empty.
    """

    run: RunResult
    values: Array
    name: str = ""

    @property
    def time(self) -> Array:
        """Instants of the values [s]."""
        return self.run.trajectory.time[: len(self.values)]


class Panel(NamedTuple):
    """One quantity over time.

    Attributes:
        label: Name and unit.
        curves: Of the runs.
        limits: Kinds of requirement that speak of it.
        reference: Where it should be, at the instants of the first run; None for nowhere.
        signed: Whether it has a sign, so that a limit is one to both sides.
        play: Of a transmission, shaded to both sides of zero.
    """

    label: str
    curves: Sequence[Curve]
    limits: tuple[str, ...] = ()
    reference: Array | None = None
    signed: bool = True
    play: float = 0.0


def panels_of(results: Sequence[RunResult]) -> list[Panel]:
    """The panels of these runs; laws' own signals are of the last plant, what chatters first."""
    first, last = results[0], [run for run in results if run.plant == results[-1].plant]
    calm = sorted(last, key=lambda run: -(run.metrics["total_variation"].value or 0.0))
    system, error = first.trajectory.system, first.controller.designed.error
    panels = list(_outputs(results))
    one, single = len(system.inputs) == 1, len(panels) == 1
    distance = "distance from y*" if single else "|y − y*|"
    unit = error.units[first.comparison.outputs[0]]
    deviations = [Curve(run, run.comparison.deviation) for run in results]
    panels.append(Panel(f"{distance} [{unit}]", deviations, ("deviation_below",), signed=single))
    kinds = {limit.kind for limit in first.experiment.limits}
    if "cart_travel_below" in kinds and has_cart(system):
        label = f"travel of the {system.states[0].name.removesuffix(' position')} [m]"
        positions = [(run, run.trajectory.state[:, 0]) for run in results]
        travels = [Curve(run, x - x[0]) for run, x in positions]
        panels.append(Panel(label, travels, ("cart_travel_below",)))
    looped = first.trajectory.seen is not None
    if looped:
        j = system.controlled[0]
        label = f"{system.states[j].name},\nseen − true [{system.states[j].unit}]"
        panels.append(Panel(label, [Curve(run, _misseen(run)[:, j]) for run in calm]))
        panels += _seen_rates(last[-1])
    units = [unit for run in results if (unit := run.controller.designed.sliding_unit)]
    if units:
        name = ("s" if one else "largest |s|") + (", as the law\nsees it" if looped else "")
        sliding = [Curve(run, _sliding(run)) for run in calm]
        limited = ("sliding_below", "no_reaching_phase")
        panels.append(Panel(f"{name} [{units[0]}]", sliding, limited, signed=one))
    name = (system.input.name if one else "largest |u|") + (" given" if looped else "")
    inputs = [Curve(run, _largest(run.trajectory.input)) for run in calm]
    panels.append(Panel(f"{name} [{system.input.unit}]", inputs, ("input_below",), signed=one))
    return panels + list(itertools.islice(_unseen(calm), _MOST_UNSEEN))


def _outputs(results: Sequence[RunResult]) -> Iterator[Panel]:
    """A panel for each output, with its reference."""
    first = results[0]
    system, error = first.trajectory.system, first.controller.designed.error
    rows, kinds = first.comparison.outputs, ("stays_within", "final_error_below", "settles_within")
    named = error.outputs is None and len(rows) == len(system.controlled)
    for j, row in enumerate(rows):
        number = "" if len(rows) == 1 else str(j + 1)
        name = system.states[system.controlled[j]].name if named else f"output y{number}"
        curves = []
        for run in results:
            known, sign = run.comparison, run.controller.designed.error.sign
            curves.append(Curve(run, known.reference[:, j] + sign * known.z[:, known.outputs[j]]))
        reference = first.comparison.reference[:, j]
        yield Panel(f"{name} [{error.units[row]}]", curves, kinds, reference)


def _seen_rates(run: RunResult) -> Iterator[Panel]:
    """Of rates estimated or measured imperfectly, the one of each unit that is seen worst."""
    loop, states, seen = run.case.loop, run.trajectory.system.states, run.trajectory.seen
    if loop is None or seen is None:
        return
    positions = sorted(rate_positions(run.trajectory.system))
    rates = [i for i in positions if states[i].name in loop.not_known_exactly]
    off = np.abs(_misseen(run)).max(axis=0, initial=0.0).tolist()
    for unit in dict.fromkeys(states[i].unit for i in rates):
        worst = max((i for i in rates if states[i].unit == unit), key=lambda i: off[i])
        true = run.trajectory.state[: len(seen), worst]
        curves = [Curve(run, true, "true"), Curve(run, seen[:, worst], "seen")]
        yield Panel(f"{states[worst].name} [{unit}]", curves)


def _unseen(runs: Sequence[RunResult]) -> Iterator[Panel]:
    """Of signals that no law sees on a machine, the largest of each kind and unit."""
    signals = runs[0].trajectory.unseen
    rows = {hidden: [hidden.of(run.trajectory.physics) for run in runs] for hidden in signals}
    sizes = {
        hidden: max(float(np.abs(y).max(initial=0.0)) for y in rows[hidden]) for hidden in signals
    }
    for kind, unit in itertools.product(_TELLING, dict.fromkeys(hidden.unit for hidden in signals)):
        alike = [hidden for hidden in signals if (hidden.kind, hidden.unit) == (kind, unit)]
        if alike:
            largest = max(alike, key=lambda signal: sizes[signal])
            shown, scale = prefixed(unit, sizes[largest])
            curves = [Curve(run, scale * y) for run, y in zip(runs, rows[largest], strict=True)]
            label = f"{largest.name},\nnot seen [{shown}]"
            yield Panel(label, curves, play=scale * largest.play)


def _sliding(run: RunResult) -> Array:
    """s, or nothing where a law has no surface."""
    sliding = run.trajectory.sliding
    return np.full(len(run.trajectory.time) - 1, np.nan) if sliding is None else _largest(sliding)


def _misseen(run: RunResult) -> Array:
    """States as a law sees them less as they are, (N, n)."""
    true, seen = run.trajectory.state[:-1], run.trajectory.seen
    return np.zeros_like(true) if seen is None else seen - true


def levels_of(limit: Limit, panel: Panel) -> Iterator[tuple[Array, Array]]:
    """Where a requirement's limit is, as times and values; none of those without a level."""
    if limit.kind in ("no_reaching_phase", "settles_within"):
        return
    first = panel.curves[0].run
    time, middle = np.array([limit.after, first.case.duration]), np.zeros(2)
    if panel.reference is not None:
        since = first.comparison.time >= limit.after
        time, middle = first.comparison.time[since], panel.reference[since]
    for side in (1.0, -1.0) if panel.signed else (1.0,):
        yield time, middle + side * limit.value


def judged_in(panel: Panel, results: Sequence[RunResult]) -> list[Judgement]:
    """The requirements that a panel shows."""
    judged = (item for run in results for item in run.requirements)
    return [item for item in judged if item.limit.kind in panel.limits]


def _largest(rows: Array) -> Array:
    """A single signal as it is; of several the largest magnitude."""
    return rows if rows.ndim == 1 else np.abs(rows).max(axis=1)


# -- as a figure ---------------------------------------------------------------------------------

# Of a panel [inch], and what stands around them all.
_WIDTH, _HEIGHT, _AROUND = 7.2, 1.9, 1.3
_ALONE: dict[str, Any] = {"lw": 1.6}
_LIMIT: dict[str, Any] = {"color": BLACK, "lw": 1.0, "ls": (0, (4, 2)), "zorder": 4}
# A rate as it is, and as a law sees it on top.
_TRUE: dict[str, Any] = {"color": BLACK, "lw": 3.2, "alpha": 0.45}
_SEEN: dict[str, Any] = {"color": ORANGE, "lw": 1.3}
_PLAY: dict[str, Any] = {"color": BLACK, "alpha": 0.13, "lw": 0}
_MARK_SIZE = 8
# More outputs than this are drawn side by side in pairs.
_ONE_BELOW_THE_OTHER = 3


def figure_size(results: Sequence[RunResult]) -> tuple[float, float]:
    """Width and height of the figure of these runs [inch]."""
    columns, rows = _grid(len(panels_of(results)), results)
    return columns * _WIDTH * (0.75 if columns > 1 else 1.0), rows * _HEIGHT + _AROUND


def draw_experiment(figure: Figure, results: Sequence[RunResult]) -> None:
    """Draw all runs of a case file on an empty figure, over time.

    A panel whose requirement is not kept has a frame and says which.
    """
    # Here, for the document of curves needs no matplotlib.
    from grosmc_mj.results.figure import TITLE_SIZE, labelled_below

    panels = panels_of(results)
    columns, rows = _grid(len(panels), results)
    axes = np.ravel(figure.subplots(rows, columns, sharex=True, squeeze=False))
    for empty in axes[len(panels) :]:
        empty.set_visible(False)
    styles, below = law_styles(result.controller.name for result in results), []
    for where, panel in zip(axes, panels, strict=False):
        several = len({curve.run.plant for curve in panel.curves}) > 1
        for curve in panel.curves:
            _draw(where, curve, styles, several=several)
        if panel.curves[0].name:
            # Above, where it hides nothing.
            corner: Any = {"loc": "lower right", "bbox_to_anchor": (1, 1), "borderaxespad": 0}
            where.legend(ncols=2, frameon=False, **corner)
        else:
            below.append(where)
        if panel.reference is not None:
            time = results[0].comparison.time
            where.plot(time, panel.reference, label="reference", **REFERENCE)
        if panel.play:
            where.axhspan(-panel.play / 2, panel.play / 2, label="backlash", **_PLAY)
        where.set_ylabel(panel.label)
        shade_disturbances(where, results[0].case)
        _mark(where, panel, results)
    for where in axes[max(0, len(panels) - columns) : len(panels)]:
        where.set_xlabel("time t [s]")
        where.tick_params(labelbottom=True)
    figure.suptitle(results[0].case.title, fontsize=TITLE_SIZE)
    labelled_below(figure, below)


def _grid(panels: int, results: Sequence[RunResult]) -> tuple[int, int]:
    """Columns and rows."""
    columns = 2 if len(results[0].comparison.outputs) > _ONE_BELOW_THE_OTHER else 1
    return columns, -(-panels // columns)


def _draw(axes: Axes, curve: Curve, styles: dict[str, LawStyle], *, several: bool) -> None:
    """A run's curve; of one that jumps at every sample its range and its mean."""
    run, time, values = curve.run, curve.time, curve.values
    law = styles[run.controller.name]
    style: dict[str, Any] = {
        "": {
            "color": law.colour,
            "label": f"{law.label}, {PLANTS[run.plant]}",
            **(LINES[run.plant] if several else _ALONE),
        },
        "true": {"label": "true", **_TRUE},
        "seen": {"label": f"seen by {label_of(run.controller.name)}", **_SEEN},
    }[curve.name]
    if not curve.name and run.status is not Status.COMPLETED and len(time):
        axes.plot(time[-1], values[-1], "X", color=law.colour, mec="white", ms=9)
        axes.annotate(
            "ended", (time[-1], values[-1]), (5, 3), textcoords="offset points",
            fontsize=_MARK_SIZE, color=law.colour, rotation=40,
        )  # fmt: skip
    if jumps(values[np.isfinite(values)]):
        band = envelope(time, values)
        ends = (band.time, band.least, band.largest)
        axes.fill_between(*ends, color=style["color"], alpha=0.25, lw=0)
        time, values = band.time, band.mean
    axes.plot(time, values, rasterized=True, **style)


def _mark(axes: Axes, panel: Panel, results: Sequence[RunResult]) -> None:
    """The limits of what a panel shows, and a frame with words where one is not kept."""
    judged = judged_in(panel, results)
    failed = [item for item in judged if not item.kept]
    for limit in dict.fromkeys(item.limit for item in judged):
        broken = any(item.limit == limit for item in failed)
        style = {"lw": 2.0, "label": "limit, not kept"} if broken else {"label": "limit"}
        for level in levels_of(limit, panel):
            axes.plot(*level, **{**_LIMIT, **style})
    if not failed:
        return
    for side in axes.spines.values():
        side.set(visible=True, color=FAILED, linewidth=1.6)
    laws = dict.fromkeys((judgement.limit.words, judgement.controller) for judgement in failed)
    title = "\n".join(f"not kept by {law}: {words}" for words, law in laws)
    axes.set_title(title, loc="right", fontsize=_MARK_SIZE, color=FAILED, pad=3)


def shade_disturbances(axes: Axes, case: Case) -> None:
    """Shade the time in which each disturbance of a case acts, on axes as long as it."""
    from grosmc_mj.results.figure import shade

    for disturbance in case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label or f"disturbance on {disturbance.body}"
        shade(axes, start, min(stop, case.duration), label)
    axes.set_xlim(0, case.duration)


# -- as a document -------------------------------------------------------------------------------

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
                "start": disturbance.window[0],
                "stop": min(disturbance.window[1], case.duration),
                "label": disturbance.label or f"disturbance on {disturbance.body}",
            }
            for disturbance in case.disturbances
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
        band = envelope(time, values)
        limits = [_short(band.least), _short(band.largest)]
        return {**whose, **_points(band.time, band.mean), "range": limits}
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
