"""Measurements, premises and drawings that several claims share.

Here and in the systems' modules every public function that takes a laboratory is one that a claim's
file names; it is told the claim's system if it asks for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import Premise, audit, per_second
from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured, NeedsSlidingModeError
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics.recorded import Comparison
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.plants import find_system
from grosmc_mj.results.palette import LABELS
from grosmc_mj.simulation.trajectory import Status, Trajectory

# Samples of a run that are looked at: odd, so that both sides of the chatter are met.
_EVERY = 7


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


def deviation(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str
) -> Measured:
    """max |x1 - x1*| in percent of the initial error."""
    result = lab.case(system, case, plant, controller)
    return of(result, from_optimum(result.comparison))


def from_optimum(comparison: Comparison) -> float:
    """max |y - y*| in percent of the initial error."""
    return 100 * float(np.abs(comparison.deviation).max() / abs(comparison.error[0]))


def extrapolated(lab: Laboratory, plant: PlantName, *, system: str, case: str) -> Measured:
    """The deviation extrapolated to a sampling time of zero, in percent of the start."""
    values = []
    for level in (lab, lab.refined):
        result = level.case(system, case, plant, "grosmc")
        judged = of(result, from_optimum(result.comparison))
        if judged.broken or judged.value is None:
            return judged
        values.append(judged.value)
    note = (
        f"{values[0]:.3g} % at T, {values[1]:.3g} % at T/2, a ratio of {values[0] / values[1]:.3g}"
    )
    return Measured(abs(2 * values[1] - values[0]), note)


def changed_response(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str
) -> Measured:
    """Largest difference between a case's response and the nominal one, in percent of the start."""
    results = [lab.case(system, name, plant, controller) for name in (case, "nominal")]
    z = [result.comparison.error for result in results]
    n = min(map(len, z))
    change = 100 * float(np.abs(z[0][:n] - z[1][:n]).max() / abs(z[1][0]))
    broken = next((r for r in results if r.status is not Status.COMPLETED), None)
    return of(broken or results[0], change)


def beside_lqr(lab: Laboratory, plant: PlantName, *, system: str, cases: Sequence[str]) -> Measured:
    """max |y - y*| under GROSMC over that under the LQR, the worst of some cases."""
    ratios, said = [], []
    for case in cases:
        results = [lab.case(system, case, plant, name) for name in ("grosmc", "lqr")]
        judged = [of(each, from_optimum(each.comparison)) for each in results]
        if broken := [each for each in judged if each.broken]:
            return broken[0]
        ours, theirs = (each.value or 0.0 for each in judged)
        ratios.append(ours / theirs)
        said.append(f"{case} {ours:.3g} % against {theirs:.3g} %")
    return Measured(max(ratios), ", ".join(said))


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
    J, least = result.metrics[name].value, result.metrics["cost_optimal"].value
    assert J is not None
    assert least is not None
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
    true = lab.equations(result.experiment, plant)
    points = balances_along(law, true, run, _EVERY, pushed=False)
    own_effect = np.diagonal(points.R, axis1=1, axis2=2)
    bands = 2 * lab.settings.control_period * points.configured[:, None] * own_effect
    if not np.all(points.configured):
        return of(result, None, "the law does not switch")
    if not np.all(bands > 0):
        return of(result, None, "the law switches the wrong way")
    away = (np.abs(s[::_EVERY]).reshape(bands.shape) / bands).max(axis=1)
    worst = int(away.argmax())
    note = f"at t = {points.t[worst]:.3g} s; max |s| = {np.abs(s).max():.3g}"
    return of(result, float(away[worst]), note)


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


def outputs(
    lab: Laboratory, *, system: str, case: str, controllers: Sequence[str] = ("lqr", "grosmc")
) -> Drawing:
    """The controlled coordinate on physics, and the optimum of the last law."""
    output = find_system(system).output
    signal = find_system(system).positions[output]
    curves = []
    for name in controllers:
        run = lab.case(system, case, "physics", name).trajectory
        curves.append(Curve(LABELS[name], run.time, run.state[:, output], name))
    last = lab.case(system, case, "physics", controllers[-1]).comparison
    curves.append(Curve("nominal optimum", last.time, last.optimum[:, 0]))
    return Drawing("time t [s]", f"{signal.name} {signal.symbol} [{signal.unit}]", curves)


def signals(lab: Laboratory, *, system: str, case: str, name: str) -> Drawing:
    """s or the input under GROSMC on physics."""
    result = lab.case(system, case, "physics", "grosmc")
    run = result.trajectory
    values: Any = run.sliding if name == "s" else run.input
    unit = result.controller.designed.sliding_unit if name == "s" else run.system.input.unit
    label = f"s [{unit}]" if name == "s" else f"{run.system.input.symbol} [{unit}]"
    return Drawing("time t [s]", label, [Curve("GROSMC", run.time[:-1], values, "grosmc")])


def gains(lab: Laboratory, *, system: str, case: str) -> Drawing:
    """Required and configured ρ along the run."""
    rates = audit(lab, find_experiment(system, case)).signals
    unit = lab.case(system, case, "physics", "grosmc").controller.designed.sliding_unit
    return Drawing(
        "time t [s]",
        f"switching rate ρ [{per_second(unit)}]",
        [
            Curve("required", rates["time"], rates["required"]),
            Curve("configured", rates["time"], rates["configured"], "grosmc"),
        ],
    )


def within(time: Array, start: float, stop: float = np.inf) -> NDArray[np.bool_]:
    """Rows of the instants from ``start`` to ``stop``."""
    return (time >= start - 1e-9) & (time < stop - 1e-9)
