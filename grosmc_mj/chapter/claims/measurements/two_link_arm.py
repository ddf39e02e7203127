"""Claims about several inputs, for which the chapter has the theory and no example."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grosmc_mj.chapter.claims.claim import ClaimValue
from grosmc_mj.chapter.claims.measurements.measures import from_run, within
from grosmc_mj.chapter.tip import true_tip
from grosmc_mj.experiments.assumptions.balance import Balance, Loads, balances
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.plants import AnalyticPlant

_SYSTEM = "two_link_arm"
# Random payloads and poses of the elbow.
_PAYLOADS = 5
_POSES = 25


def projection(lab: RunCache, plant: PlantName, *, payload: float) -> ClaimValue:
    """Measure the least share r of a switching gain that G = B+ leaves over the declared poses.

    The payload goes up to ``payload`` times the nominal one.
    """
    case = find_experiment(_SYSTEM, "regulation")
    law = lab.controller(case, plant, "grosmc")
    pseudoinverse = np.linalg.pinv(law.designed.lqr.B)
    with_pseudoinverse = replace(law, parameters=replace(law.parameters, G=pseudoinverse))

    least = ClaimValue(np.inf)
    least_of_law = np.inf
    for mass in np.linspace(1.0, payload, _PAYLOADS).tolist():
        edits = (BodyEdit("payload", mass),)
        true = lab.equations(trial(_SYSTEM, "payload", case.x0, 1.0, edits), plant)
        points = _balances_over_poses(with_pseudoinverse, true)
        worst = int(points.gain_ratio.argmin())
        where = f"{0.2 * mass:.2g} kg, q2 = {points.x[worst, 1]:.3g} rad"
        least = min(least, ClaimValue(float(points.gain_ratio[worst]), where))
        least_of_law = min(least_of_law, _balances_over_poses(law, true).gain_ratio.min())
    return least._replace(note=f"at {least.note}; the law's own G keeps {least_of_law:.3g}")


def _balances_over_poses(law: Controller, true: AnalyticPlant) -> Balance:
    """The balance at rest in the poses of the elbow that the regulation is declared for."""
    declared = find_experiment(_SYSTEM, "regulation").uncertainty
    assert declared is not None
    bound = declared.region[2]
    turns = np.linspace(-bound, bound, _POSES).tolist()
    p = law.parameters
    poses = [law.coordinates.place(0.0, [0.0, 0.0, turn, 0.0], p) for turn in turns]
    no_loads = Loads.none(true.system, _POSES)
    return balances(law, true, [0.0] * _POSES, np.array(poses), no_loads)


def off_the_circle(lab: RunCache, plant: PlantName, *, case: str) -> ClaimValue:
    """Measure the largest distance of the true tip from its reference in the last turn [mm]."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    comparison = result.comparison
    last = within(comparison.time, 4.0)
    distance = np.linalg.norm(true_tip(result)[last] - comparison.reference[last], axis=1)
    believed = 1e3 * float(comparison.error[last].max())
    note = f"by its own kinematics it is {believed:.2g} mm"
    return from_run(result, 1e3 * float(distance.max()), note)


def unknown_kinematics(lab: RunCache) -> str:
    """Return the premise that errors of the links' lengths break."""
    return (
        "the output map y = h(x) is known (section 4.1: only the dynamics have an uncertain part); "
        "here h has the links' lengths in it, and the law regulates what it believes y to be"
    )
