"""What the theorems say, on the plants: reaching, invariance, and where it is lost."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.chapter.claims.claim import Measured
from grosmc_mj.chapter.claims.measurements.arm import PAYLOADS
from grosmc_mj.chapter.claims.measurements.measures import from_optimum, of, sliding, surface_memory
from grosmc_mj.control.controller import Controller
from grosmc_mj.experiments.catalogue import find_experiment
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.laboratory import Laboratory, trial
from grosmc_mj.experiments.metrics.recorded import compare_with_optimum
from grosmc_mj.experiments.runs import PlantName
from grosmc_mj.plants import find_system
from grosmc_mj.premises.balance import balances
from grosmc_mj.simulation.disturbances import Disturbance, Pulse, SineFrom
from grosmc_mj.simulation.edits import BodyEdit
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status

_PLANTS, _STATES = 12, 40
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

    eta is the rate that the gains are declared for, unless another one is given; so are epsilon
    and the largest disturbance [N m] where nothing is declared.
    The continuous reading: at each state the law is asked on both sides of its surface, and s'
    follows from x' there and then, without a time step.
    """
    declared, scales, wrench = _declared(lab, system)
    wrench = wrench + torque * np.eye(len(wrench))[-2]
    rate = declared if rate is None else rate
    lab = lab if epsilon is None else lab.varied("laws.grosmc.epsilon", epsilon)
    random, worst, own = np.random.default_rng(1), -np.inf, None
    body = find_system(system).uncertain_body
    for index in range(_PLANTS):
        ends = [(low, high)[(index >> bit) & 1] for bit, (low, high) in enumerate(scales)]
        inner = [random.uniform(low, high) for low, high in scales]
        mass, length = ends if index < 4 else inner
        case = trial(system, "reaching", _start(system), 1.0, (BodyEdit(body, mass, length),))
        law = lab.controller(case, plant, "grosmc")
        own = getattr(law.parameters, "eta", None)
        derivative = lab.plant(case, plant).derivative
        region = lab.as_set(case).region or ()
        for _ in range(_STATES):
            z = random.uniform(-1, 1, 2) * region
            t = random.uniform(0, 2)
            for side, push in itertools.product((-1.0, 1.0), repeat=2):
                worst = max(worst, _approach(law, derivative, t, z, side, push * wrench))
    said = "" if own is None else f"; with the η = {own:.3g} of the law {worst + own:.3g}"
    return Measured(worst + rate, f"{_PLANTS} plants x {_STATES} states{said}")


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
    u = law.law(t, x, memory, p)
    dz2 = error.sign * (derivative(x, u, w)[velocity] - ddy_r)
    return float(side * (p.G @ np.array([z[1], dz2]) - p.S @ z)[0])


def reaching_time(lab: Laboratory, plant: PlantName, *, system: str, torque: float) -> Measured:
    """How long s takes back to its band after a kick of 20 ms [N m], over |s| / eta."""
    body = find_system(system).uncertain_body
    kick = Disturbance(body, (0.0, 0.0, 0.0, 0.0, -torque, 0.0), Pulse(2.0, 2.02))
    case = trial(system, "kick", _start(system), 4.0, (), (kick,))
    result = lab.run(case, plant, "grosmc")
    run, p = result.trajectory, result.controller.parameters
    s = sliding(run)
    after = np.flatnonzero(run.time[:-1] >= 2.02 - 1e-9)
    if not len(after):
        return Measured(None, result.ended, broken=True)
    start = abs(float(s[after[0]]))
    ordinary = float(np.abs(s[run.time[:-1] < 2.0]).max())
    outside = np.flatnonzero(np.abs(s[after]) > 1.5 * ordinary)
    if start < 3 * ordinary:
        return Measured(None, "the kick did not push s off its surface", broken=True)
    taken = float(run.time[after[outside[-1]] + 1] - 2.02) if len(outside) else 0.0
    eta = p.epsilon if hasattr(p, "epsilon") else p.eta
    if eta == 0:
        return of(result, None, "the law does not switch")
    note = f"from |s| = {start:.3g} in {taken:.3g} s, allowed {start / eta:.3g} s"
    return of(result, taken / (start / eta), note)


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
        largest.append(max(each.push for each in found))
    if largest[0] < 1e-9:
        return Measured(None, "nothing pushes s away here", broken=True)
    note = f"{largest[1]:.3g} rad/s² against {largest[0]:.3g} rad/s²"
    return Measured(largest[1] / largest[0], note)
