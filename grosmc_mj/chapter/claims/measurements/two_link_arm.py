"""Claims about several inputs, for which the chapter has the theory and no example."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balances_along
from grosmc_mj.chapter.claims.claim import Curve, Drawing, Measured
from grosmc_mj.chapter.claims.measurements.measures import (
    extrapolated,
    from_optimum,
    leaving_the_surface,
    of,
    sliding,
    surface_memory,
    within,
)
from grosmc_mj.control import reaching
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.uncertainty import Uncertainty
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.results.palette import LABELS

_SYSTEM = "two_link_arm"
_OTHERS = ("lqr", "pd")
# B+, with the elbow's s counted like the shoulder's.
_PSEUDOINVERSE = np.kron(np.eye(2), [[0.0, 1.0]])
# Samples of a run that are looked at: odd, so that both sides of the chatter are met.
_EVERY = 7
_PLANTS, _STATES, _POSES = 8, 20, 25


def largest_deviation(lab: Laboratory, plant: PlantName, *, cases: Sequence[str]) -> Measured:
    """Largest deviation of GROSMC from its optimum over cases, in percent of the start."""
    results = [lab.case(_SYSTEM, name, plant, "grosmc") for name in cases]
    return _extreme(results, [from_optimum(result.comparison) for result in results], max)


def least_deviation_of_linear_laws(
    lab: Laboratory, plant: PlantName, *, cases: Sequence[str]
) -> Measured:
    """Smallest deviation of LQR and PD from their own optimum or plan, in percent of the start."""
    results = [lab.case(_SYSTEM, case, plant, name) for case in cases for name in _OTHERS]
    return _extreme(results, [from_optimum(result.comparison) for result in results], min)


def _extreme(results: list[RunResult], values: list[float], pick: Callable[..., int]) -> Measured:
    """The largest or the smallest of the values of several runs, and which; broken if one is."""
    for result, value in zip(results, values, strict=True):
        measured = of(result, value)
        if measured.broken:
            return measured._replace(note=f"{_name(result)}: {measured.note}")
    place = pick(range(len(values)), key=values.__getitem__)
    return Measured(values[place], _name(results[place]))


def _name(result: RunResult) -> str:
    """Which run."""
    return f"{result.case.name} under {LABELS.get(result.controller.name, result.controller.name)}"


def leaving_the_surfaces(lab: Laboratory, plant: PlantName, *, cases: Sequence[str]) -> Measured:
    """Largest |s_i| over what one sample of the switching term makes of it, over cases."""
    results, values = [], []
    for name in cases:
        result = lab.case(_SYSTEM, name, plant, "grosmc")
        s = sliding(result.trajectory)
        if not len(s) or np.any(s[0]):
            return of(result, None, f"{name} starts off its surface")
        measured = leaving_the_surface(lab, plant, system=_SYSTEM, case=name)
        if measured.value is None:
            return measured
        results.append(result)
        values.append(measured.value)
    return _extreme(results, values, max)


def _true_gain(
    law: Controller, derivative: Callable[[Array, ArrayLike, Array], Array], x: Array, w: Array
) -> Array:
    """E* of a plant's own accelerations, in the coordinates that the law believes in, (m, m)."""
    error, p = law.coordinates, law.parameters
    assert isinstance(error, ErrorCoordinates)
    m, rows = error.inputs, list(error.linearization.last_rows)
    slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))[rows]
    still = derivative(x, np.zeros(m), w)
    columns = [derivative(x, unit, w) - still for unit in np.eye(m)]
    return error.sign * slope @ np.array(columns).T


def extrapolated_deviation(lab: Laboratory, plant: PlantName, *, cases: Sequence[str]) -> Measured:
    """Largest deviation over cases, extrapolated to a sampling time of zero, in percent."""
    limits = {name: extrapolated(lab, plant, system=_SYSTEM, case=name) for name in cases}
    for judged in limits.values():
        if judged.broken or judged.value is None:
            return judged
    worst = max(limits.values(), key=lambda limit: limit.value or 0.0)
    return worst._replace(note="; ".join(f"{name} {limit.note}" for name, limit in limits.items()))


