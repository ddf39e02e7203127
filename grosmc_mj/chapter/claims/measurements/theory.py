"""What the theorems say, on the plants: reaching, invariance, and where it is lost."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import per_second
from grosmc_mj.assumptions.balance import balances
from grosmc_mj.chapter.claims.claim import WORDS, Measured, NoValueError
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
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.experiments.plants import PlantName
from grosmc_mj.experiments.runs import RunResult
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.plants import find_system
from grosmc_mj.simulation.disturbances import Constant, Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status

_PLANTS, _STATES = 12, 40
# A kick: when the start's error has passed, and for how long [s].
_KICKED, _KICK = 4.0, 0.02
# Of the declared region's largest rate.
_SHARES = (0.1, 0.25, 0.5)
# Rounding of the plant's accelerations, up to which an inequality counts as met [unit of s/s].
_ROUNDING = WORDS["rounding"]["threshold"]
# Rate by which |s| of the arm must fall, without d(t) [rad/s^2]; the chapter declares nothing.
_ARM_RATE = 1.0
# A constant that no input matches [rad/s].
_DRIFT_OF_ERROR = 0.05

Derivative = Callable[..., Array]


def varied(system: str, name: str, duration: float, mass: float, length: float) -> Experiment:
    """The nominal start with another mass and length of the uncertain body."""
    start = find_experiment(system, "nominal").case.x0
    edit = BodyEdit(find_system(system).uncertain_body, mass, length)
    return trial(system, name, start, duration, (edit,))


def _declared(lab: Laboratory, system: str) -> tuple[float, tuple[tuple[float, float], ...], Array]:
    """Reaching rate, ranges of mass and length scale, and the largest wrench of a system."""
    declared = lab.as_set(find_experiment(system, "nominal")).uncertainty
    if declared is None:
        return _ARM_RATE, PAYLOADS, np.zeros(12)
    scales = (*declared.scales.values(), (1.0, 1.0))[:2]
    return declared.reaching_rate, scales, np.array(declared.wrench)


def _region(lab: Laboratory, case: Experiment) -> tuple[float, ...]:
    """The declared bounds of z."""
    region = lab.as_set(case).region
    assert region is not None
    return region


def slowest_approach(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    rate: float | None = None,
    torque: float = 0.0,
) -> Measured:
    """The largest s' sgn(s) + eta over the declared family, by the plant's own accelerations.

    eta is the law's own, unless another rate is given; so is the largest disturbance [N m] where
    nothing is declared. Of one input it is what |G B delta| exceeds (gamma0 + gamma1 |x|) |G B| by,
    on the side on which delta pushes s away.
    """
    key = ("slowest approach", plant, system, rate, torque)
    return lab.once(key, lambda: _slowest_approach(lab, plant, system, rate, torque))


def _slowest_approach(
    lab: Laboratory, plant: PlantName, system: str, rate: float | None, torque: float
) -> Measured:
    declared, scales, wrench = _declared(lab, system)
    wrench = wrench + torque * np.eye(len(wrench))[-2]
    random, worst, own = np.random.default_rng(1), -np.inf, rate
    region = _region(lab, find_experiment(system, "nominal"))
    for index in range(_PLANTS):
        ends = [(low, high)[(index >> bit) & 1] for bit, (low, high) in enumerate(scales)]
        inner = [random.uniform(low, high) for low, high in scales]
        case = varied(system, "reaching", 1.0, *(ends if index < 4 else inner))
        law = lab.controller(case, plant, "grosmc")
        own = law.parameters.eta if rate is None else rate
        places = ((random.uniform(-1, 1, 2) * region, random.uniform(0, 2)) for _ in range(_STATES))
        worst = max(worst, approach(law, lab.plant(case, plant).derivative, places, wrench))
    assert own is not None
    note = f"{_PLANTS} plants x {_STATES} states"
    if rate is None:
        note += f"; η = {own:.3g}, with the declared {declared:.3g} it is {worst + declared:.3g}"
    return Measured(worst + own, note)


def approach(
    law: Controller, derivative: Derivative, places: Iterable[tuple[Array, float]], wrench: Array
) -> float:
    """The largest s_i' sgn(s_i) next to the surfaces, on every side, under the wrench either way.

    The continuous reading: the law is evaluated next to its surface, and s' follows from x' there
    and then, without a time step. It is -infinity where the plant or the law is undefined.

    Args:
        law: With a surface.
        derivative: Of the plant that it meets.
        places: Error states z, (n,), and times [s].
        wrench: (6 * bodies,).
    """
    error, p, worst = law.coordinates, law.parameters, -np.inf
    assert isinstance(error, ErrorCoordinates)
    system, memory, aside = error.system, surface_memory(law), 1e-6 * np.linalg.pinv(p.G)
    for z, t in places:
        x = error.place(t, z, p)
        if abs(x[system.output]) > system.position_bound or not system.linearizable(x):
            continue
        slope = np.reshape(error.linearization.slope(x, p.plant), (error.size, len(x)))
        raised = error.raised_along([t], p)[0]
        for *signs, push in itertools.product((-1.0, 1.0), repeat=len(p.G) + 1):
            sides = np.array(signs)
            memory.z0[:], memory.t = z - aside @ sides, t
            u = law.input_at(t, x, memory)
            dz = error.sign * (slope @ derivative(x, u, push * wrench) - raised)
            worst = max(worst, float((sides * (p.G @ dz - p.S @ z)).max()))
    return worst


def unbounded(lab: Laboratory, *, system: str, assumption: str) -> str:
    """By how much the lumped uncertainty exceeds its bound in (12) or (37); empty if it does not.

    delta contains the switching input where the input gain is uncertain. The rate that the gains
    are declared for is the eta of a split of the same law that counts it.
    """
    declared, _, _ = _declared(lab, system)
    law = lab.controller(find_experiment(system, "nominal"), "corrected", "grosmc")
    excess, eta = slowest_approach(lab, "corrected", system=system).value, law.parameters.eta
    if excess is None or excess <= _ROUNDING:
        return ""
    unit = per_second(law.designed.sliding_unit)
    words = (
        f"{assumption}, with u_d counted in δ: |δ| exceeds γ0 + γ1 |x| by up to {excess:.3g} {unit}"
    )
    if excess - eta + declared > _ROUNDING:
        return words
    return (
        f"{words}, restored by η = {declared:.3g} {unit} with the other {eta - declared:.3g} "
        f"{unit} of the law's η = {eta:.3g} counted in γ0 and γ1: the same law, split so that they "
        "bound what u_d itself adds to δ"
    )


def reaching_time(lab: Laboratory, plant: PlantName, *, system: str) -> Measured:
    """How long s takes back to zero after a kick, over |s| / eta: the worst kick and plant.

    eta is the law's own; where it has none, what (56) leaves of epsilon over the declared family.
    The plants are the extremes of that family, under its largest wrench either way. A kick lasts
    20 ms and alone would change the output's rate by a tenth to a half of the declared region's.
    """
    _, scales, wrench = _declared(lab, system)
    body, returns = find_system(system).uncertain_body, []
    p = lab.controller(find_experiment(system, "nominal"), plant, "grosmc").parameters
    eta = p.eta or -(slowest_approach(lab, plant, system=system, rate=0.0).value or 0.0)
    if eta <= 0:
        return Measured(None, "the switching term does not drive s back")
    plants = list(itertools.product(*map(dict.fromkeys, scales)))
    loads = (-1, 1) if wrench.any() else (0,)
    for (mass, length), load, share in itertools.product(plants, loads, _SHARES):
        still = varied(system, "kick", _KICKED + 2, mass, length)
        kick = share * _impulse(lab, still, plant) / _KICK * np.eye(6)[4]
        acting = ((kick, Pulse(_KICKED, _KICKED + _KICK)), (load * wrench[-6:], Constant()))
        case = still.varied(
            disturbances=tuple(
                Disturbance(body, tuple(w.tolist()), course) for w, course in acting if w.any()
            )
        )
        result = lab.run_with(case, plant, lab.controller(case, plant, "grosmc"))
        where = f"{mass:g} times the mass, {length:g} times the length"
        returns += _return(result, eta, where)
    if not returns:
        raise NoValueError("no kick pushed s off its surface")
    never = [measured for measured in returns if measured.value is None]
    return never[0] if never else max(returns, key=lambda measured: measured.value or 0.0)


def _impulse(lab: Laboratory, still: Experiment, plant: PlantName) -> float:
    """The impulse on a body [N m s] that gives the output the declared region's largest rate."""
    law, derivative = lab.controller(still, plant, "grosmc"), lab.plant(still, plant).derivative
    system = law.coordinates.system
    x = law.coordinates.place(_KICKED, np.zeros(2), law.parameters)
    moved = derivative(x, 0.0, np.eye(6 * len(system.bodies))[-2]) - derivative(x)
    rate = moved[system.output + system.degrees_of_freedom]
    return _region(lab, still)[1] / float(rate)


