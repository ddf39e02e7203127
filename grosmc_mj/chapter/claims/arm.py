"""The chapter's claims about the 1-DOF arm, section 4.3."""

from __future__ import annotations

import itertools
import math

import numpy as np

from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measures import from_optimum, of, sliding, within
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.premises.audit import audit
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status

_SYSTEM = "arm"
# The chapter prints no variation: half to twice the payload, on 0.8 to 1.25 times the link.
PAYLOADS = ((0.5, 2.0), (0.8, 1.25))


def tracking(lab: Laboratory, plant: PlantName) -> Measured:
    """RMS of e1 from 3 s on, in percent of the reference's amplitude."""
    return _rms(lab, plant, 0, 1.0)


def rate_tracking(lab: Laboratory, plant: PlantName) -> Measured:
    """RMS of e2 from 3 s on, in percent of the amplitude of the reference's rate."""
    return _rms(lab, plant, 1, math.pi)


def _rms(lab: Laboratory, plant: PlantName, column: int, amplitude: float) -> Measured:
    """RMS of one error from 3 s on, in percent of an amplitude."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    after = within(result.comparison.time, 3.0)
    if not after.any():
        return Measured(None, result.ended, broken=True)
    error = result.comparison.z[after, column]
    peak = 100 / amplitude * float(np.abs(error).max())
    note = f"peak {peak:.3g} % of the amplitude"
    return of(result, 100 / amplitude * float(np.sqrt(np.mean(error**2))), note)


def settling_ratio(lab: Laboratory, plant: PlantName) -> Measured:
    """When |e1| enters 5 % of its start, over when the optimum does."""
    result = lab.case(_SYSTEM, "case1", plant, "grosmc")
    z, time = result.comparison, result.comparison.time
    entered = []
    for error in (z.z[:, 0], z.optimal[:, 0]):
        outside = np.flatnonzero(np.abs(error) > 0.05 * abs(error[0]))
        entered.append(float(time[min(outside[-1] + 1, len(time) - 1)]))
    stays = entered[0] < 0.9 * time[-1]
    note = f"for good at {entered[0]:.3g} s, the optimum at {entered[1]:.3g} s"
    return of(result, entered[0] / entered[1] if stays else None, note)


def worst_of_family(lab: Laboratory, plant: PlantName) -> Measured:
    """Worst max |e1 - e1*| over the declared payloads and links, in percent of the start."""
    start = find_experiment(_SYSTEM, "nominal").case.x0
    cases = [
        trial(_SYSTEM, f"m x{mass:g}, l x{length:g}", start, 6.0, (BodyEdit("link", mass, length),))
        for mass, length in itertools.product(*((low, 1.0, high) for low, high in PAYLOADS))
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


def deviation_of_printed_law(lab: Laboratory, plant: PlantName) -> Measured:
    """max |e1 - e1*| of the law with the printed C, in percent of the start."""
    case = find_experiment(_SYSTEM, "nominal")
    result = lab.run_misdesigned(case, plant, "grosmc", "printed")
    return of(result, from_optimum(result.comparison))


def epsilon_margin(lab: Laboratory, _: PlantName) -> Measured:
    """The printed epsilon over what d(t) needs along the run."""
    audited = audit(lab, find_experiment(_SYSTEM, "case1"))
    required, configured = audited.signals["required"], audited.signals["configured"]
    premise = next(one for one in audited.premises if one.name == "epsilon")
    if not required.any():
        return Measured(None, "nothing pushes s away here", broken=True)
    return Measured(
        float((configured / np.maximum(required, 1e-12)).min()),
        premise.restores or "the printed ε is enough",
    )


def price_of_epsilon(lab: Laboratory) -> Drawing:
    """s with d(t) and without."""
    curves = []
    for case, label, colour in (("case1", "with d(t)", "grosmc"), ("nominal", "without", "")):
        run = lab.case(_SYSTEM, case, "physics", "grosmc").trajectory
        curves.append(Curve(label, run.time[:-1], sliding(run), colour))
    return Drawing("time t [s]", "s [rad/s]", curves)
