"""Claims about several inputs, for which the chapter has the theory and no example."""

from __future__ import annotations

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.measures import EVERY, of, within
from grosmc_mj.chapter.claims.measurements.theory import Derivative, approach
from grosmc_mj.chapter.tip import true_tip
from grosmc_mj.control import reaching
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.uncertainty import Uncertainty
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit

_SYSTEM = "two_link_arm"
# B+, with the elbow's s counted like the shoulder's.
_PSEUDOINVERSE = np.kron(np.eye(2), [[0.0, 1.0]])
_PLANTS, _STATES, _POSES = 8, 20, 25


def gain_margin(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Least rho of the law over what is required of it along a run, by the true equations.

    The case ``together`` is 1 kg at the tip, links 5 % longer and every disturbance of case 1.
    """
    if case != "together":
        return _least_margin(lab, plant, find_experiment(_SYSTEM, case))
    pushed, heavier = (find_experiment(_SYSTEM, name).case for name in ("case1", "case2"))
    both = trial(_SYSTEM, case, heavier.x0, 6.0, heavier.edits, pushed.disturbances)
    return _least_margin(lab, plant, both)


def _least_margin(lab: Laboratory, plant: PlantName, experiment: Experiment) -> Measured:
    """Least margin of the gain over a run."""
    result = lab.run(experiment, plant, "grosmc")
    true = lab.equations(experiment, plant)
    points = balances_along(result.controller, true, result.trajectory, EVERY)
    needed = points.required > 0
    least = (points.configured[needed] / points.required[needed]).min(initial=np.inf)
    return of(result, float(least), f"least r {points.gain_ratio.min():.3g}")


def projection(lab: Laboratory, plant: PlantName, *, payload: float) -> Measured:
    """Least authority of G = B+ over the declared poses, up to so many times the payload."""
    case = find_experiment(_SYSTEM, "regulation")
    law = lab.controller(case, plant, "grosmc")
    error, p = law.coordinates, law.parameters
    rows = list(error.linearization.last_rows)
    projections = {"B+": _PSEUDOINVERSE[:, rows], "own": p.G[:, rows]}
    least = {"B+": (np.inf, ""), "own": (np.inf, "")}
    bound = _declared().region[2]
    for mass in np.linspace(1.0, payload, 5).tolist():
        derivative = lab.plant(_payload(mass, case), plant).derivative
        for turn in np.linspace(-bound, bound, _POSES).tolist():
            x = error.place(0.0, [0.0, 0.0, turn, 0.0], p)
            _, E = error.dynamics(0.0, x, p)
            E_true, where = _true_gain(law, derivative, x), f"{0.2 * mass:.2g} kg"
            for name, G_r in projections.items():
                r = float(reaching.gain_margin(G_r @ E_true @ np.linalg.inv(G_r @ E)))
                least[name] = min(least[name], (r, f"{where}, q2 = {x[1]:.3g} rad"))
    (r, where), (own, _) = least["B+"], least["own"]
    return Measured(r, f"at {where}; the law's own G keeps {own:.3g}")


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
    """The start of a case with so many times the payload."""
    return trial(_SYSTEM, "payload", case.case.x0, 1.0, (BodyEdit("payload", mass),))


def slowest_approach(lab: Laboratory, plant: PlantName) -> Measured:
    """The largest s_i' sgn(s_i) + eta over the declared family, by the plant's own accelerations.

    At each state the law is evaluated on all four sides of its two surfaces.
    """
    random, worst, declared = np.random.default_rng(1), -np.inf, _declared()
    law = lab.controller(find_experiment(_SYSTEM, "regulation"), plant, "grosmc")
    low, high = declared.scales["mp"]
    for mass in (low, high, *random.uniform(low, high, _PLANTS - 2).tolist()):
        heavier = _payload(mass, find_experiment(_SYSTEM, "nominal"))
        derivative = lab.plant(heavier, plant).derivative
        # Any time but the start, at which the law takes z for its own z(0).
        places = ((random.uniform(-1, 1, 4) * declared.region, 1.0) for _ in range(_STATES))
        worst = max(worst, approach(law, derivative, places, np.array(declared.wrench)))
    own = float(getattr(law.parameters, "eta", 0.0))
    note = f"{_PLANTS} payloads x {_STATES} states; the law's own η is {own:.3g}"
    return Measured(worst + declared.reaching_rate, note)


def off_the_circle(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Largest distance of the true tip from its reference in the last turn, in mm."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    last = within(result.comparison.time, 4.0)
    off = np.linalg.norm(true_tip(result)[last] - result.comparison.reference[last], axis=1)
    believed = 1e3 * float(result.comparison.error[last].max())
    return of(result, 1e3 * float(off.max()), f"by its own kinematics it is {believed:.2g} mm")


def elbow_bend(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Least |sin q2| along the run of GROSMC."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    return of(result, float(np.abs(np.sin(result.trajectory.state[:, 1])).min()))


def unknown_kinematics(lab: Laboratory) -> str:
    """Which premise the length errors break."""
    return (
        "the output map y = h(x) is known (section 4.1: only the dynamics have an uncertain part); "
        "here h has the links' lengths in it, and the law regulates what it believes y to be"
    )