def _return(result: RunResult, eta: float, where: str) -> list[Measured]:
    """The time from a kick until s is zero, over |s| / eta; none if it pushed s nowhere."""
    if result.status is not Status.COMPLETED:
        raise NoValueError(result.ended)
    s, time = np.ravel(sliding(result.trajectory)), result.trajectory.time[:-1]
    after = time >= _KICKED + _KICK - 1e-9
    ordinary, start = np.abs(s[time < _KICKED - 1e-9]).max(), float(s[after][0])
    if abs(start) < 3 * ordinary:
        return []
    back = np.flatnonzero(s[after] * start <= 0)
    if not len(back):
        return [Measured(None, f"from |s| = {abs(start):.3g} it never comes back; {where}")]
    taken, allowed = float(time[after][back[0]] - time[after][0]), abs(start) / eta
    note = (
        f"from |s| = {abs(start):.3g} in {taken:.3g} s, allowed {allowed:.3g} s with η = {eta:.3g}"
    )
    return [Measured(taken / allowed, f"{note}; {where}")]


def worst_matched(lab: Laboratory, plant: PlantName, *, system: str) -> Measured:
    """Worst deviation over random plants and matched disturbances of the declared size."""
    _, scales, wrench = _declared(lab, system)
    random, body, cases = np.random.default_rng(2), find_system(system).uncertain_body, []
    for _ in range(16):
        mass, length = (float(random.uniform(*scale)) for scale in scales)
        wave = SineFrom(float(random.uniform(0.5, 20)), 0.0, float(random.uniform(0, 6)))
        push = tuple(wrench[-6:].tolist())
        pushes = (Disturbance(body, push, wave),) if wrench.any() else ()
        cases.append(varied(system, "matched", 5.0, mass, length).varied(disturbances=pushes))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random plants and disturbances")


