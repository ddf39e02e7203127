"""Accuracy and chattering against sample time: every switching law on a scalar and on the cases.

The scalar s' = r phi + w is sampled by the very functions that the laws call; the cases run in
MuJoCo. Both tell how far s and the run stray, and how much the input has to move for that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.control.switching import (
    SWITCHINGS,
    Switching,
    find_switching,
)
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.catalogue import find_experiment, find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics import crossings, root_mean_square, variation_rate
from grosmc_mj.experiments.runs import RunResult, Surface
from grosmc_mj.results.charts import write_panels
from grosmc_mj.results.result import (
    MEASURED,
    Answer,
    LineChart,
    Series,
    Sheet,
    Value,
    finite,
    result,
)
from grosmc_mj.results.tables import Table, number, numbers, table, words

# The laws for one input; those for several are the same ones then.
LAWS = tuple(name for name in SWITCHINGS if "unit-vector" not in name)

# The scalar benchmark: w = 0.5 sin 2 pi t under rho = 1, so r rho > W for r > 0.5.
PUSH = 0.5
FREQUENCY = 2 * math.pi
SLOPE = PUSH * FREQUENCY  # largest |w'|
GAIN = 1.0
# Total variation of w per second: four times the amplitude in each cycle.
OWN_VARIATION = 4 * PUSH * FREQUENCY / (2 * math.pi)
# Two cycles to settle and two to measure.
_SETTLED, _END = 2.0, 4.0
_DIVERGED = 1e6

SAMPLE_TIMES = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
GAIN_RATIOS = tuple((np.arange(6, 47) / 20).tolist())

# The chapter's cases. The load of the servo's case 1 is a step: its w' is infinite twice.
CASES: Mapping[str, tuple[str, ...]] = {
    "servo": ("nominal", "case1", "case2"),
    "cart_pendulum": ("case1",),
    "arm": ("case1",),
}
PERIODS = (5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
SURFACES: tuple[Surface, ...] = ("printed", "discrete")
TIMESTEP = 5e-4
# The sample time of the tables [s].
SHOWN = 1e-3
# The cases of the figure where every system is measured: what the chapter promises, and its
# hardest test.
_CHOSEN = (("servo", "nominal"), ("cart_pendulum", "case1"))
_OF_RUN = ("system", "case", "law", "surface", "control_period")


def law_for(name: str) -> Switching:
    """The switching law of that name with numbers for the scalar's push.

    Raises:
        GainError: If there is no such law.
    """
    return find_switching(name, slope=SLOPE)


class Sample(NamedTuple):
    """One sample of the scalar benchmark.

    Attributes:
        t: Its time [s].
        s: What the law saw.
        phi: What it asked for.
        memory: What it remembers from here on; the next sample changes it.
    """

    t: float
    s: float
    phi: float
    memory: Any


def sine_push(start: float, end: float) -> float:
    """The integral of w = 0.5 sin 2 pi t from start to end [s]."""
    return PUSH * (math.cos(FREQUENCY * start) - math.cos(FREQUENCY * end)) / FREQUENCY


def scalar_samples(
    law: Switching,
    h: float,
    *,
    gain_ratio: float = 1.0,
    push: Callable[[float, float], float] = sine_push,
) -> Iterator[Sample]:
    """Sample s' = r phi + w with phi held, from s(0) = 0: no discretization but the law's own.

    Args:
        law: With its numbers.
        h: Sample time [s].
        gain_ratio: r, the true input gain over the nominal one.
        push: The integral of w between two instants.

    Yields:
        Each sample; none after |s| has grown beyond all bounds.
    """
    memory, s = law.new_memory(1, 1)(), 0.0
    for i in range(round(_END / h)):
        t = i * h
        memory.elapsed, memory.t = t - memory.t, t
        law.reach(np.array([s]), 0.0, GAIN, memory, law.numbers, memory.phi)
        phi = float(memory.phi[0])
        yield Sample(t, s, phi, memory)
        s += gain_ratio * h * phi + push(t, (i + 1) * h)
        if not abs(s) < _DIVERGED:
            return


class Benchmark(NamedTuple):
    """A law on the scalar benchmark, after the transient.

    Attributes:
        law: Its name.
        h: Sample time [s].
        gain_ratio: r.
        max_sliding: Largest |s|; infinite if it diverged, as the others then are.
        rms_sliding: RMS of s.
        crossings: Changes of the sign of s per second.
        total_variation: Of phi, per second; that of w is ``OWN_VARIATION``.
    """

    law: str
    h: float
    gain_ratio: float
    max_sliding: float
    rms_sliding: float
    crossings: float
    total_variation: float


def benchmark(law: Switching, h: float, gain_ratio: float = 1.0) -> Benchmark:
    """Measure one law at one sample time and gain ratio."""
    rows = np.array([row[:3] for row in scalar_samples(law, h, gain_ratio=gain_ratio)])
    if len(rows) < round(_END / h):
        return Benchmark(law.name, h, gain_ratio, *[math.inf] * 4)
    t, s, phi = rows[rows[:, 0] >= _SETTLED - h / 2].T
    seconds = len(t) * h
    return Benchmark(
        law=law.name,
        h=h,
        gain_ratio=gain_ratio,
        max_sliding=float(np.abs(s).max()),
        rms_sliding=root_mean_square(s),
        crossings=crossings(s) / seconds,
        total_variation=variation_rate(phi, seconds),
    )


def order(h: Sequence[float], values: Sequence[float]) -> float:
    """p of the fit values ~ h^p."""
    return float(np.polyfit(np.log(h), np.log(values), 1)[0])


def orders(rows: Sequence[Benchmark]) -> dict[str, float]:
    """The order of each law's largest |s| in the sample time."""
    laws = dict.fromkeys(row.law for row in rows)
    chosen = {law: [row for row in rows if row.law == law] for law in laws}
    return {
        law: order([row.h for row in points], [row.max_sliding for row in points])
        for law, points in chosen.items()
    }


