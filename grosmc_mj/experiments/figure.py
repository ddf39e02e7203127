"""The figure of a case: outputs, distance from the optimum, limits, s, input, what is unseen."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.case import Case
from grosmc_mj.experiments.metrics.recorded import has_cart
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.experiments.runs import PlantName, RunResult
from grosmc_mj.report.figure import TITLE_SIZE, envelope, jumps, labelled_below, shade
from grosmc_mj.report.palette import (
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
from grosmc_mj.report.tables import prefixed
from grosmc_mj.simulation.loop.layout import rate_positions
from grosmc_mj.simulation.machine.unseen import UnseenState
from grosmc_mj.simulation.trajectory import Status

# Of a panel [inch], and what stands around them all.
_WIDTH, _HEIGHT, _AROUND = 7.2, 1.9, 1.3
_ALONE: dict[str, Any] = {"lw": 1.6}
_LIMIT: dict[str, Any] = {"color": BLACK, "lw": 1.0, "ls": (0, (4, 2)), "zorder": 4}
# A rate as it is, and as a law sees it on top.
_TRUE: dict[str, Any] = {"color": BLACK, "lw": 3.2, "alpha": 0.45}
_SEEN: dict[str, Any] = {"color": ORANGE, "lw": 1.3}
_PLAY: dict[str, Any] = {"color": BLACK, "alpha": 0.13, "lw": 0}
_MARK_SIZE = 8
# Of what no law sees on a machine the most telling, and at most so many.
_TELLING, _TOLD = ("twist", "winding", "load", "temperature", "bristle"), 3
# More outputs than this are drawn side by side in pairs.
_ONE_BELOW_THE_OTHER = 3


class _Panel(NamedTuple):
    """One quantity over time.

    Attributes:
        label: Name and unit.
        curve: Its values in a run at instants, or at the beginnings of intervals.
        limits: Kinds of requirement that speak of it.
        reference: Where it should be; None for nowhere.
        every_plant: Whether runs on every plant are drawn, or those on the last one only.
        signed: Whether it has a sign, so that a limit is one to both sides.
        rate: The state that is drawn as it is and as one law sees it, instead of a curve.
        play: Of a transmission, shaded to both sides of zero.
    """

    label: str
    curve: Callable[[RunResult], Array]
    limits: tuple[str, ...]
    reference: Callable[[RunResult], Array] | None = None
    every_plant: bool = True
    signed: bool = True
    rate: int | None = None
    play: float = 0.0


def figure_size(results: Sequence[RunResult]) -> tuple[float, float]:
    """Width and height of the figure of these runs [inch]."""
    columns, rows = _grid(len(_panels(results)), results)
    return columns * _WIDTH * (0.75 if columns > 1 else 1.0), rows * _HEIGHT + _AROUND


def draw_experiment(figure: Figure, results: Sequence[RunResult]) -> None:
    """Draw all runs of a case file on an empty figure, over time.

    A panel whose requirement is not kept has a frame and says which.
    """
    panels = _panels(results)
    columns, rows = _grid(len(panels), results)
    axes = np.ravel(figure.subplots(rows, columns, sharex=True, squeeze=False))
    for empty in axes[len(panels) :]:
        empty.set_visible(False)
    styles = law_styles(result.controller.name for result in results)
    for where, panel in zip(axes, panels, strict=False):
        drawn = results if panel.every_plant else _calmest_last(results)
        if panel.rate is not None:
            _draw_rate(where, panel.rate, _told(results))
            drawn = []
        for result in drawn:
            _draw(where, panel, result, styles, several=len(_plants(drawn)) > 1)
        if panel.reference is not None:
            time = results[0].comparison.time
            where.plot(time, panel.reference(results[0]), label="reference", **REFERENCE)
        if panel.play:
            where.axhspan(-panel.play / 2, panel.play / 2, label="backlash", **_PLAY)
        where.set_ylabel(panel.label)
        shade_disturbances(where, results[0].case)
        _mark(where, panel, results)
    for where in axes[max(0, len(panels) - columns) : len(panels)]:
        where.set_xlabel("time t [s]")
        where.tick_params(labelbottom=True)
    figure.suptitle(results[0].case.title, fontsize=TITLE_SIZE)
    below = [each for each, panel in zip(axes, panels, strict=False) if panel.rate is None]
    labelled_below(figure, below)


def _grid(panels: int, results: Sequence[RunResult]) -> tuple[int, int]:
    """Columns and rows."""
    columns = 2 if len(results[0].comparison.outputs) > _ONE_BELOW_THE_OTHER else 1
    return columns, -(-panels // columns)


def _draw(
    axes: Axes, panel: _Panel, result: RunResult, styles: dict[str, LawStyle], *, several: bool
) -> None:
    """A run's curve; of one that jumps at every sample its range and its mean."""
    law, values = styles[result.controller.name], panel.curve(result)
    time = result.trajectory.time[: len(values)]
    label = f"{law.label}, {PLANTS[result.plant]}"
    line = LINES[result.plant] if several else _ALONE
    _draw_curve(axes, time, values, color=law.colour, label=label, **line)
    if result.status is not Status.COMPLETED and len(time):
        axes.plot(time[-1], values[-1], "X", color=law.colour, mec="white", ms=9)
        axes.annotate(
            "ended", (time[-1], values[-1]), (5, 3), textcoords="offset points",
            fontsize=_MARK_SIZE, color=law.colour, rotation=40,
        )  # fmt: skip


