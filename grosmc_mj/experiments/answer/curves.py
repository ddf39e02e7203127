"""The runs of a case over time: panels of curves, drawn as a figure or written as a document.

A panel is one quantity with its unit: an output, the deviation from the optimum, s, the input, or a
hidden state of the machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.experiments.case_document import seed_of
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.requirements.judging import Judgement
from grosmc_mj.experiments.requirements.requirement import Requirement
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.ground.wording import titled
from grosmc_mj.output.charts.chart import (
    Chart,
    ChartAxis,
    Curve,
    Layer,
    Marks,
    Panel,
    Span,
    signal_layers,
)
from grosmc_mj.output.charts.envelope import envelope, jumps
from grosmc_mj.output.palette import (
    BLACK,
    DISTURBANCE,
    INK,
    ORANGE,
    PLANT_LINES,
    PLANTS,
    REFERENCE,
    Stroke,
    law_colours,
)
from grosmc_mj.output.results.document import origin, write_json
from grosmc_mj.output.results.tables import prefixed
from grosmc_mj.simulation.trajectory import Status

# Kinds of hidden states on a machine, the most informative first, and the number of their panels.
_HIDDEN_KINDS = ("twist", "winding", "load", "temperature", "bristle")
_MOST_HIDDEN = 3


class RunSignal(NamedTuple):
    """A signal of a run, at its instants or at the beginnings of its intervals.

    Attributes:
        run: The run.
        values: Values from t = 0 on; NaN where there is none.
        name: ``true`` for a state and ``seen`` for its value that the law is given; else empty.
    """

    run: RunResult
    values: Array
    name: str = ""

    @property
    def time(self) -> Array:
        """Instants of the values [s]."""
        return self.run.trajectory.time[: len(self.values)]


class ShownQuantity(NamedTuple):
    """One quantity over time.

    Attributes:
        label: Name and unit.
        curves: Curves of the runs.
        shows: Quantities and signals whose requirements it shows.
        reference: Reference of the quantity, at the instants of the first run; None without one.
        signed: Whether it has a sign, so that a limit is one to both sides.
        play: Backlash of a transmission, shaded to both sides of zero.
    """

    label: str
    curves: Sequence[RunSignal]
    shows: tuple[str, ...] = ()
    reference: Array | None = None
    signed: bool = True
    play: float = 0.0


def panels_of(results: Sequence[RunResult]) -> list[ShownQuantity]:
    """Return the panels of runs; signals of the laws themselves are those on the last plant.

    Logs of the machine are shown where they have the quantity: outputs, states and inputs.
    """
    simulated = [run for run in results if run.simulated]
    measured = [run for run in results if not run.simulated]
    if not simulated:
        return [*_output_panels(measured), *_state_panels(measured), _input_panel(measured)]

    on_last_plant = [run for run in simulated if run.plant == simulated[-1].plant]
    chattering_first = _chattering_first(on_last_plant)
    panels = _output_panels([*simulated, *measured])
    panels += _deviation_panels(simulated)
    panels += _state_panels([*simulated, *measured])
    if simulated[0].trajectory.seen is not None:
        panels.append(_measurement_error_panel(chattering_first))
        panels += _rate_panels(on_last_plant[-1])
    panels += _sliding_panels(simulated, chattering_first)
    panels.append(_input_panel([*chattering_first, *measured]))
    return panels + _hidden_panels(chattering_first)[:_MOST_HIDDEN]


def _chattering_first(results: Sequence[RunResult]) -> list[RunResult]:
    """Return runs in the order in which their inputs are drawn: smooth ones above the others."""
    return sorted(results, key=lambda run: -(run.metrics["total_variation"].value or 0.0))


def panel_of(results: Sequence[RunResult], quantity: str) -> ShownQuantity:
    """Return the panel of one quantity of runs.

    Args:
        results: Runs of one case.
        quantity: ``output``, ``deviation``, ``sliding``, ``input``, or the name of a state.

    Raises:
        ArgumentError: If the runs have no such quantity.
    """
    with_surface = [run for run in results if run.trajectory.sliding is not None]
    panels = [
        *_output_panels(results),
        *_deviation_panels(results),
        *_sliding_panels(results, with_surface),
        _input_panel(_chattering_first(results)),
    ]
    states = results[0].trajectory.system.states
    panels += [_tracked_state_panel(results, row) for row in range(len(states))]
    for panel in panels:
        if quantity in panel.shows:
            return panel

    known = [name for panel in panels for name in panel.shows]
    raise ArgumentError(f"no quantity {quantity!r} of these runs: one of {', '.join(known)}")


def _output_panels(results: Sequence[RunResult]) -> list[ShownQuantity]:
    """Return a panel for each output, with its reference."""
    first = results[0]
    system = first.trajectory.system
    error = first.controller.designed.error
    rows = first.comparison.outputs
    outputs_are_states = error.outputs is None and len(rows) == len(system.controlled)

    panels = []
    for j, row in enumerate(rows):
        number = "" if len(rows) == 1 else str(j + 1)
        name = f"output y{number}"
        if outputs_are_states:
            name = system.states[system.controlled[j]].name
        panels.append(
            ShownQuantity(
                label=f"{name} [{error.units[row]}]",
                curves=[RunSignal(run, _output(run, j)) for run in results],
                shows=("output", error.names[row]),
                reference=first.comparison.reference[:, j],
            )
        )
    return panels


def _output(run: RunResult, j: int) -> Array:
    """Return an output of a run by its index, (N + 1,)."""
    comparison = run.comparison
    error = comparison.z[:, comparison.outputs[j]]
    return comparison.reference[:, j] + run.controller.designed.error.sign * error


def _deviation_panels(results: Sequence[RunResult]) -> list[ShownQuantity]:
    """Return the panel of the deviation from the optimum, of a single output with its sign.

    There is none where no law has weights.
    """
    weighed = [run for run in results if run.controller.designed.weighed]
    if not weighed:
        return []
    first = weighed[0]
    unit = first.controller.designed.error.units[first.comparison.outputs[0]]
    single = len(first.comparison.outputs) == 1
    deviation = "deviation y − y*" if single else "deviation |y − y*|"
    panel = ShownQuantity(
        label=titled(deviation, unit),
        curves=[RunSignal(run, run.comparison.deviation) for run in weighed],
        shows=("deviation",),
        signed=single,
    )
    return [panel]


def _state_panels(results: Sequence[RunResult]) -> list[ShownQuantity]:
    """Return a panel for each state that a requirement names and that is no output."""
    first = results[0]
    error = first.controller.designed.error
    outputs = [error.names[row] for row in first.comparison.outputs]
    named = [requirement.signal for requirement in first.case.limits]

    panels = []
    for i, state in enumerate(first.trajectory.system.states):
        if state.name in named and state.name not in outputs:
            panels.append(_state_panel(results, i))
    return panels


def _state_panel(results: Sequence[RunResult], row: int) -> ShownQuantity:
    """Return the panel of a state, by its row."""
    state = results[0].trajectory.system.states[row]
    curves = [RunSignal(run, run.trajectory.state[:, row]) for run in results]
    return ShownQuantity(titled(state.name, state.unit), curves, shows=(state.name,))


def _tracked_state_panel(results: Sequence[RunResult], row: int) -> ShownQuantity:
    """Return the panel of a state, with its reference where its error is one of the laws'."""
    panel = _state_panel(results, row)
    first = results[0]
    error = first.controller.designed.error
    name = first.trajectory.system.states[row].name
    if error.outputs is not None or name not in error.names:
        return panel

    z = first.comparison.z[:, error.names.index(name)]
    return panel._replace(reference=first.trajectory.state[:, row] - error.sign * z)


