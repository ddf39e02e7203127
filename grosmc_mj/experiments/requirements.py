"""Requirements on runs, and judgements with their margins."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.task import GrosmcParameters
from grosmc_mj.errors import ArgumentError, Mistakes, value_text
from grosmc_mj.experiments.file.schema import RequirementTable
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
from grosmc_mj.experiments.runs import Run
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.units import number_in

# s(0) is zero to rounding of z and of its reference.
_ROUNDING = 1e-9
# Metric and unit of each kind of limit. An empty metric has an instant or a band in its name, see
# ``Limit.metric``. The units "output", "input" and "sliding" stand for those of the laws.
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
# Kinds for laws with a surface only.
_OF_SURFACE = ("sliding_below", "no_reaching_phase")
# Kinds that limit an error from ``after`` on.
_AFTER = ("stays_within", "rms_below")
# Kinds whose values are numbers already in the table of the file.
_READ = ("settles_within", "cart_travel_below")


class Limit(NamedTuple):
    """One requirement with its number.

    Attributes:
        kind: Name of the key in the file.
        written: The largest value allowed, as written in the file.
        value: The largest value allowed in ``unit``.
        unit: Unit of the value.
        after: Instant from which on it holds [s].
        of: Controllers that must keep it.
        on: Plants on which they must keep it.
        key: Unique name among the requirements of a campaign.
        band: Half width of the band of ``settles_within``, in the unit of the output; None
            for 2 % of the error at the start.
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
        """Name of the limited metric."""
        if self.kind == "settles_within":
            return settled_in(self.band)
        if self.kind == "rms_below":
            return rms_after(self.after)
        if self.kind in ("stays_within", "final_error_below"):
            return error_after(self.after)
        metric, _ = _KINDS[self.kind]
        return metric

    @property
    def of_initial_error(self) -> bool:
        """Whether it is a share of the error at the start, which must not be zero then."""
        if self.kind == "settles_within":
            return self.band is None
        return self.kind == "overshoot_below"

    @property
    def words(self) -> str:
        """The requirement in words."""
        if self.kind == "no_reaching_phase":
            return "no reaching phase: s(0) = 0"
        words = f"{self.kind.replace('_', ' ')} {self.written}"
        if self.after and self.kind in _AFTER:
            words += f" from {self.after:g} s on"
        return words