def _draw_curve(axes: Axes, time: Array, values: Array, **style: Any) -> None:
    """A curve; of one that jumps at every sample its range and its mean."""
    if jumps(values[np.isfinite(values)]):
        found = envelope(time, values)
        axes.fill_between(
            found.time, found.least, found.largest, color=style["color"], alpha=0.25, lw=0
        )
        time, values = found.time, found.mean
    axes.plot(time, values, rasterized=True, **style)


def _draw_rate(axes: Axes, i: int, run: RunResult) -> None:
    """A state of a run as it is, and as its law sees it."""
    seen = run.trajectory.seen
    assert seen is not None
    time, true = run.trajectory.time[: len(seen)], run.trajectory.state[: len(seen), i]
    _draw_curve(axes, time, true, label="true", **_TRUE)
    _draw_curve(axes, time, seen[:, i], label=f"seen by {label_of(run.controller.name)}", **_SEEN)
    # Above, where it hides nothing.
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, borderaxespad=0)


def _panels(results: Sequence[RunResult]) -> list[_Panel]:
    """What is drawn of these runs."""
    first = results[0]
    system, error = first.trajectory.system, first.controller.designed.error
    wanted = {limit.kind for limit in first.experiment.limits}
    panels = list(_outputs(results))
    distance = "|y − y*|" if len(panels) > 1 else "distance from y*"
    unit = error.units[first.comparison.outputs[0]]
    one = len(system.inputs) == 1
    panels.append(
        _Panel(
            f"{distance} [{unit}]",
            lambda run: run.comparison.deviation,
            ("deviation_below",),
            signed=len(panels) == 1,
        )
    )
    if "cart_travel_below" in wanted and has_cart(system):
        cart = system.states[0]
        panels.append(
            _Panel(
                f"travel of the {cart.name.removesuffix(' position')} [{cart.unit}]",
                lambda run: run.trajectory.state[:, 0] - run.trajectory.state[0, 0],
                ("cart_travel_below",),
            )
        )
    looped = first.trajectory.seen is not None
    if looped:
        y = system.states[system.controlled[0]]
        panels.append(_Panel(f"{y.name},\nseen − true [{y.unit}]", _misseen, (), every_plant=False))
        panels += _seen_rates(_told(results))
    units = [found for r in results if (found := r.controller.designed.sliding_unit)]
    if units:
        name, kinds = "s" if one else "largest |s|", ("sliding_below", "no_reaching_phase")
        name += ", as the law\nsees it" if looped else ""
        panels.append(
            _Panel(f"{name} [{units[0]}]", _sliding, kinds, every_plant=False, signed=one)
        )
    u = system.inputs[0]
    name = (u.name if one else "largest |u|") + (" given" if looped else "")
    panels.append(
        _Panel(
            f"{name} [{u.unit}]",
            lambda run: _largest(run.trajectory.input),
            ("input_below",),
            every_plant=False,
            signed=one,
        )
    )
    panels += itertools.islice(_unseen(_calmest_last(results)), _TOLD)
    return panels


def _seen_rates(run: RunResult) -> Iterator[_Panel]:
    """Of rates estimated or measured imperfectly, the one of each unit that is seen worst."""
    loop, system, seen = run.case.loop, run.trajectory.system, run.trajectory.seen
    if loop is None or seen is None:
        return
    states = system.states
    rates = [i for i in sorted(rate_positions(system)) if states[i].name in loop.not_known_exactly]
    off = np.abs(seen - run.trajectory.state[: len(seen)]).max(axis=0, initial=0.0).tolist()
    for unit in dict.fromkeys(states[i].unit for i in rates):
        worst = max((i for i in rates if states[i].unit == unit), key=lambda i: off[i])
        yield _Panel(f"{states[worst].name} [{unit}]", _misseen, (), rate=worst)


def _unseen(runs: Sequence[RunResult]) -> Iterator[_Panel]:
    """Of what no law sees on a machine, the largest signal of each kind and unit."""
    found = runs[0].trajectory.unseen
    sizes = {
        each: max(float(np.abs(_of_machine(run, each)).max(initial=0.0)) for run in runs)
        for each in found
    }
    for kind, unit in itertools.product(_TELLING, dict.fromkeys(each.unit for each in found)):
        alike = [each for each in found if (each.kind, each.unit) == (kind, unit)]
        if not alike:
            continue
        largest = max(alike, key=lambda each: sizes[each])
        shown, scale = prefixed(unit, sizes[largest])

        def curve(run: RunResult, each: UnseenState = largest, scale: float = scale) -> Array:
            return scale * _of_machine(run, each)

        label = f"{largest.name},\nnot seen [{shown}]"
        yield _Panel(label, curve, (), every_plant=False, play=scale * largest.play)