def _measurement_error_panel(results: Sequence[RunResult]) -> ShownQuantity:
    """Return the panel of the first controlled coordinate as the law sees it less as it is."""
    system = results[0].trajectory.system
    j = system.controlled[0]
    state = system.states[j]
    return ShownQuantity(
        label=titled(f"{state.name},\nseen − true", state.unit),
        curves=[RunSignal(run, _measurement_error(run)[:, j]) for run in results],
    )


def _measurement_error(run: RunResult) -> Array:
    """Return the states as the law sees them less as they are, (N, n)."""
    true = run.trajectory.state[:-1]
    if run.trajectory.seen is None:
        return np.zeros_like(true)
    return run.trajectory.seen - true


def _rate_panels(run: RunResult) -> list[ShownQuantity]:
    """Return a panel for each unit of rates that are not known exactly, of the worst such rate."""
    loop = run.case.loop
    states = run.trajectory.system.states
    seen = run.trajectory.seen
    if loop is None or seen is None:
        return []
    largest_errors = np.abs(_measurement_error(run)).max(axis=0, initial=0.0).tolist()

    # By unit the index of the rate with the largest error.
    worst_rates: dict[str, int] = {}
    for i in sorted(run.trajectory.system.rate_positions):
        if states[i].name not in loop.not_known_exactly:
            continue
        worst = worst_rates.setdefault(states[i].unit, i)
        if largest_errors[i] > largest_errors[worst]:
            worst_rates[states[i].unit] = i

    panels = []
    for unit, i in worst_rates.items():
        true = run.trajectory.state[: len(seen), i]
        curves = [RunSignal(run, true, "true"), RunSignal(run, seen[:, i], "seen")]
        panels.append(ShownQuantity(titled(states[i].name, unit), curves))
    return panels


