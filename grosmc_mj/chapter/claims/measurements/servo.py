"""The chapter's claims about the servo rotor, section 2.3."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.measures import (
    from_optimum,
    from_run,
    sliding,
    surface_memory,
)
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.lqr import lqr
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache
from grosmc_mj.plants import Plant
from grosmc_mj.requirements.error_metrics import overshoot

_SYSTEM = "servo"
_MEASURES = ("damping ratio", "phase margin", "slowest pole", "delay margin")
_UNITS = ("", " deg", " 1/s", " s")


class _Margins(NamedTuple):
    """Phase margin [rad] and delay margin [s] of a loop."""

    phase: float
    delay: float


def overshoot_growth(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    controller: str,
) -> Measured:
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
) -> Measured:
    """Measure the robust law's overshoot over the whole run, in percent of the step."""
    result = lab.case(system, case, plant, "grosmc")
    return from_run(result, overshoot(result.comparison.z[:, 0]).value)


def stability_loss(lab: RunCache, plant: PlantName, *, measure: str) -> Measured:
    """Measure by how much 3J lowers a measure of the LQR loop's relative stability, in percent.

    Loop and plant are linearized by differences of x' on the plant, law and all.
    """
    nominal = _stability(lab, plant, "nominal")
    heavier = _stability(lab, plant, "case2")
    words = []
    for name, unit in zip(_MEASURES, _UNITS, strict=True):
        words.append(
            f"{name} {heavier[name]:.3g}{unit} under 3J, {nominal[name]:.3g}{unit} nominal"
        )
    return Measured(100 * float(1 - heavier[measure] / nominal[measure]), "; ".join(words))


def _stability(lab: RunCache, plant: PlantName, name: str) -> dict[str, float]:
    """The measures of relative stability of the LQR loop in a case, by their names."""
    case = find_experiment(_SYSTEM, name)
    closed, A = _linearized(lab.plant(case, plant), lab.controller(case, plant, "lqr"))
    margins = _margins(A, closed)
    frequency = np.sqrt(abs(np.linalg.det(closed)))
    damping = -np.trace(closed) / (2 * frequency)
    slowest = -float(np.linalg.eigvals(closed).real.max())
    values = (damping, math.degrees(margins.phase), slowest, margins.delay)
    return dict(zip(_MEASURES, values, strict=True))


def _linearized(plant: Plant, law: Controller) -> tuple[Array, Array]:
    """Jacobians of x' at rest by central differences: under the law, and without input."""
    rest = _rest(law)
    memory = law.memory()
    step = 1e-5
    closed = np.empty((2, 2))
    A = np.empty((2, 2))
    for column, d in enumerate(step * np.eye(2)):
        above = rest + d
        below = rest - d
        u_above = law.input_at(1.0, above, memory)
        u_below = law.input_at(1.0, below, memory)
        difference = plant.derivative(above, u_above) - plant.derivative(below, u_below)
        closed[:, column] = difference / (2 * step)
        free_difference = plant.derivative(above) - plant.derivative(below)
        A[:, column] = free_difference / (2 * step)
    return closed, A


def _rest(law: Controller) -> Array:
    """State at rest on the law's reference, (2,)."""
    reference = law.coordinates.reference(0.0, law.parameters.reference)
    return np.array([reference[0], 0.0])


def _margins(A: Array, closed: Array) -> _Margins:
    """Margins of the loop x' = A x + (A_closed - A) x.

    B K is of rank one, so its loop gain K (jw - A)^-1 B is the trace of (jw - A)^-1 B K.
    """
    # Imported late: few commands need this part of scipy.
    from scipy.optimize import brentq

    crossing: Any = brentq(lambda w: abs(_loop_gain(w, A, closed)) - 1, 1e-3, 1e3)
    phase = float(math.pi + np.angle(_loop_gain(crossing, A, closed)))
    return _Margins(phase, phase / crossing)


