"""What a run must keep, and by how much it does."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError, Mistakes, shown
from grosmc_mj.experiments.file.schema import RequirementTable
from grosmc_mj.experiments.file.units import number_in
from grosmc_mj.experiments.metrics import (
    DWELL,
    SETTLING_BAND,
    Windows,
    accumulate_run,
    error_after,
    has_cart,
    metrics_of_meters,
    rms_after,
    settled_in,
    settling_time,
)
from grosmc_mj.simulation.trajectory import Status

if TYPE_CHECKING:
    from grosmc_mj.experiments.runs import RunResult

# s(0) is zero to rounding of z and of its reference.
_ROUNDING = 1e-9
# Metric and unit of each kind of limit; the metrics of the first three have an instant or a band in
# their names, and "output", "input" and "sliding" stand for the units of the laws.
_KINDS = {
    "settles_within": ("", "s"),
    "stays_within": ("", "output"),
    "final_error_below": ("", "output"),
    "rms_below": ("", "output"),
    "overshoot_below": ("overshoot", "1"),
    "deviation_below": ("deviation", "output"),
    "input_below": ("max_input", "input"),
    "sliding_below": ("max_sliding", "sliding"),
    "cart_travel_below": ("cart_travel", "m"),
    "no_reaching_phase": ("sliding_start", ""),
    "cost_ratio_below": ("cost_ratio", "1"),
}
# Required of laws with a surface only.
_OF_SURFACE = ("sliding_below", "no_reaching_phase")
# Of errors from an instant on.
_AFTER = ("stays_within", "rms_below")
# Numbers already when the file has been read.
_READ = ("settles_within", "cart_travel_below")


class Limit(NamedTuple):
    """One requirement with its number.

    Attributes:
        kind: Name of the key in the file.
        written: The largest value allowed, as the file has it.
        value: The same in ``unit``.
        unit: Its unit.
        after: From when on it holds [s].
        band: Width of the band that ``settles_within`` is about, in the unit of the output; None
            for 2 % of the error at the start.
        of: Controllers that must keep it.
        on: Plants on which.
        key: What it is called where no two may have one name.
    """

    kind: str
    written: str
    value: float
    unit: str
    after: float
    of: tuple[str, ...]
    on: tuple[str, ...]
    key: str = ""
    band: float | None = None

    @property
    def metric(self) -> str:
        """Name of what is limited."""
        if self.kind == "settles_within":
            return settled_in(self.band)
        if self.kind == "rms_below":
            return rms_after(self.after)
        return _KINDS[self.kind][0] or error_after(self.after)

    @property
    def of_initial_error(self) -> bool:
        """Whether it is a share of the error at the start, which a run must have then."""
        return self.kind == "overshoot_below" or (
            self.kind == "settles_within" and self.band is None
        )

    @property
    def words(self) -> str:
        """The requirement in words."""
        if self.kind == "no_reaching_phase":
            return "no reaching phase: s(0) = 0"
        since = f" from {self.after:g} s on" if self.after and self.kind in _AFTER else ""
        return f"{self.kind.replace('_', ' ')} {self.written}{since}"


class Judgement(NamedTuple):
    """A requirement of one run.

    Attributes:
        limit: The requirement.
        controller: Whose run.
        plant: On which plant.
        measured: What was measured, in the limit's unit; None if there is nothing to measure.
        margin: Limit less measured; None without a measurement.
        kept: Whether the run keeps it.
        note: Why nothing was measured.
    """

    limit: Limit
    controller: str
    plant: str
    measured: float | None
    margin: float | None
    kept: bool
    note: str = ""

    @property
    def share(self) -> float:
        """How much of the limit is used; infinite without a measurement."""
        return math.inf if self.margin is None else 1 - self.margin / self.limit.value


def limits(
    table: RequirementTable,
    controllers: Sequence[Controller],
    plants: Sequence[str],
    duration: float,
) -> list[Limit]:
    """The requirements that a table of a case file makes, with their units checked.

    Args:
        table: Of the file.
        controllers: Those that may be meant.
        plants: Where they run.
        duration: Of a run [s]: the final error is the largest one in its last tenth.

    Raises:
        ArgumentError: If it requires nothing, names what is not there, or a unit does not fit.
    """
    named = tuple(table.of or ())
    # Physics is judged unless the file names plants, or all where there is none.
    on = tuple(table.on or (("physics",) if "physics" in plants else plants))
    error = controllers[0].designed.error
    surfaces = {law.name: unit for law in controllers if (unit := law.designed.sliding_unit)}
    own = [surfaces[name] for name in named or surfaces if name in surfaces]
    units = {
        "output": error.units[error.output_rows[0]],
        "input": error.system.inputs[0].unit,
        "sliding": own[0] if own else "",
    }
    values = {kind: getattr(table, kind) for kind in _KINDS}
    values = {kind: value for kind, value in values.items() if value not in (None, False)}
    if not values:
        raise ArgumentError(f"nothing is required: give one of {', '.join(_KINDS)}")
    required, mistakes = [], Mistakes()
    for kind, value in values.items():
        judged = surfaces if kind in _OF_SURFACE else [law.name for law in controllers]
        of = named or tuple(judged)
        unit, band = units.get(_KINDS[kind][1], _KINDS[kind][1]), None
        with mistakes.gathered(f"{kind}: "):
            _refuse_undefined(kind, error, of)
            number = _number(kind, value, unit)
            after = table.after if kind in _AFTER else 0.0
            written = f"{value:g} {unit}" if kind in _READ else str(value)
            if kind == "final_error_below":
                after = (1 - DWELL) * duration
            if kind == "settles_within" and table.band is not None:
                band = _number("band", table.band, units["output"])
                written += f" to {table.band}"
            required.append(Limit(kind, written, number, unit, after, of, on, band=band))
    mistakes.refuse()
    return required


def _refuse_undefined(kind: str, error: Any, of: Sequence[str]) -> None:
    """Refuse a limit of a quantity that these laws or this plant do not have."""
    outputs = {error.units[row] for row in error.output_rows}
    inputs = {signal.unit for signal in error.system.inputs}
    reasons = {
        "no law has a surface": kind in _OF_SURFACE and not of,
        f"{error.system.name} has no cart": kind == "cart_travel_below"
        and not has_cart(error.system),
        "the outputs have different units: there is no one error": len(outputs) > 1
        and _KINDS[kind][1] == "output",
        "the inputs have different units": kind == "input_below" and len(inputs) > 1,
        "several outputs have no one overshoot": kind == "overshoot_below"
        and len(error.output_rows) > 1,
    }
    for reason, present in reasons.items():
        if present:
            raise ArgumentError(reason)


def initial_error(law: Controller, x0: Sequence[float]) -> float:
    """Size of the outputs' error at a start (n,), in their unit."""
    error = law.designed.error
    z = error.along(np.zeros(1), np.array([x0]), law.parameters)[0]
    return float(np.linalg.norm(z[list(error.output_rows)]))