def gain_margin(lab: Laboratory, plant: PlantName, *, cases: Sequence[str]) -> Measured:
    """Least rho of the law over what is required of it along runs, by the true equations."""
    return _least_margin(lab, plant, (find_experiment(_SYSTEM, name) for name in cases))


def gain_margin_together(lab: Laboratory, plant: PlantName) -> Measured:
    """The same under 1 kg at the tip, links 5 % longer and every disturbance of case 1."""
    pushed, heavier = (find_experiment(_SYSTEM, name) for name in ("case1", "case2"))
    both = trial(
        _SYSTEM, "both", heavier.case.x0, 6.0, heavier.case.edits, pushed.case.disturbances
    )
    return _least_margin(lab, plant, (both,))


def _least_margin(lab: Laboratory, plant: PlantName, cases: Iterable[Experiment]) -> Measured:
    """Least margin of the gain over the runs of cases."""
    results, values, notes = [], [], []
    for case in cases:
        result = lab.run(case, plant, "grosmc")
        true, law = lab.equations(case, plant), result.controller
        points = balances_along(law, true, result.trajectory, _EVERY)
        needed = points.required > 0
        worst = (points.configured[needed] / points.required[needed]).min(initial=np.inf)
        least = points.gain_ratio.min()
        results.append(result)
        values.append(float(worst))
        notes.append(f"{case.case.name}: {worst:.3g}, least r {least:.3g}")
    return _extreme(results, values, min)._replace(note="; ".join(notes))


def projection(lab: Laboratory, plant: PlantName, *, payload: float) -> Measured:
    """Least authority of G = B+ over the declared poses, up to so many times the payload."""
    case = find_experiment(_SYSTEM, "regulation")
    law = lab.controller(case, plant, "grosmc")
    error, p = law.coordinates, law.parameters
    rows = list(error.linearization.last_rows)
    least = {"B+": (np.inf, ""), "own": (np.inf, "")}
    projections = {"B+": _PSEUDOINVERSE[:, rows], "own": p.G[:, rows]}
    bound, nothing = _declared().region[2], np.zeros(18)
    for mass in np.linspace(1.0, payload, 5).tolist():
        heavier = trial(_SYSTEM, "payload", case.case.x0, 1.0, (BodyEdit("payload", mass),))
        derivative = lab.plant(heavier, plant).derivative
        for turn in np.linspace(-bound, bound, _POSES).tolist():
            x = error.place(0.0, [0.0, 0.0, turn, 0.0], p)
            _, E = error.dynamics(0.0, x, p)
            E_true = _true_gain(law, derivative, x, nothing)
            for name, G_r in projections.items():
                r = reaching.gain_margin(G_r @ E_true @ np.linalg.inv(G_r @ E))
                if r < least[name][0]:
                    least[name] = (r, f"{0.2 * mass:.2g} kg, q2 = {x[1]:.3g} rad")
    (r, where), (own, _) = least["B+"], least["own"]
    return Measured(float(r), f"at {where}; the law's own G keeps {own:.3g}")


def _declared() -> Uncertainty:
    """What the gain of the regulation is declared for."""
    declared = find_experiment(_SYSTEM, "regulation").uncertainty
    assert declared is not None
    return declared


def slowest_approach(lab: Laboratory, plant: PlantName) -> Measured:
    """The largest s_i' sgn(s_i) + eta over the declared family, by the plant's own accelerations.

    The continuous reading: at each state the law is asked on all four sides of its two surfaces,
    and s' follows from x' there and then, without a time step.
    """
    random, worst = np.random.default_rng(1), -np.inf
    declared = _declared()
    low, high = declared.scales["mp"]
    start = find_experiment(_SYSTEM, "nominal").case.x0
    wrench = np.array(declared.wrench)
    law = lab.controller(find_experiment(_SYSTEM, "regulation"), plant, "grosmc")
    masses = [low, high, *random.uniform(low, high, _PLANTS - 2).tolist()]
    for mass in masses:
        heavier = trial(_SYSTEM, "reaching", start, 1.0, (BodyEdit("payload", mass),))
        derivative = lab.plant(heavier, plant).derivative
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 4) * declared.region
            for *sides, push in itertools.product((-1.0, 1.0), repeat=3):
                rates = _approach(law, derivative, z, np.array(sides), push * wrench)
                worst = max(worst, float(rates.max()))
    own = float(getattr(law.parameters, "eta", 0.0))
    said = f"{len(masses)} payloads x {_STATES} states; the law's own η is {own:.3g}"
    return Measured(worst + declared.reaching_rate, said)


