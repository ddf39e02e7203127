"""The chapter's claims about the cart-pendulum, section 3.4."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from grosmc_mj.chapter.claims.claim import Claim, Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measures import (
    ALL,
    SAME,
    SAME_WHY,
    SENSITIVE,
    SENSITIVE_WHY,
    Measure,
    changed_response,
    deviation,
    excess_cost,
    from_optimum,
    gains,
    leaving_the_surface,
    of,
    outputs,
    signals,
    within,
)
from grosmc_mj.experiments.experiment import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants.cart_pendulum import CartPendulumParameters
from grosmc_mj.premises.balance import balance
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status

_SYSTEM = "cart_pendulum"
_ANGLES = range(5, 90, 5)
_LARGER = (BodyEdit("pole", mass_scale=4.0, length_scale=4.0),)


def _about_two_seconds(controller: str) -> Measure:
    """Distance of the settling time from 2 s."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(_SYSTEM, "nominal", plant, controller)
        found = result.metrics["settling_time"]
        off = None if found.value is None else abs(found.value - 2.0)
        note = found.note or f"settles in {found.value:.3g} s"
        return of(result, off, note)

    return measure


def _held(controller: str) -> Measure:
    """Largest |θ| while d(t) acts."""

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        result = lab.case(_SYSTEM, "case2", plant, controller)
        after = within(result.comparison.time, 9.0)
        if not after.any():
            return Measured(None, result.ended, broken=True)
        return of(result, 1e3 * float(np.abs(result.comparison.z[after, 0]).max()))

    return measure


def _largest_start(
    controller: str, edits: tuple[BodyEdit, ...], within_percent: float = math.inf
) -> Measure:
    """The largest start angle such that it and every smaller one converge within the region.

    Args:
        controller: Whose region.
        edits: Of the pole.
        within_percent: How far from its optimum a response may go, in percent of the start.
    """

    def measure(lab: Laboratory, plant: PlantName) -> Measured:
        cases = [
            trial(_SYSTEM, "start", (0.0, -math.radians(angle), 0.0, 0.0), 6.0, edits)
            for angle in _ANGLES
        ]
        key = ("region", controller, edits, plant)
        law, runs = lab.once(key, lambda: lab.batch(cases, plant, controller))
        reached = 0
        for index, angle in enumerate(_ANGLES):
            theta = runs.state[index, :, 1]
            kept = runs.status[index] is Status.COMPLETED and np.abs(theta).max() < math.pi / 2
            if not (kept and abs(theta[-1]) <= 0.02 * math.radians(angle)):
                return Measured(float(reached), f"not from {angle} degrees")
            away = from_optimum(compare_with_optimum(runs[index], law))
            if away > within_percent:
                return Measured(float(reached), f"from {angle} degrees it goes {away:.3g} % astray")
            reached = angle
        return Measured(float(reached), "from every angle tried")

    return measure


def _final_speed(lab: Laboratory, plant: PlantName) -> Measured:
    """Speed of the cart when the pole has long been at rest [m/s]."""
    result = lab.case(_SYSTEM, "case2", plant, "grosmc")
    run = result.trajectory
    travel = float(np.abs(run.state[:, 0]).max())
    at_rest = within(run.time, 6.0, 9.0)
    if not at_rest.any():
        return Measured(None, result.ended, broken=True)
    note = f"it travels {travel:.3g} m in {run.time[-1]:g} s"
    return of(result, float(np.abs(run.state[at_rest, 2]).min()), note)


def _acceleration(lab: Laboratory, plant: PlantName) -> Measured:
    """Largest difference of theta'' from Lagrange's equations, in percent of the largest term."""
    case = find_experiment(_SYSTEM, "nominal")
    derivative = lab.derivative(lab.plant(case, plant))
    random, worst = np.random.default_rng(0), 0.0
    for _ in range(300):
        x = np.array([0.0, random.uniform(-1.2, 1.2), 0.0, random.uniform(-5, 5)])
        u = random.uniform(-10, 10)
        terms = np.array(_lagrange(x, u))
        found = derivative(x, u, np.zeros(12))[3]
        worst = max(worst, abs(found - terms.sum()) / np.abs(terms).max())
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


