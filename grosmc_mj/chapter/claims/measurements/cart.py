"""Claims about the laws that hold pole and cart, and about what is unmatched then.

The chapter has no such law: these statements are what section 2 promises, read for four states.
All are measured with the ledger's own sign function and printed surface. They chatter (95 N under
case 1), but angle and cart come out as with the implicit law to 1 % of the start, and halving the
sampling time then tests the same realization as in the rest of the ledger.
"""

from __future__ import annotations

import math

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum.cart import LEAN, holding_ism, holding_lqr
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of, within
from grosmc_mj.chapter.claims.measurements.theory import varied
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.lqr import LqrDesign, lqr
from grosmc_mj.control.reaching import mismatch, sliding_dynamics
from grosmc_mj.control.task import Realization
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import SETTLING_BAND
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
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
# A run is judged by its last part [s].
_LAST = 5.0
# What is largest in the first second or two is looked at for this long [s].
_SHORT = 8.0
_STARTS = range(5, 65, 5)
# A cart that is held stiffly: with it the unmatched length costs most.
_STIFF = np.diag([10.0, 100.0, 1.0, 1.0])

Model = tuple[Array, Array]


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


def uncertainty(optimum: LqrDesign, model: Model) -> tuple[Array, Array]:
    """The matched and the unmatched part of dA - dB K, (n, n) each."""
    added, matched = mismatch(optimum, *model)
    return matched, added - matched


def amplification(optimum: LqrDesign, G: Array | None, model: Model) -> float | None:
    """|(I - B (G B)^-1 G) phi_u| / |phi_u| in the spectral norm; None if nothing is unmatched.

    On s = 0 the switching input answers phi_u with -(G B)^-1 G phi_u, which adds to it.
    """
    matched, unmatched = uncertainty(optimum, model)
    size = float(np.linalg.norm(unmatched, 2))
    if G is None or size <= 1e-9 * np.linalg.norm(matched, 2):
        return None
    answered = unmatched - optimum.B @ np.linalg.solve(G @ optimum.B, G @ unmatched)
    return float(np.linalg.norm(answered, 2) / size)


def _slowest_pole(optimum: LqrDesign, G: Array | None, model: Model) -> float:
    """Largest real part of the sliding dynamics or, without G, of A_t - B_t K [1/s]."""
    A_t, B_t = model
    loop = A_t - B_t @ optimum.K if G is None else sliding_dynamics(optimum, G, A_t, B_t)
    return float(np.linalg.eigvals(loop).real.max())


def distance_from_hold(
    lab: Laboratory, plant: PlantName, *, case: str, controller: str
) -> Measured:
    """The worse of cart and angle at the end of a case, in units of their bands."""
    result = lab.run(holding_case(case), plant, controller)
    rail = rail_half_length(MujocoPlant.load(SYSTEM))
    if result.status is not Status.COMPLETED:
        return of(result, None)
    x = np.abs(result.trajectory.state)
    late = within(result.trajectory.time, result.case.duration - _LAST)
    cart, angle, travel = x[late, 0].max(), x[late, 1].max(), x[:, 0].max()
    # Off the rail it is not held, wherever it ends.
    off = travel if travel > rail else cart
    note = f"|p| {1e3 * cart:.2g} mm, |θ| {1e3 * angle:.2g} mrad, travel {travel:.3g} of {rail:g} m"
    band = SETTLING_BAND * abs(result.case.x0[1])
    return Measured(float(max(off / CART_BAND, angle / band)), note)


def _pole(uncertainty: str) -> Experiment:
    """The chapter's start with one change of the pole."""
    edit = UNCERTAINTIES[uncertainty]
    return varied(SYSTEM, "pole", _SHORT, edit.mass_scale, edit.length_scale)


def deviation(lab: Laboratory, plant: PlantName, *, uncertainty: str) -> Measured:
    """max |θ - θ*| of cart-ism under one uncertainty, in percent of the start."""
    result = lab.run(_pole(uncertainty), plant, "cart-ism")
    return of(result, from_optimum(result.comparison))