def _sliding_panels(
    results: Sequence[RunResult], drawn: Sequence[RunResult]
) -> list[ShownQuantity]:
    """Return a panel of s of the drawn runs, if a law has a surface."""
    units = [run.controller.designed.sliding_unit for run in results]
    units = [unit for unit in units if unit]
    if not units:
        return []
    first = results[0].trajectory
    single = len(first.system.inputs) == 1
    name = "s" if single else "largest |s|"
    if first.seen is not None:
        name += ", as the law\nsees it"
    return [
        ShownQuantity(
            label=titled(name, units[0]),
            curves=[RunSignal(run, _sliding(run)) for run in drawn],
            shows=("sliding",),
            signed=single,
        )
    ]


def _sliding(run: RunResult) -> Array:
    """Return s, or NaN where a law has no surface."""
    sliding = run.trajectory.sliding
    if sliding is None:
        return np.full(len(run.trajectory.time) - 1, np.nan)
    return _largest(sliding)


def _input_panel(results: Sequence[RunResult]) -> ShownQuantity:
    """Return the panel of the input that the plant is given."""
    trajectory = results[0].trajectory
    system = trajectory.system
    single = len(system.inputs) == 1
    name = system.input.name if single else "largest |u|"
    if trajectory.seen is not None:
        name += " given"
    return ShownQuantity(
        label=titled(name, system.input.unit),
        curves=[RunSignal(run, _largest(run.trajectory.input)) for run in results],
        shows=("input",),
        signed=single,
    )


def _largest(rows: Array) -> Array:
    """Return a single signal as it is, else the largest magnitude of several."""
    if rows.ndim == 1:
        return rows
    return np.abs(rows).max(axis=1)


def _hidden_panels(results: Sequence[RunResult]) -> list[ShownQuantity]:
    """Return a panel for each kind and unit of the machine's hidden states, of the largest one."""
    signals = results[0].trajectory.unseen
    rows = {}
    sizes = {}
    for signal in signals:
        rows[signal] = [signal.of(run.trajectory.physics) for run in results]
        sizes[signal] = max(float(np.abs(values).max(initial=0.0)) for values in rows[signal])

    panels = []
    for kind in _HIDDEN_KINDS:
        of_kind = [signal for signal in signals if signal.kind == kind]
        for unit in dict.fromkeys(signal.unit for signal in signals):
            alike = [signal for signal in of_kind if signal.unit == unit]
            if alike:
                largest = max(alike, key=sizes.__getitem__)
                panels.append(_hidden_panel(largest, sizes[largest], rows[largest], results))
    return panels


