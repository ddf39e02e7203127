"""What the theorems say, on the plants: reaching, invariance, and where it is lost."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.audit import per_second
from grosmc_mj.assumptions.balance import balances
from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.arm import PAYLOADS
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, sliding, surface_memory
from grosmc_mj.chapter.claims.words import WORDS
from grosmc_mj.control.controller import Controller
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
_ROUNDING = WORDS["rounding"]["at_most"]
# What |s| of the arm shall fall by, without d(t) [rad/s^2]; the chapter declares nothing.
_ARM_RATE = 1.0


def _start(system: str) -> tuple[float, ...]:
    """Where the nominal case begins."""
    return find_experiment(system, "nominal").case.x0


def _declared(lab: Laboratory, system: str) -> tuple[float, tuple[tuple[float, float], ...], Array]:
    """Reaching rate, ranges of mass and length scale, and the largest wrench of a system."""
    declared = lab.as_set(find_experiment(system, "nominal")).uncertainty
    if declared is None:
        return _ARM_RATE, PAYLOADS, np.zeros(12)
    scales = (*declared.scales.values(), (1.0, 1.0))[:2]
    return declared.reaching_rate, scales, np.array(declared.wrench)


def slowest_approach(
    lab: Laboratory,
    plant: PlantName,
    *,
    system: str,
    rate: float | None = None,
    epsilon: float | None = None,
    torque: float = 0.0,
) -> Measured:
    """The largest s' sgn(s) + eta over the declared family, by the plant's own accelerations.

    eta is the law's own, unless another rate is given; so are epsilon and the largest disturbance
    [N m] where nothing is declared. Of one input it is what |G B delta| exceeds
    (gamma0 + gamma1 |x|) |G B| by, on the side on which delta pushes s away.
    The continuous reading: at each state the law is asked on both sides of its surface, and s'
    follows from x' there and then, without a time step.
    """
    declared, scales, wrench = _declared(lab, system)
    wrench = wrench + torque * np.eye(len(wrench))[-2]
    lab = lab if epsilon is None else lab.varied("laws.grosmc.epsilon", epsilon)
    random, worst, own = np.random.default_rng(1), -np.inf, rate
    body = find_system(system).uncertain_body
    for index in range(_PLANTS):
        ends = [(low, high)[(index >> bit) & 1] for bit, (low, high) in enumerate(scales)]
        inner = [random.uniform(low, high) for low, high in scales]
        mass, length = ends if index < 4 else inner
        case = trial(system, "reaching", _start(system), 1.0, (BodyEdit(body, mass, length),))
        law = lab.controller(case, plant, "grosmc")
        own = law.parameters.eta if rate is None else rate
        derivative = lab.plant(case, plant).derivative
        region = lab.as_set(case).region or ()
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 2) * region
            t = random.uniform(0, 2)
            for side, push in itertools.product((-1.0, 1.0), repeat=2):
                worst = max(worst, _approach(law, derivative, t, z, side, push * wrench))
    assert own is not None
    said = f"; η = {own:.3g}, with the declared {declared:.3g} it is {worst + declared:.3g}"
    return Measured(
        worst + own, f"{_PLANTS} plants x {_STATES} states{said if rate is None else ''}"
    )


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
    said = (
        f"{assumption}, with u_d counted in δ: |δ| exceeds γ0 + γ1 |x| by up to {excess:.3g} {unit}"
    )
    if excess - eta + declared > _ROUNDING:
        return said
    return (
        f"{said}, restored by η = {declared:.3g} {unit} with the other {eta - declared:.3g} {unit} "
        f"of the law's η = {eta:.3g} counted in γ0 and γ1: the same law, split so that they bound "
        "what u_d itself adds to δ"
    )


def _approach(
    law: Controller,
    derivative: Callable[[Array, float, Array], Array],
    t: float,
    z: Array,
    side: float,
    w: Array,
) -> float:
    """s' sgn(s) next to the surface; -infinity where the plant or the law is undefined."""
    error, p = law.coordinates, law.parameters
    system = error.system
    ddy_r = error.reference(t, p.reference)[-1]
    x = error.place(t, z, p)
    velocity = system.output + system.degrees_of_freedom
    if abs(x[system.output]) > system.position_bound or not system.linearizable(x):
        return -np.inf
    near = 1e-6 * side * p.G[0] / (p.G[0] @ p.G[0])
    memory = surface_memory(law)
    memory.z0[:], memory.t = z - near, t
    u = law.input_at(t, x, memory)
    dz2 = error.sign * (derivative(x, u.item(), w)[velocity] - ddy_r)
    return float(side * (p.G @ np.array([z[1], dz2]) - p.S @ z)[0])