def _optimum(lab: Laboratory, plant: PlantName) -> LqrDesign:
    """The optimum of cart-ism as it is used."""
    return lab.controller(holding_case("case1"), plant, "cart-ism").designed.lqr


def _unmatched_model(lab: Laboratory, plant: PlantName) -> tuple[LqrDesign, Model]:
    """The optimum, and the linear model of case 1.

    Raises:
        NoValueError: If all of its uncertainty is matched.
    """
    model = lab.plant(holding_case("case1"), plant).linearization()
    optimum = _optimum(lab, plant)
    if amplification(optimum, np.linalg.pinv(optimum.B), model) is None:
        raise NoValueError("nothing is unmatched here")
    return optimum, model


def amplification_by_pseudoinverse(lab: Laboratory, plant: PlantName) -> Measured:
    """By how much B+ enlarges the unmatched uncertainty, in percent of it."""
    optimum, model = _unmatched_model(lab, plant)
    factors = {
        name: amplification(optimum, G, model) for name, G in projections_of(optimum).items()
    }
    words = ", ".join(f"{name} {value:.3f}" for name, value in factors.items() if value is not None)
    return Measured(100 * ((factors["B+"] or 0.0) - 1), f"amplification: {words}")


def slowest_pole_loss(lab: Laboratory, plant: PlantName) -> Measured:
    """How far the sliding dynamics' pole lies right of LQR's, with the stiff weights [1/s]."""
    optimum, model = _unmatched_model(lab, plant)
    stiff = lqr(optimum.A, optimum.B, _STIFF, 1.0)
    (ours, alone), declared = (
        [_slowest_pole(design, G, model) for G in (np.linalg.pinv(design.B), None)]
        for design in (stiff, optimum)
    )
    note = (
        f"poles at {ours:.3g} and, LQR alone, {alone:.3g} 1/s; with the declared weights "
        f"{declared[0]:.3g} and {declared[1]:.3g} 1/s"
    )
    return Measured(ours - alone, note)


def deviation_over_least(lab: Laboratory, plant: PlantName) -> Measured:
    """Deviation with G = B+ over the least of the others', in case 1."""
    case = holding_case("case1").varied(duration=_SHORT)
    realization = case.with_settings(**lab.settings.changes()).realization
    results = {
        name: lab.run(case, plant, "cart-ism")
        if name == "B+"
        else lab.run_with(case, plant, projected_law(G, realization))
        for name, G in projections_of(_optimum(lab, plant)).items()
    }
    away = {name: from_optimum(result.comparison) for name, result in results.items()}
    ratio = away["B+"] / min(value for name, value in away.items() if name != "B+")
    for result in results.values():
        if result.status is not Status.COMPLETED:
            return of(result, ratio)
    return Measured(ratio, ", ".join(f"{name} {value:.3g} %" for name, value in away.items()))


def lean_excess(lab: Laboratory, plant: PlantName) -> Measured:
    """How far |θ| under cart-pfl goes beyond its start or the lean asked for, in percent."""
    cases = [_pole("4m, 4L").varied(x0=(0.0, -math.radians(a), 0.0, 0.0)) for a in _STARTS]
    _, runs = lab.batch(cases, plant, "cart-pfl")
    worst = (-math.inf, "")
    for index, angle in enumerate(_STARTS):
        if runs.status[index] is not Status.COMPLETED:
            raise NoValueError(f"not from {angle} degrees")
        largest = float(np.abs(runs.state[index, :, 1]).max())
        beyond = 100 * (largest / max(math.radians(angle), LEAN) - 1)
        note = f"from {angle} degrees |θ| <= {largest:.4g} rad; asked for: {LEAN:g} rad"
        worst = max(worst, (beyond, note))
    return Measured(*worst)