def _hidden_panel(
    signal: Any,
    size: float,
    rows: Sequence[Array],
    results: Sequence[RunResult],
) -> ShownQuantity:
    """Return the panel of a hidden state, in a unit with a prefix that suits its size."""
    unit, scale = prefixed(signal.unit, size)
    curves = [RunSignal(run, scale * values) for run, values in zip(results, rows, strict=True)]
    return ShownQuantity(
        titled(f"{signal.name},\nnot seen", unit), curves, play=scale * signal.play
    )


def levels_of(limit: Requirement, panel: ShownQuantity) -> Iterator[tuple[Array, Array]]:
    """Return the lines of a limit in a panel as times [s] and values; none without a level."""
    if not limit.is_level:
        return
    first = panel.curves[0].run
    time = np.array([limit.after, first.case.duration])
    middle = np.zeros(2)
    if panel.reference is not None:
        since = first.comparison.time >= limit.after
        time = first.comparison.time[since]
        middle = panel.reference[since]

    yield time, middle + limit.number
    if panel.signed:
        yield time, middle - limit.number


def judged_in(panel: ShownQuantity, results: Sequence[RunResult]) -> list[Judgement]:
    """Return the judgements that a panel shows."""
    judgements = []
    for run in results:
        judgements += [
            item for item in run.requirements if item.requirement.shown_with in panel.shows
        ]
    return judgements


# -- as a figure ---------------------------------------------------------------------------------

# Size of a panel, and height of title and legend [inch].
_WIDTH = 7.2
_HEIGHT = 1.9
_AROUND = 1.3
_ALONE = Stroke(INK, 1.6)
# A limit that is kept, and one that is not.
_LIMIT = Stroke(INK, 1.0, "dash")
_BROKEN_LIMIT = Stroke(INK, 2.0, "dash")
# A true rate, and the rate that a law sees on top of it.
_TRUE = Stroke(INK, 3.2, "solid", 0.45)
_SEEN = Stroke(ORANGE, 1.3)
# Panels of more outputs than this are drawn in two columns.
_MOST_IN_ONE_COLUMN = 3


def binding_first(
    panels: Sequence[ShownQuantity], results: Sequence[RunResult]
) -> list[ShownQuantity]:
    """Return panels, the first one that of the requirement that is nearest to its limit or past it.

    Their order is kept where no panel shows it, or nothing is required.
    """
    judgements = [item for run in results for item in run.requirements]
    if not judgements:
        return list(panels)
    shown_with = max(judgements, key=lambda item: item.share).requirement.shown_with
    binding = [panel for panel in panels if shown_with in panel.shows][:1]
    return [*binding, *(panel for panel in panels if not any(panel is one for one in binding))]


def experiment_chart(results: Sequence[RunResult]) -> Chart:
    """Return the chart of all runs of a case file over time.

    It opens with the panel of the requirement that binds. A panel whose requirement is not kept has
    a frame and names the requirement. Above the first one stand those that no panel shows, such as
    a cost.
    """
    quantities = binding_first(panels_of(results), results)
    columns = 1
    width = _WIDTH
    if len(results[0].comparison.outputs) > _MOST_IN_ONE_COLUMN:
        columns = 2
        width = 1.5 * _WIDTH

    colours = law_colours(result.controller.name for result in results)
    panels = []
    for index, quantity in enumerate(quantities):
        panel = _judged_panel(quantity, colours, results)
        if index == 0:
            failed = failures_without_panel(quantities, results)
            panel = replace(panel, remark=f"{_named(failed)}\n{panel.remark}".strip())
        if index >= len(quantities) - columns:
            panel = replace(panel, x=replace(panel.x, title="time t [s]"))
        panels.append(panel)

    rows = [panels[first : first + columns] for first in range(0, len(panels), columns)]
    size = (width, len(rows) * _HEIGHT + _AROUND)
    return Chart(rows, title=results[0].case.title, size=size, shared="x")