def _loop_gain(w: float, A: Array, closed: Array) -> complex:
    """Loop gain at a frequency [rad/s]."""
    resolvent = 1j * w * np.eye(2) - A
    return np.trace(np.linalg.solve(resolvent, A - closed))


def slowest_of_definite(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the largest real part of a pole under (5), for semidefinite Q with P > 0.

    Of 100 random Q of rank one, those with a singular P are left out: (5)-(7) do not treat them.
    """
    case = find_experiment(_SYSTEM, "nominal")
    law = lab.controller(case, plant, "lqr")
    servo = lab.plant(case, plant)
    design = law.designed.lqr
    random = np.random.default_rng(0)

    poles = []
    for angle in random.uniform(-math.pi / 2, math.pi / 2, 100):
        q = np.array([math.cos(angle), math.sin(angle)])
        optimum = lqr(design.A, design.B, np.outer(q, q), design.R)
        if np.linalg.eigvalsh(optimum.P).min() > 0:
            optimal_law = replace(law, parameters=replace(law.parameters, K=optimum.K))
            closed, _ = _linearized(servo, optimal_law)
            poles.append(float(np.linalg.eigvals(closed).real.max()))
    return Measured(max(poles), f"{len(poles)} weights of rank one with P > 0")


def undercut(lab: RunCache, plant: PlantName) -> Measured:
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
        f"the run's largest |s| is {s:.2g} {law.designed.sliding_unit}"
    )
    return from_run(result, 100 * (J / least - 1), note)


def naive_gain(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the bound sized without the switching term, over the one that 3J requires.

    Assumption 4 bounds the lumped uncertainty, which under J = 3 J_hat contains (r - 1) u with
    the switching input in it. Left out of the bound, |u_d| = |(r - 1)/r u_c + ...| is required
    while |(r - 1) u_c + ...| is configured.

    Raises:
        NoValueError: If nothing pushes s away.
    """
    case = find_experiment(_SYSTEM, "case2")
    law = lab.controller(case, plant, "grosmc")
    derivative = lab.plant(case, plant).derivative
    design = law.designed.lqr
    rest = _rest(law)
    B = float(design.B[1, 0])
    B_true = -(derivative(rest, 1.0) - derivative(rest))[1]

    # Largest difference of z2' from the nominal one on the unit circle, under u_c.
    differences = []
    for angle in np.linspace(0, np.pi, 181):
        z = np.array([np.cos(angle), np.sin(angle)])
        u_c = -float(design.K[0] @ z)
        nominal = float(design.A[1] @ z) + B * u_c
        differences.append(-derivative(rest - z, u_c)[1] - nominal)
    largest = float(np.abs(differences).max())

    naive = largest / abs(B)
    required = largest / abs(B_true)
    if required < 1e-9:
        raise NoValueError("nothing pushes s away here")
    return Measured(float(naive / required), f"γ1 = {naive:.3g} sized so, {required:.4g} required")


def cost_of_switching(lab: RunCache, plant: PlantName, *, case: str) -> Measured:
    """Measure the cost of the input beyond (13), over J*, in percent per second of the run."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    continuous, switching = result.cost_shares
    if continuous.value is None or switching.value is None:
        return from_run(result, None, "the law has no J*")

    duration = float(result.trajectory.time[-1])
    whole = continuous.value + switching.value * duration
    note = f"J with the whole u is {whole:.3g} J* after {duration:g} s"
    return from_run(result, 100 * abs(switching.value), note)


def without_bounds(lab: RunCache, plant: PlantName) -> Measured:
    """Measure max |x1 - x1*| in case 1 under the law with eta alone, in percent of the step."""
    experiment = find_experiment(_SYSTEM, "case1")
    law = lab.controller(experiment, plant, "grosmc")
    # Another law has no eta.
    surface_memory(law)
    p = law.parameters
    eta_alone = replace(law, parameters=replace(p, gamma0=0.0, gamma1=0.0))
    result = lab.once(("without bounds", plant), lambda: lab.run_with(experiment, plant, eta_alone))
    return from_run(result, from_optimum(result.comparison), f"η = {p.eta:.3g} A alone")
