"""The chapter's claims about the 1-DOF arm, section 4.3."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import audit
from grosmc_mj.chapter.claims.claim import WORDS, Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    Size,
    deviation,
    difference_of,
    equation_error,
    excess_cost,
    from_optimum,
    leaving_the_surface,
    of,
    size_of,
    sliding,
    worst_deviation,
)
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant

_SYSTEM = "arm"
# The chapter prints no variation: half to twice the payload, on 0.8 to 1.25 times the link.
PAYLOADS = ((0.5, 2.0), (0.8, 1.25))
# Of y_r = sin(pi t) [rad] and of its rate [rad/s].
_AMPLITUDES = (1.0, math.pi)


def tracking(
    lab: Laboratory, plant: PlantName, *, state: int, statistic: str, arrived: float
) -> Measured:
    """Peak or RMS of an entry of e in case 1, in percent of its reference's amplitude.

    It counts from where the nominal optimum's own error is below ``arrived`` percent for good.
    """
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    amplitude, time = _AMPLITUDES[state], result.comparison.time
    away = np.flatnonzero(np.abs(result.comparison.optimal[:, state]) > arrived / 100 * amplitude)
    begin = int(away[-1]) + 1 if len(away) else 0
    if begin >= len(time) - 1:
        raise NoValueError(result.ended or "the optimum is still on its way")
    error = result.comparison.z[begin:, state]
    values = {"peak": np.abs(error).max(), "RMS": np.sqrt(np.mean(error**2))}
    value = 100 / amplitude * float(values[statistic])
    return of(result, value, f"from {time[begin]:.3g} s on")


def settling_ratio(lab: Laboratory, plant: PlantName, *, band: float, percent_of: Size) -> Measured:
    """When |e1| enters a band [%] for good, over when the optimum does."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    beside, time = result.comparison, result.comparison.time
    width, entered = band / 100 * size_of(beside, percent_of), []
    for error in (beside.z[:, 0], beside.optimal[:, 0]):
        outside = np.flatnonzero(np.abs(error) > width)
        entered.append(float(time[min(outside[-1] + 1, len(time) - 1)]))
    if entered[0] >= 0.9 * time[-1]:
        return of(result, None, f"|e1| is never within {band:g} % of the {percent_of} for good")
    note = f"for good at {entered[0]:.3g} s, the optimum at {entered[1]:.3g} s"
    return of(result, entered[0] / entered[1], note)


def worst_of_family(lab: Laboratory, plant: PlantName, *, heaviest: float) -> Measured:
    """Worst max |e1 - e1*| over payloads of up to so much, and links, in percent of the start."""
    start = find_experiment(_SYSTEM, "nominal").case.x0
    (lightest, _), (shortest, longest) = PAYLOADS
    family = itertools.product((lightest, 1.0, heaviest), (shortest, 1.0, longest))
    cases = [
        trial(_SYSTEM, f"m x{mass:g}, l x{length:g}", start, 6.0, (BodyEdit("link", mass, length),))
        for mass, length in family
    ]
    return worst_deviation(lab, plant, cases)


def unbalanced_torque(lab: Laboratory, plant: PlantName) -> Measured:
    """Power that the equation invents: C q' against M'(q) q'^2 / 2, relative to its largest."""
    p = MujocoPlant.load(_SYSTEM).analytic().parameters

    def balance(q: float, rate: float, torque: float) -> tuple[float, tuple[float, ...]]:
        gravity, coriolis = p.m * p.l * p.g * math.cos(q), 0.03 * math.cos(q) * rate * rate
        return 0.1 + 0.06 * math.sin(q), (torque, -gravity, -coriolis)

    return equation_error(lab, plant, _SYSTEM, (1.4, 5.0, 2.0), balance)


def difference_of_printed_law(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Largest difference of e1 under the laws of both C, in percent of the start."""
    experiment = find_experiment(_SYSTEM, case)
    printed = lab.run_misdesigned(experiment, plant, "grosmc", "printed")
    true = lab.run(experiment, plant, "grosmc")
    away = [from_optimum(result.comparison) for result in (printed, true)]
    note = f"from the optimum {away[0]:.3g} % with the printed C, {away[1]:.3g} % with energy's"
    return of(printed, difference_of((printed, true)), note)


def epsilon_margin(lab: Laboratory, _: PlantName) -> Measured:
    """epsilon over what d(t) needs along the run."""
    required, configured = _rates(lab)
    if not required.any():
        raise NoValueError("nothing pushes s away here")
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
    k = lab.controller(find_experiment(_SYSTEM, "case1"), plant, "grosmc").parameters.k
    runs = [
        level.case(_SYSTEM, "case1", plant, "grosmc")
        for level in (lab, lab.varied("laws.grosmc.k", k / 100))
    ]
    largest = [float(np.abs(sliding(result.trajectory)).max()) for result in runs]
    if k == 0:
        raise NoValueError("the law has no k")
    note = f"{largest[0]:.3g} rad/s with k = {k:g}, {largest[1]:.3g} rad/s with {k / 100:g}"
    return of(runs[0], largest[0] / largest[1], note)


def worst_of_three(lab: Laboratory, plant: PlantName) -> Measured:
    """The worst of s, deviation and index in case 1, each over the limit that its word has."""
    case: Any = {"system": _SYSTEM, "case": "case1"}
    measured = {
        "sliding": leaving_the_surface(lab, plant, **case),
        "same": deviation(lab, plant, controller="grosmc", **case),
        "optimal": excess_cost(lab, plant, name="cost_continuous", **case),
    }
    shares = {}
    for word, (value, note, broken) in measured.items():
        if value is None or broken:
            return Measured(value, note, broken)
        shares[word] = value / WORDS[word]["threshold"]
    words = ", ".join(f"{word} {share:.3g} of its limit" for word, share in shares.items())
    return Measured(max(shares.values()), words)
