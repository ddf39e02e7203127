"""The chapter's claims about the cart-pendulum, section 3.4."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from grosmc_mj.chapter.claims.claim import ClaimValue
from grosmc_mj.chapter.claims.measurements.measures import equation_error, from_optimum, from_run
from grosmc_mj.experiments.experiment import RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.theory.plants.cart_pendulum import CartPendulumParameters

_SYSTEM = "cart_pendulum"
# Angles at the start that are tried [deg].
_ANGLES = range(5, 90, 5)
# Duration of their runs [s].
_DURATION = 6.0
_LARGER = (BodyEdit("pole", mass_scale=4.0, length_scale=4.0),)
_SYMBOLS = {"eta": "η", "gamma0": "γ0", "gamma1": "γ1"}


def from_two_seconds(
    lab: RunCache,
    plant: PlantName,
    *,
    controller: str,
    band: float,
) -> ClaimValue:
    """Measure the difference of settling to a band [%] from 2 s, in percent."""
    result = lab.case(_SYSTEM, "nominal", plant, controller)
    theta = result.comparison.z[:, 0]
    settled = result.settled(result.comparison.z, band / 100 * abs(float(theta[0])))
    if settled is None:
        return from_run(result, None, f"{controller} does not settle")
    return ClaimValue(50 * abs(settled - 2.0), f"at {settled:.3g} s")


def largest_start(
    lab: RunCache,
    plant: PlantName,
    *,
    controller: str,
    perturbed: bool = False,
    within_percent: float = math.inf,
) -> ClaimValue:
    """Measure the largest start angle up to which every one converges within the region.

    There is no value if the least start fails already: the law has no region then.

    Args:
        lab: Cache of the runs.
        plant: Plant of the runs.
        controller: Law whose region is measured.
        perturbed: Whether the pole is four times as long and heavy.
        within_percent: How far from its optimum a response may go, in percent of the start.
    """
    edits = _LARGER if perturbed else ()
    largest = None
    result = None
    for angle in _ANGLES:
        x0 = (0.0, -math.radians(angle), 0.0, 0.0)
        result = lab.run(trial(_SYSTEM, "start", x0, _DURATION, edits), plant, controller)
        if not _converged(result):
            return ClaimValue(largest, f"not from {angle} degrees")
        distance = from_optimum(result)
        if distance > within_percent:
            return ClaimValue(largest, f"from {angle} degrees it goes {distance:.3g} % astray")
        largest = float(angle)

    assert result is not None
    words = [f"up to {result.metrics['max_input'].value:.3g} N"]
    gains = result.controller.designed.gains
    for name, symbol in _SYMBOLS.items():
        if name in gains:
            words.append(f"{symbol} = {gains[name]:.3g}")
    return ClaimValue(largest, f"from every angle tried; {', '.join(words)}")


def _converged(result: RunResult) -> bool:
    """Whether a run stayed in the laws' region and settled."""
    return not from_run(result, None).broken and result.metrics["settling_time"].value is not None


def acceleration_error(lab: RunCache, plant: PlantName) -> ClaimValue:
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
