"""Claims about the laws that hold pole and cart, and about what is unmatched then.

The chapter has no such law: these statements are what section 2 promises, read for four states.
All are measured with the ledger's own sign function and printed surface. They chatter (95 N under
case 1), but angle and cart come out as with the implicit law to 1 % of the start, and halving the
sampling time then tests the same realization as in the rest of the ledger.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum.cart import LEAN, holding_ism, holding_lqr
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of, within
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.reaching import mismatch, sliding_dynamics
from grosmc_mj.control.task import Realization
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics.definitions import SETTLING_BAND
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.results.palette import LABELS
from grosmc_mj.simulation.trajectory import Status

SYSTEM = "cart_pendulum"
# [s]: the cart takes longer than the pole; case 2 begins its disturbance at 9 s.
HORIZONS = {"nominal": 20.0, "case1": 20.0, "case2": 30.0}
# The cart has settled within this of the origin [m].
CART_BAND = 0.02
# Changes of the pole: matched in mass, not in length.
UNCERTAINTIES = {
    "4m": BodyEdit("pole", mass_scale=4.0),
    "4L": BodyEdit("pole", length_scale=4.0),
    "4m, 4L": BodyEdit("pole", mass_scale=4.0, length_scale=4.0),
}
ALONE = "LQR alone"
# A run is judged by what it does in its last part [s].
_LAST = 5.0
# What is largest in the first second or two is looked at for this long [s].
_SHORT = 8.0
_STARTS = range(5, 65, 5)
# A cart that is held stiffly: what makes the unmatched length cost most.
_STIFF = np.diag([10.0, 100.0, 1.0, 1.0])


def holding_case(name: str) -> Experiment:
    """A case of the chapter over the time that the cart needs."""
    return find_experiment(SYSTEM, name).varied(duration=HORIZONS[name])


def rail_half_length(plant: MujocoPlant) -> float:
    """How far the cart's centre can go to either side [m], from the drawn rail."""
    rail = plant.model.geom("rail")
    return float(rail.size[0] - abs(rail.pos[0]))


def projections_of(optimum: LqrDesign) -> dict[str, Array | None]:
    """The choices of G that are compared, (1, 4) each, and LQR without any."""
    return {
        "B+": np.linalg.pinv(optimum.B),
        "[0 0 1 0]": np.array([[0.0, 0.0, 1.0, 0.0]]),
        "[0 0 0 1]": np.array([[0.0, 0.0, 0.0, 1.0]]),
        "B'P": optimum.B.T @ optimum.P,
        ALONE: None,
    }


def projected_law(G: Array | None, realization: Realization) -> Controller:
    """cart-ism with this G, or cart-lqr.

    Raises:
        GainError: If no switching gain holds the declared family with it.
    """
    physics = MujocoPlant.load(SYSTEM)
    if G is None:
        return holding_lqr(physics.analytic(), linearize(physics))
    return realized(holding_ism(physics.analytic(), linearize(physics), G=G), realization)


def uncertainty(optimum: LqrDesign, model: tuple[Array, Array]) -> tuple[Array, Array]:
    """The matched and the unmatched part of dA - dB K, (n, n) each."""
    added, matched = mismatch(optimum, *model)
    return matched, added - matched


def amplification(optimum: LqrDesign, G: Array | None, model: tuple[Array, Array]) -> float | None:
    """|(I - B (G B)^-1 G) phi_u| / |phi_u| in the spectral norm; None if nothing is unmatched.

    On s = 0 the switching input answers phi_u with -(G B)^-1 G phi_u, which adds to it.
    """
    matched, unmatched = uncertainty(optimum, model)
    size = float(np.linalg.norm(unmatched, 2))
    if G is None or size <= 1e-9 * np.linalg.norm(matched, 2):
        return None
    answered = unmatched - optimum.B @ np.linalg.solve(G @ optimum.B, G @ unmatched)
    return float(np.linalg.norm(answered, 2) / size)


def slowest_pole(optimum: LqrDesign, G: Array | None, model: tuple[Array, Array]) -> float:
    """Largest real part of the sliding dynamics or, without G, of A_t - B_t K [1/s]."""
    A_t, B_t = model
    loop = A_t - B_t @ optimum.K if G is None else sliding_dynamics(optimum, G, A_t, B_t)
    return float(np.linalg.eigvals(loop).real.max())


def distance_from_hold(lab: Laboratory, plant: PlantName, *, controller: str) -> Measured:
    """The worse of cart and angle at the end of cases 1 and 2, in units of their bands."""
    worst, notes = 0.0, []
    rail = rail_half_length(MujocoPlant.load(SYSTEM))
    for name in ("case1", "case2"):
        result = lab.run(holding_case(name), plant, controller)
        x, time = result.trajectory.state, result.trajectory.time
        if result.status is not Status.COMPLETED:
            return of(result, None)
        late = within(time, result.case.duration - _LAST)
        cart, angle = (float(np.abs(x[late, i]).max()) for i in (0, 1))
        travel = float(np.abs(x[:, 0]).max())
        band = SETTLING_BAND * abs(result.case.x0[1])
        # Off the rail it is not held, wherever it ends.
        off = travel if travel > rail else cart
        worst = max(worst, off / CART_BAND, angle / band)
        notes.append(
            f"{name}: |p| {1e3 * cart:.2g} mm, |θ| {1e3 * angle:.2g} mrad, travel {travel:.3g} "
            f"of {rail:g} m"
        )
    return Measured(worst, "; ".join(notes))


def _trial(edit: BodyEdit) -> Experiment:
    """The chapter's start with one edit of the pole."""
    return trial(SYSTEM, "pole", find_experiment(SYSTEM, "nominal").case.x0, _SHORT, (edit,))


