"""Statements of the theorems on the plants: reaching, invariance, and its limits."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grosmc_mj.chapter.claims.claim import ClaimValue, NoValueError
from grosmc_mj.chapter.claims.measurements.arm import PAYLOADS
from grosmc_mj.chapter.claims.measurements.measures import EVERY, from_run, sliding, worst_deviation
from grosmc_mj.experiments.assumptions.balance import Loads, balance, balances, balances_along
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edits import BodyEdit
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.trajectory import Status
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.lqr import LqrDesign, lqr
from grosmc_mj.theory.plants import AnalyticPlant, find_system

# Plants of a declared family, and random states of each.
_PLANTS = 12
_STATES = 40
# A kick begins when the start's error has passed, and lasts so long [s].
_KICKED = 4.0
_KICK = 0.02
# Kicks, as shares of the declared region's largest rate.
_SHARES = (0.1, 0.25, 0.5)
# Rate by which |s| of the arm must fall, without d(t) [rad/s^2]; the chapter declares nothing.
_ARM_RATE = 1.0

Range = tuple[float, float]


class _Family(NamedTuple):
    """The plants and disturbances that a gain is declared for.

    Attributes:
        rate: Reaching rate [unit of s/s].
        mass: Range of the mass scale.
        length: Range of the length scale.
        wrench: Largest wrench, (6 * bodies,).
    """

    rate: float
    mass: Range
    length: Range
    wrench: Array


def perturbed(
    system: str,
    name: str,
    duration: float,
    mass: float,
    length: float,
) -> Experiment:
    """Return the nominal start with another mass and length of the uncertain body.

    Args:
        system: The system.
        name: Name of the experiment.
        duration: Duration [s].
        mass: Factor of the body's mass.
        length: Factor of its length.
    """
    start = find_experiment(system, "nominal").x0
    edit = BodyEdit(find_system(system).uncertain_body, mass, length)
    return trial(system, name, start, duration, (edit,))


def _declared(lab: RunCache, system: str) -> _Family:
    """The family that a system's gain is declared for."""
    declared = lab.as_set(find_experiment(system, "nominal")).uncertainty
    if declared is None:
        mass, length = PAYLOADS
        return _Family(_ARM_RATE, mass, length, np.zeros(12))

    # A rotor has no length.
    mass, length = (*declared.scales.values(), (1.0, 1.0))[:2]
    return _Family(declared.reaching_rate, mass, length, np.array(declared.wrench))


def _region(lab: RunCache, case: Experiment) -> tuple[float, ...]:
    """The declared bounds of z."""
    region = lab.as_set(case).region
    assert region is not None
    return region


def slowest_approach(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    rate: float | None = None,
    torque: float = 0.0,
) -> ClaimValue:
    """Measure the largest s' sgn(s) + eta over the declared family.

    On the surface s' sgn(s) is push - r rho, see ``assumptions.balance``. A law's gain eta + gamma0
    may be split in any way: eta is the declared reaching rate, and the rest of the law's own
    eta is counted in gamma0. For one input the value is the excess of |G B delta| over
    (gamma0 + gamma1 |x|) |G B|, on the side on which delta pushes s away.

    Args:
        lab: Cache of the runs.
        plant: The plant.
        system: Its system.
        rate: eta; the declared reaching rate by default.
        torque: Largest disturbance beyond the declared one [N m].
    """
    family = _declared(lab, system)
    wrench = family.wrench + torque * np.eye(len(family.wrench))[-2]
    region = _region(lab, find_experiment(system, "nominal"))
    corners = [(mass, length) for length in family.length for mass in family.mass]
    random = np.random.default_rng(1)

    worst = -np.inf
    eta_of_law = 0.0
    for index in range(_PLANTS):
        mass = random.uniform(*family.mass)
        length = random.uniform(*family.length)
        if index < len(corners):
            mass, length = corners[index]
        case = perturbed(system, "reaching", 1.0, mass, length)
        law = lab.controller(case, plant, "grosmc")
        eta_of_law = law.parameters.eta

        places = []
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 2) * region
            t = random.uniform(0, 2)
            places.append((z, t))
        worst = max(worst, _approach(law, lab.equations(case, plant), places, wrench))

    note = f"{_PLANTS} plants x {_STATES} states"
    if rate is not None:
        return ClaimValue(worst + rate, note)
    rest = eta_of_law - family.rate
    note += f"; η = {family.rate:.3g}, the other {rest:.3g} of the law's counted in γ0"
    return ClaimValue(worst + family.rate, note)