def worst_start(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, bound: float
) -> Measured:
    """Worst deviation over random starts in a case, in percent of each start.

    Args:
        lab: Where it is measured.
        plant: On which plant.
        system: Of which plant.
        case: The case, but for its start.
        bound: Of each state at the start; of the output it is at least half of it.
    """
    random, cases = np.random.default_rng(3), []
    experiment, output = find_experiment(system, case), find_system(system).output
    for _ in range(8):
        start = random.uniform(-bound, bound, len(experiment.case.x0))
        start[output] = random.choice([-1, 1]) * random.uniform(bound / 2, bound)
        cases.append(experiment.varied(x0=tuple(start.tolist())))
    return worst_deviation(lab, plant, cases, f"{len(cases)} random starts")


def unmatched_drift(lab: Laboratory, plant: PlantName) -> Measured:
    """max |x1 - x1*| of the servo with a constant 0.05 rad/s added to theta', in percent."""
    case = find_experiment("servo", "nominal")
    law, servo = lab.controller(case, plant, "grosmc"), lab.equations(case, plant)
    rate, acceleration = servo.system.equations.f
    drifting = replace(servo.system.equations, f=(rate + _DRIFT_OF_ERROR, acceleration))
    strange = replace(servo, system=replace(servo.system, equations=drifting))
    # The law goes on believing in the true kinematics: it is designed for another system.
    unaware = replace(law, design=None)
    run = simulate(
        strange, unaware, case.case.x0, duration=5.0, control_period=lab.settings.control_period,
        timestep=lab.settings.timestep, engine=lab.settings.engine_for(unaware),
    )  # fmt: skip
    return Measured(from_optimum(compare_with_optimum(run, law)))


def proof_three(lab: Laboratory, _: PlantName) -> Measured:
    """Largest difference between -k s's and -k |s|_1 as proof 3 writes it, for |s| below 1."""
    law = lab.controller(find_experiment("arm", "nominal"), "corrected", "grosmc")
    s = np.linspace(-1, 1, 201)
    return Measured(float(np.abs(-law.parameters.k * s * s + law.parameters.k * np.abs(s)).max()))