def sample_time_sweep(sample_times: Sequence[float] = SAMPLE_TIMES) -> Iterator[Benchmark]:
    """Every law over the sample times, with the nominal input gain."""
    for name in LAWS:
        for h in sample_times:
            yield benchmark(law_for(name), h)


def gain_ratio_sweep(
    h: float = 1e-3, gain_ratios: Sequence[float] = GAIN_RATIOS
) -> Iterator[Benchmark]:
    """Every law over the input-gain ratios, within and beyond what it stands."""
    for name in LAWS:
        for gain_ratio in gain_ratios:
            yield benchmark(law_for(name), h, gain_ratio)


@dataclass(frozen=True)
class SwitchingRun:
    """One run of a case.

    Attributes:
        experiment: The case.
        law: Name of the switching law.
        surface: ``printed`` or ``discrete``.
        control_period: [s].
    """

    experiment: Experiment
    law: str
    surface: Surface
    control_period: float

    @property
    def system(self) -> str:
        """Name of the system."""
        return self.experiment.case.system

    @property
    def case(self) -> str:
        """Name of the case."""
        return self.experiment.case.name

    @property
    def key(self) -> str:
        """For people: what runs."""
        return f"{self.system}/{self.case}/{self.law}/{self.surface} {self.control_period:g} s"


class CaseRow(NamedTuple):
    """A case in MuJoCo under one switching law.

    Attributes:
        run: What was run.
        deviation: Largest distance from the optimal trajectory, in the output's unit.
        max_sliding: Largest |s|, in the unit of the law's surface.
        rms_sliding: RMS of s.
        total_variation: Of the input per second, in its unit.
        crossings: Changes of the sign of s per second.
        cost_continuous: J with the continuous part of the input over J*.
        cost_rate: What the rest of the input costs a second, over J* [1/s]: J with the whole input
            grows with the run's length.
        ended: Empty, or why the run ended early.
    """

    run: SwitchingRun
    deviation: float
    max_sliding: float
    rms_sliding: float
    total_variation: float
    crossings: float
    cost_continuous: float
    cost_rate: float
    ended: str = ""


def cases_of(target: str | None = None) -> list[Experiment]:
    """The cases that are studied.

    Args:
        target: One of the chapter's systems, ``SYSTEM/CASE`` or the path of a case file; None for
            the chapter's cases.

    Raises:
        GrosmcError: If there is no such case, or the study has nothing to say of it.
    """
    if target is None or target in CASES:
        return [
            find_experiment(name, case)
            for name in ([target] if target else CASES)
            for case in CASES[name]
        ]
    experiments = find_experiments(target)
    if len(experiments) > 1:
        raise ArgumentError(unknown_name("system of the chapter", target, CASES))
    for experiment in experiments:
        _law_that_switches(experiment)
    return experiments


def _law_that_switches(experiment: Experiment) -> str:
    """Name of the law that is studied: GROSMC or, without one, the first that switches.

    Raises:
        ArgumentError: If there is none, or it has several inputs.
    """
    where, system = experiment.path, experiment.nominal.system
    if len(system.inputs) > 1:
        raise ArgumentError(
            f"{where}: {system.name} has {len(system.inputs)} inputs, the study compares laws of "
            "one: take a case with one input"
        )
    plant, names = experiment.nominal.truest, experiment.controllers
    designs = {name: experiment.law(plant, name).design for name in names}
    laws = [
        name
        for name, controller in designs.items()
        if controller is not None and controller.switching
    ]
    if not laws:
        raise ArgumentError(f'{where}: none of {", ".join(names)} switches: add law = "grosmc"')
    return "grosmc" if "grosmc" in laws else laws[0]


