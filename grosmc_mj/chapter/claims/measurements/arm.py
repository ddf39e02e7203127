"""The chapter's claims about the 1-DOF arm, section 4.3."""

from __future__ import annotations

import itertools
import math

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import audit
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measurements.measures import (
    deviation,
    excess_cost,
    from_optimum,
    leaving_the_surface,
    of,
    sliding,
)
from grosmc_mj.chapter.claims.words import WORDS
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status

_SYSTEM = "arm"
# The chapter prints no variation: half to twice the payload, on 0.8 to 1.25 times the link.
PAYLOADS = ((0.5, 2.0), (0.8, 1.25))


# What an error is a percentage of [rad]: e1(0), and the amplitude of y_r = sin(pi t).
_SIZES = {"start": 0.5, "amplitude": 1.0}
# Of y_r [rad] and of its rate [rad/s].
_AMPLITUDES = (1.0, math.pi)


def tracking(lab: Laboratory, plant: PlantName, *, statistic: str, arrived: float) -> Measured:
    """Peak or RMS of e1 in percent of the amplitude, once the optimum's is below ``arrived``."""
    return _late_error(lab, plant, 0, statistic, arrived)


def rate_tracking(lab: Laboratory, plant: PlantName, *, statistic: str, arrived: float) -> Measured:
    """Peak or RMS of e2, likewise, in percent of the amplitude of the reference's rate."""
    return _late_error(lab, plant, 1, statistic, arrived)


def _late_error(
    lab: Laboratory, plant: PlantName, column: int, statistic: str, arrived: float
) -> Measured:
    """One error in percent of its amplitude, after the start has passed.

    That is, for good, where the nominal optimum's own error is below so many percent of it.
    """
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    amplitude, time = _AMPLITUDES[column], result.comparison.time
    away = np.flatnonzero(np.abs(result.comparison.optimal[:, column]) > arrived / 100 * amplitude)
    begin = int(away[-1]) + 1 if len(away) else 0
    if begin >= len(time) - 1:
        return Measured(None, result.ended or "the optimum is still on its way", broken=True)
    error = result.comparison.z[begin:, column]
    values = {"peak": np.abs(error).max(), "RMS": np.sqrt(np.mean(error**2))}
    said = ", ".join(f"{name} {100 / amplitude * value:.3g} %" for name, value in values.items())
    value = 100 / amplitude * float(values[statistic])
    return of(result, value, f"{said} from {time[begin]:.3g} s on")


def rejection(lab: Laboratory, plant: PlantName, *, percent_of: str) -> Measured:
    """max |e1 - e1*| in case 1, in percent of the start or of the amplitude."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    return of(result, 100 / _SIZES[percent_of] * float(np.abs(result.comparison.deviation).max()))


def settling_ratio(lab: Laboratory, plant: PlantName, *, band: float, percent_of: str) -> Measured:
    """When |e1| enters a band [%] for good, over when the optimum does."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    z, time = result.comparison, result.comparison.time
    entered = []
    for error in (z.z[:, 0], z.optimal[:, 0]):
        outside = np.flatnonzero(np.abs(error) > band / 100 * _SIZES[percent_of])
        entered.append(float(time[min(outside[-1] + 1, len(time) - 1)]))
    stays = entered[0] < 0.9 * time[-1]
    note = f"for good at {entered[0]:.3g} s, the optimum at {entered[1]:.3g} s"
    if not stays:
        return of(result, None, f"|e1| is never within {band:g} % of the {percent_of} for good")
    return of(result, entered[0] / entered[1], note)


def worst_of_family(lab: Laboratory, plant: PlantName, *, heaviest: float) -> Measured:
    """Worst max |e1 - e1*| over payloads of up to so much, and links, in percent of the start."""
    start = find_experiment(_SYSTEM, "nominal").case.x0
    (lightest, _), links = PAYLOADS
    cases = [
        trial(_SYSTEM, f"m x{mass:g}, l x{length:g}", start, 6.0, (BodyEdit("link", mass, length),))
        for mass, length in itertools.product((lightest, 1.0, heaviest), (links[0], 1.0, links[1]))
    ]
    law, runs = lab.batch(cases, plant, "grosmc")
    worst, where = 0.0, ""
    for index, case in enumerate(cases):
        run = runs[index]
        where_now = case.case.title
        if run.status is not Status.COMPLETED:
            return Measured(None, f"{where_now}: the run ended early", broken=True)
        away = from_optimum(compare_with_optimum(run, law))
        if away >= worst:
            worst, where = away, where_now
    return Measured(worst, f"worst at {where}")


def unbalanced_torque(lab: Laboratory, plant: PlantName) -> Measured:
    """Power that the equation invents: C q' against M'(q) q'^2 / 2, relative to its largest."""
    case = find_experiment(_SYSTEM, "nominal")
    derivative = lab.plant(case, plant).derivative
    p = MujocoPlant.load(_SYSTEM).analytic().parameters
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(300):
        q, rate, tau = random.uniform(-1.4, 1.4), random.uniform(-5, 5), random.uniform(-2, 2)
        M = 0.1 + 0.06 * math.sin(q)
        gravity = p.m * p.l * p.g * math.cos(q)
        coriolis = 0.03 * math.cos(q) * rate * rate
        acceleration = derivative(np.array([q, rate]), tau, np.zeros(12))[1]
        terms = np.array([tau, -gravity, -coriolis])
        worst = max(worst, abs(M * acceleration - terms.sum()) / np.abs(terms).max())
    return Measured(100 * float(worst), "300 random states and torques")


