"""What is shown of the runs of a case over time: outputs, distance, limits, s, input, unseen."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.experiments.metrics.recorded import has_cart
from grosmc_mj.experiments.requirements import Limit
from grosmc_mj.experiments.runs import PlantName, RunResult
from grosmc_mj.loop.controllers import rate_positions
from grosmc_mj.physics.hidden_states import HiddenState
from grosmc_mj.results.tables import prefixed

# Of what no law sees on a machine the most telling, and at most so many.
_TELLING, _TOLD = ("twist", "winding", "load", "temperature", "bristle"), 3


class Panel(NamedTuple):
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


def panels_of(results: Sequence[RunResult]) -> list[Panel]:
    """What is drawn of these runs."""
    first = results[0]
    system, error = first.trajectory.system, first.controller.designed.error
    wanted = {limit.kind for limit in first.experiment.limits}
    panels = list(_outputs(results))
    distance = "|y − y*|" if len(panels) > 1 else "distance from y*"
    unit = error.units[first.comparison.outputs[0]]
    one = len(system.inputs) == 1
    panels.append(
        Panel(
            f"{distance} [{unit}]",
            lambda run: run.comparison.deviation,
            ("deviation_below",),
            signed=len(panels) == 1,
        )
    )
    if "cart_travel_below" in wanted and has_cart(system):
        cart = system.states[0]
        panels.append(
            Panel(
                f"travel of the {cart.name.removesuffix(' position')} [{cart.unit}]",
                lambda run: run.trajectory.state[:, 0] - run.trajectory.state[0, 0],
                ("cart_travel_below",),
            )
        )
    looped = first.trajectory.seen is not None
    if looped:
        y = system.states[system.controlled[0]]
        panels.append(Panel(f"{y.name},\nseen − true [{y.unit}]", _misseen, (), every_plant=False))
        panels += _seen_rates(told(results))
    units = [found for r in results if (found := r.controller.designed.sliding_unit)]
    if units:
        name, kinds = "s" if one else "largest |s|", ("sliding_below", "no_reaching_phase")
        name += ", as the law\nsees it" if looped else ""
        panels.append(Panel(f"{name} [{units[0]}]", _sliding, kinds, every_plant=False, signed=one))
    u = system.inputs[0]
    name = (u.name if one else "largest |u|") + (" given" if looped else "")
    panels.append(
        Panel(
            f"{name} [{u.unit}]",
            lambda run: _largest(run.trajectory.input),
            ("input_below",),
            every_plant=False,
            signed=one,
        )
    )
    panels += itertools.islice(_unseen(calmest_last(results)), _TOLD)
    return panels


def _seen_rates(run: RunResult) -> Iterator[Panel]:
    """Of rates estimated or measured imperfectly, the one of each unit that is seen worst."""
    loop, system, seen = run.case.loop, run.trajectory.system, run.trajectory.seen
    if loop is None or seen is None:
        return
    states = system.states
    rates = [i for i in sorted(rate_positions(system)) if states[i].name in loop.not_known_exactly]
    off = np.abs(seen - run.trajectory.state[: len(seen)]).max(axis=0, initial=0.0).tolist()
    for unit in dict.fromkeys(states[i].unit for i in rates):
        worst = max((i for i in rates if states[i].unit == unit), key=lambda i: off[i])
        yield Panel(f"{states[worst].name} [{unit}]", _misseen, (), rate=worst)


def _unseen(runs: Sequence[RunResult]) -> Iterator[Panel]:
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

        def curve(run: RunResult, each: HiddenState = largest, scale: float = scale) -> Array:
            return scale * _of_machine(run, each)

        label = f"{largest.name},\nnot seen [{shown}]"
        yield Panel(label, curve, (), every_plant=False, play=scale * largest.play)


def _of_machine(run: RunResult, each: HiddenState) -> Array:
    """What no law sees, at every instant of a run in MuJoCo."""
    physics = run.trajectory.physics
    assert physics is not None  # what is unseen is of a plant in MuJoCo
    return each.of(physics)


def _outputs(results: Sequence[RunResult]) -> Iterator[Panel]:
    """A panel for each output, with its reference."""
    first = results[0]
    system, error = first.trajectory.system, first.controller.designed.error
    rows, kinds = first.comparison.outputs, ("stays_within", "final_error_below", "settles_within")
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

        yield Panel(f"{name} [{error.units[row]}]", curve, kinds, reference)


def _sliding(run: RunResult) -> Array:
    """s, or nothing where a law has no surface."""
    sliding = run.trajectory.sliding
    return np.full(len(run.trajectory.time) - 1, np.nan) if sliding is None else _largest(sliding)


def _misseen(run: RunResult) -> Array:
    """What a law sees of the first controlled state less what it is."""
    seen, j = run.trajectory.seen, run.trajectory.system.controlled[0]
    true = run.trajectory.state[:-1, j]
    return np.zeros_like(true) if seen is None else seen[:, j] - true


def levels_of(limit: Limit, panel: Panel, run: RunResult) -> Iterator[tuple[Array, Array]]:
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


def plants_of(results: Sequence[RunResult]) -> list[PlantName]:
    """Plants that were run on."""
    return list(dict.fromkeys(result.plant for result in results))


def told(results: Sequence[RunResult]) -> RunResult:
    """The run whose rates are shown: of the last law on the last plant."""
    return [result for result in results if result.plant == plants_of(results)[-1]][-1]


def calmest_last(results: Sequence[RunResult]) -> list[RunResult]:
    """The runs on the last plant, physics if it is there: what chatters is drawn below the rest."""
    last = [result for result in results if result.plant == plants_of(results)[-1]]
    return sorted(last, key=lambda result: -(result.metrics["total_variation"].value or 0.0))


def _largest(rows: Array) -> Array:
    """A single signal as it is; of several the largest magnitude."""
    return rows if rows.ndim == 1 else np.abs(rows).max(axis=1)
