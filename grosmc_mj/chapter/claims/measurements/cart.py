"""Claims about the laws that hold pole and cart, and about what is unmatched then.

The chapter has no such law: these statements are what section 2 promises, read for four states.
All are measured with the ledger's own sign function and printed surface. They chatter (95 N under
case 1), but angle and cart come out as with the implicit law to 1 % of the start, and halving the
sampling time then tests the same realization as in the rest of the ledger.
"""

from __future__ import annotations

import numpy as np

from grosmc_mj.chapter.claims.claim import ClaimValue, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, from_run, within
from grosmc_mj.chapter.claims.measurements.theory import perturbed
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.requirements.metrics import SETTLING_BAND
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.mechanics.physics.linearization import linearize
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.design import realized
from grosmc_mj.theory.control.kinds.cart import holding_ism, holding_lqr
from grosmc_mj.theory.control.lqr import LqrDesign, lqr
from grosmc_mj.theory.control.reaching import mismatch, sliding_dynamics
from grosmc_mj.theory.control.task import Realization

SYSTEM = "cart_pendulum"
# Durations [s]: the cart takes longer than the pole; case 2 begins its disturbance at 9 s.
HORIZONS = {"nominal": 20.0, "case1": 20.0, "case2": 30.0}
# The cart has settled within this distance of the origin [m].
CART_BAND = 0.02
# Changes of the pole: matched in mass, not in length.
UNCERTAINTIES = {
    "4m": BodyEdit("pole", mass_scale=4.0),
    "4L": BodyEdit("pole", length_scale=4.0),
}
ALONE = "LQR alone"
# A run is judged by its last part [s].
_LAST = 5.0
# Duration of runs whose largest value occurs in the first second or two [s].
_SHORT = 8.0
# Weights that hold the cart stiffly: with them the unmatched length costs most.
_STIFF = np.diag([10.0, 100.0, 1.0, 1.0])

# State and input matrix of a linear model.
Model = tuple[Array, Array]


def holding_case(name: str) -> Experiment:
    """Return a case of the chapter over the time that the cart needs."""
    return find_experiment(SYSTEM, name).changed(duration=HORIZONS[name])


def rail_half_length(plant: MujocoPlant) -> float:
    """Return how far the cart's centre can go to either side [m], from the drawn rail."""
    rail = plant.model.geom("rail")
    return float(rail.size[0] - abs(rail.pos[0]))


def projections_of(optimum: LqrDesign) -> dict[str, Array | None]:
    """Return the choices of G that are compared, (1, 4) each, and LQR without any."""
    return {
        "B+": np.linalg.pinv(optimum.B),
        "[0 0 1 0]": np.array([[0.0, 0.0, 1.0, 0.0]]),
        "[0 0 0 1]": np.array([[0.0, 0.0, 0.0, 1.0]]),
        "B'P": optimum.B.T @ optimum.P,
        ALONE: None,
    }


def projected_law(G: Array | None, realization: Realization) -> Controller:
    """Return cart-ism with this G, or cart-lqr without one.

    Raises:
        GainError: If no switching gain holds the declared family with it.
    """
    physics = MujocoPlant.load(SYSTEM)
    equations = physics.analytic()
    model = linearize(physics)
    if G is None:
        return holding_lqr(equations, model)
    return realized(holding_ism(equations, model, G=G), realization)


def uncertainty(optimum: LqrDesign, model: Model) -> tuple[Array, Array]:
    """Return the matched and the unmatched part of dA - dB K, (n, n) each."""
    added, matched = mismatch(optimum, *model)
    return matched, added - matched