def quantity_panel(
    quantity: ShownQuantity,
    colours: dict[str, str],
    results: Sequence[RunResult],
) -> Panel:
    """Return disturbances, backlash, curves and reference of a quantity."""
    case = results[0].case
    layers = disturbance_spans(case)
    if quantity.play:
        layers.append(
            Span("y", -quantity.play / 2, quantity.play / 2, BLACK, 0.13, name="backlash")
        )
    several_plants = len({curve.run.plant for curve in quantity.curves}) > 1
    for curve in quantity.curves:
        layers += _curve_layers(curve, colours, several_plants=several_plants)
    if quantity.reference is not None:
        time = results[0].comparison.time
        layers.append(Curve(time, quantity.reference, REFERENCE, name="reference"))
    return Panel(
        layers,
        ChartAxis(low=0, high=case.duration),
        ChartAxis(quantity.label),
        own_legend=bool(quantity.curves[0].name),
    )


def _judged_panel(
    quantity: ShownQuantity,
    colours: dict[str, str],
    results: Sequence[RunResult],
) -> Panel:
    """Return the panel of a quantity with its limits; those that are not kept are named."""
    panel = quantity_panel(quantity, colours, results)
    judgements = judged_in(quantity, results)
    failed = [item for item in judgements if not item.kept]
    return replace(
        panel,
        layers=[*panel.layers, *_limit_layers(quantity, judgements)],
        framed=bool(failed),
        remark=_named(failed),
    )


def _curve_layers(
    curve: RunSignal,
    colours: dict[str, str],
    *,
    several_plants: bool,
) -> list[Layer]:
    """Return a run's curve; if it jumps at every sample, its range and its mean."""
    stroke, label = _line_of(curve, colours, several_plants=several_plants)
    layers = signal_layers(curve.time, curve.values, stroke, label)
    if not curve.name and curve.run.status is not Status.COMPLETED and len(curve.time):
        layers.append(
            Marks(curve.time[-1:], curve.values[-1:], stroke.colour, "x", 9.0, text="ended")
        )
    return layers


def _line_of(
    curve: RunSignal,
    colours: dict[str, str],
    *,
    several_plants: bool,
) -> tuple[Stroke, str]:
    """Return line and label of a curve."""
    law = curve.run.controller.name
    if curve.name == "true":
        return _TRUE, "true"
    if curve.name == "seen":
        return _SEEN, f"seen by {law}"
    # The name of a log may stand behind that of its plant.
    kind, _, log = curve.run.plant.partition(" ")
    stroke = PLANT_LINES[kind] if several_plants else _ALONE
    label = f"{law}, {PLANTS[kind]} {log}".rstrip()
    return stroke._replace(colour=colours[law]), label


def _limit_layers(quantity: ShownQuantity, judgements: Sequence[Judgement]) -> list[Layer]:
    """Return the lines of limits, thick where one is not kept."""
    failed = [item.requirement for item in judgements if not item.kept]
    layers: list[Layer] = []
    for limit in dict.fromkeys(item.requirement for item in judgements):
        broken = limit in failed
        stroke = _BROKEN_LIMIT if broken else _LIMIT
        name = "limit, not kept" if broken else "limit"
        for time, values in levels_of(limit, quantity):
            layers.append(Curve(time, values, stroke, name=name))
    return layers


def failures_without_panel(
    panels: Sequence[ShownQuantity], results: Sequence[RunResult]
) -> list[Judgement]:
    """Return the requirements that are not kept and that no panel shows."""
    shown: set[str] = set()
    for panel in panels:
        shown.update(panel.shows)
    failed: list[Judgement] = []
    for run in results:
        failed += [
            item
            for item in run.requirements
            if not item.kept and item.requirement.shown_with not in shown
        ]
    return failed


def _named(failed: Sequence[Judgement]) -> str:
    """Write the requirements that are not kept, a line for each law."""
    lines = [f"not kept by {item.controller}: {item.requirement.words}" for item in failed]
    return "\n".join(dict.fromkeys(lines))


def disturbance_spans(case: Experiment) -> list[Layer]:
    """Return the times in which each disturbance of a case acts."""
    spans: list[Layer] = []
    for disturbance in case.disturbances:
        start, stop = disturbance.window
        spans.append(
            Span("x", start, min(stop, case.duration), DISTURBANCE, name=disturbance.title)
        )
    return spans


# -- as a document -------------------------------------------------------------------------------

# Folder beside the results.
FOLDER = "curves"
# Largest distance of a curve from the recorded values, as a share of its range.
_OFF = 5e-4
# Most points of a curve; one that needs more is drawn as one that jumps.
_MOST_POINTS = 800