def deviation(lab: Laboratory, plant: PlantName, *, what: str) -> Measured:
    """max |θ - θ*| of cart-ism under one uncertainty, in percent of the start."""
    result = lab.run(_trial(UNCERTAINTIES[what]), plant, "cart-ism")
    return of(result, from_optimum(result.comparison))


def _optimum(lab: Laboratory, plant: PlantName) -> LqrDesign:
    """The optimum of cart-ism as it is used."""
    return lab.controller(holding_case("case1"), plant, "cart-ism").designed.lqr


def amplification_by_pseudoinverse(lab: Laboratory, plant: PlantName) -> Measured:
    """What B+ adds to the unmatched uncertainty, in percent of it."""
    return _unmatched(lab, plant, _amplified)


def slowest_pole_loss(lab: Laboratory, plant: PlantName) -> Measured:
    """How far the sliding dynamics' pole lies right of LQR's, with the stiff weights [1/s]."""
    return _unmatched(lab, plant, _worse)


def _unmatched(
    lab: Laboratory,
    plant: PlantName,
    measure: Callable[[LqrDesign, tuple[np.ndarray, np.ndarray]], Measured],
) -> Measured:
    """A measurement on the linear model of case 1; there is none where all of it is matched."""
    model = lab.plant(holding_case("case1"), plant).linearization()
    optimum = _optimum(lab, plant)
    if amplification(optimum, projections_of(optimum)["B+"], model) is None:
        return Measured(None, "nothing is unmatched here", broken=True)
    return measure(optimum, model)


def _amplified(optimum: LqrDesign, model: tuple[np.ndarray, np.ndarray]) -> Measured:
    """The factors of all projections, and what that of B+ adds."""
    factors = {
        name: amplification(optimum, G, model) for name, G in projections_of(optimum).items()
    }
    words = ", ".join(f"{name} {value:.3f}" for name, value in factors.items() if value is not None)
    value = factors["B+"]
    return Measured(None if value is None else 100 * (value - 1), f"amplification: {words}")


def _worse(optimum: LqrDesign, model: tuple[np.ndarray, np.ndarray]) -> Measured:
    """The slowest poles with the stiff and with the declared weights."""
    stiff = lqr(optimum.A, optimum.B, _STIFF, 1.0)
    declared, poles = (
        {name: slowest_pole(design, G, model) for name, G in projections_of(design).items()}
        for design in (optimum, stiff)
    )
    note = (
        f"poles at {poles['B+']:.3g} and, LQR alone, {poles[ALONE]:.3g} 1/s; with the declared "
        f"weights {declared['B+']:.3g} and {declared[ALONE]:.3g} 1/s"
    )
    return Measured(poles["B+"] - poles[ALONE], note)


def deviation_over_least(lab: Laboratory, plant: PlantName) -> Measured:
    """Deviation with G = B+ over the least of the others', in case 1."""
    case = holding_case("case1").varied(duration=_SHORT)
    away, worst = {}, None
    for name, G in projections_of(_optimum(lab, plant)).items():
        if name == "B+":
            result = lab.run(case, plant, "cart-ism")
        else:
            law = projected_law(G, case.with_settings(**lab.settings.changes()).realization)
            result = lab.run_with(case, plant, law)
        if result.status is not Status.COMPLETED:
            worst = result
        away[name] = from_optimum(result.comparison)
    words = ", ".join(f"{name} {value:.3g} %" for name, value in away.items())
    ratio = away["B+"] / min(value for name, value in away.items() if name != "B+")
    return Measured(ratio, words) if worst is None else of(worst, ratio)


def lean_excess(lab: Laboratory, plant: PlantName) -> Measured:
    """How far |θ| under cart-pfl goes beyond its start or the lean asked for, in percent."""
    cases = [
        _trial(UNCERTAINTIES["4m, 4L"]).varied(x0=(0.0, -math.radians(angle), 0.0, 0.0))
        for angle in _STARTS
    ]
    _, runs = lab.batch(cases, plant, "cart-pfl")
    worst, note = -math.inf, ""
    for index, angle in enumerate(_STARTS):
        if runs.status[index] is not Status.COMPLETED:
            return Measured(None, f"not from {angle} degrees", broken=True)
        largest = float(np.abs(runs.state[index, :, 1]).max())
        beyond = 100 * (largest / max(math.radians(angle), LEAN) - 1)
        if beyond > worst:
            worst = beyond
            note = f"from {angle} degrees |θ| <= {largest:.4g} rad; asked for: {LEAN:g} rad"
    return Measured(worst, note)


def paths(lab: Laboratory) -> Drawing:
    """The cart's position in case 1."""
    curves = []
    for name in ("cart-lqr", "cart-ism", "cart-pfl"):
        run = lab.run(holding_case("case1"), "physics", name).trajectory
        curves.append(Curve(LABELS[name], run.time, run.state[:, 0], name))
    return Drawing("time t [s]", "cart position p [m]", curves)


def angles(lab: Laboratory) -> Drawing:
    """The pole's angle under each uncertainty, and the optimum."""
    curves = []
    for what, colour in (("4m", "cart-ism"), ("4L", "cart-pfl")):
        result = lab.run(_trial(UNCERTAINTIES[what]), "physics", "cart-ism")
        run = result.trajectory
        curves.append(Curve(f"{LABELS['cart-ism']}, {what}", run.time, run.state[:, 1], colour))
    comparison = lab.run(_trial(UNCERTAINTIES["4m"]), "physics", "cart-ism").comparison
    curves.append(Curve("nominal optimum", comparison.time, comparison.optimum[:, 0]))
    return Drawing("time t [s]", "pole angle θ [rad]", curves)
