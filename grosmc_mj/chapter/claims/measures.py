"""Measurements that several claims share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.experiments.experiment import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import Comparison
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.plants import find_system
from grosmc_mj.premises.audit import Premise, audit, per_second
from grosmc_mj.premises.balance import balance
from grosmc_mj.report.palette import LABELS
from grosmc_mj.simulation.trajectory import Status

Measure = Callable[[Laboratory, PlantName], Measured]
BOTH: tuple[PlantName, ...] = ("corrected", "physics")
ALL: tuple[PlantName, ...] = ("printed", "corrected", "physics")

# What counts as "the same" or "almost not affected": the band that settling is judged by.
SAME = 2.0
SAME_WHY = "2 % of the start is the usual settling band: less does not show in the chapter's plots"
# What counts as "deviates" or "sensitive": five such bands.
SENSITIVE = 10.0
# Samples of a run that are looked at: odd, so that both sides of the chatter are met.
_EVERY = 7
SENSITIVE_WHY = "10 % of the start, five times what counts as the same, shows in any plot"


def of(result: RunResult, value: float | None, note: str = "") -> Measured:
    """A value from one run; broken if the run ended early or left the laws' region."""
    if result.status is not Status.COMPLETED:
        return Measured(value, result.ended, broken=True)
    system = result.trajectory.system
    if not all(system.linearizable(x) for x in result.trajectory.state[::20]):
        return Measured(value, f"the run leaves {system.region}", broken=True)
    return Measured(value, note)


def deviation(system: str, case: str, controller: str) -> Measure:
    """max |x1 - x1*| in percent of the initial error."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(system, case, plant, controller)
        return of(result, from_optimum(result.comparison))

    return measure


def from_optimum(found: Comparison) -> float:
    """max |y - y*| in percent of the initial error."""
    return 100 * float(np.abs(found.deviation).max() / abs(found.error[0]))


def extrapolated(system: str, case: str) -> Measure:
    """The deviation extrapolated to a sampling time of zero, in percent of the start."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        found = []
        for each in (lab, lab.refined):
            result = each.case(system, case, plant, "grosmc")
            judged = of(result, from_optimum(result.comparison))
            if judged.broken or judged.value is None:
                return judged
            found.append(judged.value)
        note = (
            f"{found[0]:.3g} % at T, {found[1]:.3g} % at T/2, a ratio of {found[0] / found[1]:.3g}"
        )
        return Measured(abs(2 * found[1] - found[0]), note)

    return measure


def changed_response(system: str, case: str, controller: str) -> Measure:
    """Largest difference between a case's response and the nominal one, in percent of the start."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        results = [lab.case(system, name, plant, controller) for name in (case, "nominal")]
        z = [result.comparison.error for result in results]
        n = min(map(len, z))
        change = 100 * float(np.abs(z[0][:n] - z[1][:n]).max() / abs(z[1][0]))
        broken = next((r for r in results if r.status is not Status.COMPLETED), None)
        return of(broken or results[0], change)

    return measure


def excess_cost(system: str, case: str, name: str) -> Measure:
    """J over J*, less 1, in percent, under GROSMC."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(system, case, plant, "grosmc")
        J, least = result.metrics[name].value, result.metrics["cost_optimal"].value
        assert J is not None
        assert least is not None
        return of(result, 100 * (J / least - 1))

    return measure


def leaving_the_surface(system: str, case: str) -> Measure:
    """Largest |s_i| over what one sample of the switching term makes of it, at that instant.

    While the gain covers what pushes, |s_i'| is at most twice what the switching term does through
    the true input gain, 2 rho R_ii: what is pushed plus what pushes back. A sampled law that never
    leaves the surface by more than one sample stays below 1.
    """

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(system, case, plant, "grosmc")
        run, law = result.trajectory, result.controller
        assert run.sliding is not None
        true = lab.equations(result.experiment, plant)
        nothing = np.zeros(6 * len(run.system.bodies))
        worst, note = 0.0, ""
        for row in range(0, len(run.time) - 1, _EVERY):
            t, x = float(run.time[row]), run.state[row]
            found = balance(law, true, t, x, nothing)
            band = 2 * lab.settings.control_period * found.configured * np.diag(found.R)
            if found.configured == 0:
                return of(result, None, "the law does not switch")
            if not np.all(band > 0):
                return of(result, None, "the law switches the wrong way")
            away = float((np.abs(run.sliding[row]) / band).max())
            if away > worst:
                worst = away
                note = f"at t = {t:.3g} s; max |s| = {np.abs(run.sliding).max():.3g}"
        return of(result, worst, note)

    return measure


def failed_premise(system: str, case: str) -> Callable[[Laboratory], str]:
    """The premises of the case that fail, in words; empty if none does."""

    def say(lab: Laboratory) -> str:
        failed = audit(lab, find_experiment(system, case)).failed()
        return "; ".join(
            f"{premise.name} ({premise.source}): {premise.requirement}; margin {_margins(premise)}"
            + (f", restored by {premise.restores}" if premise.restores else "")
            for premise in failed
        )

    return say


def _margins(premise: Premise) -> str:
    """The margins over the region and along the run."""
    readings = (("over the region", premise.region), ("along the run", premise.along))
    found = [f"{r.margin:.3g} {premise.unit} {where}" for where, r in readings if r is not None]
    return " and ".join(found)


def outputs(
    system: str, case: str, controllers: tuple[str, ...] = ("lqr", "grosmc")
) -> Callable[[Laboratory], Drawing]:
    """The controlled coordinate on physics, and the optimum of the last law."""

    def draw(lab: Laboratory) -> Drawing:
        output = find_system(system).output
        signal = find_system(system).positions[output]
        curves = []
        for name in controllers:
            run = lab.case(system, case, "physics", name).trajectory
            curves.append(Curve(LABELS[name], run.time, run.state[:, output], name))
        last = lab.case(system, case, "physics", controllers[-1]).comparison
        curves.append(Curve("nominal optimum", last.time, last.optimum[:, 0]))
        return Drawing("time t [s]", f"{signal.name} {signal.symbol} [{signal.unit}]", curves)

    return draw


def signals(system: str, case: str, name: str) -> Callable[[Laboratory], Drawing]:
    """s or the input under GROSMC on physics."""

    def draw(lab: Laboratory) -> Drawing:
        result = lab.case(system, case, "physics", "grosmc")
        run = result.trajectory
        values: Any = run.sliding if name == "s" else run.input
        unit = result.controller.sliding_unit if name == "s" else run.system.input.unit
        label = f"s [{unit}]" if name == "s" else f"{run.system.input.symbol} [{unit}]"
        return Drawing("time t [s]", label, [Curve("GROSMC", run.time[:-1], values, "grosmc")])

    return draw


def gains(system: str, case: str) -> Callable[[Laboratory], Drawing]:
    """Required and configured ρ along the run."""

    def draw(lab: Laboratory) -> Drawing:
        found = audit(lab, find_experiment(system, case)).signals
        unit = lab.case(system, case, "physics", "grosmc").controller.sliding_unit
        return Drawing(
            "time t [s]",
            f"switching rate ρ [{per_second(unit)}]",
            [
                Curve("required", found["time"], found["required"]),
                Curve("configured", found["time"], found["configured"], "grosmc"),
            ],
        )

    return draw


def within(time: Array, start: float, stop: float = np.inf) -> NDArray[np.bool_]:
    """Rows of the instants from ``start`` to ``stop``."""
    return (time >= start - 1e-9) & (time < stop - 1e-9)
