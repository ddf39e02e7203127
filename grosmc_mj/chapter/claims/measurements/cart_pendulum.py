"""The chapter's claims about the cart-pendulum, section 3.4."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    equation_error,
    from_optimum,
    from_run,
    within,
)
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters
from grosmc_mj.requirements.error_metrics import settling_time
from grosmc_mj.requirements.optimum import compare_with_optimum
from grosmc_mj.simulation.trajectory import Status, Trajectory

_SYSTEM = "cart_pendulum"
# Angles at the start that are tried [deg].
_ANGLES = range(5, 90, 5)
_LARGER = (BodyEdit("pole", mass_scale=4.0, length_scale=4.0),)
_SYMBOLS = {"eta": "η", "gamma0": "γ0", "gamma1": "γ1"}


def from_two_seconds(
    lab: RunCache,
    plant: PlantName,
    *,
    controller: str,
    band: float,
) -> Measured:
    """Measure the difference of settling to a band [%] from 2 s, in percent."""
    result = lab.case(_SYSTEM, "nominal", plant, controller)
    theta = result.comparison.z[:, 0]
    settled = settling_time(result.comparison.time, theta, band / 100 * abs(theta[0])).value
    if settled is None:
        return from_run(result, None, f"{controller} does not settle")
    return Measured(50 * abs(settled - 2.0), f"at {settled:.3g} s")


def largest_start(
    lab: RunCache,
    plant: PlantName,
    *,
    controller: str,
    perturbed: bool = False,
    within_percent: float = math.inf,
) -> Measured:
    """Measure the largest start angle up to which every one converges within the region.

    There is no value if the least start fails already: the law has no region then.

    Args:
        lab: Cache of the runs.
        plant: Plant of the runs.
        controller: Law whose region is measured.
        perturbed: Whether the pole is four times as long and heavy.
        within_percent: How far from its optimum a response may go, in percent of the start.
    """
    edits = ()
    if perturbed:
        edits = _LARGER
    cases = []
    for angle in _ANGLES:
        x0 = (0.0, -math.radians(angle), 0.0, 0.0)
        cases.append(trial(_SYSTEM, "start", x0, 6.0, edits))
    key = ("region", controller, edits, plant)
    law, runs = lab.once(key, lambda: lab.batch(cases, plant, controller))

    largest = None
    for index, angle in enumerate(_ANGLES):
        run = runs[index]
        if not _converged(run, math.radians(angle)):
            return Measured(largest, f"not from {angle} degrees")
        distance = from_optimum(compare_with_optimum(run, law))
        if distance > within_percent:
            return Measured(largest, f"from {angle} degrees it goes {distance:.3g} % astray")
        largest = float(angle)

    gains = law.designed.gains
    words = [f"up to {np.abs(runs.input[-1]).max():.3g} N"]
    for name, symbol in _SYMBOLS.items():
        if name in gains:
            words.append(f"{symbol} = {gains[name]:.3g}")
    return Measured(largest, f"from every angle tried; {', '.join(words)}")


def _converged(run: Trajectory, start: float) -> bool:
    """Whether a run from an angle [rad] stayed in the region and came to rest."""
    if run.status is not Status.COMPLETED:
        return False
    theta = np.abs(run.state[:, 1])
    return bool(theta.max() < math.pi / 2 and theta[-1] <= 0.02 * start)


def final_cart_speed(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the speed of the cart when the pole has long been at rest [m/s]."""
    result = lab.case(_SYSTEM, "case2", plant, "grosmc")
    run = result.trajectory
    at_rest = within(run.time, 6.0, 9.0)
    speed = float(np.abs(run.state[at_rest, 2]).min())
    travel = np.abs(run.state[:, 0]).max()
    return from_run(result, speed, f"it travels {travel:.3g} m in {run.time[-1]:g} s")


def acceleration_error(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the largest error of theta'' against Lagrange, in percent of the largest term."""
    p = MujocoPlant.load(_SYSTEM).analytic().parameters
    return equation_error(lab, plant, _SYSTEM, (1.2, 5.0, 10.0), partial(_lagrange, p))


def _lagrange(
    p: CartPendulumParameters, theta: float, rate: float, u: float
) -> tuple[float, list[float]]:
    """The terms of theta'' of a cart with a uniform rod, from its mass matrix.

    Independent of eq. (40):

        (M + m) p'' - m L cos(theta) theta'' = u - m L sin(theta) theta'^2
        -m L cos(theta) p'' + 4/3 m L^2 theta'' = m g L sin(theta)
    """
    m = p.m
    L = p.L
    s = math.sin(theta)
    c = math.cos(theta)
    coupling = -m * L * c
    mass = np.array([[p.M + m, coupling], [coupling, 4 / 3 * m * L * L]])
    gravity = [0.0, m * p.g * L * s]
    centrifugal = [-m * L * s * rate**2, 0.0]
    accelerations = []
    for force in (gravity, centrifugal, [u, 0.0]):
        acceleration = np.linalg.solve(mass, force)
        accelerations.append(float(acceleration[1]))
    return 1.0, accelerations


def naive_gain(lab: RunCache, plant: PlantName) -> Measured:
    """Measure a gain sized on u_c alone, over the required one, in case 1 along the run.

    Raises:
        NoValueError: If nothing pushes s away.
    """
    case = find_experiment(_SYSTEM, "case1")
    result = lab.run(case, plant, "grosmc")
    true = lab.equations(case, plant)
    points = balances_along(result.controller, true, result.trajectory, 10, pushed=False)
    naive = float(points.push.max())
    required = float(points.required.max())
    if required < 1e-9:
        raise NoValueError("nothing pushes s away here")
    note = f"{naive:.3g} rad/s² sized so, {required:.3g} rad/s² required"
    return from_run(result, naive / required, note)
