"""The one rule that every rival's number comes from.

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
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

from grosmc_mj.errors import ArgumentError, GrosmcError
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.schema import ControllerTable
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements import judge

# The number of each law that the rule chooses.
NUMBERS: Mapping[str, str] = {
    "lqi": "integral_weight",
    "pid": "frequency",
    "adrc": "bandwidth",
}
# The nominal case of each system, in which the outputs of all its laws are the joints.
NOMINAL: Mapping[str, str] = {
    "servo": "nominal",
    "cart_pendulum": "nominal",
    "arm": "nominal",
    "two_link_arm": "regulation",
}
WITHIN = 0.05
SAMPLES = 30.0
# Frequencies of the adaptive law that are tried [1/s].
FREQUENCIES = (0.3, 6.0)
# Inputs grow with the frequency: so many that are too large in a row are enough.
_ENOUGH = 3


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
        plant: What it runs on: the nominal equations are MuJoCo's to rounding, and a search on
            them takes a quarter of the time.
    """
    run = (each for each in experiment.file.controller if each.called == law)
    known = next(run, ControllerTable(law=law)).model_dump(exclude_unset=True)
    table = ControllerTable.model_validate({**known, **numbers})
    changed = experiment.file.model_copy(update={"controller": [table]})
    metrics = replace(experiment, file=changed).run(plant, law).metrics
    settling, peak = metrics["settling_time"].value, metrics["max_input"].value
    return Response(*(math.inf if value is None else value for value in (settling, peak)))


def budget(experiment: Experiment) -> Response:
    """What the rule allows: the settling time of the nominal optimum, the input of GROSMC."""
    return Response(response(experiment, "fl-lqr").settling, response(experiment, "grosmc").peak)


def allowed(experiment: Experiment, law: str, number: float, given: Response) -> bool:
    """Whether the rule allows a law this number.

    Args:
        experiment: The nominal case.
        law: ``lqi``, ``pid``, ``adrc`` ...
        number: The one of ``NUMBERS``.
        given: The ``budget``.
    """
    name = NUMBERS[law]
    fastest = 2 * math.pi / (SAMPLES * experiment.settings.control_period)
    if name == "bandwidth" and number > fastest:
        return False
    found = response(experiment, law, {name: number})
    return abs(found.settling / given.settling - 1) <= WITHIN and found.peak <= given.peak


def largest(experiment: Experiment, law: str, low: float, high: float) -> float:
    """The number that the rule chooses between two bounds.

    All of two digits are tried, from above: the settling time jumps where an overshoot leaves its
    band, so it does not fall with every step.

    Args:
        experiment: The nominal case.
        law: ``lqi``, ``pid``, ``adrc`` ...
        low: Least number that is tried.
        high: Largest number that is tried.

    Raises:
        ArgumentError: If the rule allows none.
    """
    given = budget(experiment)
    for number in reversed(two_digits(low, high)):
        if allowed(experiment, law, number, given):
            return number
    raise ArgumentError(f"the rule allows {law} no number between {low:g} and {high:g}")


def fitting_frequency(experiment: Experiment, adaptation: float) -> float | None:
    """The adaptive law's frequency for an adaptation; None where the rule allows none.

    Args:
        experiment: The nominal case.
        adaptation: gamma.
    """
    given, found, nearest, too_large = budget(experiment), None, WITHIN, 0
    for frequency in two_digits(*FREQUENCIES):
        numbers = {"frequency": frequency, "adaptation": adaptation}
        seen = response(experiment, "adaptive", numbers)
        if seen.peak > given.peak:
            too_large += 1
            if too_large == _ENOUGH:
                break
            continue
        off = abs(seen.settling / given.settling - 1)
        if off <= nearest:
            found, nearest = frequency, off
    return found


def two_digits(low: float, high: float) -> list[float]:
    """All numbers of two digits between two positive bounds, in order."""
    decades = range(math.floor(math.log10(low)) - 1, math.floor(math.log10(high)))
    every = [float(f"{digits}e{decade}") for decade in decades for digits in range(10, 100)]
    return [number for number in every if low <= number <= high]


# As quick as the actuator allows, on a machine: the number that makes a law quicker, and the one
# that makes it stronger against loads, if there is one.
QUICK: Mapping[str, tuple[str, str | None]] = {
    "lqi": ("R", "integral_weight"),
    "pid": ("frequency", None),
    "adrc": ("R", None),
    "adaptive": ("frequency", "adaptation"),
}
# From where on both are looked for: slow, and next to nothing against loads.
_SLOW: Mapping[str, float] = {"R": 0.1, "frequency": 3.0}
_WEAK, _DECADES = 1e-6, range(6, -6, -1)


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
    table = ControllerTable.model_validate({"law": law, "name": law, **numbers})
    file = experiment.file.model_copy(update={"controller": [table]})
    experiment = replace(experiment, file=file)
    try:
        run = experiment.run("corrected", law)
    except GrosmcError:
        return Quickness(math.inf, math.inf, math.inf)
    shares = {limit.kind: judge(limit, run).share for limit in experiment.limits}
    limit = next(each for each in experiment.limits if each.kind == "settles_within")
    others = [share for kind, share in shares.items() if kind != "input_below"]
    settling = judge(limit, run).measured
    return Quickness(
        max(shares["input_below"], 1.0),
        max(*others, 1.0),
        math.inf if settling is None else settling,
    )


def quickest(experiment: Experiment, law: str, numbers: Mapping[str, Any]) -> dict[str, float]:
    """The numbers, of one digit each, with which a law is as quick as the actuator allows.

    First the one that makes it quicker: with an input within the actuator's range and the rest of
    the task kept, the nominal machine settles soonest; next to nothing is done against loads. Then
    the one against loads: the largest with which the nominal machine still keeps the task.

    Args:
        experiment: A nominal machine, see ``nominal_machine``.
        law: ``lqi``, ``linear-lqi`` ...
        numbers: Those that stay.
    """
    quick, strong = QUICK[law.removeprefix("linear-")]
    weak = {} if strong is None else {strong: _WEAK}
    best = _SLOW[quick]

    def found(number: float, weak: Mapping[str, float] = weak) -> Quickness:
        return quickness(experiment, law, {**numbers, **weak, quick: number})

    least = found(best)
    while better := next(((q, n) for n in neighbours(best) if (q := found(n)) < least), None):
        least, best = better
    if strong is None:
        return {quick: best}

    def allowed(number: float) -> bool:
        return found(best, {strong: number})[:2] <= least[:2]

    # From above, as in ``largest``: a slow tail of the integral may be worse than a quick one.
    every = (float(f"{digit}e{decade}") for decade in _DECADES for digit in range(9, 0, -1))
    return {quick: best, strong: next(filter(allowed, every), _WEAK)}


def neighbours(number: float) -> tuple[float, float, float, float]:
    """Numbers of one digit: the next below and above, a tenth, and ten times."""
    digit, _, exponent = f"{number:.0e}".partition("e")
    first, decade = int(digit), int(exponent)
    below = (first - 1, decade) if first > 1 else (9, decade - 1)
    above = (first + 1, decade) if first < 9 else (1, decade + 1)
    steps = (below, above, (first, decade - 1), (first, decade + 1))
    return tuple(float(f"{a}e{b}") for a, b in steps)  # pyright: ignore[reportReturnType]
