"""The chapter's claims about the servo rotor, section 2.3."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy

from grosmc_mj.chapter.claims.claim import ClaimValue
from grosmc_mj.chapter.claims.measurements.measures import from_run, sliding
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.wording import unit_after
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.lqr import lqr

_SYSTEM = "servo"
_MEASURES = ("damping ratio", "phase margin", "slowest pole", "delay margin")
_UNITS = ("", " deg", " 1/s", " s")


def overshoot_growth(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
) -> ClaimValue:
    """Measure the overshoot in a case less the nominal one, in percent of the step."""
    result = lab.case(system, case, plant, controller)
    nominal_result = lab.case(system, "nominal", plant, controller)
    changed = result.metrics["overshoot"].value or 0.0
    nominal = nominal_result.metrics["overshoot"].value or 0.0
    return from_run(result, changed - nominal, f"{changed:.2g} % against {nominal:.2g} %")


def largest_overshoot(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
) -> ClaimValue:
    """Measure the robust law's overshoot over the whole run, in percent of the step."""
    result = lab.case(system, case, plant, "grosmc")
    return from_run(result, 100 * result.errors(result.comparison.z)["overshoot"])


def stability_loss(lab: RunCache, plant: PlantName, *, measure: str) -> ClaimValue:
    """Measure by how much 3J lowers a measure of the LQR loop's relative stability, in percent.

    The loop gain is K (sI - A)^-1 B of the plant's own linear model.
    """
    nominal = _stability(lab, plant, "nominal")
    heavier = _stability(lab, plant, "case2")
    words = []
    for name, unit in zip(_MEASURES, _UNITS, strict=True):
        words.append(
            f"{name} {heavier[name]:.3g}{unit} under 3J, {nominal[name]:.3g}{unit} nominal"
        )
    return ClaimValue(100 * float(1 - heavier[measure] / nominal[measure]), "; ".join(words))


def _stability(lab: RunCache, plant: PlantName, name: str) -> dict[str, float]:
    """The measures of relative stability of the LQR loop in a case, by their names."""
    # Imported late: it takes a second.
    import control

    case = find_experiment(_SYSTEM, name)
    law = lab.controller(case, plant, "lqr")
    A, B = lab.plant(case, plant).linearization()
    K = _state_gain(law)
    _, phase, _, crossing = control.margin(control.ss(A, B, K, 0.0))
    closed = A - B @ K

    natural_frequency = np.sqrt(np.linalg.det(closed))
    return {
        "damping ratio": float(-np.trace(closed) / (2 * natural_frequency)),
        "phase margin": float(phase),
        "slowest pole": _decay(closed),
        "delay margin": math.radians(phase) / float(crossing),
    }


def _state_gain(law: Controller) -> Array:
    """K of u = -K x about a rest, (1, 2); the law's own K multiplies its error."""
    error = law.coordinates
    assert isinstance(error, ErrorCoordinates)
    return error.sign * law.parameters.K


def _decay(closed: Array) -> float:
    """Decay rate of the slowest pole [1/s]."""
    return -float(np.linalg.eigvals(closed).real.max())


def slowest_of_definite(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure the largest real part of a pole under (5), for semidefinite Q with P > 0.

    Of 100 random Q of rank one, those with a singular P are left out: (5)-(7) do not treat them.
    """
    case = find_experiment(_SYSTEM, "nominal")
    law = lab.controller(case, plant, "lqr")
    design = law.designed.lqr
    A, B = lab.plant(case, plant).linearization()
    random = np.random.default_rng(0)

    poles = []
    for angle in random.uniform(-math.pi / 2, math.pi / 2, 100):
        q = np.array([math.cos(angle), math.sin(angle)])
        optimum = lqr(design.A, design.B, np.outer(q, q), design.R)
        if np.linalg.eigvalsh(optimum.P).min() > 0:
            optimal_law = replace(law, parameters=replace(law.parameters, K=optimum.K))
            poles.append(-_decay(A - B @ _state_gain(optimal_law)))
    return ClaimValue(max(poles), f"{len(poles)} weights of rank one with P > 0")


def undercut(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure by how much u_c = 0 changes the index (13) from J*, in percent.

    The surface (8) fixes x, whether u_c or u_d supplies the input. So the law (12) runs with
    u_c = 0 and with gamma1 larger by |K|, which covers -K x: s stays at zero, x is the optimum, and
    the integral of x'Qx/2 remains of (13). On the sliding motion x' = (A - B K) x it is x0'Wx0/2,
    with W from the Lyapunov equation (A - B K)'W + W (A - B K) + Q = 0.
    """
    case = find_experiment(_SYSTEM, "nominal")
    law = lab.controller(case, plant, "grosmc")
    design = law.designed.lqr
    p = law.parameters
    gamma1 = p.gamma1 + float(np.linalg.norm(p.K))
    without_K = replace(p, K=0 * p.K, gamma1=gamma1)
    by_switching = replace(law, parameters=without_K)
    result = lab.once(("undercut", plant), lambda: lab.run_with(case, plant, by_switching))

    z = result.comparison.z
    integrand = np.sum(z @ design.Q * z, axis=1)
    J = 0.5 * float(np.trapezoid(integrand, result.comparison.time))
    x0 = np.array([1.0, 0.0])
    least = design.optimal_cost(x0)
    W = scipy.linalg.solve_continuous_lyapunov(design.closed_loop.T, -design.Q)
    ideal = float(0.5 * x0 @ W @ x0)

    s = float(np.abs(sliding(result.trajectory)).max())
    note = (
        f"on s = 0 {ideal:.5f} against J* = {least:.5f}, {100 * (ideal / least - 1):.3g} %; "
        f"the run's largest |s| is {s:.2g}{unit_after(law.designed.sliding_unit)}"
    )
    return from_run(result, 100 * (J / least - 1), note)