def _of_machine(run: RunResult, each: UnseenState) -> Array:
    """What no law sees, at every instant of a run in MuJoCo."""
    physics = run.trajectory.physics
    assert physics is not None  # what is unseen is of a plant in MuJoCo
    return each.of(physics)


def _outputs(results: Sequence[RunResult]) -> Iterator[_Panel]:
    """A panel for each output, with its reference."""
    first = results[0]
    system, error = first.trajectory.system, first.controller.designed.error
    rows, kinds = first.comparison.outputs, ("stays_within", "settles_within")
    named = error.outputs is None and len(rows) == len(system.controlled)
    for j, row in enumerate(rows):
        name = system.states[system.controlled[j]].name if named else "output y"
        if not named and len(rows) > 1:
            name = f"output y{j + 1}"

        def curve(run: RunResult, j: int = j) -> Array:
            comparison, error = run.comparison, run.controller.designed.error
            z = comparison.z[:, comparison.outputs[j]]
            return comparison.reference[:, j] + error.sign * z

        def reference(run: RunResult, j: int = j) -> Array:
            return run.comparison.reference[:, j]

        yield _Panel(f"{name} [{error.units[row]}]", curve, kinds, reference)


def _sliding(run: RunResult) -> Array:
    """s, or nothing where a law has no surface."""
    sliding = run.trajectory.sliding
    return np.full(len(run.trajectory.time) - 1, np.nan) if sliding is None else _largest(sliding)


def _misseen(run: RunResult) -> Array:
    """What a law sees of the first controlled state less what it is."""
    seen, j = run.trajectory.seen, run.trajectory.system.controlled[0]
    true = run.trajectory.state[:-1, j]
    return np.zeros_like(true) if seen is None else seen[:, j] - true


def _mark(axes: Axes, panel: _Panel, results: Sequence[RunResult]) -> None:
    """The limits of what a panel shows, and a frame with words where one is not kept."""
    judged = [each for run in results for each in run.requirements]
    of_it = [each for each in judged if each.limit.kind in panel.limits]
    failed = [each for each in of_it if not each.kept]
    for limit in dict.fromkeys(each.limit for each in of_it):
        broken = any(each.limit == limit for each in failed)
        for level in _levels(limit, panel, results[0]):
            said = {"lw": 2.0, "label": "limit, not kept"} if broken else {"label": "limit"}
            axes.plot(*level, **{**_LIMIT, **said})
    if not failed:
        return
    for side in axes.spines.values():
        side.set(visible=True, color=FAILED, linewidth=1.6)
    laws = dict.fromkeys((each.limit.words, each.controller) for each in failed)
    said = "\n".join(f"not kept by {law}: {words}" for words, law in laws)
    axes.set_title(said, loc="right", fontsize=_MARK_SIZE, color=FAILED, pad=3)


def _levels(limit: Limit, panel: _Panel, run: RunResult) -> Iterator[tuple[Array, Array]]:
    """Where a requirement's limit is, as times and values; none of those without a level."""
    if limit.kind in ("no_reaching_phase", "settles_within"):
        return
    end = run.case.duration
    for side in (1.0, -1.0) if panel.signed else (1.0,):
        if panel.reference is None:
            yield np.array([limit.after, end]), np.full(2, side * limit.value)
        else:
            time = run.comparison.time
            since = time >= limit.after
            yield time[since], panel.reference(run)[since] + side * limit.value


def _plants(results: Sequence[RunResult]) -> list[PlantName]:
    """Plants that were run on."""
    return list(dict.fromkeys(result.plant for result in results))


def _told(results: Sequence[RunResult]) -> RunResult:
    """The run whose rates are shown: of the last law on the last plant."""
    return [result for result in results if result.plant == _plants(results)[-1]][-1]


def _calmest_last(results: Sequence[RunResult]) -> list[RunResult]:
    """The runs on the last plant, physics if it is there: what chatters is drawn below the rest."""
    last = [result for result in results if result.plant == _plants(results)[-1]]
    return sorted(last, key=lambda result: -(result.metrics["total_variation"].value or 0.0))


def _largest(rows: Array) -> Array:
    """A single signal as it is; of several the largest magnitude."""
    return rows if rows.ndim == 1 else np.abs(rows).max(axis=1)


def shade_disturbances(axes: Axes, case: Case) -> None:
    """Shade the time in which each disturbance of a case acts, on axes as long as it."""
    for disturbance in case.disturbances:
        start, stop = disturbance.window
        label = disturbance.label or f"disturbance on {disturbance.body}"
        shade(axes, start, min(stop, case.duration), label)
    axes.set_xlim(0, case.duration)
