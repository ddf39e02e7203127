"""Claims about several inputs, for which the chapter has the theory and no example."""

from __future__ import annotations

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.measures import EVERY, from_run, within
from grosmc_mj.chapter.claims.measurements.theory import Derivative, approach
from grosmc_mj.chapter.tip import true_tip
from grosmc_mj.control import reaching
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.uncertainty.outputs import Uncertainty
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.physics.edits import BodyEdit

_SYSTEM = "two_link_arm"
# B+, with the elbow's s counted like the shoulder's.
_PSEUDOINVERSE = np.kron(np.eye(2), [[0.0, 1.0]])
# Random payloads, random states of each, and poses of the elbow.
_PLANTS = 8
_STATES = 20
_POSES = 25


def gain_margin(lab: RunCache, plant: PlantName, *, case: str) -> Measured:
    """Measure the least rho of the law over the required one along a run, by the true equations.

    The case ``together`` is 1 kg at the tip, links 5 % longer and every disturbance of case 1.
    """
    if case == "together":
        disturbances = find_experiment(_SYSTEM, "case1").disturbances
        heavier = find_experiment(_SYSTEM, "case2")
        experiment = trial(_SYSTEM, case, heavier.x0, 6.0, heavier.edits, disturbances)
    else:
        experiment = find_experiment(_SYSTEM, case)

    result = lab.run(experiment, plant, "grosmc")
    true = lab.equations(experiment, plant)
    points = balances_along(result.controller, true, result.trajectory, EVERY)
    needed = points.required > 0
    least = (points.configured[needed] / points.required[needed]).min(initial=np.inf)
    return from_run(result, float(least), f"least r {points.gain_ratio.min():.3g}")


def projection(lab: RunCache, plant: PlantName, *, payload: float) -> Measured:
    """Measure the least authority of G = B+ over the declared poses.

    The payload goes up to ``payload`` times the nominal one.
    """
    case = find_experiment(_SYSTEM, "regulation")
    law = lab.controller(case, plant, "grosmc")
    error = law.coordinates
    p = law.parameters
    rows = list(error.linearization.last_rows)
    G_plus = _PSEUDOINVERSE[:, rows]
    G_law = p.G[:, rows]

    least = np.inf
    least_of_law = np.inf
    where = ""
    bound = _declared().region[2]
    for mass in np.linspace(1.0, payload, 5).tolist():
        derivative = lab.plant(_payload(mass, case), plant).derivative
        for turn in np.linspace(-bound, bound, _POSES).tolist():
            x = error.place(0.0, [0.0, 0.0, turn, 0.0], p)
            _, E = error.dynamics(0.0, x, p)
            E_true = _true_gain(law, derivative, x)
            least_of_law = min(least_of_law, _authority(G_law, E, E_true))
            authority = _authority(G_plus, E, E_true)
            if authority < least:
                least = authority
                where = f"{0.2 * mass:.2g} kg, q2 = {x[1]:.3g} rad"
    return Measured(least, f"at {where}; the law's own G keeps {least_of_law:.3g}")


def _authority(G: Array, E: Array, E_true: Array) -> float:
    """The part of the input gain G E that the true plant keeps, see ``reaching.gain_margin``."""
    return float(reaching.gain_margin(G @ E_true @ np.linalg.inv(G @ E)))


def _true_gain(law: Controller, derivative: Derivative, x: Array) -> Array:
    """E* of a plant's own accelerations, in the coordinates that the law believes in, (m, m)."""
    error = law.coordinates
    assert isinstance(error, ErrorCoordinates)
    slopes = error.linearization.slope(x, law.parameters.plant)
    slope = np.reshape(slopes, (error.size, len(x)))[list(error.linearization.last_rows)]
    still = derivative(x, np.zeros(error.inputs))
    columns = [derivative(x, unit) - still for unit in np.eye(error.inputs)]
    return error.sign * slope @ np.array(columns).T


def _declared() -> Uncertainty:
    """The uncertainty that the gain of the regulation is declared for."""
    declared = find_experiment(_SYSTEM, "regulation").uncertainty
    assert declared is not None
    return declared


def _payload(mass: float, case: Experiment) -> Experiment:
    """The start of a case with ``mass`` times the payload."""
    return trial(_SYSTEM, "payload", case.x0, 1.0, (BodyEdit("payload", mass),))


def slowest_approach(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the largest s_i' sgn(s_i) + eta over the declared family.

    s' follows from the plant's own accelerations. At each state the law is evaluated on all four
    sides of its two surfaces.
    """
    declared = _declared()
    law = lab.controller(find_experiment(_SYSTEM, "regulation"), plant, "grosmc")
    nominal = find_experiment(_SYSTEM, "nominal")
    wrench = np.array(declared.wrench)
    random = np.random.default_rng(1)
    low, high = declared.scales["mp"]

    worst = -np.inf
    masses = random.uniform(low, high, _PLANTS - 2).tolist()
    for mass in (low, high, *masses):
        derivative = lab.plant(_payload(mass, nominal), plant).derivative
        # At any time but the start, where the law takes z for its own z(0).
        places = []
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 4) * declared.region
            places.append((z, 1.0))
        worst = max(worst, approach(law, derivative, places, wrench))

    eta = float(getattr(law.parameters, "eta", 0.0))
    note = f"{_PLANTS} payloads x {_STATES} states; the law's own η is {eta:.3g}"
    return Measured(worst + declared.reaching_rate, note)


def off_the_circle(lab: RunCache, plant: PlantName, *, case: str) -> Measured:
    """Measure the largest distance of the true tip from its reference in the last turn [mm]."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    comparison = result.comparison
    last = within(comparison.time, 4.0)
    distance = np.linalg.norm(true_tip(result)[last] - comparison.reference[last], axis=1)
    believed = 1e3 * float(comparison.error[last].max())
    note = f"by its own kinematics it is {believed:.2g} mm"
    return from_run(result, 1e3 * float(distance.max()), note)


def elbow_bend(lab: RunCache, plant: PlantName, *, case: str) -> Measured:
    """Measure the least |sin q2| along the run of GROSMC."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    bend = np.abs(np.sin(result.trajectory.state[:, 1]))
    return from_run(result, float(bend.min()))


def unknown_kinematics(lab: RunCache) -> str:
    """Return the premise that errors of the links' lengths break."""
    return (
        "the output map y = h(x) is known (section 4.1: only the dynamics have an uncertain part); "
        "here h has the links' lengths in it, and the law regulates what it believes y to be"
    )