def _naive_gain(lab: Laboratory, plant: PlantName) -> Measured:
    """A gain sized on u_c alone, over the required one, in case 1 along the run."""
    case = find_experiment(_SYSTEM, "case1")
    result = lab.run(case, plant, "grosmc")
    true = lab.equations(case, plant)
    law, run = result.controller, result.trajectory
    naive = required = 0.0
    for row in range(0, len(run.time) - 1, 10):
        found = balance(law, true, float(run.time[row]), run.state[row], np.zeros(12))
        naive = max(naive, found.push)
        required = max(required, found.required)
    if required < 1e-9:
        return Measured(None, "nothing pushes s away here", broken=True)
    return of(
        result, naive / required, f"{naive:.3g} rad/s² sized so, {required:.3g} rad/s² required"
    )


def _travel(lab: Laboratory) -> Drawing:
    """The cart's position."""
    curves = []
    for name, label in (("lqr", "LQR"), ("grosmc", "GROSMC")):
        run = lab.case(_SYSTEM, "case2", "physics", name).trajectory
        curves.append(Curve(label, run.time, run.state[:, 0], name))
    return Drawing("time t [s]", "cart position p [m]", curves)


def _close_up(lab: Laboratory) -> Drawing:
    """The pole's angle under d(t), magnified."""
    curves = []
    for name, label in (("lqr", "LQR"), ("grosmc", "GROSMC")):
        found = lab.case(_SYSTEM, "case2", "physics", name).comparison
        after = within(found.time, 8.0)
        curves.append(Curve(label, found.time[after], 1e3 * found.z[after, 0], name))
    return Drawing("time t [s]", "pole angle θ [mrad]", curves)


