"""Measurements and premises that claims about several systems share.

In this folder every public function that takes a run cache is one that a claim's file names. It
gets the claim's system if it has an argument ``system``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.chapter.claims.claim import ClaimValue, NeedsSlidingModeError, NoValueError
from grosmc_mj.experiments.assumptions.audit import Premise, audit
from grosmc_mj.experiments.assumptions.balance import balances_along
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.measurement import Windows
from grosmc_mj.experiments.requirements.metrics import largest_of
from grosmc_mj.experiments.requirements.optimum import Comparison
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.simulation.trajectory import Status, Trajectory

# Every so many samples of a run are evaluated: odd, to meet both sides of the chatter.
EVERY = 7
Size = Literal["start", "amplitude"]
# (q, q', u) -> M and the terms of M q'' = sum of terms.
ForceBalance = Callable[[float, float, float], tuple[float, Sequence[float]]]


def from_run(result: RunResult, value: float | None, note: str = "") -> ClaimValue:
    """Return a value from one run; broken if the run ended early or left the laws' region."""
    if result.status is not Status.COMPLETED:
        return ClaimValue(value, result.ended, broken=True)

    system = result.trajectory.system
    if not all(system.linearizable(x) for x in result.trajectory.state[::20]):
        return ClaimValue(value, f"the run leaves {system.region}", broken=True)
    return ClaimValue(value, note)


def sliding(run: Trajectory) -> Array:
    """Return s at the samples of a run, (samples,) or (samples, m).

    Raises:
        NeedsSlidingModeError: If its law has none.
    """
    if run.sliding is None:
        raise NeedsSlidingModeError("it asks for the law's sliding variable")
    return run.sliding


def within(time: Array, start: float, stop: float = np.inf) -> NDArray[np.bool_]:
    """Return the rows of the instants from ``start`` to ``stop`` [s].

    Raises:
        NoValueError: If there are none.
    """
    rows = (time >= start - 1e-9) & (time < stop - 1e-9)
    if not rows.any():
        raise NoValueError(f"the run ended before {start:g} s")
    return rows


def size_of(comparison: Comparison, percent_of: Size) -> float:
    """Return |error(0)|, or the amplitude of the reference."""
    if percent_of == "amplitude":
        return float(np.abs(comparison.reference).max())
    return abs(float(comparison.error[0]))


def from_optimum(result: RunResult, percent_of: Size = "start") -> float:
    """Return max |y - y*| in percent of the initial error, or of the reference's amplitude."""
    largest = result.values().get("deviation", 0.0)
    return 100 * largest / size_of(result.comparison, percent_of)


def deviation(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
    percent_of: Size = "start",
    bandwidth: float | None = None,
) -> ClaimValue:
    """Measure max |y - y*| in percent.

    With a bandwidth [rad/s], the case runs on the bench, whose observers have that bandwidth.
    """
    experiment = find_experiment(system, case)
    if bandwidth is not None:
        experiment = _on_bench(experiment, bandwidth)
    result = lab.run(experiment, plant, controller)
    return from_run(result, from_optimum(result, percent_of))


def _on_bench(experiment: Experiment, bandwidth: float) -> Experiment:
    """A case in the loop of its system's bench, with observers of that bandwidth [rad/s]."""
    case = experiment
    bench = find_experiment(case.system, "bench")
    loop = bench.loop
    assert loop is not None

    estimators = tuple(replace(estimator, bandwidth=bandwidth) for estimator in loop.estimators)
    return bench.changed(
        name=f"bench, {case.name}",
        title=f"{case.title}, on the bench",
        x0=case.x0,
        duration=case.duration,
        edits=case.edits,
        disturbances=case.disturbances,
        loop=replace(loop, estimators=estimators),
    )


def worst_deviation(
    lab: RunCache, plant: PlantName, cases: Sequence[Experiment], note: str = ""
) -> ClaimValue:
    """Measure the largest max |y - y*| over experiments under GROSMC, in percent of each start.

    Returns:
        The measurement of the first run that is broken, if one is.
    """
    worst = ClaimValue(-np.inf)
    for case in cases:
        result = lab.run(case, plant, "grosmc")
        where = note or f"worst at {case.title}"
        measured = from_run(result, from_optimum(result), where)
        if measured.broken:
            return measured._replace(value=None, note=f"{case.title}: {measured.note}")
        worst = max(worst, measured)
    return worst


def late_error(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
    since: float,
) -> ClaimValue:
    """Measure the largest error from the instant ``since`` [s] on, in percent of the start."""
    result = lab.case(system, case, plant, controller)
    within(result.trajectory.time, since)
    largest = result.values(Windows(after=(since,)))[largest_of("", since)]
    return from_run(result, 100 * largest / size_of(result.comparison, "start"))


