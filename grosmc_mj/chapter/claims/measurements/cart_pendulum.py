"""The chapter's claims about the cart-pendulum, section 3.4."""

from __future__ import annotations

import math

import numpy as np

from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    equation_error,
    from_optimum,
    of,
    within,
)
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum, settling_time
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status

_SYSTEM = "cart_pendulum"
_ANGLES = range(5, 90, 5)
_LARGER = (BodyEdit("pole", mass_scale=4.0, length_scale=4.0),)


def from_two_seconds(
    lab: Laboratory, plant: PlantName, *, controller: str, band: float
) -> Measured:
    """Distance of settling to a band [%] from 2 s, in percent."""
    result = lab.case(_SYSTEM, "nominal", plant, controller)
    theta = result.comparison.z[:, 0]
    settled = settling_time(result.comparison.time, theta, band / 100 * abs(theta[0])).value
    if settled is None:
        return of(result, None, f"{controller} does not settle")
    return Measured(50 * abs(settled - 2.0), f"at {settled:.3g} s")


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
        plant: On which plant.
        controller: Whose region.
        perturbed: Whether the pole is four times as long and heavy.
        within_percent: How far from its optimum a response may go, in percent of the start.
    """
    edits = _LARGER if perturbed else ()
    starts = [math.radians(angle) for angle in _ANGLES]
    cases = [trial(_SYSTEM, "start", (0.0, -start, 0.0, 0.0), 6.0, edits) for start in starts]
    key = ("region", controller, edits, plant)
    law, runs = lab.once(key, lambda: lab.batch(cases, plant, controller))
    reached = None
    for index, (angle, start) in enumerate(zip(_ANGLES, starts, strict=True)):
        theta = np.abs(runs.state[index, :, 1])
        kept = runs.status[index] is Status.COMPLETED and theta.max() < math.pi / 2
        if not (kept and theta[-1] <= 0.02 * start):
            return Measured(reached, f"not from {angle} degrees")
        away = from_optimum(compare_with_optimum(runs[index], law))
        if away > within_percent:
            return Measured(reached, f"from {angle} degrees it goes {away:.3g} % astray")
        reached = float(angle)
    gains = law.designed.gains
    symbols = {"eta": "η", "gamma0": "γ0", "gamma1": "γ1"}
    words = [f"{symbols[name]} = {gains[name]:.3g}" for name in symbols if name in gains]
    most = f"up to {np.abs(runs.input[-1]).max():.3g} N"
    return Measured(reached, f"from every angle tried; {', '.join([most, *words])}")


def final_cart_speed(lab: Laboratory, plant: PlantName) -> Measured:
    """Speed of the cart when the pole has long been at rest [m/s]."""
    result = lab.case(_SYSTEM, "case2", plant, "grosmc")
    run = result.trajectory
    at_rest = within(run.time, 6.0, 9.0)
    note = f"it travels {np.abs(run.state[:, 0]).max():.3g} m in {run.time[-1]:g} s"
    return of(result, float(np.abs(run.state[at_rest, 2]).min()), note)


def acceleration_error(lab: Laboratory, plant: PlantName) -> Measured:
    """Largest difference of theta'' from Lagrange's equations, in percent of the largest term.

    Of a cart with a uniform rod, from its mass matrix; independent of eq. (40):

        (M + m) p'' - m L cos(theta) theta'' = u - m L sin(theta) theta'^2
        -m L cos(theta) p'' + 4/3 m L^2 theta'' = m g L sin(theta)
    """
    p = MujocoPlant.load(_SYSTEM).analytic().parameters
    m, L = p.m, p.L

    def balance(theta: float, rate: float, u: float) -> tuple[float, list[float]]:
        s, c = math.sin(theta), math.cos(theta)
        mass = np.array([[p.M + m, -m * L * c], [-m * L * c, 4 / 3 * m * L * L]])
        forces = ([0.0, m * p.g * L * s], [-m * L * s * rate**2, 0.0], [u, 0.0])
        return 1.0, [float(np.linalg.solve(mass, force)[1]) for force in forces]

    return equation_error(lab, plant, _SYSTEM, (1.2, 5.0, 10.0), balance)


def naive_gain(lab: Laboratory, plant: PlantName) -> Measured:
    """A gain sized on u_c alone, over the required one, in case 1 along the run."""
    case = find_experiment(_SYSTEM, "case1")
    result = lab.run(case, plant, "grosmc")
    true = lab.equations(case, plant)
    points = balances_along(result.controller, true, result.trajectory, 10, pushed=False)
    naive, required = float(points.push.max()), float(points.required.max())
    if required < 1e-9:
        raise NoValueError("nothing pushes s away here")
    note = f"{naive:.3g} rad/s² sized so, {required:.3g} rad/s² required"
    return of(result, naive / required, note)
