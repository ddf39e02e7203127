"""Rivals of GROSMC beside it, and the one rule that their numbers come from.

A law's number is the largest one of two digits with which, on the nominal case,

1. the error settles (2 %) within 5 % of the time that the nominal optimum takes,
2. the largest input is at most GROSMC's there,
3. no observer is faster than a thirtieth of the sampling frequency, in the middle of the 20 to 40
   samples per period of the bandwidth of G. F. Franklin, J. D. Powell and M. L. Workman, "Digital
   Control of Dynamic Systems", 3rd ed., section 11.2.

So each law does as much against what it does not know as the nominal response lets it. The adaptive
law has two: its adaptation, of one digit, is the largest for which some frequency of two digits
keeps the rule, and its frequency is the one of those that settles nearest to the optimum's time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import judge
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.results.tables import markdown_table, number, numbers, words

# The nominal case of each system, in which the outputs of all its laws are the joints.
NOMINAL: Mapping[str, str] = {
    "servo": "nominal",
    "cart_pendulum": "nominal",
    "arm": "nominal",
    "two_link_arm": "regulation",
}
SYSTEMS = tuple(NOMINAL)
# The number of each law that the rule chooses.
NUMBERS: Mapping[str, str] = {
    "lqi": "integral_weight",
    "pid": "frequency",
    "adrc": "bandwidth",
}
# On a machine, as quick as the actuator allows: the number that makes a law quicker, and the one
# that makes it stronger against loads, if there is one.
QUICK: Mapping[str, tuple[str, str | None]] = {
    "lqi": ("R", "integral_weight"),
    "pid": ("frequency", None),
    "adrc": ("R", None),
    "adaptive": ("frequency", "adaptation"),
}
WITHIN, SAMPLES = 0.05, 30.0
# Frequencies of the adaptive law that are tried [1/s]; inputs grow with them, so that many in a
# row that are too large are enough.
FREQUENCIES, _ENOUGH = (0.3, 6.0), 3
# The remaining error is the largest of so long an end [s].
_END = 1.0


class Rival(NamedTuple):
    """A run of a law, and its numbers for comparison.

    Attributes:
        system: Name of the system.
        law: Name of the controller.
        settling: Time to within 2 % of the start's error, up to the load [s]; infinite for never.
        deviation: max |y - y*|, y* the nominal optimum of the law, in the unit of the output; of
            several outputs, the norm.
        remaining: max |e| in the last second, in the unit of the output; of several, the norm.
        peak: Largest entry of |u|, in the unit of the input.
        variation: Total variation of u per second, in the unit of the input per second: chatter;
            of several inputs, by the norm of their changes.
        kept: Whether all that the case requires is kept.
        output_unit: Unit of the output.
        input_unit: Unit of the input.
    """

    system: str
    law: str
    settling: float
    deviation: float
    remaining: float
    peak: float
    variation: float
    kept: bool
    output_unit: str
    input_unit: str


def rivals(system: str) -> list[Rival]:
    """Every law of the rivals' case of one of ``SYSTEMS``, in the order of its file."""
    experiment = Experiment.load(f"rivals/{system}")
    return [compared(experiment.run(law=law)) for law in experiment.controllers]


def compared(run: RunResult) -> Rival:
    """The numbers of a run; its outputs have one unit, and its inputs one."""
    trajectory, law = run.trajectory, run.controller
    z = law.coordinates.along(trajectory.time, trajectory.state, law.parameters)
    e = np.linalg.norm(z[:, list(law.coordinates.output_rows)], axis=1)
    last = e[trajectory.time >= trajectory.time[-1] - _END]
    u = trajectory.input.reshape(len(trajectory.input), -1)
    moved = np.linalg.norm(np.diff(u, axis=0), axis=1).sum()
    return Rival(
        system=run.case.name,
        law=law.name,
        settling=_metric(run, "settling_time"),
        deviation=_metric(run, "deviation"),
        remaining=math.inf if run.ended else float(last.max()),
        peak=_metric(run, "max_input"),
        variation=float(moved / trajectory.time[-1]),
        kept=all(judgement.kept for judgement in run.requirements),
        output_unit=law.coordinates.output_units[0],
        input_unit=law.designed.error.system.inputs[0].unit,
    )


def _metric(run: RunResult, name: str) -> float:
    """A metric's value; infinite where it has none."""
    value = run.metrics[name].value
    return math.inf if value is None else float(value)


def rivals_table(rows: Iterable[Rival]) -> str:
    """The table of ``docs/rivals.md``, in Markdown."""
    cells = []
    for row in rows:
        y, u = row.output_unit, row.input_unit
        cells.append(
            [
                row.system,
                row.law,
                f"{number(row.settling)} s" if math.isfinite(row.settling) else "not reached",
                f"{number(row.deviation)} {y}",
                f"{number(row.remaining)} {y}" if math.isfinite(row.remaining) else "ended early",
                f"{number(row.peak)} {u}",
                f"{number(row.variation)} {u}/s",
                "yes" if row.kept else "no",
            ]
        )
    columns = [
        *words("system", "law"),
        *numbers(
            "settled", "max |y − y\\*|", "left at the end", "max |u|", "variation of u", "kept"
        ),
    ]  # fmt: skip
    return "\n".join(markdown_table(columns, cells))


# The rule


class Response(NamedTuple):
    """A nominal run.

    Attributes:
        settling: Time to within 2 % of the start's error [s]; infinite if it never settles.
        peak: Largest |u|, in the unit of the input.
    """

    settling: float
    peak: float