def optimal_gain(A: Array, B: Array, Q: Array) -> tuple[Array, Array]:
    """K and P of the optimal law for R = 1, the limit of those for finite horizons.

    It exists also where (6) has no stabilizing solution: the Riccati differential equation is
    integrated from P = 0 over 100 s.

    Args:
        A: State matrix, (n, n).
        B: Input matrix, (n, m).
        Q: Weight of the state, (n, n), positive semidefinite.
    """
    # Here, for it is a part of scipy that little needs.
    from scipy.integrate import solve_ivp

    def slope(_: float, flat: Array) -> Array:
        P = flat.reshape(A.shape)
        return (P @ A + A.T @ P - P @ B @ B.T @ P + Q).ravel()

    solution = solve_ivp(slope, (0.0, 100.0), np.zeros(A.size), "LSODA", rtol=1e-10, atol=1e-12)
    P = solution.y[:, -1].reshape(A.shape)
    return B.T @ P, P


def left_unseen(lab: Laboratory, plant: PlantName) -> Measured:
    """The servo's error 20 s after a start at 1 rad/s, in percent of that at the start.

    Under the optimal law for Q = diag(0, 1), R = 1. What no weight sees costs nothing, so
    the optimum leaves it alone.
    """
    experiment = find_experiment("servo", "nominal")
    law = lab.controller(experiment, plant, "lqr")
    linear = law.designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.diag([0.0, 1.0]))
    run = simulate(
        lab.plant(experiment, plant), replace(law, parameters=replace(law.parameters, K=K)),
        [0.0, 1.0], duration=20.0, control_period=lab.settings.control_period,
        timestep=lab.settings.timestep,
    )  # fmt: skip
    error = law.coordinates.along(run.time, run.state, law.parameters)[:, 0]
    least, slowest = np.linalg.eigvalsh(P).min(), np.linalg.eigvals(linear.A - linear.B @ K).real
    note = f"poles {np.sort(slowest).round(3).tolist()}, least eigenvalue of P {least:.3g}"
    return Measured(100 * abs(float(error[-1] / error[0])), note)


def approach_under_equality(lab: Laboratory, plant: PlantName) -> Measured:
    """How fast |s| falls next to the surface with |d/M| = epsilon, in percent of epsilon.

    The torque that is epsilon M(q) pushes s away on either side.
    """
    experiment = find_experiment("arm", "nominal")
    law = lab.controller(experiment, plant, "grosmc")
    derivative, epsilon = lab.plant(experiment, plant).derivative, law.parameters.epsilon
    if epsilon == 0:
        return Measured(None, "the law does not switch")
    z, unit, fastest = np.zeros(2), np.eye(12)[-2], -np.inf
    for t in np.linspace(0.1, 2.0, 20).tolist():  # the law begins at 0
        x = law.coordinates.place(t, z, law.parameters)
        moved = (derivative(x, 0.0, unit) - derivative(x))[1]
        fastest = max(fastest, approach(law, derivative, [(z, t)], epsilon / moved * unit))
    return Measured(-100 * fastest / epsilon, "the least of 40 states")


def growth_of_mismatch(lab: Laboratory, plant: PlantName, *, heaviest: float = 2.0) -> Measured:
    """How much a wrong M(q) pushes s, with rates five times the region's over within it."""
    case = varied("arm", "payload", 1.0, heaviest, 1.0)
    law, true = lab.controller(case, plant, "grosmc"), lab.equations(case, plant)
    sides, pushes = np.linspace(-1, 1, 9), []
    region = _region(lab, case)
    for factor in (1.0, 5.0):
        bounds = np.array([1.0, factor]) * region
        grid = (bounds * z for z in itertools.product(sides, sides))
        places = [law.coordinates.place(0.0, z, law.parameters) for z in grid]
        x = np.array([place for place in places if true.system.linearizable(place)])
        points = balances(law, true, [0.0] * len(x), x, np.zeros((len(x), 12)))
        pushes.append(float(points.push.max()))
    if pushes[0] < 1e-9:
        raise NoValueError("nothing pushes s away here")
    note = f"{pushes[1]:.3g} rad/s² against {pushes[0]:.3g} rad/s²"
    return Measured(pushes[1] / pushes[0], note)
