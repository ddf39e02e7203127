"""What holding pole and cart costs: ``cases.cart_pendulum.cart`` on the chapter's cases."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.cases.cart_pendulum.cart import holding_ism, holding_lqr
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import realized
from grosmc_mj.control.lqr import LqrDesign
from grosmc_mj.control.reaching import mismatch, sliding_dynamics
from grosmc_mj.control.task import Realization
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.metrics.recorded import Metric, settling_time
from grosmc_mj.experiments.runs import RunResult, Settings, run_on
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.linearization import linearize
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.trajectory import Status, Trajectory

SYSTEM = "cart_pendulum"
# The chapter's law first, for contrast: it leaves the cart alone.
LAWS = ("grosmc", "cart-lqr", "cart-ism", "cart-pfl")
# [s]: the cart takes longer than the pole; case 2 begins its disturbance at 9 s.
HORIZONS = {"nominal": 20.0, "case1": 20.0, "case2": 30.0}
# The cart has settled within this of the origin [m].
CART_BAND = 0.02
# What is added to the pole: matched in mass, not in length.
UNCERTAINTIES = {
    "4m": BodyEdit("pole", mass_scale=4.0),
    "4L": BodyEdit("pole", length_scale=4.0),
    "4m, 4L": BodyEdit("pole", mass_scale=4.0, length_scale=4.0),
}
ALONE = "LQR alone"


class Held(NamedTuple):
    """One law in one case, and whether it held pole and cart.

    Attributes:
        result: The run.
        measures: By name; those under a disturbance have no value without one.
    """

    result: RunResult
    measures: Mapping[str, Metric]


class Projection(NamedTuple):
    """What one choice of G makes of the unmatched uncertainty of case 1.

    Attributes:
        name: G in words, or LQR without a surface.
        G: Projection of the surface, (1, 4); None without one.
        amplification: |(I - B (G B)^-1 G) phi_u| / |phi_u|, at the first instant.
        gain_ratio: r = G B_t / G B.
        pole: Largest real part of the sliding dynamics, or of A_t - B_t K [1/s].
        deviation: max |theta - theta*| on physics, in percent of the start.
        max_input: max |u| there [N].
    """

    name: str
    G: Array | None
    amplification: float | None
    gain_ratio: float | None
    pole: float
    deviation: Metric
    max_input: Metric


class Parts(NamedTuple):
    """Norms of the matched and the unmatched part of A_t - A - (B_t - B) K.

    Attributes:
        name: What is changed.
        matched: |B B+ (dA - dB K)|.
        unmatched: |(I - B B+)(dA - dB K)|.
    """

    name: str
    matched: float
    unmatched: float


@dataclass(frozen=True, eq=False)
class Study:
    """All that was measured.

    Attributes:
        settings: How it was run.
        rail: Half the rail's length [m].
        held: Every law in every case.
        projections: Every G under case 1.
        parts: Every uncertainty.
    """

    settings: Settings
    rail: float
    held: Sequence[Held]
    projections: Sequence[Projection]
    parts: Sequence[Parts]


def holding_case(name: str) -> Experiment:
    """A case of the chapter over the time that the cart needs."""
    return find_experiment(SYSTEM, name).varied(duration=HORIZONS[name])


def steps() -> int:
    """How often ``study`` reports that it has advanced."""
    return len(HORIZONS) * len(LAWS) + len(projections_of(_nominal_lqr()))


def study(settings: Settings, advance: Callable[[str], object] = lambda _: None) -> Study:
    """Run everything.

    Args:
        settings: With the switching law and the surface.
        advance: Called with a word whenever a part is done.
    """
    rail = rail_half_length(MujocoPlant.load(SYSTEM))
    held = []
    for name in HORIZONS:
        for law in LAWS:
            result = holding_case(name).with_settings(**settings.changes()).run("physics", law)
            held.append(Held(result, measures_of(result, rail)))
            advance(result.key)
    return Study(settings, rail, held, projections(settings, advance), parts())


def rail_half_length(plant: MujocoPlant) -> float:
    """How far the cart's centre can go to either side [m], from the drawn rail."""
    rail = plant.model.geom("rail")
    return float(rail.size[0] - abs(rail.pos[0]))


