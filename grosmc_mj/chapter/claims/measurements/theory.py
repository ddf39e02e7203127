"""Statements of the theorems on the plants: reaching, invariance, and its limits."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balances
from grosmc_mj.chapter.claims.claim import Measured, NoValueError
from grosmc_mj.chapter.claims.measurements.arm import PAYLOADS
from grosmc_mj.chapter.claims.measurements.measures import (
    from_optimum,
    sliding,
    surface_memory,
    worst_deviation,
)
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment, RunResult
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.run_cache import RunCache, trial
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.plants import AnalyticPlant, find_system
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status

# Plants of a declared family, and random states of each.
_PLANTS = 12
_STATES = 40
# A kick begins when the start's error has passed, and lasts so long [s].
_KICKED = 4.0
_KICK = 0.02
# Kicks, as shares of the declared region's largest rate.
_SHARES = (0.1, 0.25, 0.5)
_SIGNS = (-1.0, 1.0)
# Rounding of the plant's accelerations, up to which an inequality counts as met [unit of s/s].
# Rate by which |s| of the arm must fall, without d(t) [rad/s^2]; the chapter declares nothing.
_ARM_RATE = 1.0
# A constant that no input matches [rad/s].
_DRIFT_OF_ERROR = 0.05

Derivative = Callable[..., Array]
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
    start = find_experiment(system, "nominal").case.x0
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
) -> Measured:
    """Measure the largest s' sgn(s) + eta over the declared family.

    s' follows from the plant's own accelerations. A law's gain eta + gamma0 may be split in any
    way: eta is the reaching rate that is declared, and the rest of the law's own eta is counted in
    gamma0. For one input the value is the excess of |G B delta| over (gamma0 + gamma1 |x|) |G B|,
    on the side on which delta pushes s away.

    Args:
        lab: Cache of the runs.
        plant: The plant.
        system: Its system.
        rate: eta; the declared reaching rate by default.
        torque: Largest disturbance beyond the declared one [N m].
    """
    key = ("slowest approach", plant, system, rate, torque)
    return lab.once(key, lambda: _slowest_approach(lab, plant, system, rate, torque))


def _slowest_approach(
    lab: RunCache,
    plant: PlantName,
    system: str,
    rate: float | None,
    torque: float,
) -> Measured:
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
        derivative = lab.plant(case, plant).derivative
        worst = max(worst, approach(law, derivative, places, wrench))

    note = f"{_PLANTS} plants x {_STATES} states"
    if rate is not None:
        return Measured(worst + rate, note)
    rest = eta_of_law - family.rate
    note += f"; η = {family.rate:.3g}, the other {rest:.3g} of the law's counted in γ0"
    return Measured(worst + family.rate, note)


def approach(
    law: Controller,
    derivative: Derivative,
    places: Iterable[tuple[Array, float]],
    wrench: Array,
) -> float:
    """Return the largest s_i' sgn(s_i) next to the surfaces, on every side.

    The law is read as continuous: it is evaluated next to its surface, and s' follows from x' at
    the same instant, without a time step. The wrench acts either way.

    Args:
        law: Law with a surface.
        derivative: x' of the plant that it meets.
        places: Error states z, (n,), and times [s].
        wrench: (6 * bodies,).

    Returns:
        -infinity where the plant or the law is undefined.
    """
    error = law.coordinates
    assert isinstance(error, ErrorCoordinates)
    p = law.parameters
    system = error.system
    memory = surface_memory(law)
    memory.begun = 1.0
    # Moves z by 1e-6 of s.
    aside = 1e-6 * np.linalg.pinv(p.G)

    worst = -np.inf
    for z, t in places:
        x = error.place(t, z, p)
        if abs(x[system.output]) > system.position_bound or not system.linearizable(x):
            continue
        slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))
        raised = error.raised_along([t], p)[0]

        for *signs, push in itertools.product(_SIGNS, repeat=len(p.G) + 1):
            sides = np.array(signs)
            memory.z0[:] = z - aside @ sides
            memory.t = t
            u = law.input_at(t, x, memory)
            dz = error.sign * (slope @ derivative(x, u, push * wrench) - raised)
            ds = p.G @ dz - p.S @ z
            worst = max(worst, float((sides * ds).max()))
    return worst


def reaching_time(lab: RunCache, plant: PlantName, *, system: str) -> Measured:
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
        return Measured(None, "the switching term does not drive s back")

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
    body = find_system(still.case.system).uncertain_body
    disturbances = [Disturbance(body, tuple(kick.tolist()), Pulse(_KICKED, _KICKED + _KICK))]
    if load.any():
        disturbances.append(Disturbance(body, tuple(load.tolist()), Constant()))
    return still.varied(disturbances=tuple(disturbances))


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


def _return(result: RunResult, eta: float, where: str) -> Measured | None:
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
        return Measured(None, f"from |s| = {abs(start):.3g} it never comes back; {where}")
    duration = float(time[after][back[0]] - time[after][0])
    allowed = abs(start) / eta
    note = (
        f"from |s| = {abs(start):.3g} in {duration:.3g} s, allowed {allowed:.3g} s "
        f"with η = {eta:.3g}"
    )
    return Measured(duration / allowed, f"{note}; {where}")


def worst_matched(lab: RunCache, plant: PlantName, *, system: str) -> Measured:
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
        cases.append(case.varied(disturbances=disturbances))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random plants and disturbances")


def worst_start(
    lab: RunCache,
    plant: PlantName,
    *,
    system: str,
    case: str,
    bound: float,
) -> Measured:
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
        start = random.uniform(-bound, bound, len(experiment.case.x0))
        start[output] = random.choice([-1, 1]) * random.uniform(bound / 2, bound)
        cases.append(experiment.varied(x0=tuple(start.tolist())))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random starts")


def unmatched_drift(lab: RunCache, plant: PlantName) -> Measured:
    """Measure max |x1 - x1*| of the servo in percent, with 0.05 rad/s added to theta'."""
    case = find_experiment("servo", "nominal")
    law = lab.controller(case, plant, "grosmc")
    servo = lab.equations(case, plant)
    rate, acceleration = servo.system.symbolic_equations.f
    drifting = replace(servo.system.symbolic_equations, f=(rate + _DRIFT_OF_ERROR, acceleration))
    strange = replace(servo, system=replace(servo.system, equations=drifting))

    # The law believes in the true kinematics: it is designed for another system.
    unaware = replace(law, design=None)
    run = simulate(
        strange,
        unaware,
        case.case.x0,
        duration=5.0,
        control_period=lab.settings.control_period,
        timestep=lab.settings.timestep,
        engine=lab.settings.engine_for(unaware),
    )
    return Measured(from_optimum(compare_with_optimum(run, law)))


