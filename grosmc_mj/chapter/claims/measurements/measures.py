"""Measurements and premises that claims about several systems share.

Here and in the modules beside it every public function that takes a laboratory is one that a
claim's file names; it gets the claim's system if it has such an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import Premise, audit
from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Measured, NeedsSlidingModeError, NoValueError
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import Comparison, compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.simulation.trajectory import Status, Trajectory

# Samples of a run that are looked at: odd, so that both sides of the chatter are met.
EVERY = 7
Size = Literal["start", "amplitude"]


def of(result: RunResult, value: float | None, note: str = "") -> Measured:
    """A value from one run; broken if the run ended early or left the laws' region."""
    if result.status is not Status.COMPLETED:
        return Measured(value, result.ended, broken=True)
    system = result.trajectory.system
    if not all(system.linearizable(x) for x in result.trajectory.state[::20]):
        return Measured(value, f"the run leaves {system.region}", broken=True)
    return Measured(value, note)


def sliding(run: Trajectory) -> Array:
    """s at the samples of a run, (samples,) or (samples, m).

    Raises:
        NeedsSlidingModeError: If its law has none.
    """
    if run.sliding is None:
        raise NeedsSlidingModeError("it asks for the law's sliding variable")
    return run.sliding


def surface_memory(law: Controller) -> SurfaceMemory:
    """A new memory of the law's surface.

    Raises:
        NeedsSlidingModeError: If it has none.
    """
    memory = law.memory()
    if not isinstance(memory, SurfaceMemory):
        raise NeedsSlidingModeError("it asks for the law's sliding variable")
    return memory


def within(time: Array, start: float, stop: float = np.inf) -> NDArray[np.bool_]:
    """Rows of the instants from ``start`` to ``stop``.

    Raises:
        NoValueError: If there are none.
    """
    rows = (time >= start - 1e-9) & (time < stop - 1e-9)
    if not rows.any():
        raise NoValueError(f"the run ended before {start:g} s")
    return rows


def size_of(comparison: Comparison, percent_of: Size) -> float:
    """|error(0)|, or the amplitude of the reference."""
    if percent_of == "amplitude":
        return float(np.abs(comparison.reference).max())
    return abs(float(comparison.error[0]))


def from_optimum(comparison: Comparison, percent_of: Size = "start") -> float:
    """max |y - y*| in percent of the initial error, or of the reference's amplitude."""
    return 100 * float(np.abs(comparison.deviation).max() / size_of(comparison, percent_of))


def deviation(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
    percent_of: Size = "start",
    bandwidth: float | None = None,
) -> Measured:
    """max |y - y*| in percent; of a bandwidth [rad/s], on the bench with such observers."""
    experiment = find_experiment(system, case)
    if bandwidth is not None:
        experiment = _on_bench(experiment, bandwidth)
    result = lab.run(experiment, plant, controller)
    return of(result, from_optimum(result.comparison, percent_of))


def _on_bench(experiment: Experiment, bandwidth: float) -> Experiment:
    """A case in the loop of its system's bench, with observers as fast as that [rad/s]."""
    case, bench = experiment.case, find_experiment(experiment.case.system, "bench")
    loop = bench.case.loop
    assert loop is not None
    faster = tuple(replace(estimator, bandwidth=bandwidth) for estimator in loop.estimators)
    return bench.varied(
        name=f"bench, {case.name}",
        title=f"{case.title}, on the bench",
        x0=case.x0,
        duration=case.duration,
        edits=case.edits,
        disturbances=case.disturbances,
        loop=replace(loop, estimators=faster),
    )


def worst_deviation(
    lab: Laboratory, plant: PlantName, cases: Sequence[Experiment], note: str = ""
) -> Measured:
    """The largest of max |y - y*| over experiments under GROSMC, in percent of each start."""
    law, runs = lab.batch(cases, plant, "grosmc")
    worst, where = -np.inf, ""
    for index, case in enumerate(cases):
        run = runs[index]
        if run.status is not Status.COMPLETED:
            raise NoValueError(f"{case.case.title}: the run ended early")
        if (away := from_optimum(compare_with_optimum(run, law))) >= worst:
            worst, where = away, case.case.title
    return Measured(worst, note or f"worst at {where}")


def late_error(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
    since: float,
    percent_of: Size = "start",
) -> Measured:
    """Largest error from an instant [s] on, in percent."""
    result = lab.case(system, case, plant, controller)
    error = np.abs(result.comparison.error[within(result.comparison.time, since)])
    return of(result, 100 * float(error.max()) / size_of(result.comparison, percent_of))