def _approach(
    law: Controller,
    derivative: Callable[[Array, ArrayLike, Array], Array],
    z: Array,
    sides: Array,
    w: Array,
) -> Array:
    """s_i' sgn(s_i) next to the surfaces on the named sides, (m,)."""
    error, p = law.coordinates, law.parameters
    x, memory = error.place(0.0, z, p), surface_memory(law)
    assert isinstance(error, ErrorCoordinates)
    # Any time but the start, at which the law takes z for its own z(0).
    memory.z0[:], memory.t = z - np.linalg.pinv(p.G) @ (1e-6 * sides), 1.0
    u = law.input_at(1.0, x, memory)
    slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))
    dz = error.sign * slope @ derivative(x, u, w)
    return sides * (p.G @ dz - p.S @ z)


def off_the_circle(lab: Laboratory, plant: PlantName, *, case: str) -> Measured:
    """Largest distance of the true tip from its reference in the last turn, in mm."""
    result = lab.case(_SYSTEM, case, plant, "grosmc")
    last = within(result.comparison.time, 4.0)
    if not last.any():
        return Measured(None, result.ended, broken=True)
    there = true_tip(result)[last]
    off = np.linalg.norm(there - result.comparison.reference[last], axis=1)
    believed = 1e3 * float(result.comparison.error[last].max())
    return of(result, 1e3 * float(off.max()), f"by its own kinematics it is {believed:.2g} mm")


def elbow_bend(lab: Laboratory, plant: PlantName, *, cases: Sequence[str]) -> Measured:
    """Least |sin q2| along the runs of GROSMC."""
    results = [lab.case(_SYSTEM, case, plant, "grosmc") for case in cases]
    values = [float(np.abs(np.sin(result.trajectory.state[:, 1])).min()) for result in results]
    return _extreme(results, values, min)


def true_tip(result: RunResult) -> Array:
    """Where the tip truly is, by the plant's own lengths: (x, z) from the shoulder [m], (N, 2)."""
    error = result.controller.designed.error
    assert isinstance(error, ErrorCoordinates)
    z = error.outputs_along(result.trajectory.state, result.plant_parameters)
    return z[:, error.output_rows]


def tip_path(lab: Laboratory, *, case: str, controllers: Sequence[str]) -> Drawing:
    """The true tip in the plane on physics, and the circle."""
    curves = []
    for name in controllers:
        result = lab.case(_SYSTEM, case, "physics", name)
        path = true_tip(result)
        curves.append(Curve(LABELS.get(name, name), path[:, 0], path[:, 1], name))
    reference = lab.case(_SYSTEM, case, "physics", "grosmc").comparison.reference
    curves.append(Curve("reference", reference[:, 0], reference[:, 1]))
    return Drawing("tip x [m]", "tip z [m]", curves)


def distance_from_optimum(lab: Laboratory, *, case: str, scale: float, unit: str) -> Drawing:
    """The distance of each law from its own nominal trajectory, on physics."""
    curves = []
    for name in (*_OTHERS, "grosmc"):
        comparison = lab.case(_SYSTEM, case, "physics", name).comparison
        label = LABELS.get(name, name)
        curves.append(Curve(label, comparison.time, scale * comparison.deviation, name))
    return Drawing("time t [s]", f"distance from the optimum [{unit}]", curves)


def surfaces(lab: Laboratory, *, case: str) -> Drawing:
    """Both sliding variables of GROSMC on physics."""
    result = lab.case(_SYSTEM, case, "physics", "grosmc")
    s, time = sliding(result.trajectory), result.trajectory.time[:-1]
    curves = [Curve("s₁", time, s[:, 0], "grosmc"), Curve("s₂", time, s[:, 1])]
    return Drawing("time t [s]", f"s [{result.controller.designed.sliding_unit}]", curves)


def unknown_kinematics(lab: Laboratory) -> str:
    """Which premise the length errors break."""
    return (
        "the output map y = h(x) is known (section 4.1: only the dynamics have an uncertain part); "
        "here h has the links' lengths in it, and the law regulates what it believes y to be"
    )