def measures_of(result: RunResult, rail: float) -> dict[str, Metric]:
    """Whether a run held pole and cart, and what it took.

    Settling times count up to the onset of a disturbance; the cart's is of ``CART_BAND``. What
    the disturbance does is read in the second half of its time, when the start is forgotten.
    """
    run, onset = result.trajectory, result.case.onset
    cart, angle = run.state[:, 0], run.state[:, 1]
    calm = run.time <= onset
    travel = float(np.abs(cart).max())
    after = run.time >= 0.5 * (onset + result.case.duration)
    found = result.metrics["deviation"].value
    start = abs(angle[0])
    deviation = None if found is None or start == 0 else float(100 * found / start)
    return {
        "angle_settling": result.metrics["settling_time"],
        "cart_settling": settling_time(run.time[calm], cart[calm], CART_BAND),
        "travel": Metric(travel, "m"),
        "rail_margin": Metric(rail - travel, "m", "" if travel <= rail else "off the rail"),
        "max_input": result.metrics["max_input"],
        "deviation": Metric(deviation, "%"),
        "total_variation": result.metrics["total_variation"],
        "cart_disturbed": _largest(cart[after], "m"),
        "angle_disturbed": _largest(angle[after], "rad"),
        "cart_end": Metric(float(abs(cart[-1])), "m"),
        "angle_end": Metric(float(abs(angle[-1])), "rad"),
    }


def _largest(values: Array, unit: str) -> Metric:
    if len(values) == 0:
        return Metric(None, unit, "no disturbance")
    return Metric(float(np.abs(values).max()), unit)


def _nominal_lqr() -> LqrDesign:
    """The optimum that cart-lqr and cart-ism share."""
    physics = MujocoPlant.load(SYSTEM)
    return holding_lqr(physics.analytic(), linearize(physics)).designed.lqr


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


def projections(
    settings: Settings, advance: Callable[[str], object] = lambda _: None
) -> list[Projection]:
    """Each G under case 1 on physics: what the linear model says, and what is measured."""
    experiment = holding_case("case1").with_settings(**settings.changes())
    plant = experiment.plant("physics")
    model, optimum = plant.linearization(), _nominal_lqr()
    rows = []
    for name, G in projections_of(optimum).items():
        law = projected_law(G, experiment.realization)
        result = run_on(experiment, "physics", law, plant)
        measured = measures_of(result, math.inf)
        deviation, most = measured["deviation"], measured["max_input"]
        if result.status is not Status.COMPLETED:
            deviation = most = Metric(None, "", result.ended)
        rows.append(
            Projection(
                name,
                G,
                amplification(optimum, G, model),
                None if G is None else gain_ratio(optimum, G, model),
                slowest_pole(optimum, G, model),
                deviation,
                most,
            )
        )
        advance(f"G = {name}" if G is not None else name)
    return rows


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


def gain_ratio(optimum: LqrDesign, G: Array, model: tuple[Array, Array]) -> float:
    """r = G B_t / G B."""
    return float((G @ model[1]).item() / (G @ optimum.B).item())


def slowest_pole(optimum: LqrDesign, G: Array | None, model: tuple[Array, Array]) -> float:
    """Largest real part of the sliding dynamics or, without G, of A_t - B_t K [1/s]."""
    A_t, B_t = model
    loop = A_t - B_t @ optimum.K if G is None else sliding_dynamics(optimum, G, A_t, B_t)
    return float(np.linalg.eigvals(loop).real.max())


def parts() -> list[Parts]:
    """What of each uncertainty the input can reach, and what it cannot."""
    optimum, nominal = _nominal_lqr(), MujocoPlant.load(SYSTEM)
    rows = []
    for name, edit in UNCERTAINTIES.items():
        found = uncertainty(optimum, linearize(nominal.edited(edit)))
        rows.append(Parts(name, *(float(np.linalg.norm(part, 2)) for part in found)))
    return rows


def run_of(found: Study, case: str, law: str) -> Trajectory:
    """One run of a study."""
    return next(
        each.result.trajectory
        for each in found.held
        if (each.result.case.name, each.result.controller.name) == (case, law)
    )