def write_curves(results: Sequence[RunResult], name: str, out: Path) -> Path:
    """Write the curves of the runs of one case, and return the path of the file.

    Args:
        results: Runs of the case.
        name: Name of the file.
        out: Folder of the other results.

    Raises:
        SetupError: If it cannot be written.
    """
    path = out / FOLDER / f"{name}.json"
    write_json(path, curves_document(results))
    return path


def curves_document(results: Sequence[RunResult]) -> dict[str, Any]:
    """Return the curves of the runs of one case, with no more points than straight lines need.

    Of a signal that jumps all the time the range and the mean in short times stand side by
    side. Every other number is one of the run's, to seven digits.
    """
    case = results[0].case
    colours = law_colours(result.controller.name for result in results)
    disturbances = [
        {
            "start": disturbance.window[0],
            "stop": min(disturbance.window[1], case.duration),
            "label": disturbance.title,
        }
        for disturbance in case.disturbances
    ]
    laws = {name: {"label": name, "colour": colour} for name, colour in colours.items()}
    return {
        "kind": "curves",
        **origin(seed_of(case)),
        "system": case.system,
        "case": case.name,
        "title": case.title,
        "duration": case.duration,
        "disturbances": disturbances,
        "laws": laws,
        "panels": [_panel_document(panel, results) for panel in panels_of(results)],
    }


def _panel_document(panel: ShownQuantity, results: Sequence[RunResult]) -> dict[str, Any]:
    """Return one panel as plain values."""
    reference = None
    if panel.reference is not None:
        reference = _drawn(results[0].comparison.time, panel.reference)
    limits = []
    for limit in dict.fromkeys(item.requirement for item in judged_in(panel, results)):
        for time, values in levels_of(limit, panel):
            limits.append({"words": limit.words, **_drawn(time, values)})
    return {
        "label": panel.label.replace("\n", " "),
        "curves": [_curve_document(curve) for curve in panel.curves],
        "reference": reference,
        "limits": limits,
        "play": panel.play,
    }


def _curve_document(curve: RunSignal) -> dict[str, Any]:
    """Return the finite values of one curve as plain values."""
    document: dict[str, Any] = {
        "law": curve.run.controller.name,
        "plant": curve.run.plant,
        "name": curve.name,
    }
    finite = np.isfinite(curve.values)
    time = curve.time[finite]
    values = curve.values[finite]
    if not jumps(values):
        needed = _needed_points(time, values)
        if needed.sum() <= _MOST_POINTS:
            return {**document, **_points(time[needed], values[needed]), "range": None}
    band = envelope(time, values)
    limits = [_short(band.least), _short(band.largest)]
    return {**document, **_points(band.time, band.mean), "range": limits}


def _drawn(time: Array, values: Array) -> dict[str, list[float]]:
    """Return the points of a curve without those on a line between their neighbours."""
    needed = _needed_points(time, values)
    return _points(time[needed], values[needed])


def _points(time: Array, values: Array) -> dict[str, list[float]]:
    """Return the points of a curve, in short numbers."""
    return {"t": _short(time), "y": _short(values)}


def _needed_points(time: Array, values: Array) -> NDArray[np.bool_]:
    """Select points of a curve by the algorithm of Ramer, Douglas and Peucker, along y.

    Between two of them no value is further from their line than a small share of the range.
    """
    needed = np.zeros(len(values), bool)
    if len(values) == 0:
        return needed
    needed[0] = True
    needed[-1] = True
    allowed = _OFF * float(np.ptp(values))

    parts = [(0, len(values) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        slope = (values[last] - values[first]) / (time[last] - time[first])
        distances = np.abs(values[inner] - values[first] - slope * (time[inner] - time[first]))
        worst = int(distances.argmax())
        if distances[worst] > allowed:
            split = first + 1 + worst
            needed[split] = True
            parts.append((first, split))
            parts.append((split, last))
    return needed


def _short(values: Array) -> list[float]:
    """Return numbers with seven digits."""
    return [float(f"{value:.7g}") for value in values.tolist()]