def difference_of_printed_law(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Largest difference of e1 under the laws of both C, in percent of the start."""
    experiment = find_experiment(_SYSTEM, case)
    laws = [
        lab.run(experiment, plant, "grosmc"),
        lab.run_misdesigned(experiment, plant, "grosmc", "printed"),
    ]
    errors = [law.comparison.error for law in laws]
    n = min(map(len, errors))
    away = [from_optimum(law.comparison) for law in laws]
    note = f"from the optimum {away[1]:.3g} % with the printed C, {away[0]:.3g} % with energy's"
    difference = 100 / _SIZES["start"] * float(np.abs(errors[0][:n] - errors[1][:n]).max())
    return of(laws[1], difference, note)


def epsilon_margin(lab: Laboratory, _: PlantName) -> Measured:
    """epsilon over what d(t) needs along the run."""
    required, configured = _rates(lab)
    if not required.any():
        return Measured(None, "nothing pushes s away here", broken=True)
    margin = float((configured / np.maximum(required, 1e-12)).min())
    if margin >= 1:
        return Measured(margin, "ε is enough")
    # The run that needs it has left its surface: one that has enough stays on it.
    enough = float(_rates(lab.varied("laws.grosmc.epsilon", float(required.max())))[0].max())
    return Measured(margin, f"ε = {enough:.3g} rad/s² along a run that stays on its surface")


def _rates(lab: Laboratory) -> tuple[Array, Array]:
    """The required and the configured rate along case 1."""
    signals = audit(lab, find_experiment(_SYSTEM, "case1")).signals
    return signals["required"], signals["configured"]


def excursion_with_k(lab: Laboratory, plant: PlantName) -> Measured:
    """max |s| in case 1 over that with a hundredth of k."""
    key = "laws.grosmc.k"
    k = lab.controller(find_experiment(_SYSTEM, "case1"), plant, "grosmc").parameters.k
    runs = [
        level.case(_SYSTEM, "case1", plant, "grosmc") for level in (lab, lab.varied(key, k / 100))
    ]
    largest = [float(np.abs(sliding(result.trajectory)).max()) for result in runs]
    if k == 0:
        return Measured(None, "the law has no k", broken=True)
    note = f"{largest[0]:.3g} rad/s with k = {k:g}, {largest[1]:.3g} rad/s with {k / 100:g}"
    return of(runs[0], largest[0] / largest[1], note)


def with_enough(lab: Laboratory, plant: PlantName, *, epsilon: float) -> Measured:
    """Case 1 with another epsilon [rad/s^2]: the worst of three measures, each over its limit."""
    level = lab.varied("laws.grosmc.epsilon", epsilon)
    case = {"system": _SYSTEM, "case": "case1"}
    found = {
        "|s|": leaving_the_surface(level, plant, **case),
        "error": deviation(level, plant, controller="grosmc", **case),
        "index": excess_cost(level, plant, name="cost_continuous", **case),
    }
    limits = dict(zip(found, ("sliding", "same", "optimal"), strict=True))
    shares = {}
    for name, measured in found.items():
        if measured.value is None or measured.broken:
            return measured
        shares[name] = measured.value / WORDS[limits[name]]["at_most"]
    note = ", ".join(f"{name} {share:.3g} of its limit" for name, share in shares.items())
    return Measured(max(shares.values()), note)


def error_left(lab: Laboratory, plant: PlantName, *, epsilon: float, since: float) -> Measured:
    """|e1| at the end of case 1 with another epsilon [rad/s^2], in percent of the amplitude.

    It is the largest from an instant [s] on, extrapolated to a sampling time of zero.
    """
    left = []
    for level in (lab, lab.refined):
        level = level.varied("laws.grosmc.epsilon", epsilon)
        result = level.case(_SYSTEM, "case1", plant, "grosmc")
        late = result.comparison.time >= since
        error = np.abs(result.comparison.z[late, 0])
        if result.status is not Status.COMPLETED or not len(error):
            return Measured(
                None, result.ended or f"there is nothing from {since:g} s on", broken=True
            )
        left.append(100 / _AMPLITUDES[0] * float(error.max()))
    return Measured(abs(2 * left[1] - left[0]), f"{left[0]:.3g} % at T, {left[1]:.3g} % at T/2")


def price_of_epsilon(lab: Laboratory) -> Drawing:
    """s with d(t) and without."""
    curves = []
    for case, label, colour in (("case1", "with d(t)", "grosmc"), ("nominal", "without", "")):
        run = lab.case(_SYSTEM, case, "physics", "grosmc").trajectory
        curves.append(Curve(label, run.time[:-1], sliding(run), colour))
    return Drawing("time t [s]", "s [rad/s]", curves)