CLAIMS = (
    Claim(
        id="pendulum-variation-grosmc",
        system=_SYSTEM,
        statement="Under 4m and 4L the robust law's response is exactly the nominal one",
        source="section 3.4, Fig. 3, eqs. (31)+(37)",
        criterion="max |θ of case 1 - θ nominal|, at most 2 % of the start angle",
        why=SAME_WHY,
        measure=changed_response(_SYSTEM, "case1", "grosmc"),
        sense="at most",
        threshold=SAME,
        unit="%",
        plants=ALL,
        untested="poles outside 1 to 4 times mass and length; the cart's travel, see pendulum-cart",
        drawing=outputs(_SYSTEM, "case1"),
    ),
    Claim(
        id="pendulum-variation-lqr",
        system=_SYSTEM,
        statement="Under 4m and 4L the LQR's response is obviously different",
        source="section 3.4, Fig. 3",
        criterion="max |θ of case 1 - θ nominal|, at least 10 % of the start angle",
        why=SENSITIVE_WHY,
        measure=changed_response(_SYSTEM, "case1", "lqr"),
        sense="at least",
        threshold=SENSITIVE,
        unit="%",
        plants=ALL,
        untested="other weights; the chapter prints none",
        drawing=outputs(_SYSTEM, "case1"),
    ),
    Claim(
        id="pendulum-variation-fl",
        system=_SYSTEM,
        statement="Feedback linearization needs the sliding mode: alone it is not robust",
        source="section 3.3.1, eqs. (23)+(28)",
        criterion="max |θ - θ*| in case 1 without sliding mode, at least 10 % of the start angle",
        why=SENSITIVE_WHY,
        measure=deviation(_SYSTEM, "case1", "fl-lqr"),
        sense="at least",
        threshold=SENSITIVE,
        unit="%",
        plants=ALL,
        untested="smaller variations",
        drawing=outputs(_SYSTEM, "case1", ("lqr", "fl-lqr", "grosmc")),
    ),
    Claim(
        id="pendulum-rest-grosmc",
        system=_SYSTEM,
        statement="The robust law brings the pole to rest at about 2 s",
        source="section 3.4, Fig. 4",
        criterion="distance of the 2 % settling time from 2 s, at most 0.5 s",
        why="about 2 s, read to half a second",
        sense="at most",
        threshold=0.5,
        unit="s",
        plants=ALL,
        untested="the chapter's own weights: it prints none, these are chosen to settle so",
        drawing=outputs(_SYSTEM, "nominal"),
        measure=_about_two_seconds("grosmc"),
    ),
    Claim(
        id="pendulum-rest-lqr",
        system=_SYSTEM,
        statement="The LQR brings the pole to rest at about 2 s too",
        source="section 3.4, Fig. 4",
        criterion="distance of the 2 % settling time from 2 s, at most 0.5 s",
        why="about 2 s, read to half a second",
        sense="at most",
        threshold=0.5,
        unit="s",
        plants=ALL,
        untested="other weights than those declared: with Q = diag(400, 100) both settle at 2 s",
        drawing=outputs(_SYSTEM, "nominal"),
        measure=_about_two_seconds("lqr"),
    ),
    Claim(
        id="pendulum-disturbance-grosmc",
        system=_SYSTEM,
        statement="Under d(t) the robust law keeps the equilibrium",
        source="section 3.4, Fig. 4",
        criterion="max |θ| from 9 s on, at most 1.7 mrad",
        why="1 % of the start angle: a plot of Fig. 4's scale shows no less",
        sense="at most",
        threshold=1.7,
        unit="mrad",
        plants=ALL,
        untested="larger disturbances",
        drawing=_close_up,
        measure=_held("grosmc"),
    ),
    Claim(
        id="pendulum-disturbance-lqr",
        system=_SYSTEM,
        statement="Under d(t) the LQR does not keep the equilibrium",
        source="section 3.4, Fig. 4",
        criterion="max |θ| from 9 s on, at least 1.7 mrad",
        why="1 % of the start angle: a plot of Fig. 4's scale shows no less",
        sense="at least",
        threshold=1.7,
        unit="mrad",
        plants=ALL,
        untested="larger disturbances: 0.01 rad/s² is a thousandth of what gravity does at 0.7 rad",
        defect=True,
        equation=r"d(t) = 0.01\sin 2t\ \mathrm{rad/s^2}",
        drawing=_close_up,
        measure=_held("lqr"),
    ),
    Claim(
        id="pendulum-sliding",
        system=_SYSTEM,
        statement="The motion slides from the beginning, without a reaching phase",
        source="section 3.4, Fig. 5, eq. (31)",
        criterion="sampled: max |s| in case 1 over one sample's worth of switching, at most 1",
        why="a sampled law cannot do better than one sample; more means that s was pushed away",
        measure=leaving_the_surface(_SYSTEM, "case1"),
        sense="at most",
        threshold=1.0,
        unit="1",
        plants=ALL,
        untested="measurement noise and delay",
        drawing=signals(_SYSTEM, "case1", "s"),
    ),
    Claim(
        id="pendulum-index",
        system=_SYSTEM,
        statement="On the sliding motion the index (27), of v_0 alone, is J*",
        source="section 3.5, eqs. (27), (34)",
        criterion="J with v_0 over J*, less 1, in case 1, at most 1 %",
        why="sampling at 1 kHz costs a few tenths of a percent",
        measure=excess_cost(_SYSTEM, "case1", "cost_continuous"),
        sense="at most",
        threshold=1.0,
        unit="%",
        plants=ALL,
        untested="the same index with the whole v, see servo-whole-cost",
    ),
    Claim(
        id="pendulum-region",
        system=_SYSTEM,
        statement="The law applies to the entire transformation region, |θ| < 90 degrees",
        source="section 3.5",
        criterion="largest start angle (5 to 85 degrees) that converges within 6 s, at least 85",
        why="the edge of the region on a grid of 5 degrees",
        measure=_largest_start("grosmc", ()),
        sense="at least",
        threshold=85.0,
        unit="degrees",
        plants=ALL,
        untested="starts with a rate; limits of the force, which grows without bound at 90 degrees",
    ),
    Claim(
        id="pendulum-region-perturbed",
        system=_SYSTEM,
        statement="It converges from all of it under parameter variations too",
        source="section 3.5",
        criterion="the same under 4m and 4L",
        why="the edge of the region on a grid of 5 degrees",
        measure=_largest_start("grosmc", _LARGER),
        sense="at least",
        threshold=85.0,
        unit="degrees",
        plants=ALL,
        untested="the way there, see pendulum-region-robust",
    ),
    Claim(
        id="pendulum-region-robust",
        system=_SYSTEM,
        statement="There it is globally robust: the response stays the nominal one",
        source="section 3.5, Theorem 2",
        criterion="largest start with max |θ - θ*| at most 2 % of it under 4m and 4L, at least 85",
        why="the edge of the region on a grid of 5 degrees; 2 % is what counts as the same",
        measure=_largest_start("grosmc", _LARGER, SAME),
        sense="at least",
        threshold=85.0,
        unit="degrees",
        plants=ALL,
        untested="gains declared for more than |θ| <= 30 degrees",
    ),
    Claim(
        id="pendulum-region-lqr",
        system=_SYSTEM,
        statement="A linear design works in a small neighbourhood of the equilibrium only",
        source="sections 1 and 3.5",
        criterion="largest start angle (5 to 85 degrees) from which LQR converges, at most 30",
        why="within 30 degrees sin θ is θ to 5 %: what a linear design takes for granted",
        measure=_largest_start("lqr", ()),
        sense="at most",
        threshold=30.0,
        unit="degrees",
        plants=ALL,
        untested="other weights of the linear design",
    ),
    Claim(
        id="pendulum-cart",
        system=_SYSTEM,
        statement="Global robustness, read for the whole machine: all of it comes to rest",
        source="section 3.5, eq. (40)",
        criterion="least speed of the cart between 6 s and 9 s, at most 0.05 m/s",
        why="at 5 cm/s a cart still leaves a laboratory's rail within half a minute",
        measure=_final_speed,
        sense="at most",
        threshold=0.05,
        unit="m/s",
        plants=ALL,
        untested="friction of the cart, which would stop it; a law that holds the cart too",
        defect=True,
        equation=r"(M+m)\ddot p = u + mL(\ddot\theta\cos\theta - \dot\theta^2\sin\theta)"
        r"\quad\text{is in no state of (40)}",
        drawing=_travel,
    ),
    Claim(
        id="pendulum-eq40",
        system=_SYSTEM,
        statement="Eq. (40) describes a cart with a pendulum",
        source="section 3.4, eq. (40), a = m/(M+m)",
        criterion="largest difference of θ'' from Lagrange's equations, at most 1e-8 % of a term",
        why="rounding: a true equation has no other difference",
        measure=_acceleration,
        sense="at most",
        threshold=1e-8,
        unit="%",
        plants=("corrected", "physics", "printed"),
        untested="friction; a pole that is no uniform rod",
        defect=True,
        exact=True,
        equation=r"a = \frac{m}{M+m}\ \text{(printed)},\qquad a = \frac{1}{M+m}\ \text{(Lagrange)}",
    ),
    Claim(
        id="pendulum-naive-gain",
        system=_SYSTEM,
        statement="A bound on the uncertainty under u_c is enough for the gain",
        source="Assumption 6, eq. (37), case 1",
        criterion="gain sized on u_c alone over the required one, along the run, at least 1",
        why="below 1 the law (37) cannot hold the surface",
        measure=_naive_gain,
        sense="at least",
        threshold=1.0,
        unit="1",
        plants=ALL,
        untested="smaller variations",
        defect=True,
        equation=r"r = \frac{E_\text{true}}{E_\text{nominal}} \approx 0.22 \;\Rightarrow\; "
        r"|u_d| \ge \tfrac1r\,|\ldots + (r-1)u_c|",
        drawing=gains(_SYSTEM, "case1"),
    ),
)
