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
from grosmc_mj.experiments.file.tables.laws import ControllerTable
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


# The numbers by which each law may be made quicker, beside those that stay.
QUICK: Mapping[str, tuple[str, ...]] = {
    "lqi": ("R", "integral_weight"),
    "pid": ("frequency",),
    "adrc": ("R",),
    "adaptive": ("frequency", "adaptation"),
}


class Quickness(NamedTuple):
    """By what the quickest numbers of a law are found: the smaller, the better.

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
    return machine.varied(loop=None, edits=own)


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


def quickest(
    experiment: Experiment, law: str, numbers: Mapping[str, Any], start: Mapping[str, float]
) -> dict[str, float]:
    """The numbers with which a law is as quick as the actuator allows.

    Of one digit each, from a start on, as long as the next one or the next decade of some number
    is better: with an input within the actuator's range, all else of the task kept, and sooner
    settled.

    Args:
        experiment: A nominal machine, see ``nominal_machine``.
        law: Name of a law of the package.
        numbers: Those that stay.
        start: The first ones of ``QUICK``.
    """
    best = dict(start)
    least = quickness(experiment, law, {**numbers, **best})
    while True:
        for trial in neighbours(best):
            found = quickness(experiment, law, {**numbers, **trial})
            if found < least:
                best, least = trial, found
                break
        else:
            return best


def neighbours(numbers: Mapping[str, float]) -> list[dict[str, float]]:
    """The same numbers with one of them a digit or a decade smaller or larger."""
    found = []
    for name, number in numbers.items():
        decade = math.floor(math.log10(number * (1 + 1e-9)))
        digit = round(number / 10.0**decade)
        below = f"{digit - 1}e{decade}" if digit > 1 else f"9e{decade - 1}"
        above = f"{digit + 1}e{decade}" if digit < 9 else f"1e{decade + 1}"
        steps = (below, above, f"{digit}e{decade - 1}", f"{digit}e{decade + 1}")
        found += [{**numbers, name: float(step)} for step in steps]
    return found
