"""The chapter's claims about the 1-DOF arm, section 4.3."""

from __future__ import annotations

import itertools
import math
from functools import partial
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
    from_run,
    leaving_the_surface,
    size_of,
    sliding,
    worst_deviation,
)
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant

_SYSTEM = "arm"
# The chapter prints no variation: half to twice the payload, on 0.8 to 1.25 times the link.
PAYLOADS = ((0.5, 2.0), (0.8, 1.25))
# Amplitudes of y_r = sin(pi t) [rad] and of its rate [rad/s].
_AMPLITUDES = (1.0, math.pi)


def tracking(
    lab: RunCache,
    plant: PlantName,
    *,
    state: int,
    statistic: str,
    arrived: float,
) -> Measured:
    """Measure peak or RMS of an entry of e in case 1, in percent of its reference's amplitude.

    It counts from where the nominal optimum's error is below ``arrived`` percent for good.

    Raises:
        NoValueError: If the run ends before.
    """
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    comparison = result.comparison
    time = comparison.time
    amplitude = _AMPLITUDES[state]

    outside = np.abs(comparison.optimal[:, state]) > arrived / 100 * amplitude
    begin = 0
    if outside.any():
        begin = int(np.flatnonzero(outside)[-1]) + 1
    if begin >= len(time) - 1:
        raise NoValueError(result.ended or "the optimum is still on its way")

    error = comparison.z[begin:, state]
    size = np.abs(error).max()
    if statistic == "RMS":
        size = np.sqrt(np.mean(error**2))
    value = 100 / amplitude * float(size)
    return from_run(result, value, f"from {time[begin]:.3g} s on")


def settling_ratio(
    lab: RunCache,
    plant: PlantName,
    *,
    band: float,
    percent_of: Size,
) -> Measured:
    """Measure when |e1| enters a band [%] for good, over when the optimum does."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    comparison = result.comparison
    time = comparison.time
    width = band / 100 * size_of(comparison, percent_of)

    entered = _last_entry(time, comparison.z[:, 0], width)
    optimum_entered = _last_entry(time, comparison.optimal[:, 0], width)
    if entered >= 0.9 * time[-1]:
        note = f"|e1| is never within {band:g} % of the {percent_of} for good"
        return from_run(result, None, note)
    note = f"for good at {entered:.3g} s, the optimum at {optimum_entered:.3g} s"
    return from_run(result, entered / optimum_entered, note)


def _last_entry(time: Array, error: Array, width: float) -> float:
    """When the error enters a band for good [s]; the last instant if it never does."""
    outside = np.flatnonzero(np.abs(error) > width)
    return float(time[min(outside[-1] + 1, len(time) - 1)])


def worst_of_family(lab: RunCache, plant: PlantName, *, heaviest: float) -> Measured:
    """Measure the worst max |e1 - e1*| over payloads and links, in percent of the start.

    Payloads go up to ``heaviest`` times the nominal one.
    """
    start = find_experiment(_SYSTEM, "nominal").x0
    (lightest, _), (shortest, longest) = PAYLOADS
    masses = (lightest, 1.0, heaviest)
    lengths = (shortest, 1.0, longest)

    cases = []
    for mass, length in itertools.product(masses, lengths):
        edits = (BodyEdit("link", mass, length),)
        cases.append(trial(_SYSTEM, f"m x{mass:g}, l x{length:g}", start, 6.0, edits))
    return worst_deviation(lab, plant, cases)


def unbalanced_torque(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the power that the equation invents, relative to its largest term.

    C q' is held against M'(q) q'^2 / 2.
    """
    p = MujocoPlant.load(_SYSTEM).analytic().parameters
    return equation_error(lab, plant, _SYSTEM, (1.4, 5.0, 2.0), partial(_balance, p))


def _balance(
    p: Any,
    q: float,
    rate: float,
    torque: float,
) -> tuple[float, tuple[float, ...]]:
    """M(q) of eq. (57), and the torques by the energy-true C."""
    gravity = p.m * p.l * p.g * math.cos(q)
    coriolis = 0.03 * math.cos(q) * rate * rate
    return 0.1 + 0.06 * math.sin(q), (torque, -gravity, -coriolis)


def difference_of_printed_law(lab: RunCache, plant: PlantName, *, case: str) -> Measured:
    """Measure the largest difference of e1 under the laws of both C, in percent of the start."""
    experiment = find_experiment(_SYSTEM, case)
    printed = lab.run_misdesigned(experiment, plant, "grosmc", "printed")
    true = lab.run(experiment, plant, "grosmc")
    value = difference_of((printed, true))

    with_printed = from_optimum(printed.comparison)
    with_true = from_optimum(true.comparison)
    note = (
        f"from the optimum {with_printed:.3g} % with the printed C, {with_true:.3g} % with energy's"
    )
    return from_run(printed, value, note)


def epsilon_margin(lab: RunCache, _: PlantName) -> Measured:
    """Measure epsilon over the rate that d(t) requires along the run.

    Raises:
        NoValueError: If nothing pushes s away.
    """
    required, configured = _rates(lab)
    if not required.any():
        raise NoValueError("nothing pushes s away here")
    margin = float((configured / np.maximum(required, 1e-12)).min())
    if margin >= 1:
        return Measured(margin, "ε is enough")

    # A run that needs more has left its surface; one that has enough stays on it.
    enlarged = lab.varied("laws.grosmc.epsilon", float(required.max()))
    required_on_surface, _configured = _rates(enlarged)
    enough = float(required_on_surface.max())
    return Measured(margin, f"ε = {enough:.3g} rad/s² along a run that stays on its surface")


def _rates(lab: RunCache) -> tuple[Array, Array]:
    """The required and the configured rate along case 1."""
    signals = audit(lab, find_experiment(_SYSTEM, "case1")).signals
    return signals["required"], signals["configured"]


def excursion_with_k(lab: RunCache, plant: PlantName) -> Measured:
    """Measure max |s| in case 1 over that with a hundredth of k.

    Raises:
        NoValueError: If k is zero.
    """
    k = lab.controller(find_experiment(_SYSTEM, "case1"), plant, "grosmc").parameters.k
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    weaker = lab.varied("laws.grosmc.k", k / 100).case(_SYSTEM, "case1", plant, "grosmc")
    largest = float(np.abs(sliding(result.trajectory)).max())
    largest_weaker = float(np.abs(sliding(weaker.trajectory)).max())
    if k == 0:
        raise NoValueError("the law has no k")

    note = f"{largest:.3g} rad/s with k = {k:g}, {largest_weaker:.3g} rad/s with {k / 100:g}"
    return from_run(result, largest / largest_weaker, note)


def worst_of_three(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the worst of s, deviation and index in case 1, each over the limit of its word."""
    case: Any = {"system": _SYSTEM, "case": "case1"}
    by_word = {
        "sliding": leaving_the_surface(lab, plant, **case),
        "same": deviation(lab, plant, controller="grosmc", **case),
        "optimal": excess_cost(lab, plant, name="cost_continuous", **case),
    }

    shares = {}
    for word, measured in by_word.items():
        if measured.value is None or measured.broken:
            return measured
        shares[word] = measured.value / WORDS[word]["threshold"]
    words = ", ".join(f"{word} {share:.3g} of its limit" for word, share in shares.items())
    return Measured(max(shares.values()), words)