def experiments(cases: Sequence[Experiment]) -> list[SwitchingRun]:
    """All that is to be run."""
    return [
        SwitchingRun(case, law, surface, period)
        for case in cases
        for law in LAWS
        for surface in SURFACES
        for period in PERIODS
    ]


def run_experiment(planned: SwitchingRun, timestep: float = TIMESTEP) -> RunResult:
    """Run a case, in MuJoCo if it has a model, under its law with that sampling."""
    experiment = planned.experiment.with_settings(
        control_period=planned.control_period,
        timestep=timestep,
        switching=planned.law,
        surface=planned.surface,
    )
    return experiment.run(law=_law_that_switches(planned.experiment))


def measure_case(planned: SwitchingRun, timestep: float = TIMESTEP) -> CaseRow:
    """Run a case and keep what accuracy and chattering are."""
    result = run_experiment(planned, timestep)
    trajectory = result.trajectory
    assert trajectory.sliding is not None
    names = (*result.metrics, "cost_continuous_share", "cost_rate")
    values = (metric.value for metric in (*result.metrics.values(), *result.cost_shares))
    numbers = {k: math.nan if v is None else v for k, v in zip(names, values, strict=True)}
    return CaseRow(
        run=planned,
        deviation=numbers["deviation"],
        max_sliding=numbers["max_sliding"],
        rms_sliding=numbers["rms_sliding"],
        total_variation=numbers["total_variation"],
        crossings=crossings(trajectory.sliding) / float(trajectory.time[-1]),
        cost_continuous=numbers["cost_continuous_share"],
        cost_rate=numbers["cost_rate"],
        ended=result.ended,
    )


# Tables, charts and document


def is_shown(period: float) -> bool:
    """Whether the tables show this sample time; figure and file have them all."""
    return math.isclose(period, SHOWN)


def scalar_table(by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark]) -> Table:
    """The scalar benchmark at one sample time, the most chatter first."""
    slopes, rows = orders(by_time), []
    shown = [row for row in by_time if is_shown(row.h)]
    for row in sorted(shown, key=lambda row: -row.total_variation):
        own = (x for x in by_ratio if x.law == row.law and not math.isfinite(x.max_sliding))
        diverges = min((x.gain_ratio for x in own), default=None)
        measured = (row.max_sliding, row.rms_sliding, row.crossings)
        rows.append(
            [
                row.law,
                f"{slopes[row.law]:.2f}",
                *map(number, measured),
                number(row.total_variation / OWN_VARIATION),
                "-" if diverges is None else f"{diverges:.2f}",
            ]
        )
    columns = [
        *words("law"),
        *numbers(
            "order of\nmax|s|", "max|s|", "RMS s", "zeros\nper s", "variation of u\nover w's",
            "diverges\nfrom r",
        ),
    ]  # fmt: skip
    return table("Scalar s' = r u + 0.5 sin 2πt, r the true over the nominal gain", columns, rows)


def cases_table(rows: Sequence[CaseRow]) -> Table:
    """The cases at one sample time; deviation and variation are in the units of the system."""
    cells = [
        [
            f"{row.run.system}/{row.run.case}", row.run.law, row.run.surface,
            *map(number, (row.deviation, row.max_sliding, row.crossings, row.total_variation)),
            f"{row.cost_continuous:.4g}", number(row.cost_rate), row.ended,
        ]
        for row in rows
        if is_shown(row.run.control_period)
    ]  # fmt: skip
    columns = [
        *words("case", "law", "surface"),
        *numbers(
            "max\n|x1-x1*|", "max|s|", "zeros\nper s", "variation\nof u per s",
            "J of u_c\nover J*", "u_d per s\nover J*",
        ),
        *words("ended"),
    ]  # fmt: skip
    return table("Cases in MuJoCo", columns, cells, grouped=True)