def difference(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    runs: Sequence[tuple[str, str]],
    until: float = np.inf,
) -> Measured:
    """Largest difference of the errors of two runs, a case and a law each, in percent."""
    results = [lab.case(system, case, plant, controller) for case, controller in runs]
    broken = next(
        (result for result in results if result.status is not Status.COMPLETED), results[0]
    )
    return of(broken, difference_of(results, until))


def difference_of(results: Sequence[RunResult], until: float = np.inf) -> float:
    """Largest difference of two runs' errors up to an instant [s], in percent of the second's."""
    one, other = (result.comparison for result in results)
    n = min(len(one.time), len(other.time))
    rows = within(one.time[:n], 0.0, until)
    away = np.abs(one.error[:n] - other.error[:n])[rows]
    return 100 * float(away.max()) / abs(float(other.error[0]))


def beside_lqr(lab: Laboratory, plant: PlantName, *, system: str, case: str) -> Measured:
    """max |y - y*| under GROSMC over that under the LQR."""
    ours, theirs = (
        deviation(lab, plant, system=system, case=case, controller=name)
        for name in ("grosmc", "lqr")
    )
    if ours.broken or theirs.broken:
        return ours if ours.broken else theirs
    one, other = (metric.value or np.nan for metric in (ours, theirs))
    return Measured(one / other, f"{one:.3g} % against {other:.3g} %")


def excess_cost(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    case: str,
    name: str,
    controller: str = "grosmc",
) -> Measured:
    """J over J*, less 1, in percent."""
    result = lab.case(system, case, plant, controller)
    J, least = (result.metrics[key].value or np.nan for key in (name, "cost_optimal"))
    return of(result, 100 * (J / least - 1), f"over {result.trajectory.time[-1]:g} s")


def leaving_the_surface(lab: Laboratory, plant: PlantName, *, system: str, case: str) -> Measured:
    """Largest |s_i| over what one sample of the switching term makes of it, at that instant.

    While the gain covers what pushes, |s_i'| is at most twice what the switching term does through
    the true input gain, 2 rho R_ii: what is pushed plus what pushes back. A sampled law that never
    leaves the surface by more than one sample stays below 1.
    """
    result = lab.case(system, case, plant, "grosmc")
    run, law = result.trajectory, result.controller
    s = sliding(run)
    if not len(s) or np.any(s[0]):
        return of(result, None, "the run starts off its surface")
    points = balances_along(law, lab.equations(result.experiment, plant), run, EVERY, pushed=False)
    own_effect = np.diagonal(points.R, axis1=1, axis2=2)
    bands = 2 * lab.settings.control_period * points.configured[:, None] * own_effect
    if not np.all(points.configured):
        return of(result, None, "the law does not switch")
    if not np.all(bands > 0):
        return of(result, None, "the law switches the wrong way")
    away = (np.abs(s[::EVERY]).reshape(bands.shape) / bands).max(axis=1)
    worst = int(away.argmax())
    note = f"at t = {points.t[worst]:.3g} s; max |s| = {np.abs(s).max():.3g}"
    return of(result, float(away[worst]), note)


def equation_error(
    lab: Laboratory,
    plant: PlantName,
    system: str,
    bounds: Sequence[float],
    balance: Callable[[float, float, float], tuple[float, Sequence[float]]],
) -> Measured:
    """Largest residual of M q'' = sum of terms over the largest term, in percent.

    Args:
        lab: Where it is measured.
        plant: It gives q'', its last acceleration.
        system: Of which plant.
        bounds: Of the random q, q' and u, to both sides.
        balance: (q, q', u) -> M and the terms.
    """
    derivative = lab.plant(find_experiment(system, "nominal"), plant).derivative
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(300):
        q, rate, u = (random.uniform(-bound, bound) for bound in bounds)
        x = np.array([q, rate] if system == "arm" else [0.0, q, 0.0, rate])
        mass, terms = balance(q, rate, u)
        residual = mass * derivative(x, u)[-1] - sum(terms)
        worst = max(worst, abs(residual) / np.abs(terms).max())
    return Measured(100 * float(worst), "300 random states and inputs")


def failed_premise(lab: Laboratory, *, system: str, case: str) -> str:
    """The premises of the case that fail, in words; empty if none does."""
    failed = audit(lab, find_experiment(system, case)).failed()
    return "; ".join(
        f"{premise.name} ({premise.source}): {premise.requirement}; margin {_margins(premise)}"
        + (f", restored by {premise.restores}" if premise.restores else "")
        for premise in failed
    )


def _margins(premise: Premise) -> str:
    """The margins over the region and along the run."""
    readings = (("over the region", premise.region), ("along the run", premise.along))
    margins = [f"{r.margin:.3g} {premise.unit} {where}" for where, r in readings if r is not None]
    return " and ".join(margins)
