"""The chapter's claims about the servo rotor, section 2.3."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    from_optimum,
    of,
    sliding,
    surface_memory,
)
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.lqr import lqr
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.laboratory import Laboratory
from grosmc_mj.experiments.metrics import overshoot
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.plants import Plant


def overshoot_growth(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, controller: str
) -> Measured:
    """Overshoot in a case less the nominal one, in percent of the step."""
    results = [lab.case(system, name, plant, controller) for name in (case, "nominal")]
    changed, nominal = (result.metrics["overshoot"].value or 0.0 for result in results)
    return of(results[0], changed - nominal, f"{changed:.2g} % against {nominal:.2g} %")


def largest_overshoot(lab: Laboratory, plant: PlantName, *, system: str, case: str) -> Measured:
    """The robust law's overshoot over the whole run, in percent of the step."""
    result = lab.case(system, case, plant, "grosmc")
    return of(result, overshoot(result.comparison.z[:, 0]).value)


def stability_loss(lab: Laboratory, plant: PlantName, *, measure: str) -> Measured:
    """By how much 3J lowers a measure of the LQR loop's relative stability, in percent.

    Loop and plant are linearized by differences of x' on the plant, law and all.
    """
    loops = []
    for name in ("nominal", "case2"):
        case = find_experiment("servo", name)
        closed, A = _linearized(lab.plant(case, plant), lab.controller(case, plant, "lqr"))
        phase, delay = _margins(A, closed)
        damping = -np.trace(closed) / (2 * np.sqrt(abs(np.linalg.det(closed))))
        slowest = -float(np.linalg.eigvals(closed).real.max())
        loops.append((damping, math.degrees(phase), slowest, delay))
    measures = ["damping ratio", "phase margin", "slowest pole", "delay margin"]
    nominal, heavier = (dict(zip(measures, loop, strict=True)) for loop in loops)
    units = zip(measures, ("", " deg", " 1/s", " s"), strict=True)
    note = "; ".join(
        f"{name} {heavier[name]:.3g}{unit} under 3J, {nominal[name]:.3g}{unit} nominal"
        for name, unit in units
    )
    return Measured(100 * float(1 - heavier[measure] / nominal[measure]), note)


def _linearized(plant: Plant, law: Controller) -> tuple[Array, Array]:
    """x' of the plant at rest by x, under the law and without input, by central differences."""
    p, memory, step = law.parameters, law.memory(), 1e-5
    rest = np.array([law.coordinates.reference(0.0, p.reference)[0], 0.0])

    def rates(x: Array) -> Array:
        return np.stack([plant.derivative(x, law.input_at(1.0, x, memory)), plant.derivative(x)])

    slopes = [(rates(rest + d) - rates(rest - d)) / (2 * step) for d in step * np.eye(2)]
    closed, A = np.stack(slopes, axis=-1)
    return closed, A


def slowest_of_definite(lab: Laboratory, plant: PlantName) -> Measured:
    """The largest real part of a pole under (5), over semidefinite Q with a positive definite P.

    100 random Q of rank one; the others of them have a singular P, of which (5)-(7) say nothing.
    """
    case = find_experiment("servo", "nominal")
    law, on = lab.controller(case, plant, "lqr"), lab.plant(case, plant)
    design, random = law.designed.lqr, np.random.default_rng(0)
    poles = []
    for angle in random.uniform(-math.pi / 2, math.pi / 2, 100):
        q = np.array([math.cos(angle), math.sin(angle)])
        optimum = lqr(design.A, design.B, np.outer(q, q), design.R)
        if np.linalg.eigvalsh(optimum.P).min() > 0:
            weighted = replace(law, parameters=replace(law.parameters, K=optimum.K))
            poles.append(float(np.linalg.eigvals(_linearized(on, weighted)[0]).real.max()))
    return Measured(max(poles), f"{len(poles)} weights of rank one with P > 0")


def _margins(A: Array, closed: Array) -> tuple[float, float]:
    """Phase margin [rad] and delay margin [s] of the loop x' = A x + (A_closed - A) x.

    B K is of rank one, so its loop gain K (jw - A)^-1 B is the trace of (jw - A)^-1 B K.
    """
    # Here, for it is a part of scipy that little needs.
    from scipy.optimize import brentq

    def gain(w: float) -> complex:
        return np.trace(np.linalg.solve(1j * w * np.eye(2) - A, A - closed))

    crossing: Any = brentq(lambda w: abs(gain(w)) - 1, 1e-3, 1e3)
    margin = float(math.pi + np.angle(gain(crossing)))
    return margin, margin / crossing


