"""The chapter's claims about the cart-pendulum, section 3.4."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of, within
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum, settling_time
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters
from grosmc_mj.simulation.trajectory import Status

_SYSTEM = "cart_pendulum"
_ANGLES = range(5, 90, 5)
_LARGER = (BodyEdit("pole", mass_scale=4.0, length_scale=4.0),)


def from_two_seconds(lab: Laboratory, plant: PlantName, *, band: float) -> Measured:
    """Distance of settling to a band [%] from 2 s, in percent, of the law that is further off."""
    worst, said = 0.0, []
    for name in ("lqr", "grosmc"):
        result = lab.case(_SYSTEM, "nominal", plant, name)
        theta = result.comparison.z[:, 0]
        settled = settling_time(result.comparison.time, theta, band / 100 * abs(theta[0])).value
        if settled is None:
            return of(result, None, f"{name} does not settle")
        worst = max(worst, 50 * abs(settled - 2.0))
        said.append(f"{name} at {settled:.3g} s")
    return Measured(worst, ", ".join(said))


def largest_angle_late(lab: Laboratory, plant: PlantName, *, controller: str) -> Measured:
    """Largest |θ| while d(t) acts, in percent of the start."""
    result = lab.case(_SYSTEM, "case2", plant, controller)
    after = within(result.comparison.time, 9.0)
    if not after.any():
        return Measured(None, result.ended, broken=True)
    late = float(np.abs(result.comparison.z[after, 0]).max())
    return of(result, 100 * late / abs(result.comparison.z[0, 0]), f"{1e3 * late:.3g} mrad")


def largest_start(
    lab: Laboratory,
    plant: PlantName,
    *,
    controller: str,
    perturbed: bool = False,
    within_percent: float = math.inf,
) -> Measured:
    """The largest start angle such that it and every smaller one converge within the region.

    There is none where the least start fails already: a law that works nowhere has no region.

    Args:
        lab: Where it is measured.
        plant: On what.
        controller: Whose region.
        perturbed: Whether the pole is four times as long and heavy.
        within_percent: How far from its optimum a response may go, in percent of the start.
    """
    edits = _LARGER if perturbed else ()
    cases = [
        trial(_SYSTEM, "start", (0.0, -math.radians(angle), 0.0, 0.0), 6.0, edits)
        for angle in _ANGLES
    ]
    key = ("region", controller, edits, plant)
    law, runs = lab.once(key, lambda: lab.batch(cases, plant, controller))
    reached = None
    for index, angle in enumerate(_ANGLES):
        theta = runs.state[index, :, 1]
        kept = runs.status[index] is Status.COMPLETED and np.abs(theta).max() < math.pi / 2
        if not (kept and abs(theta[-1]) <= 0.02 * math.radians(angle)):
            return Measured(reached, f"not from {angle} degrees")
        away = from_optimum(compare_with_optimum(runs[index], law))
        if away > within_percent:
            return Measured(reached, f"from {angle} degrees it goes {away:.3g} % astray")
        reached = float(angle)
    asked = float(np.abs(runs.input[-1]).max())
    gains = law.designed.gains
    said = "".join(
        f", {symbol} = {gains[name]:.3g}"
        for name, symbol in (("eta", "η"), ("gamma0", "γ0"), ("gamma1", "γ1"))
        if name in gains
    )
    return Measured(reached, f"from every angle tried; up to {asked:.3g} N{said}")


def final_cart_speed(lab: Laboratory, plant: PlantName) -> Measured:
    """Speed of the cart when the pole has long been at rest [m/s]."""
    result = lab.case(_SYSTEM, "case2", plant, "grosmc")
    run = result.trajectory
    travel = float(np.abs(run.state[:, 0]).max())
    at_rest = within(run.time, 6.0, 9.0)
    if not at_rest.any():
        return Measured(None, result.ended, broken=True)
    note = f"it travels {travel:.3g} m in {run.time[-1]:g} s"
    return of(result, float(np.abs(run.state[at_rest, 2]).min()), note)


def acceleration_error(lab: Laboratory, plant: PlantName) -> Measured:
    """Largest difference of theta'' from Lagrange's equations, in percent of the largest term."""
    case = find_experiment(_SYSTEM, "nominal")
    derivative = lab.plant(case, plant).derivative
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(300):
        x = np.array([0.0, random.uniform(-1.2, 1.2), 0.0, random.uniform(-5, 5)])
        u = random.uniform(-10, 10)
        terms = np.array(_lagrange(x, u))
        acceleration = derivative(x, u, np.zeros(12))[3]
        worst = max(worst, abs(acceleration - terms.sum()) / np.abs(terms).max())
    return Measured(100 * float(worst), "300 random states and forces")


def _lagrange(x: np.ndarray, u: float) -> tuple[float, float, float]:
    """theta'' of a cart with a uniform rod, from its mass matrix; independent of eq. (40).

    (M + m) p'' - m L cos(theta) theta'' = u - m L sin(theta) theta'^2
    -m L cos(theta) p'' + 4/3 m L^2 theta'' = m g L sin(theta)
    """
    p = _nominal()
    s, c, m, L = math.sin(x[1]), math.cos(x[1]), p.m, p.L
    mass = np.array([[p.M + m, -m * L * c], [-m * L * c, 4 / 3 * m * L * L]])
    gravity = np.linalg.solve(mass, [0.0, m * p.g * L * s])[1]
    centrifugal = np.linalg.solve(mass, [-m * L * s * x[3] ** 2, 0.0])[1]
    pushed = np.linalg.solve(mass, [u, 0.0])[1]
    return float(gravity), float(centrifugal), float(pushed)


@cache
def _nominal() -> CartPendulumParameters:
    """The numbers of the nominal model."""
    return MujocoPlant.load(_SYSTEM).analytic().parameters


def naive_gain(lab: Laboratory, plant: PlantName) -> Measured:
    """A gain sized on u_c alone, over the required one, in case 1 along the run."""
    case = find_experiment(_SYSTEM, "case1")
    result = lab.run(case, plant, "grosmc")
    true = lab.equations(case, plant)
    law, run = result.controller, result.trajectory
    points = balances_along(law, true, run, 10, pushed=False)
    naive, required = float(points.push.max()), float(points.required.max())
    if required < 1e-9:
        return Measured(None, "nothing pushes s away here", broken=True)
    return of(
        result, naive / required, f"{naive:.3g} rad/s² sized so, {required:.3g} rad/s² required"
    )


def travel(lab: Laboratory) -> Drawing:
    """The cart's position."""
    curves = []
    for name, label in (("lqr", "LQR"), ("grosmc", "GROSMC")):
        run = lab.case(_SYSTEM, "case2", "physics", name).trajectory
        curves.append(Curve(label, run.time, run.state[:, 0], name))
    return Drawing("time t [s]", "cart position p [m]", curves)


def close_up(lab: Laboratory) -> Drawing:
    """The pole's angle under d(t), magnified."""
    curves = []
    for name, label in (("lqr", "LQR"), ("grosmc", "GROSMC")):
        comparison = lab.case(_SYSTEM, "case2", "physics", name).comparison
        after = within(comparison.time, 8.0)
        curves.append(Curve(label, comparison.time[after], 1e3 * comparison.z[after, 0], name))
    return Drawing("time t [s]", "pole angle θ [mrad]", curves)