def _approach(
    law: Controller,
    true: AnalyticPlant,
    places: Iterable[tuple[Array, float]],
    wrench: Array,
) -> float:
    """Largest s' sgn(s) of a law with one input on its surface, under a wrench either way.

    Args:
        law: Law with a surface.
        true: The plant that it meets.
        places: Error states z, (n,), and times [s]; those where the law is undefined are left out.
        wrench: (6 * bodies,).
    """
    system = law.coordinates.system
    times = []
    states = []
    for z, t in places:
        x = law.coordinates.place(t, z, law.parameters)
        if abs(x[system.output]) <= system.position_bound and system.linearizable(x):
            times.append(t)
            states.append(x)

    worst = -np.inf
    for side in (-1.0, 1.0):
        wrenches = np.tile(side * wrench, (len(states), 1))
        loads = Loads.of_wrench(wrenches, true.system)
        points = balances(law, true, times, np.array(states), loads)
        approach = points.push - points.gain_ratio * points.configured
        worst = max(worst, float(approach.max()))
    return worst


def reaching_time(lab: RunCache, plant: PlantName, *, system: str) -> ClaimValue:
    """Measure the time of s back to zero after a kick, over |s| / eta: the worst kick and plant.

    eta is the declared reaching rate, see ``slowest_approach``; of a law without eta the part of
    epsilon that (56) leaves over the declared family.

    The plants are the extremes of that family, under its largest wrench either way. A kick
    lasts 20 ms and alone would change the output's rate by a tenth to a half of the declared
    region's.

    Raises:
        NoValueError: If a run ended early, or no kick pushed s off its surface.
    """
    family = _declared(lab, system)
    nominal = find_experiment(system, "nominal")
    eta = family.rate
    if not lab.controller(nominal, plant, "grosmc").parameters.eta:
        eta = -(slowest_approach(lab, plant, system=system, rate=0.0).value or 0.0)
    if eta <= 0:
        return ClaimValue(None, "the switching term does not drive s back")

    masses = dict.fromkeys(family.mass)
    lengths = dict.fromkeys(family.length)
    loads = (-1, 1)
    if not family.wrench.any():
        loads = (0,)
    returns = []
    for mass, length, load, share in itertools.product(masses, lengths, loads, _SHARES):
        still = perturbed(system, "kick", _KICKED + 2, mass, length)
        case = _kicked(lab, still, plant, share, load * family.wrench[-6:])
        result = lab.run_with(case, plant, lab.controller(case, plant, "grosmc"))
        where = f"{mass:g} times the mass, {length:g} times the length"
        measured = _return(result, eta, where)
        if measured is not None:
            returns.append(measured)

    if not returns:
        raise NoValueError("no kick pushed s off its surface")
    for measured in returns:
        if measured.value is None:
            return measured
    return max(returns, key=lambda measured: measured.value or 0.0)


def _kicked(
    lab: RunCache, still: Experiment, plant: PlantName, share: float, load: Array
) -> Experiment:
    """An experiment under a kick, a share of the largest, and a constant wrench, (6,)."""
    kick = share * _impulse(lab, still, plant) / _KICK * np.eye(6)[4]
    body = find_system(still.system).uncertain_body
    disturbances = [Disturbance(body, tuple(kick.tolist()), Pulse(_KICKED, _KICKED + _KICK))]
    if load.any():
        disturbances.append(Disturbance(body, tuple(load.tolist()), Constant()))
    return still.changed(disturbances=tuple(disturbances))


