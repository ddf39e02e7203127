"""The chapter's claims about the 1-DOF arm, section 4.3."""

from __future__ import annotations

import itertools
import math
from functools import partial
from typing import Any

import numpy as np

from grosmc_mj.chapter.claims.claim import ClaimValue, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    Size,
    equation_error,
    from_run,
    size_of,
    worst_deviation,
)
from grosmc_mj.experiments.assumptions.audit import audit
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

_SYSTEM = "arm"
# The chapter prints no variation: half to twice the payload, on 0.8 to 1.25 times the link.
PAYLOADS = ((0.5, 2.0), (0.8, 1.25))
# Amplitude of y_r = sin(pi t) [rad].
_AMPLITUDE = 1.0


def tracking(
    lab: RunCache,
    plant: PlantName,
    *,
    statistic: str,
    arrived: float,
) -> ClaimValue:
    """Measure peak or RMS of e1 in case 1, in percent of the reference's amplitude.

    It counts from where the nominal optimum's error is below ``arrived`` percent for good.

    Raises:
        NoValueError: If the run ends before.
    """
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    comparison = result.comparison
    time = comparison.time

    outside = np.abs(comparison.optimal[:, 0]) > arrived / 100 * _AMPLITUDE
    begin = 0
    if outside.any():
        begin = int(np.flatnonzero(outside)[-1]) + 1
    if begin >= len(time) - 1:
        raise NoValueError(result.ended or "the optimum is still on its way")

    error = comparison.z[begin:, 0]
    size = np.abs(error).max()
    if statistic == "RMS":
        size = np.sqrt(np.mean(error**2))
    value = 100 / _AMPLITUDE * float(size)
    return from_run(result, value, f"from {time[begin]:.3g} s on")


def settling_ratio(
    lab: RunCache,
    plant: PlantName,
    *,
    band: float,
    percent_of: Size,
) -> ClaimValue:
    """Measure when |e1| enters a band [%] for good, over when the optimum does."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    comparison = result.comparison
    width = band / 100 * size_of(comparison, percent_of)

    settled = result.settled(comparison.z, width)
    optimum_settled = result.settled(comparison.optimal, width)
    if settled is None or optimum_settled is None:
        note = f"|e1| is never within {band:g} % of the {percent_of} for good"
        return from_run(result, None, note)
    note = f"for good at {settled:.3g} s, the optimum at {optimum_settled:.3g} s"
    return from_run(result, settled / optimum_settled, note)


def worst_of_family(lab: RunCache, plant: PlantName, *, heaviest: float) -> ClaimValue:
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


def unbalanced_torque(lab: RunCache, plant: PlantName) -> ClaimValue:
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


def epsilon_margin(lab: RunCache, _: PlantName) -> ClaimValue:
    """Measure epsilon over the rate that d(t) requires along the run.

    Raises:
        NoValueError: If nothing pushes s away.
    """
    required, configured = _rates(lab)
    if not required.any():
        raise NoValueError("nothing pushes s away here")
    margin = float((configured / np.maximum(required, 1e-12)).min())
    if margin >= 1:
        return ClaimValue(margin, "ε is enough")

    # A run that needs more has left its surface; one that has enough stays on it.
    enlarged = lab.varied("laws.grosmc.epsilon", float(required.max()))
    required_on_surface, _configured = _rates(enlarged)
    enough = float(required_on_surface.max())
    return ClaimValue(margin, f"ε = {enough:.3g} rad/s² along a run that stays on its surface")


def _rates(lab: RunCache) -> tuple[Array, Array]:
    """The required and the configured rate along case 1."""
    signals = audit(lab, find_experiment(_SYSTEM, "case1")).signals
    return signals["required"], signals["configured"]