class Judgement(NamedTuple):
    """A requirement of one run, judged.

    Attributes:
        limit: The requirement.
        controller: Name of the run's controller.
        plant: Name of the run's plant.
        measured: Measured value in the limit's unit; None if nothing could be measured.
        margin: Limit less measured value; None without one.
        kept: Whether the run keeps it.
        note: Reason why nothing was measured; of an input its time at the actuators' limit.
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
        """Measured value over the limit; infinite without a measurement."""
        if self.margin is None:
            return math.inf
        return 1 - self.margin / self.limit.value


def limits(
    table: RequirementTable,
    controllers: Sequence[Controller],
    plants: Sequence[str],
    duration: float,
) -> list[Limit]:
    """Return the requirements in a table of a case file, with their units checked.

    Args:
        table: Table of the file.
        controllers: All controllers of the file.
        plants: Plants that they run on.
        duration: Duration of a run [s]: the final error is the largest one in its last tenth.

    Raises:
        ArgumentError: If it requires nothing, names a missing thing, or a unit does not fit.
    """
    kinds = [kind for kind in _KINDS if getattr(table, kind) not in (None, False)]
    if not kinds:
        raise ArgumentError(f"nothing is required: give one of {', '.join(_KINDS)}")

    required = []
    mistakes = Mistakes()
    for kind in kinds:
        with mistakes.gathered(f"{kind}: "):
            required.append(_limit(kind, table, controllers, plants, duration))
    mistakes.refuse()
    return required


def _limit(
    kind: str,
    table: RequirementTable,
    controllers: Sequence[Controller],
    plants: Sequence[str],
    duration: float,
) -> Limit:
    """Return one requirement of a table."""
    of = tuple(table.of or [law.name for law in controllers])
    if kind in _OF_SURFACE:
        # Nothing can be asked of the surface of a law that has none.
        with_surface = {law.name for law in controllers if law.designed.sliding_unit}
        of = tuple(name for name in of if name in with_surface)
    _refuse_undefined(kind, controllers[0].designed.error, of)

    units = _units(controllers, table.of)
    _, unit = _KINDS[kind]
    unit = units.get(unit, unit)
    value = getattr(table, kind)
    number = _number(kind, value, unit)
    written = f"{value:g} {unit}" if kind in _READ else str(value)

    after = 0.0
    if kind in _AFTER:
        after = table.after
    elif kind == "final_error_below":
        after = (1 - DWELL) * duration

    band = None
    if kind == "settles_within" and table.band is not None:
        band = _number("band", table.band, units["output"])
        written += f" to {table.band}"
    return Limit(kind, written, number, unit, after, of, _plants_of(table, plants), band=band)


def _plants_of(table: RequirementTable, plants: Sequence[str]) -> tuple[str, ...]:
    """Return the plants that a table names: physics by default, or all where there is none."""
    if table.on:
        return tuple(table.on)
    if "physics" in plants:
        return ("physics",)
    return tuple(plants)


def _units(controllers: Sequence[Controller], names: Sequence[str] | None) -> dict[str, str]:
    """Return the units of output, input and s; of s under the named controllers, if any."""
    error = controllers[0].designed.error
    sliding_units = {law.name: law.designed.sliding_unit for law in controllers}
    named_units = [sliding_units.get(name, "") for name in names or sliding_units]
    return {
        "output": error.units[error.output_rows[0]],
        "input": error.system.inputs[0].unit,
        "sliding": next(filter(None, named_units), ""),
    }


def _refuse_undefined(kind: str, error: Any, of: Sequence[str]) -> None:
    """Refuse a limit of a quantity that these laws or this plant do not have."""
    _, unit = _KINDS[kind]
    if kind in _OF_SURFACE and not of:
        raise ArgumentError("no law that it is asked of has a surface")
    if kind == "cart_travel_below" and not has_cart(error.system):
        raise ArgumentError(f"{error.system.name} has no cart")

    output_units = {error.units[row] for row in error.output_rows}
    if unit == "output" and len(output_units) > 1:
        raise ArgumentError("the outputs have different units: there is no one error")
    input_units = {signal.unit for signal in error.system.inputs}
    if kind == "input_below" and len(input_units) > 1:
        raise ArgumentError("the inputs have different units")
    if kind == "overshoot_below" and len(error.output_rows) > 1:
        raise ArgumentError("several outputs have no one overshoot")


def initial_error(law: Controller, x0: Sequence[float]) -> float:
    """Return the size of the outputs' error at a start (n,), in their unit."""
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
        ArgumentError: If the error at the start is zero to rounding.
    """
    if initial_error(law, x0) > _ROUNDING:
        return
    share = "it is a share"
    if kind == "settles_within":
        share = f"its band is {100 * SETTLING_BAND:g} %"
    raise ArgumentError(
        f"{kind}: {share} of the error at the start, and runs start without error: ask for "
        "stays_within with after instead, or start elsewhere"
    )


def _number(kind: str, value: Any, unit: str) -> float:
    """Return the number of a limit in a unit."""
    if kind == "no_reaching_phase":
        return _ROUNDING
    number = float(value) if kind in _READ else number_in(value, unit)
    if not number > 0:
        raise ArgumentError(f"{value_text(value)} must be positive")
    return number


def judge(limit: Limit, result: Run) -> Judgement:
    """Judge a run by a requirement; a run that ended early keeps none.

    Where a run does not settle in time, the note says how long its nominal optimum itself takes.
    """
    completed = result.status is Status.COMPLETED
    if completed:
        measured, note = _measured(limit, result)
    else:
        measured = None
        note = f"the run ended at {float(result.trajectory.valid_until):.3g} s"

    margin = None
    kept = False
    if measured is not None:
        margin = limit.value - measured
        kept = margin >= 0
    if completed and limit.kind == "input_below" and np.any(np.isfinite(result.input_limits)):
        note = f"at the actuator's limit {100 * result.saturated:.2g} % of the time"
    if completed and limit.kind == "settles_within" and not kept and _has_nominal_error(result):
        optimum = f"its nominal optimum itself: {_settling_of_optimum(limit, result)}"
        note = f"{note}; {optimum}" if note else optimum
    return Judgement(limit, result.controller.name, result.plant, measured, margin, kept, note)


def _has_nominal_error(result: Run) -> bool:
    """Whether the error of the law's nominal loop is that of its design: of K z, with more or not.

    Laws with an integrator of their own and a user's laws are only compared with an optimum.
    """
    law = result.controller
    return law.designed.follows_optimum or hasattr(law.parameters, "K")


def unfailing(limits: Sequence[Limit], results: Sequence[Run]) -> list[str]:
    """Return a line for each requirement that none of the runs could fail, with the reason."""
    lines = []
    for limit in limits:
        reasons = [
            why_unfailing(limit, result.controller, result.input_limits)
            for result in results
            if _applies(limit, result)
        ]
        lines += unfailing_line(limit, reasons)
    return list(dict.fromkeys(lines))


def unfailing_line(limit: Limit, reasons: Sequence[str]) -> list[str]:
    """Return the line on a requirement if there is a reason for each of its runs, else none."""
    if not reasons or not all(reasons):
        return []
    return [f"cannot fail: {limit.words} ({max(reasons, key=len)})"]


def why_unfailing(limit: Limit, law: Controller, input_limits: Array) -> str:
    """Return why a run that reaches its end keeps a requirement whatever it does, or nothing.

    Args:
        limit: The requirement.
        law: The controller of the run.
        input_limits: Least and largest of each input, (2, m).
    """
    if limit.kind == "input_below":
        largest = float(np.abs(input_limits).max())
        if limit.value >= largest:
            return f"the actuator gives {largest:g} {limit.unit} at most"
    integral = isinstance(law.parameters, GrosmcParameters)
    if limit.kind == "no_reaching_phase" and integral:
        return "an integral surface starts at zero"
    return ""


def _settling_of_optimum(limit: Limit, result: Run) -> str:
    """Return the time that the nominal optimum takes to settle, in words."""
    comparison = result.comparison
    settled = settling_time(comparison.time, comparison.optimal_error, limit.band)
    if settled.value is None:
        return settled.note
    return f"takes {settled.value:.3g} s"


def _measured(limit: Limit, result: Run) -> tuple[float | None, str]:
    """Return the limited value of a run, or None and the reason why there is none."""
    run = result.trajectory
    comparison = result.comparison
    metrics = result.metrics
    if limit.kind == "cost_ratio_below":
        cost = metrics["cost_whole"].value
        optimal_cost = metrics["cost_optimal"].value
        if cost is None or not optimal_cost:
            return None, "J* is zero: the run starts where it shall end"
        return cost / optimal_cost, ""
    if limit.kind == "no_reaching_phase" and run.sliding is None:
        return None, "the law has no surface"
    if limit.after and comparison.time[-1] < limit.after * (1 - 1e-12):
        return None, "the run is shorter"

    name = limit.metric
    if limit.kind == "settles_within" and limit.band is None:
        name = "settling_time"
    # The overshoot among the metrics is in percent.
    if name in metrics and limit.kind != "overshoot_below":
        return metrics[name].value, metrics[name].note

    meters, recording = accumulate_run(run, comparison, result.case.onset, windows([limit]))
    measured = float(metrics_of_meters(meters, recording)[limit.metric][0])
    if math.isfinite(measured):
        return measured, ""
    if limit.kind == "settles_within":
        return None, "not reached"
    return None, "there is no error at the start"


def transient(duration: float, onsets: Iterable[tuple[float, float]]) -> float:
    """Return the time before a disturbance begins or the run ends, in every run [s].

    Args:
        duration: Duration of a run [s].
        onsets: Earliest and latest onset of each disturbance [s]; one that acts from the start of
            every run is part of the transient.
    """
    ends = [duration]
    for earliest, latest in onsets:
        if latest > 0:
            ends.append(max(earliest, 0.0))
    return min(ends)


def judgeable(limits: Sequence[Limit], before: float) -> tuple[list[Limit], list[str]]:
    """Return the requirements that runs can decide, and a note about each of the other ones.

    Args:
        limits: All requirements.
        before: Length of a run's ``transient`` [s].
    """
    latest = (1 - DWELL) * before
    judged = []
    notes = []
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
    """Return the requirements of the laws that are run, with unique keys.

    Args:
        limits: All requirements.
        laws: Names of the laws that are run.
    """
    chosen: list[Limit] = []
    for limit in limits:
        of = tuple(name for name in limit.of if name in laws)
        if not of:
            continue
        number = 1 + sum(earlier.kind == limit.kind for earlier in chosen)
        key = limit.kind
        if number > 1:
            key = f"{limit.kind} {number}"
        chosen.append(limit._replace(of=of, key=key))
    return tuple(chosen)


def costs_wanted(limits: Iterable[Limit]) -> bool:
    """Whether one of the requirements limits the index."""
    return any(limit.metric == "cost_ratio" for limit in limits)


def windows(limits: Sequence[Limit]) -> Windows:
    """Return the windows and bands that requirements need besides the usual metrics."""
    after = {limit.after for limit in limits if limit.after or limit.kind in _AFTER}
    bands = {limit.band for limit in limits if limit.band is not None}
    return Windows(tuple(sorted(after)), tuple(sorted(bands)))


def margins_of(
    limits: Sequence[Limit], metrics: Mapping[str, Array], completed: Array
) -> dict[str, Array]:
    """Return limit less measured value of n runs by key, (n,) each; -inf if a run ended early.

    Args:
        limits: Requirements of the runs' controller.
        metrics: Metrics of the runs, (n,) each.
        completed: Whether each run reached its end, (n,).
    """
    return {
        limit.key: np.where(completed, limit.value - metrics[limit.metric], -np.inf)
        for limit in limits
    }


def judge_all(limits: Sequence[Limit], results: Sequence[Run]) -> list[Judgement]:
    """Judge each run by each of its requirements."""
    judgements = []
    for limit in limits:
        judgements += [judge(limit, result) for result in results if _applies(limit, result)]
    return judgements


def _applies(limit: Limit, result: Run) -> bool:
    """Whether a requirement is about a run."""
    return result.controller.name in limit.of and result.plant in limit.on