def _impulse(lab: RunCache, still: Experiment, plant: PlantName) -> float:
    """The impulse on a body [N m s] that gives the output the declared region's largest rate."""
    law = lab.controller(still, plant, "grosmc")
    derivative = lab.plant(still, plant).derivative
    system = law.coordinates.system
    x = law.coordinates.place(_KICKED, np.zeros(2), law.parameters)
    torque = np.eye(6 * len(system.bodies))[-2]
    change = derivative(x, 0.0, torque) - derivative(x)
    rate = change[system.output + system.degrees_of_freedom]
    return _region(lab, still)[1] / float(rate)


def _return(result: RunResult, eta: float, where: str) -> ClaimValue | None:
    """The time from a kick until s is zero, over |s| / eta; None if the kick did not move s.

    Raises:
        NoValueError: If the run ended early.
    """
    if result.status is not Status.COMPLETED:
        raise NoValueError(result.ended)

    s = np.ravel(sliding(result.trajectory))
    time = result.trajectory.time[:-1]
    after = time >= _KICKED + _KICK - 1e-9
    chatter = np.abs(s[time < _KICKED - 1e-9]).max()
    start = float(s[after][0])
    if abs(start) < 3 * chatter:
        return None

    back = np.flatnonzero(s[after] * start <= 0)
    if not len(back):
        return ClaimValue(None, f"from |s| = {abs(start):.3g} it never comes back; {where}")
    duration = float(time[after][back[0]] - time[after][0])
    allowed = abs(start) / eta
    note = (
        f"from |s| = {abs(start):.3g} in {duration:.3g} s, allowed {allowed:.3g} s "
        f"with η = {eta:.3g}"
    )
    return ClaimValue(duration / allowed, f"{note}; {where}")


def naive_gain(lab: RunCache, plant: PlantName, *, system: str, case: str) -> ClaimValue:
    """Measure a gain sized on u_c alone over the required one, along the run of a case.

    Assumptions 4 and 6 bound the lumped uncertainty, which contains (r - 1) u with the switching
    input in it. Left out of the bound, |u_d| = |(r - 1)/r u_c + ...| is required while
    |(r - 1) u_c + ...| is configured.

    Raises:
        NoValueError: If nothing pushes s away.
    """
    result = lab.case(system, case, plant, "grosmc")
    true = lab.equations(result.case, plant)
    points = balances_along(result.controller, true, result.trajectory, EVERY, pushed=False)
    naive = float(points.push.max())
    required = float(points.required.max())
    if required < 1e-9:
        raise NoValueError("nothing pushes s away here")

    unit = result.controller.designed.sliding_unit
    note = f"{naive:.3g} sized so, {required:.3g} required [{unit} per s]"
    return from_run(result, naive / required, note)


def worst_matched(lab: RunCache, plant: PlantName, *, system: str) -> ClaimValue:
    """Measure the worst deviation over random plants and matched disturbances of declared size."""
    family = _declared(lab, system)
    body = find_system(system).uncertain_body
    wrench = tuple(family.wrench[-6:].tolist())
    random = np.random.default_rng(2)
    cases = []
    for _ in range(16):
        mass = float(random.uniform(*family.mass))
        length = float(random.uniform(*family.length))
        frequency = float(random.uniform(0.5, 20))
        phase = float(random.uniform(0, 6))
        disturbances = ()
        if family.wrench.any():
            disturbances = (Disturbance(body, wrench, SineFrom(frequency, 0.0, phase)),)
        case = perturbed(system, "matched", 5.0, mass, length)
        cases.append(case.changed(disturbances=disturbances))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random plants and disturbances")