def reaching_time(lab: Laboratory, plant: PlantName, *, system: str) -> Measured:
    """How long s takes back to zero after a kick, over |s| / eta: the worst kick and plant.

    eta is the law's own; where it has none, what (56) leaves of epsilon over the declared family.
    The plants are the extremes of that family, under its largest wrench either way. A kick lasts
    20 ms and alone would change the output's rate by a tenth to a half of the declared region's.
    """
    _, scales, wrench = _declared(lab, system)
    body, found = find_system(system).uncertain_body, []
    p = lab.controller(find_experiment(system, "nominal"), plant, "grosmc").parameters
    eta = p.eta or -(slowest_approach(lab, plant, system=system, rate=0.0).value or 0.0)
    if eta <= 0:
        return Measured(None, "the switching term does not drive s back")
    plants = list(itertools.product(*map(dict.fromkeys, scales)))
    loads = (-1, 1) if wrench.any() else (0,)
    for (mass, length), load, share in itertools.product(plants, loads, _SHARES):
        still = trial(system, "kick", _start(system), _KICKED + 2, (BodyEdit(body, mass, length),))
        kick = share * _impulse(lab, still, plant) / _KICK * np.eye(6)[4]
        acting = ((kick, Pulse(_KICKED, _KICKED + _KICK)), (load * wrench[-6:], Constant()))
        case = still.varied(
            disturbances=tuple(
                Disturbance(body, tuple(w.tolist()), course) for w, course in acting if w.any()
            )
        )
        result = lab.run_with(case, plant, lab.controller(case, plant, "grosmc"))
        if result.status is not Status.COMPLETED:
            return Measured(None, result.ended, broken=True)
        if (measured := _return(result, eta)) is not None:
            where = f"{mass:g} times the mass, {length:g} times the length"
            found.append(measured._replace(note=f"{measured.note}; {where}"))
    if not found:
        return Measured(None, "no kick pushed s off its surface", broken=True)
    never = [each for each in found if each.value is None]
    return never[0] if never else max(found, key=lambda each: each.value or 0.0)


def _impulse(lab: Laboratory, still: Experiment, plant: PlantName) -> float:
    """The impulse on a body [N m s] that gives the output the declared region's largest rate."""
    law, region = lab.controller(still, plant, "grosmc"), lab.as_set(still).region
    system, derivative = law.coordinates.system, lab.plant(still, plant).derivative
    assert region is not None
    x = law.coordinates.place(_KICKED, np.zeros(2), law.parameters)
    unit = np.eye(6 * len(system.bodies))[-2]
    moved = derivative(x, 0.0, unit) - derivative(x, 0.0, 0 * unit)
    return region[1] / float(moved[system.output + system.degrees_of_freedom])


def _return(result: RunResult, eta: float) -> Measured | None:
    """The time from a kick until s is zero, over |s| / eta; None if it pushed s nowhere."""
    run = result.trajectory
    s, time = np.ravel(sliding(run)), run.time[:-1]
    after = time >= _KICKED + _KICK - 1e-9
    ordinary, start = np.abs(s[time < _KICKED - 1e-9]).max(), float(s[after][0])
    if abs(start) < 3 * ordinary:
        return None
    back = np.flatnonzero(s[after] * start <= 0)
    if not len(back):
        return Measured(None, f"from |s| = {abs(start):.3g} it never comes back")
    taken, allowed = float(time[after][back[0]] - time[after][0]), abs(start) / eta
    note = (
        f"from |s| = {abs(start):.3g} in {taken:.3g} s, allowed {allowed:.3g} s with η = {eta:.3g}"
    )
    return Measured(taken / allowed, note)


def worst_matched(lab: Laboratory, plant: PlantName, *, system: str) -> Measured:
    """Worst deviation over random plants and matched disturbances of the declared size."""
    _, scales, wrench = _declared(lab, system)
    random, body = np.random.default_rng(2), find_system(system).uncertain_body
    cases = []
    for _ in range(16):
        mass, length = (float(random.uniform(*scale)) for scale in scales)
        push = (*(float(each) for each in wrench[-6:]),)
        wave = SineFrom(float(random.uniform(0.5, 20)), 0.0, float(random.uniform(0, 6)))
        cases.append(
            trial(
                system, "matched", _start(system), 5.0, (BodyEdit(body, mass, length),),
                (Disturbance(body, push, wave),) if wrench.any() else (),  # pyright: ignore
            )
        )  # fmt: skip
    return _worst(lab, plant, cases, f"{len(cases)} random plants and disturbances")