def undercut(lab: Laboratory, plant: PlantName) -> Measured:
    """How far u_c = 0 takes the index (13) from J*, in percent: u_d carries -K x instead.

    The surface (8) fixes x, whoever supplies the input. So the law (12) runs with u_c = 0 and with
    gamma1 larger by |K|, which covers -K x: s stays at zero, x is the optimum, and what is left of
    (13) is the integral of x'Qx/2. On the sliding motion x' = (A - B K) x it is x0'Wx0/2, with W
    from the Lyapunov equation (A - B K)'W + W (A - B K) + Q = 0.
    """
    case = find_experiment("servo", "nominal")
    law = lab.controller(case, plant, "grosmc")
    design, p = law.designed.lqr, law.parameters
    gamma1 = p.gamma1 + float(np.linalg.norm(p.K))
    by_switching = replace(law, parameters=replace(p, K=0 * p.K, gamma1=gamma1))
    result = lab.once(("undercut", plant), lambda: lab.run_with(case, plant, by_switching))
    z, x0 = result.comparison.z, np.array([1.0, 0.0])
    J = 0.5 * float(np.trapezoid(np.sum(z @ design.Q * z, axis=1), result.comparison.time))
    W = scipy.linalg.solve_continuous_lyapunov(design.closed_loop.T, -design.Q)
    least, ideal = design.optimal_cost(x0), float(0.5 * x0 @ W @ x0)
    s = float(np.abs(sliding(result.trajectory)).max())
    note = (
        f"on s = 0 {ideal:.5f} against J* = {least:.5f}, {100 * (ideal / least - 1):.3g} %; "
        f"the run's largest |s| is {s:.2g} {law.designed.sliding_unit}"
    )
    return of(result, 100 * (J / least - 1), note)


def naive_gain(lab: Laboratory, plant: PlantName) -> Measured:
    """The bound sized without the switching term's own share, over what 3J requires.

    Assumption 4 bounds the lumped uncertainty, which under J = 3 J_hat contains (r - 1) u with
    the switching input in it. Left out of the bound, |u_d| = |(r - 1)/r u_c + ...| is required
    while |(r - 1) u_c + ...| is configured.
    """
    case = find_experiment("servo", "case2")
    law = lab.controller(case, plant, "grosmc")
    derivative, design = lab.plant(case, plant).derivative, law.designed.lqr
    rest = np.array([law.coordinates.reference(0.0, law.parameters.reference)[0], 0.0])
    B, B_true = float(design.B[1, 0]), -(derivative(rest, 1.0) - derivative(rest))[1]
    pushes = []
    for angle in np.linspace(0, np.pi, 181):
        z = np.array([np.cos(angle), np.sin(angle)])
        u_c = -float(design.K[0] @ z)
        pushes.append(-derivative(rest - z, u_c)[1] - (float(design.A[1] @ z) + B * u_c))
    push = float(np.abs(pushes).max())
    naive, required = push / abs(B), push / abs(B_true)
    if required < 1e-9:
        raise NoValueError("nothing pushes s away here")
    return Measured(float(naive / required), f"γ1 = {naive:.3g} sized so, {required:.4g} required")


def cost_of_switching(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """What the input costs beyond (13), over J* and the length of the run, in percent a second."""
    result = lab.case("servo", case, plant, "grosmc")
    counted, rest = (share.value for share in result.cost_shares)
    if counted is None or rest is None:
        return of(result, None, "the law has no J*")
    duration = float(result.trajectory.time[-1])
    note = f"J with the whole u is {counted + rest * duration:.3g} J* after {duration:g} s"
    return of(result, 100 * abs(rest), note)


def without_bounds(lab: Laboratory, plant: PlantName) -> Measured:
    """max |x1 - x1*| in case 1 under the law with eta alone, in percent of the step."""
    experiment = find_experiment("servo", "case1")
    law = lab.controller(experiment, plant, "grosmc")
    surface_memory(law)
    alone = replace(law, parameters=replace(law.parameters, gamma0=0.0, gamma1=0.0))
    result = lab.once(("without bounds", plant), lambda: lab.run_with(experiment, plant, alone))
    return of(result, from_optimum(result.comparison), f"η = {law.parameters.eta:.3g} A alone")