def difference(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    runs: Sequence[tuple[str, str]],
    until: float = np.inf,
) -> ClaimValue:
    """Measure the largest difference of the errors of two runs in percent.

    Args:
        lab: Cache of the runs.
        plant: Plant of both runs.
        system: System of both runs.
        runs: Case and law of each run.
        until: Instant up to which errors are compared [s].
    """
    results = [lab.case(system, case, plant, controller) for case, controller in runs]
    first, second = (result.comparison for result in results)
    count = min(len(first.time), len(second.time))
    rows = within(first.time[:count], 0.0, until)
    distance = np.abs(first.error[:count] - second.error[:count])[rows]
    value = 100 * float(distance.max()) / size_of(second, "start")

    measured = [from_run(result, value) for result in results]
    return max(measured, key=lambda one: one.broken)


def beside_lqr(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
) -> ClaimValue:
    """Measure max |y - y*| under GROSMC over that under the LQR."""
    robust = deviation(lab, plant, system=system, case=case, controller="grosmc")
    linear = deviation(lab, plant, system=system, case=case, controller="lqr")
    if robust.broken:
        return robust
    if linear.broken:
        return linear

    ours = robust.value or np.nan
    theirs = linear.value or np.nan
    return ClaimValue(ours / theirs, f"{ours:.3g} % against {theirs:.3g} %")


def excess_cost(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    name: str,
    controller: str = "grosmc",
) -> ClaimValue:
    """Measure J over J*, less 1, in percent; J is the metric of that name."""
    result = lab.case(system, case, plant, controller)
    J = result.metrics[name].value or np.nan
    least = result.metrics["cost_optimal"].value or np.nan
    return from_run(result, 100 * (J / least - 1), f"over {result.trajectory.time[-1]:g} s")


def leaving_the_surface(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
) -> ClaimValue:
    """Measure the largest |s_i| over the change that one sample of the switching term makes.

    While the gain covers the disturbance, |s_i'| is at most twice the effect of the switching term
    through the true input gain, 2 rho R_ii: the disturbance and the answer to it. A sampled law
    that never leaves the surface by more than one sample stays below 1.
    """
    result = lab.case(system, case, plant, "grosmc")
    run = result.trajectory
    law = result.controller
    s = sliding(run)
    if not len(s) or np.any(s[0]):
        return from_run(result, None, "the run starts off its surface")

    true = lab.equations(result.case, plant)
    points = balances_along(law, true, run, EVERY, pushed=False)
    gains = np.diagonal(points.R, axis1=1, axis2=2)
    bands = 2 * lab.settings.control_period * points.configured[:, None] * gains
    if not np.all(points.configured):
        return from_run(result, None, "the law does not switch")
    if not np.all(bands > 0):
        return from_run(result, None, "the law switches the wrong way")

    samples = np.abs(s[::EVERY]).reshape(bands.shape)
    distances = (samples / bands).max(axis=1)
    worst = int(distances.argmax())
    note = f"at t = {points.t[worst]:.3g} s; max |s| = {np.abs(s).max():.3g}"
    return from_run(result, float(distances[worst]), note)


def equation_error(
    lab: RunCache,
    plant: PlantName,
    system: str,
    bounds: Sequence[float],
    balance: ForceBalance,
) -> ClaimValue:
    """Measure the largest residual of M q'' = sum of terms over the largest term, in percent.

    Args:
        lab: Cache of the runs.
        plant: Plant that gives q'', its last acceleration.
        system: System of the plant.
        bounds: Bounds of the random q, q' and u, to both sides.
        balance: M and the terms.
    """
    derivative = lab.plant(find_experiment(system, "nominal"), plant).derivative
    random = np.random.default_rng(0)
    worst = 0.0
    for _ in range(300):
        q, rate, u = (random.uniform(-bound, bound) for bound in bounds)
        x = np.array([q, rate])
        if system == "cart_pendulum":
            x = np.array([0.0, q, 0.0, rate])

        mass, terms = balance(q, rate, u)
        residual = mass * derivative(x, u)[-1] - sum(terms)
        worst = max(worst, abs(residual) / np.abs(terms).max())
    return ClaimValue(100 * float(worst), "300 random states and inputs")


def failed_premise(lab: RunCache, *, system: str, case: str) -> str:
    """Return the premises of the case that fail, in words; empty if none does."""
    lines = []
    for premise in audit(lab, find_experiment(system, case)).failed():
        line = (
            f"{premise.name} ({premise.source}): {premise.requirement}; margin {_margins(premise)}"
        )
        if premise.restores:
            line += f", restored by {premise.restores}"
        lines.append(line)
    return "; ".join(lines)


def _margins(premise: Premise) -> str:
    """The margins over the region and along the run."""
    margins = []
    if premise.region is not None:
        margins.append(f"{premise.region.margin:.3g}{unit_after(premise.unit)} over the region")
    if premise.along is not None:
        margins.append(f"{premise.along.margin:.3g}{unit_after(premise.unit)} along the run")
    return " and ".join(margins)