def worst_start(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    bound: float,
) -> ClaimValue:
    """Measure the worst deviation over random starts in a case, in percent of each start.

    Args:
        lab: Cache of the runs.
        plant: The plant.
        system: Its system.
        case: The case, but for its start.
        bound: Bound of each state at the start; the output is at least at half of it.
    """
    experiment = find_experiment(system, case)
    output = find_system(system).output
    random = np.random.default_rng(3)
    cases = []
    for _ in range(8):
        start = random.uniform(-bound, bound, len(experiment.x0))
        start[output] = random.choice([-1, 1]) * random.uniform(bound / 2, bound)
        cases.append(experiment.changed(x0=tuple(start.tolist())))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random starts")


def proof_three(lab: RunCache, _: PlantName) -> ClaimValue:
    """Measure the largest difference of -k s's from -k |s|_1, which proof 3 has, for |s| < 1."""
    law = lab.controller(find_experiment("arm", "nominal"), "corrected", "grosmc")
    k = law.parameters.k
    s = np.linspace(-1, 1, 201)
    difference = -k * s * s + k * np.abs(s)
    return ClaimValue(float(np.abs(difference).max()))


def left_unseen(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure the servo's error 20 s after a start at 1 rad/s, in percent of that at the start.

    The law is the optimal one for Q = diag(0, 1), R = 1. A state that no weight sees costs
    nothing, so the optimum leaves it alone.
    """
    nominal = find_experiment("servo", "nominal")
    law = lab.controller(nominal, plant, "lqr")
    linear = law.designed.lqr
    K, P = optimum_of_rate(linear)
    blind = replace(law, parameters=replace(law.parameters, K=K))
    turning = nominal.changed(x0=(0.0, 1.0), duration=20.0)
    error = lab.run_with(turning, plant, blind).comparison.z[:, 0]

    least = np.linalg.eigvalsh(P).min()
    poles = np.sort(np.linalg.eigvals(linear.A - linear.B @ K).real)
    note = f"poles {poles.round(3).tolist()}, least eigenvalue of P {least:.3g}"
    return ClaimValue(100 * abs(float(error[-1] / error[0])), note)


def optimum_of_rate(servo: LqrDesign) -> tuple[Array, Array]:
    """Return K, (1, 2), and P, (2, 2), of the servo's optimum for Q = diag(0, 1), R = 1.

    The rate does not depend on the angle, so the Riccati equation of the rate alone gives it; P is
    zero beyond. For both states (6) has no stabilizing solution.
    """
    of_rate = lqr(servo.A[1:, 1:], servo.B[1:], 1.0, 1.0)
    K = np.array([[0.0, of_rate.K.item()]])
    P = np.diag([0.0, of_rate.P.item()])
    return K, P


def approach_under_equality(lab: RunCache, plant: PlantName) -> ClaimValue:
    """Measure how fast |s| falls at |s| = 1e-6 rad/s with |d/M| = epsilon, in percent of epsilon.

    The torque epsilon M(q) pushes s away on either side; k s drives it back, eq. (55).
    """
    experiment = find_experiment("arm", "nominal")
    law = lab.controller(experiment, plant, "grosmc")
    true = lab.equations(experiment, plant)
    epsilon = law.parameters.epsilon
    if epsilon == 0:
        return ClaimValue(None, "the law does not switch")

    at_rest = np.zeros(2)
    torque = np.eye(12)[-2]
    load = Loads.of_wrench(torque, true.system)
    slowest = np.inf
    for t in np.linspace(0.1, 2.0, 20).tolist():
        x = law.coordinates.place(t, at_rest, law.parameters)
        pushed_by_torque = balance(law, true, t, x, load).push
        equal = epsilon / pushed_by_torque * torque
        slowest = min(slowest, -_approach(law, true, [(at_rest, t)], equal))

    rate = slowest + 1e-6 * law.parameters.k
    return ClaimValue(100 * rate / epsilon, "the least of 40 states")