def require_initial_error(kind: str, law: Controller, x0: Sequence[float]) -> None:
    """Refuse a limit that is a share of the error at the start for runs that start without one.

    Args:
        kind: ``settles_within`` without a band, or ``overshoot_below``.
        law: One of the laws that must keep it.
        x0: Start, (n,).

    Raises:
        ArgumentError: If the error at the start, of which the band is a share, is zero to rounding.
    """
    if initial_error(law, x0) <= _ROUNDING:
        share = (
            f"its band is {100 * SETTLING_BAND:g} %"
            if kind == "settles_within"
            else "it is a share"
        )
        raise ArgumentError(
            f"{kind}: {share} of the error at the start, and runs start without error: ask for "
            "stays_within with after instead, or start elsewhere"
        )


def _number(kind: str, value: Any, unit: str) -> float:
    """The number of a limit."""
    if kind == "no_reaching_phase":
        return _ROUNDING
    number = float(value) if kind in _READ else number_in(value, unit)
    if not number > 0:
        raise ArgumentError(f"{shown(value)} must be positive")
    return number


def judge(limit: Limit, result: RunResult) -> Judgement:
    """Whether a run keeps a requirement; one that ended early keeps none.

    Where a run does not settle in time, the note says how long its nominal optimum itself takes.
    """
    margin, kept = None, False
    if result.status is Status.COMPLETED:
        measured, note = _measured(limit, result)
    else:
        measured = None
        note = f"the run ended at {float(result.trajectory.valid_until):.3g} s"
    if measured is not None:
        margin = limit.value - measured
        kept = margin >= 0
    if limit.kind == "settles_within" and not kept and result.status is Status.COMPLETED:
        best = result.comparison
        needed = settling_time(best.time, best.optimal_error, limit.band)
        time = needed.note if needed.value is None else f"takes {needed.value:.3g} s"
        note = f"{note}; its nominal optimum itself: {time}".removeprefix("; ")
    return Judgement(limit, result.controller.name, result.plant, measured, margin, kept, note)