def amplification(optimum: LqrDesign, G: Array | None, model: Model) -> float | None:
    """Return |(I - B (G B)^-1 G) phi_u| / |phi_u| in the spectral norm.

    On s = 0 the switching input answers phi_u with -(G B)^-1 G phi_u, which adds to it.

    Returns:
        None if there is no G, or nothing is unmatched.
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
    loop = A_t - B_t @ optimum.K
    if G is not None:
        loop = sliding_dynamics(optimum, G, A_t, B_t)
    return float(np.linalg.eigvals(loop).real.max())


def distance_from_hold(
    lab: RunCache,
    plant: PlantName,
    *,
    case: str,
    controller: str,
) -> ClaimValue:
    """Measure the worse of cart and angle at the end of a case, in units of their bands."""
    result = lab.run(holding_case(case), plant, controller)
    rail = rail_half_length(MujocoPlant.load(SYSTEM))
    if result.status is not Status.COMPLETED:
        return from_run(result, None)

    x = np.abs(result.trajectory.state)
    late = within(result.trajectory.time, result.case.duration - _LAST)
    cart = x[late, 0].max()
    angle = x[late, 1].max()
    travel = x[:, 0].max()
    note = f"|p| {1e3 * cart:.2g} mm, |θ| {1e3 * angle:.2g} mrad, travel {travel:.3g} of {rail:g} m"

    # A cart that left the rail does not hold, wherever it ends.
    distance = cart
    if travel > rail:
        distance = travel
    band = SETTLING_BAND * abs(result.case.x0[1])
    return ClaimValue(float(max(distance / CART_BAND, angle / band)), note)


def deviation(lab: RunCache, plant: PlantName, *, uncertainty: str) -> ClaimValue:
    """Measure max |θ - θ*| of cart-ism under one uncertainty, in percent of the start."""
    edit = UNCERTAINTIES[uncertainty]
    pole = perturbed(SYSTEM, "pole", _SHORT, edit.mass_scale, edit.length_scale)
    result = lab.run(pole, plant, "cart-ism")
    return from_run(result, from_optimum(result))


def _optimum(lab: RunCache, plant: PlantName) -> LqrDesign:
    """The optimum that cart-ism is designed for."""
    return lab.controller(holding_case("case1"), plant, "cart-ism").designed.lqr


def _unmatched_model(lab: RunCache, plant: PlantName) -> tuple[LqrDesign, Model]:
    """The optimum, and the linear model of case 1.

    Raises:
        NoValueError: If all of its uncertainty is matched.
    """
    model = lab.plant(holding_case("case1"), plant).linearization()
    optimum = _optimum(lab, plant)
    if amplification(optimum, np.linalg.pinv(optimum.B), model) is None:
        raise NoValueError("nothing is unmatched here")
    return optimum, model


def amplification_by_pseudoinverse(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure by how much B+ enlarges the unmatched uncertainty, in percent of it."""
    optimum, model = _unmatched_model(lab, plant)
    factors = {}
    for name, G in projections_of(optimum).items():
        factor = amplification(optimum, G, model)
        if factor is not None:
            factors[name] = factor

    words = ", ".join(f"{name} {factor:.3f}" for name, factor in factors.items())
    return ClaimValue(100 * (factors["B+"] - 1), f"amplification: {words}")


def slowest_pole_loss(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure how far the sliding dynamics' pole lies right of LQR's [1/s].

    The weights are the stiff ones.
    """
    optimum, model = _unmatched_model(lab, plant)
    stiff = lqr(optimum.A, optimum.B, _STIFF, 1.0)
    sliding = _slowest_pole(stiff, np.linalg.pinv(stiff.B), model)
    alone = _slowest_pole(stiff, None, model)

    declared_sliding = _slowest_pole(optimum, np.linalg.pinv(optimum.B), model)
    declared_alone = _slowest_pole(optimum, None, model)
    note = (
        f"poles at {sliding:.3g} and, LQR alone, {alone:.3g} 1/s; with the declared weights "
        f"{declared_sliding:.3g} and {declared_alone:.3g} 1/s"
    )
    return ClaimValue(sliding - alone, note)


def deviation_over_least(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure the deviation with G = B+ over the least with another G, in case 1."""
    case = holding_case("case1").changed(duration=_SHORT)
    realization = case.changed(**lab.settings.changes()).realization
    results = {"B+": lab.run(case, plant, "cart-ism")}
    for name, G in projections_of(_optimum(lab, plant)).items():
        if name != "B+":
            results[name] = lab.run_with(case, plant, projected_law(G, realization))

    deviations = {name: from_optimum(result) for name, result in results.items()}
    words = ", ".join(f"{name} {value:.3g} %" for name, value in deviations.items())
    with_pseudoinverse = deviations.pop("B+")
    ratio = with_pseudoinverse / min(deviations.values())
    for result in results.values():
        if result.status is not Status.COMPLETED:
            return from_run(result, ratio)
    return ClaimValue(ratio, words)