def proof_three(lab: RunCache, _: PlantName) -> Measured:
    """Measure the largest difference of -k s's from -k |s|_1, which proof 3 has, for |s| < 1."""
    law = lab.controller(find_experiment("arm", "nominal"), "corrected", "grosmc")
    k = law.parameters.k
    s = np.linspace(-1, 1, 201)
    difference = -k * s * s + k * np.abs(s)
    return Measured(float(np.abs(difference).max()))


def optimal_gain(A: Array, B: Array, Q: Array) -> tuple[Array, Array]:
    """Return K and P of the optimal law for R = 1, the limit of those for finite horizons.

    It exists also where (6) has no stabilizing solution: the Riccati differential equation is
    integrated from P = 0 over 100 s.

    Args:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: Positive semidefinite weight of the state, (n, n).

    Returns:
        K, (m, n), and P, (n, n).
    """
    # Imported late: few commands need this part of scipy.
    from scipy.integrate import solve_ivp

    solution = solve_ivp(
        _riccati_rate,
        (0.0, 100.0),
        np.zeros(A.size),
        "LSODA",
        args=(A, B, Q),
        rtol=1e-10,
        atol=1e-12,
    )
    P = solution.y[:, -1].reshape(A.shape)
    return B.T @ P, P


def _riccati_rate(
    _: float,
    flat: Array,
    A: Array,
    B: Array,
    Q: Array,
) -> Array:
    """-P' of the Riccati differential equation backwards in time for R = 1, (n * n,)."""
    P = flat.reshape(A.shape)
    return (P @ A + A.T @ P - P @ B @ B.T @ P + Q).ravel()