def _measured(limit: Limit, result: RunResult) -> tuple[float | None, str]:
    """The value that a limit is of, or why there is nothing to measure."""
    run, comparison, metrics = result.trajectory, result.comparison, result.metrics
    if limit.kind == "cost_ratio_below":
        total, least = metrics["cost_whole"].value, metrics["cost_optimal"].value
        if total is None or not least:
            return None, "J* is zero: the run starts where it shall end"
        return total / least, ""
    if limit.kind == "no_reaching_phase" and run.sliding is None:
        return None, "the law has no surface"
    if limit.after and comparison.time[-1] < limit.after * (1 - 1e-12):
        return None, "the run is shorter"
    usual = limit.kind == "settles_within" and limit.band is None
    known = metrics.get("settling_time" if usual else limit.metric)
    if known is not None and limit.kind != "overshoot_below":
        return known.value, known.note
    values = metrics_of_meters(
        *accumulate_run(run, comparison, result.case.onset, windows([limit]))
    )
    measured = float(values[limit.metric][0])
    if math.isfinite(measured):
        return measured, ""
    never = limit.kind == "settles_within"
    return None, "not reached" if never else "there is no error at the start"


def transient(duration: float, onsets: Iterable[tuple[float, float]]) -> float:
    """How long every run goes on before a disturbance begins, or until its end [s].

    Args:
        duration: Of a run [s].
        onsets: When each disturbance begins at the earliest and at the latest [s]; one that acts
            from the start of every run is part of the transient.
    """
    return min([duration, *(max(low, 0.0) for low, high in onsets if high > 0)])


def judgeable(limits: Sequence[Limit], before: float) -> tuple[list[Limit], list[str]]:
    """The requirements that runs tell about, and of the others why they do not.

    Args:
        limits: All that there are.
        before: How long a run is a ``transient`` [s].
    """
    latest, judged, notes = (1 - DWELL) * before, [], []
    for limit in limits:
        if limit.kind == "settles_within" and limit.value > latest * (1 + 1e-12):
            notes.append(
                f"not judged: {limit.words}: there are {before:g} s before a run ends or a "
                f"disturbance begins; they tell up to {latest:g} s, since an error counts as "
                f"settled after a tenth of them in the band: require that at most, or make them "
                f"{math.ceil(100 * limit.value / (1 - DWELL)) / 100:g} s at least"
            )
        else:
            judged.append(limit)
    return judged, notes


def required(limits: Sequence[Limit], laws: Container[str]) -> tuple[Limit, ...]:
    """The requirements of the laws that are run, each with a key of its own.

    Args:
        limits: All that there are.
        laws: Names of those that are run.
    """
    chosen: list[Limit] = []
    for limit in limits:
        of = tuple(name for name in limit.of if name in laws)
        if not of:
            continue
        same = sum(other.kind == limit.kind for other in chosen)
        key = f"{limit.kind} {same + 1}" if same else limit.kind
        chosen.append(limit._replace(of=of, key=key))
    return tuple(chosen)


def costs_wanted(limits: Iterable[Limit]) -> bool:
    """Whether one of them is of the index."""
    return any(limit.metric == "cost_ratio" for limit in limits)


def windows(limits: Sequence[Limit]) -> Windows:
    """What must be measured for some limits besides the usual metrics."""
    errors = (limit for limit in limits if limit.after or limit.kind in _AFTER)
    return Windows(
        tuple(sorted({limit.after for limit in errors})),
        tuple(sorted({limit.band for limit in limits if limit.band is not None})),
    )


def margins_of(
    limits: Sequence[Limit], metrics: Mapping[str, Array], completed: Array
) -> dict[str, Array]:
    """Limit less measured of n runs by key, (n,) each; -inf for runs that ended early.

    Args:
        limits: Of the runs' controller.
        metrics: Of the runs, (n,) each.
        completed: Which runs did, (n,).
    """
    return {
        limit.key: np.where(completed, limit.value - metrics[limit.metric], -np.inf)
        for limit in limits
    }


def judge_all(limits: Sequence[Limit], results: Sequence[RunResult]) -> list[Judgement]:
    """Every requirement of every run that it is about."""
    return [
        judge(limit, result)
        for limit in limits
        for result in results
        if result.controller.name in limit.of and result.plant in limit.on
    ]