def charts(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> list[list[LineChart]]:
    """A row of the scalar benchmark over a row for each case, on the discrete-time surface."""
    h = sorted({row.h for row in by_time})
    ideal = [
        Series(name="order 1: W T", x=h, y=[PUSH * x for x in h]),
        Series(name="order 2: L T²", x=h, y=[SLOPE * x**2 for x in h]),
    ]
    time, names = "sample time T [s]", ("max_sliding", "total_variation")
    accuracy, variation = (_series(by_time, lambda row: row.h, name) for name in names)
    over_gain = _series(by_ratio, lambda row: row.gain_ratio, "max_sliding")
    rows = [
        [
            LineChart(name="Scalar s' = u + 0.5 sin 2πt", titles=(time, "max |s|"),
                      lines=[*accuracy, *ideal]),
            LineChart(name="Scalar: variation of u, dashed of w itself",
                      titles=(time, "variation of u [1/s]"), lines=variation, limit=OWN_VARIATION),
            LineChart(name="Scalar with input r u; dashed: r ρ = W, 4/3, 2",
                      titles=("true over nominal gain r", "max |s|"), lines=over_gain,
                      marks=(PUSH / GAIN, 4 / 3, 2.0)),
        ]
    ]  # fmt: skip
    drawn = [row for row in cases if row.run.surface == "discrete"]
    for system, case in dict.fromkeys((row.run.system, row.run.case) for row in drawn):
        own = [row for row in drawn if (row.run.system, row.run.case) == (system, case)]
        plant = own[0].run.experiment.nominal.system
        output, u = plant.positions[plant.output].unit, plant.input.unit
        rows.append(
            [
                LineChart(
                    name=f"{system}/{case}: {title}",
                    titles=("control period [s]", unit),
                    lines=_series(own, lambda row: row.run.control_period, name),
                )
                for name, title, unit in (
                    ("deviation", "max |x₁ - x₁*|", f"deviation [{output}]"),
                    ("total_variation", "variation of u", f"variation of u [{u}/s]"),
                    ("cost_rate", "cost of u_d", "per second, over J* [1/s]"),
                )
            ]
        )
    return rows


def _series(rows: Sequence[Any], x: Callable[[Any], float], name: str) -> list[Series]:
    """A curve for each law; what diverged or ended early has no point."""
    curves = []
    for law in LAWS:
        own = [row for row in rows if (row.run.law if isinstance(row, CaseRow) else row.law) == law]
        values = [math.nan if getattr(row, "ended", "") else getattr(row, name) for row in own]
        y = [*map(finite, values)]
        curves.append(Series(name=law, x=[x(row) for row in own], y=y))
    return curves


def write_switching_figure(
    by_time: Sequence[Benchmark],
    by_ratio: Sequence[Benchmark],
    cases: Sequence[CaseRow],
    path: Path,
) -> Path:
    """Draw the charts; if the cases are of several systems, two of them stand for all.

    Raises:
        SetupError: If a file cannot be written.
    """
    several = len({row.run.system for row in cases}) > 1
    drawn = [x for x in cases if not several or (x.run.system, x.run.case) in _CHOSEN]
    title = "Accuracy and chattering against sample time"
    return write_panels(path, title, charts(by_time, by_ratio, drawn))


def switching_document(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> dict[str, Any]:
    """The content of switching.json; what diverged has null for its numbers."""
    slopes = orders(by_time)
    first, *rest = charts(by_time, by_ratio, cases)
    bounded = [row for row in by_time if math.isfinite(row.max_sliding)]
    words = "every law diverges"
    if best := min(bounded, key=lambda row: (row.h, row.max_sliding), default=None):
        size = f"max |s| = {number(best.max_sliding)} at {number(best.h * 1e3)} ms"
        words = f"the most accurate is {best.law}: {size}"
    return result(
        "switching",
        {
            "timestep": {"value": TIMESTEP, "unit": "s"},
            "slopes": {row.run.system: row.run.experiment.slope for row in cases},
        },
        answers=[
            Answer(
                question="Switching laws", verdict=MEASURED, words=words,
                more=f"orders: {', '.join(f'{law} {number(p)}' for law, p in slopes.items())}",
            )
        ],
        sheets=[
            Sheet(table=scalar_table(by_time, by_ratio), charts=first),
            Sheet(table=cases_table(cases), charts=[chart for row in rest for chart in row]),
        ],
        values=_values(by_time, by_ratio, cases),
        benchmark={
            "equation": "s' = r phi + 0.5 sin(2 pi t), rho = 1, phi held",
            "own_total_variation": {"value": OWN_VARIATION, "unit": "1/s"},
            "orders": slopes,
            "sample_times": [row._asdict() for row in by_time],
            "gain_ratios": [row._asdict() for row in by_ratio],
        },
        cases=[
            {name: getattr(row.run, name) for name in _OF_RUN}
            | {key: value for key, value in row._asdict().items() if key != "run"}
            for row in cases
        ],
    )  # fmt: skip


def _values(
    by_time: Sequence[Benchmark], by_ratio: Sequence[Benchmark], cases: Sequence[CaseRow]
) -> Iterator[Value]:
    named = [(f"scalar benchmark, {x.law} at h = {x.h:g}: max |s|", x.max_sliding) for x in by_time]
    named += [
        (f"scalar benchmark, {x.law} at r = {x.gain_ratio:g}: max |s|", x.max_sliding)
        for x in by_ratio
    ]
    for row in cases:
        run = row.run
        name = f"{run.system}/{run.case} {run.law}, {run.surface}, at {run.control_period:g} s"
        named.append((f"{name}: deviation", row.deviation))
    for name, value in named:
        yield Value(name=name, value=finite(value), better=-1, relative=0.1)
