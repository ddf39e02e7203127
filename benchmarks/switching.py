"""Accuracy and chattering of the switching laws against sample time.

    python -m benchmarks.switching [FIGURE.png]

The scalar s' = r phi + w with w = 0.5 sin 2 pi t is sampled by the functions that the laws call.
The chapter's cases run in MuJoCo under GROSMC on the discrete-time surface. The tables have the
numbers of docs/beyond.md at a sample time of 1 ms, the figure is the one of that page.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.cli import screen
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.output.charts.figure import write_chart
from grosmc_mj.output.charts.of_results import panels_chart
from grosmc_mj.output.results.result import LineChart, Series, finite
from grosmc_mj.output.results.tables import Table, number, numbers, table, words
from grosmc_mj.theory.control.switching import SWITCHINGS, Switching, find_switching

FIGURE = Path("docs/figures/switching.png")
# The laws for one input; with one input the unit vectors are sign and implicit.
LAWS = tuple(name for name in SWITCHINGS if "unit-vector" not in name)

# The scalar: W is the amplitude of w, L the largest |w'|, and rho > W.
FREQUENCY = 2 * math.pi
W = 0.5
L = W * FREQUENCY
RHO = 1.0
# Total variation of w per second: four times the amplitude in each cycle.
VARIATION_OF_W = 4 * W * FREQUENCY / (2 * math.pi)
# Two cycles to settle and two to measure [s].
_SETTLED = 2.0
_END = 4.0
_DIVERGED = 1e6

SAMPLE_TIMES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
GAIN_RATIOS = tuple((np.arange(6, 47) / 20).tolist())
# Sample time of the tables and of the gain ratios [s].
SAMPLE_TIME = 1e-3

# Cases of the figure, for every control period; the tables have the others, too.
DRAWN = ("servo/nominal", "cart_pendulum/case1")
CASES = (*DRAWN, "servo/case1", "servo/case2", "arm/case1")
CONTROL_PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
TIMESTEP = 5e-4


class Sample(NamedTuple):
    """One sample of the scalar.

    Attributes:
        t: Time [s].
        s: Sliding variable.
        phi: Output of the law.
        memory: Memory of the law, which the next sample changes.
    """

    t: float
    s: float
    phi: float
    memory: Any


class ScalarRun(NamedTuple):
    """A law on the scalar, measured after the transient.

    Attributes:
        law: Name of the law.
        sample_time: [s].
        gain_ratio: r.
        max_sliding: Largest |s|; infinite if it diverged, as the others are then.
        crossings: Changes of the sign of s per second.
        total_variation: Total variation of phi per second.
    """

    law: str
    sample_time: float
    gain_ratio: float
    max_sliding: float
    crossings: float
    total_variation: float


class CaseRun(NamedTuple):
    """A case in MuJoCo under GROSMC with one switching law.

    Attributes:
        case: SYSTEM/CASE.
        law: Name of the switching law.
        control_period: [s].
        deviation: Largest distance from the optimal trajectory, in the unit of the output.
        max_sliding: Largest |s|, in the unit of the surface.
        total_variation: Total variation of the input per second, in its unit.
        cost: J of the whole input over J*.
    """

    case: str
    law: str
    control_period: float
    deviation: float
    max_sliding: float
    total_variation: float
    cost: float


# The scalar


def law_for(name: str) -> Switching:
    """Switching law with the numbers for the disturbance of the scalar.

    Raises:
        GainError: If there is no such law.
    """
    return find_switching(name, slope=L)


def integral_of_w(start: float, end: float) -> float:
    """Integral of w from start to end [s]."""
    return W * (math.cos(FREQUENCY * start) - math.cos(FREQUENCY * end)) / FREQUENCY


def scalar_samples(
    law: Switching,
    sample_time: float,
    gain_ratio: float = 1.0,
    integral: Callable[[float, float], float] = integral_of_w,
) -> Iterator[Sample]:
    """Sample s' = r phi + w from s(0) = 0, with phi held between samples; exact in between.

    Args:
        law: Switching law with its numbers.
        sample_time: [s].
        gain_ratio: r, the true input gain over the nominal one.
        integral: Integral of w between two instants.

    Yields:
        Each sample; none after |s| has exceeded 1e6.
    """
    memory = law.new_memory(1, 1)()
    s = 0.0
    for i in range(round(_END / sample_time)):
        t = i * sample_time
        memory.elapsed = t - memory.t
        memory.t = t
        law.reach(np.array([s]), 0.0, RHO, memory, law.numbers, memory.phi)
        phi = float(memory.phi[0])
        yield Sample(t, s, phi, memory)

        s += gain_ratio * sample_time * phi + integral(t, (i + 1) * sample_time)
        if not abs(s) < _DIVERGED:
            return


def scalar_run(law: Switching, sample_time: float, gain_ratio: float = 1.0) -> ScalarRun:
    """Measure one law on the scalar at one sample time and gain ratio."""
    samples = list(scalar_samples(law, sample_time, gain_ratio))
    if len(samples) < round(_END / sample_time):
        return ScalarRun(law.name, sample_time, gain_ratio, math.inf, math.inf, math.inf)

    measured = [sample for sample in samples if sample.t >= _SETTLED - sample_time / 2]
    s = np.array([sample.s for sample in measured])
    phi = np.array([sample.phi for sample in measured])
    seconds = len(measured) * sample_time
    return ScalarRun(
        law=law.name,
        sample_time=sample_time,
        gain_ratio=gain_ratio,
        max_sliding=float(np.abs(s).max()),
        crossings=crossings(s) / seconds,
        total_variation=float(np.abs(np.diff(phi, axis=0)).sum() / seconds),
    )


def crossings(values: Array) -> int:
    """How often values change their sign; a zero in between counts once."""
    return int(np.count_nonzero(np.diff(np.sign(values[values != 0.0]))))


def order_of(runs: Sequence[ScalarRun]) -> float:
    """Order p of the fit max |s| ~ T^p of one law."""
    sample_times = [run.sample_time for run in runs]
    largest = [run.max_sliding for run in runs]
    return float(np.polyfit(np.log(sample_times), np.log(largest), 1)[0])


# The cases


def case_run(case: str, law: str, control_period: float) -> CaseRun:
    """Run a case in MuJoCo under GROSMC with a switching law on the discrete-time surface.

    Raises:
        GrosmcError: If there is no such case or law.
    """
    experiment = Experiment.load(case).changed(
        control_period=control_period,
        timestep=TIMESTEP,
        switching=law,
        surface="discrete",
    )
    result = experiment.run(law="grosmc")
    values = {name: metric.value for name, metric in result.metrics.items()}
    numbers_of_run = {name: math.nan if x is None else x for name, x in values.items()}
    return CaseRun(
        case=case,
        law=law,
        control_period=control_period,
        deviation=numbers_of_run["deviation"],
        max_sliding=numbers_of_run["max_sliding"],
        total_variation=numbers_of_run["total_variation"],
        cost=numbers_of_run["cost_whole"] / numbers_of_run["cost_optimal"],
    )


# Tables and figure


def scalar_table(by_time: Sequence[ScalarRun], by_ratio: Sequence[ScalarRun]) -> Table:
    """Table of the scalar at 1 ms, with the order in T and the ratio from which a law diverges."""
    rows = []
    for law in LAWS:
        over_time = [run for run in by_time if run.law == law]
        at_sample_time = next(run for run in over_time if run.sample_time == SAMPLE_TIME)
        diverged = [
            run.gain_ratio for run in by_ratio if run.law == law and math.isinf(run.max_sliding)
        ]
        rows.append(
            [
                law,
                f"{order_of(over_time):.2f}",
                number(at_sample_time.max_sliding),
                number(at_sample_time.crossings),
                number(at_sample_time.total_variation / VARIATION_OF_W),
                f"{min(diverged):.2f}" if diverged else "-",
            ]
        )
    headers = ("order of\nmax|s|", "max|s|", "zeros\nper s", "variation of u\nover w's")
    columns = [*words("law"), *numbers(*headers, "diverges\nfrom r")]
    return table("Scalar s' = r u + 0.5 sin 2πt, r the true over the nominal gain", columns, rows)


def cases_table(runs: Sequence[CaseRun]) -> Table:
    """Table of the cases at 1 ms; deviation and variation are in the units of the system."""
    rows = [
        [
            run.case,
            run.law,
            number(run.deviation),
            number(run.max_sliding),
            number(run.total_variation),
            number(run.cost),
        ]
        for run in runs
        if run.control_period == SAMPLE_TIME
    ]
    headers = ("max\n|y-y*|", "max|s|", "variation\nof u per s", "J of u\nover J*")
    columns = [*words("case", "law"), *numbers(*headers)]
    return table("Cases in MuJoCo", columns, rows, grouped=True)


def scalar_charts(by_time: Sequence[ScalarRun], by_ratio: Sequence[ScalarRun]) -> list[LineChart]:
    """Charts of the scalar: accuracy and variation over T, accuracy over r."""
    milliseconds = [1e3 * T for T in SAMPLE_TIMES]
    bounds = ([W * T for T in SAMPLE_TIMES], [L * T**2 for T in SAMPLE_TIMES])
    ideal = [
        Series(name="W T (order 1), L T² (order 2)", x=milliseconds, y=bound, bound=True)
        for bound in bounds
    ]
    return [
        LineChart(
            name="Scalar s' = u + 0.5 sin 2πt",
            titles=("sample time T [ms]", "max |s|"),
            lines=[*_curves(by_time, "sample_time", "max_sliding", 1e3), *ideal],
        ),
        LineChart(
            name="Scalar: variation of u, dashed of w itself",
            titles=("sample time T [ms]", "variation of u [1/s]"),
            lines=_curves(by_time, "sample_time", "total_variation", 1e3),
            limit=VARIATION_OF_W,
        ),
        LineChart(
            name="Scalar with input r u; dashed: r ρ = W, 4/3, 2",
            titles=("true over nominal gain r", "max |s|"),
            lines=_curves(by_ratio, "gain_ratio", "max_sliding"),
            marks=(W / RHO, 4 / 3, 2.0),
        ),
    ]


def case_charts(case: str, runs: Sequence[CaseRun]) -> list[LineChart]:
    """Charts of a case over the control period: distance from the optimum, variation, cost."""
    system = Experiment.load(case).nominal.system
    output = system.positions[system.output].unit
    quantities = (
        ("deviation", "max |y − y*|", f"deviation [{output}]"),
        ("total_variation", "variation of u", f"variation of u [{system.input.unit}/s]"),
        ("cost", "J of the whole input", "J / J*"),
    )
    runs_of_case = [run for run in runs if run.case == case]
    return [
        LineChart(
            name=f"{case}: {title}",
            titles=("control period [ms]", axis),
            lines=_curves(runs_of_case, "control_period", quantity, 1e3),
        )
        for quantity, title, axis in quantities
    ]


def _curves(runs: Sequence[Any], x: str, y: str, scale: float = 1.0) -> list[Series]:
    """Curve for each law, with x times a scale; a run that diverged has no point."""
    curves = []
    for law in LAWS:
        runs_of_law = [run for run in runs if run.law == law]
        curves.append(
            Series(
                name=law,
                x=[scale * getattr(run, x) for run in runs_of_law],
                y=[finite(getattr(run, y)) for run in runs_of_law],
            )
        )
    return curves


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the tables, draw the figure."""
    parser = argparse.ArgumentParser("python -m benchmarks.switching", description=__doc__)
    parser.add_argument("figure", nargs="?", type=Path, default=FIGURE, metavar="FIGURE.png")
    figure = parser.parse_args(arguments).figure
    if figure.suffix != ".png":
        parser.error(f"{figure} must end in .png")

    by_time = [scalar_run(law_for(law), T) for law in LAWS for T in SAMPLE_TIMES]
    by_ratio = [scalar_run(law_for(law), SAMPLE_TIME, r) for law in LAWS for r in GAIN_RATIOS]
    cases = []
    for case in CASES:
        control_periods = CONTROL_PERIODS if case in DRAWN else (SAMPLE_TIME,)
        cases += [case_run(case, law, period) for law in LAWS for period in control_periods]

    console = screen.wide_console()
    console.print(scalar_table(by_time, by_ratio))
    console.print(cases_table(cases))
    rows = [scalar_charts(by_time, by_ratio)]
    rows += [case_charts(case, cases) for case in DRAWN]
    chart = panels_chart("Accuracy and chattering against sample time", rows)
    # The page shows the PNG only.
    write_chart(chart, figure, [".png"])
    screen.say_files(console, figure)


if __name__ == "__main__":
    main()
