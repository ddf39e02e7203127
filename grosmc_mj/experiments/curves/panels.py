"""What is shown of the runs of a case over time: outputs, distance, limits, s, input, unseen."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.metrics import has_cart
from grosmc_mj.experiments.requirements import Judgement, Limit
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.loop.controllers import rate_positions
from grosmc_mj.results.tables import prefixed

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
    rows = {each: [each.of(run.trajectory.physics) for run in runs] for each in signals}
    sizes = {each: max(float(np.abs(y).max(initial=0.0)) for y in rows[each]) for each in signals}
    for kind, unit in itertools.product(_TELLING, dict.fromkeys(each.unit for each in signals)):
        alike = [each for each in signals if (each.kind, each.unit) == (kind, unit)]
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