def worst_start(
    lab: Laboratory, plant: PlantName, *, system: str, case: str, bound: float
) -> Measured:
    """Worst deviation over random starts in a case, in percent of each start.

    Args:
        lab: Where it is measured.
        plant: On which.
        system: Of which plant.
        case: The case, but for its start.
        bound: Of each state at the start; of the output it is at least half of it.
    """
    random, cases = np.random.default_rng(3), []
    output = find_system(system).output
    for _ in range(8):
        start = random.uniform(-bound, bound, len(_start(system)))
        start[output] = random.choice([-1, 1]) * random.uniform(bound / 2, bound)
        cases.append(find_experiment(system, case).varied(x0=tuple(start.tolist())))
    return _worst(lab, plant, cases, f"{len(cases)} random starts")


def _worst(lab: Laboratory, plant: PlantName, cases: Sequence[Experiment], what: str) -> Measured:
    """Worst max |y - y*| over experiments, in percent of each start."""
    law, runs = lab.batch(cases, plant, "grosmc")
    worst = 0.0
    for index in range(len(cases)):
        run = runs[index]
        if run.status is not Status.COMPLETED:
            return Measured(None, "a run ended early", broken=True)
        worst = max(worst, from_optimum(compare_with_optimum(run, law)))
    return Measured(worst, what)


_DRIFT_OF_ERROR = 0.05


def unmatched_drift(lab: Laboratory, plant: PlantName) -> Measured:
    """max |x1 - x1*| of the servo with a constant 0.05 rad/s added to theta', in percent."""
    case = find_experiment("servo", "nominal")
    law, servo = lab.controller(case, plant, "grosmc"), lab.equations(case, plant)
    equations = servo.system.equations
    rate, acceleration = equations.f
    drifting = replace(equations, f=(rate + _DRIFT_OF_ERROR, acceleration))
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

    found = solve_ivp(slope, (0.0, 100.0), np.zeros(A.size), "LSODA", rtol=1e-10, atol=1e-12)
    P = found.y[:, -1].reshape(A.shape)
    return B.T @ P, P


def left_unseen(lab: Laboratory, plant: PlantName, *, angle: float = 0.0) -> Measured:
    """The servo's error 20 s after a start at 1 rad/s, in percent of that at the start.

    Under the optimal law for Q = diag(angle, 1), R = 1. What no weight sees costs nothing, so
    the optimum leaves it alone.
    """
    experiment = find_experiment("servo", "nominal")
    law = lab.controller(experiment, plant, "lqr")
    linear = law.designed.lqr
    K, P = optimal_gain(linear.A, linear.B, np.diag([angle, 1.0]))
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

    The torque that is epsilon M(q) pushes s away on either side; what is left of s' is asked of
    the plant at s = 1e-6 rad/s.
    """
    experiment = find_experiment("arm", "nominal")
    law = lab.controller(experiment, plant, "grosmc")
    derivative, epsilon = lab.plant(experiment, plant).derivative, law.parameters.epsilon
    if epsilon == 0:
        return Measured(None, "the law does not switch")
    least = np.inf
    for t in np.linspace(0.1, 2.0, 20):  # the law begins at 0
        z = np.zeros(2)
        x = law.coordinates.place(float(t), z, law.parameters)
        unit = np.eye(12)[-2]
        moved = derivative(x, 0.0, unit)[1] - derivative(x, 0.0, np.zeros(12))[1]
        for side in (-1.0, 1.0):
            push = side * epsilon / moved * unit
            least = min(least, -_approach(law, derivative, float(t), z, side, push))
    return Measured(100 * float(least) / epsilon, "the least of 40 states")


def growth_of_mismatch(lab: Laboratory, plant: PlantName, *, heaviest: float = 2.0) -> Measured:
    """What a wrong M(q) does to s', with rates five times the region's over within it."""
    start = _start("arm")
    case = trial("arm", "payload", start, 1.0, (BodyEdit("link", heaviest, 1.0),))
    law, true = lab.controller(case, plant, "grosmc"), lab.equations(case, plant)
    region, largest = lab.as_set(case).region, []
    assert region is not None
    for factor in (1.0, 5.0):
        places = []
        for angle, rate in itertools.product(np.linspace(-1, 1, 9), np.linspace(-1, 1, 9)):
            z = np.array([angle * region[0], factor * rate * region[1]])
            x = law.coordinates.place(0.0, z, law.parameters)
            if true.system.linearizable(x):
                places.append(x)
        start, still = [0.0] * len(places), np.zeros((len(places), 12))
        found = balances(law, true, start, np.array(places), still)
        largest.append(float(found.push.max()))
    if largest[0] < 1e-9:
        return Measured(None, "nothing pushes s away here", broken=True)
    note = f"{largest[1]:.3g} rad/s² against {largest[0]:.3g} rad/s²"
    return Measured(largest[1] / largest[0], note)
