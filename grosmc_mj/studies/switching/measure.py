"""Accuracy and chattering against sample time: every switching law on a scalar and on the cases.

The scalar s' = r phi + w is sampled by the very functions that the laws call; the cases run in
MuJoCo. Both say how far s and the run stray, and how much the input has to move for that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from grosmc_mj.control.switching import (
    SWITCHINGS,
    SuperTwisting,
    Switching,
    find_switching,
)
from grosmc_mj.errors import ArgumentError, unknown_name
from grosmc_mj.experiments.catalogue import find_experiment, find_experiments
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics import crossings, root_mean_square, variation_rate
from grosmc_mj.experiments.runs import RunResult, Surface

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


def law_for(name: str) -> Switching:
    """The switching law of that name with numbers for the scalar's push.

    Raises:
        GainError: If there is no such law.
    """
    law = find_switching(name)
    return replace(law, slope=SLOPE) if isinstance(law, SuperTwisting) else law


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
        law.reach(np.array([s]), 0.0, GAIN, memory, law, memory.phi)
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
        law: order([row.h for row in found], [row.max_sliding for row in found])
        for law, found in chosen.items()
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
    found = find_experiments(target)
    if len(found) > 1:
        raise ArgumentError(unknown_name("system of the chapter", target, CASES))
    for experiment in found:
        _law_that_switches(experiment)
    return found


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
    found = [name for name, made in designs.items() if made is not None and made.switching]
    if not found:
        raise ArgumentError(f'{where}: none of {", ".join(names)} switches: add law = "grosmc"')
    return "grosmc" if "grosmc" in found else found[0]


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
    found = {k: math.nan if v is None else v for k, v in zip(names, values, strict=True)}
    return CaseRow(
        run=planned,
        deviation=found["deviation"],
        max_sliding=found["max_sliding"],
        rms_sliding=found["rms_sliding"],
        total_variation=found["total_variation"],
        crossings=crossings(trajectory.sliding) / float(trajectory.time[-1]),
        cost_continuous=found["cost_continuous_share"],
        cost_rate=found["cost_rate"],
        ended=result.ended,
    )