def response(
    experiment: Experiment,
    law: str,
    numbers: Mapping[str, Any] = MappingProxyType({}),
    plant: PlantName = "corrected",
) -> Response:
    """The run of a law with other numbers than the file's.

    Args:
        experiment: The nominal case.
        law: A controller of the case, or a law of its file.
        numbers: By their names.
        plant: The nominal equations are MuJoCo's to rounding, and four times as quick.
    """
    own = (table for table in experiment.file.controller if table.called == law)
    known = next(own, ControllerTable(law=law)).model_dump(exclude_unset=True)
    run = _with_table(experiment, {**known, **numbers}).run(plant, law)
    return Response(_metric(run, "settling_time"), _metric(run, "max_input"))


def _with_table(experiment: Experiment, table: Mapping[str, Any]) -> Experiment:
    """An experiment with one controller."""
    controller = [ControllerTable.model_validate(table)]
    file = experiment.file.model_copy(update={"controller": controller})
    return replace(experiment, file=file)


def budget(experiment: Experiment) -> Response:
    """Bounds of the rule: the settling time of the nominal optimum, the input of GROSMC."""
    return Response(response(experiment, "fl-lqr").settling, response(experiment, "grosmc").peak)


def allowed(experiment: Experiment, law: str, number: float, bounds: Response) -> bool:
    """Whether the rule allows a law this number.

    Args:
        experiment: The nominal case.
        law: ``lqi``, ``pid``, ``adrc`` ...
        number: The one of ``NUMBERS``.
        bounds: The ``budget``.
    """
    fastest = 2 * math.pi / (SAMPLES * experiment.settings.control_period)
    if NUMBERS[law] == "bandwidth" and number > fastest:
        return False
    run = response(experiment, law, {NUMBERS[law]: number})
    return abs(run.settling / bounds.settling - 1) <= WITHIN and run.peak <= bounds.peak


def largest(experiment: Experiment, law: str, low: float, high: float) -> float:
    """The number that the rule chooses between two bounds.

    All of two digits are tried, from above: the settling time jumps where an overshoot leaves its
    band, so it does not fall with every step.

    Raises:
        ArgumentError: If the rule allows none.
    """
    bounds = budget(experiment)
    for value in reversed(two_digits(low, high)):
        if allowed(experiment, law, value, bounds):
            return value
    raise ArgumentError(f"the rule allows {law} no number between {low:g} and {high:g}")


def fitting_frequency(experiment: Experiment, adaptation: float) -> float | None:
    """The adaptive law's frequency for an adaptation; None where the rule allows none."""
    bounds, best, nearest, too_large = budget(experiment), None, WITHIN, 0
    for frequency in two_digits(*FREQUENCIES):
        numbers = {"frequency": frequency, "adaptation": adaptation}
        run = response(experiment, "adaptive", numbers)
        if run.peak > bounds.peak:
            too_large += 1
            if too_large == _ENOUGH:
                break
        elif (off := abs(run.settling / bounds.settling - 1)) <= nearest:
            best, nearest = frequency, off
    return best


def two_digits(low: float, high: float) -> list[float]:
    """All numbers of two digits between two positive bounds, in order."""
    decades = range(math.floor(math.log10(low)) - 1, math.floor(math.log10(high)))
    every = [float(f"{digits}e{decade}") for decade in decades for digits in range(10, 100)]
    return [number for number in every if low <= number <= high]


class Quickness(NamedTuple):
    """How quickly a law does a task; of two the smaller is better.

    Attributes:
        input: Share of the actuator's range that the input takes; 1 up to all of it.
        others: Largest share that is used of another limit of the task; 1 up to all of it.
        settling: Time to settle as the task means it [s].
    """

    input: float
    others: float
    settling: float


def nominal_machine(system: str) -> Experiment:
    """The machine of a system as its laws know it: rigid, without friction, in an ideal loop."""
    machine = Experiment.load(f"{system}/machine")
    own = tuple(edit for edit in machine.case.edits if edit not in machine.case.parts)
    bare = machine.varied(loop=None, edits=own)
    # RK4 needs no finer step on equations without friction and play.
    return bare.with_settings(timestep=bare.settings.control_period)


def quickness(experiment: Experiment, law: str, numbers: Mapping[str, Any]) -> Quickness:
    """How quickly a law with these numbers does the task of a nominal machine."""
    experiment = _with_table(experiment, {"law": law, "name": law, **numbers})
    try:
        run = experiment.run("corrected", law)
    except GrosmcError:
        return Quickness(math.inf, math.inf, math.inf)
    judged = {limit.kind: judge(limit, run) for limit in experiment.limits}
    settling = judged["settles_within"].measured
    others = [found.share for kind, found in judged.items() if kind != "input_below"]
    return Quickness(
        max(judged["input_below"].share, 1.0),
        max(*others, 1.0),
        math.inf if settling is None else settling,
    )


def neighbours(number: float) -> tuple[float, ...]:
    """Numbers of one digit: the next below and above, a tenth, and ten times."""
    digit, _, exponent = f"{number:.0e}".partition("e")
    first, decade = int(digit), int(exponent)
    below = (first - 1, decade) if first > 1 else (9, decade - 1)
    above = (first + 1, decade) if first < 9 else (1, decade + 1)
    steps = (below, above, (first, decade - 1), (first, decade + 1))
    return tuple(float(f"{a}e{b}") for a, b in steps)