def left_unseen(lab: RunCache, plant: PlantName) -> Measured:
    """Measure the servo's error 20 s after a start at 1 rad/s, in percent of that at the start.

    The law is the optimal one for Q = diag(0, 1), R = 1. A state that no weight sees costs
    nothing, so the optimum leaves it alone.
    """
    experiment = find_experiment("servo", "nominal")
    law = lab.controller(experiment, plant, "lqr")
    linear = law.designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.diag([0.0, 1.0]))
    run = simulate(
        lab.plant(experiment, plant),
        replace(law, parameters=replace(law.parameters, K=K)),
        [0.0, 1.0],
        duration=20.0,
        control_period=lab.settings.control_period,
        timestep=lab.settings.timestep,
    )

    error = law.coordinates.along(run.time, run.state, law.parameters)[:, 0]
    least = np.linalg.eigvalsh(P).min()
    poles = np.sort(np.linalg.eigvals(linear.A - linear.B @ K).real)
    note = f"poles {poles.round(3).tolist()}, least eigenvalue of P {least:.3g}"
    return Measured(100 * abs(float(error[-1] / error[0])), note)


def approach_under_equality(lab: RunCache, plant: PlantName) -> Measured:
    """Measure how fast |s| falls next to the surface with |d/M| = epsilon, in percent of epsilon.

    The torque epsilon M(q) pushes s away on either side.
    """
    experiment = find_experiment("arm", "nominal")
    law = lab.controller(experiment, plant, "grosmc")
    derivative = lab.plant(experiment, plant).derivative
    epsilon = law.parameters.epsilon
    if epsilon == 0:
        return Measured(None, "the law does not switch")

    z = np.zeros(2)
    torque = np.eye(12)[-2]
    largest = -np.inf
    # The law begins at 0, where it takes z for its own z(0).
    for t in np.linspace(0.1, 2.0, 20).tolist():
        x = law.coordinates.place(t, z, law.parameters)
        acceleration = (derivative(x, 0.0, torque) - derivative(x))[1]
        equal = epsilon / acceleration * torque
        largest = max(largest, approach(law, derivative, [(z, t)], equal))
    return Measured(-100 * largest / epsilon, "the least of 40 states")


def growth_of_mismatch(lab: RunCache, plant: PlantName, *, heaviest: float = 2.0) -> Measured:
    """Measure how much more a wrong M(q) drives s off if the rates may be five times as large.

    It is the largest rate of s on a grid with five times the declared bound of the rate, divided
    by that on a grid within the declared region.

    Raises:
        NoValueError: If nothing pushes s away within the region.
    """
    case = perturbed("arm", "payload", 1.0, heaviest, 1.0)
    law = lab.controller(case, plant, "grosmc")
    true = lab.equations(case, plant)
    region = _region(lab, case)
    within = _largest_push(law, true, np.array([1.0, 1.0]) * region)
    beyond = _largest_push(law, true, np.array([1.0, 5.0]) * region)
    if within < 1e-9:
        raise NoValueError("nothing pushes s away here")
    return Measured(beyond / within, f"{beyond:.3g} rad/s² against {within:.3g} rad/s²")


def _largest_push(law: Controller, true: AnalyticPlant, bounds: Array) -> float:
    """The largest rate that the mismatch gives s on a grid within bounds of z, (2,)."""
    states = []
    sides = np.linspace(-1, 1, 9)
    for z in itertools.product(sides, sides):
        x = law.coordinates.place(0.0, bounds * z, law.parameters)
        if true.system.linearizable(x):
            states.append(x)

    count = len(states)
    points = balances(law, true, [0.0] * count, np.array(states), np.zeros((count, 12)))
    return float(points.push.max())
