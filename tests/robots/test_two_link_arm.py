"""The two-link arm: several inputs, from the equations to the closed loop."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
import two_link_oracle as oracle
from scipy.integrate import trapezoid
from shipped import (
    TWO_LINK_CIRCLE,
    TWO_LINK_G,
    TWO_LINK_JOINTS,
    TWO_LINK_TIP,
    TWO_LINK_UNCERTAINTY,
    find_case,
    task_of,
)

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import computed_torque_pd, regulating_grosmc
from grosmc_mj.control.memory import SurfaceMemory
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.errors import GainError, ModelError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.experiments.metrics import compare_with_optimum
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.files import load_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import TWO_LINK_ARM, AnalyticPlant
from grosmc_mj.plants.two_link_arm import TwoLinkParameters
from grosmc_mj.simulation.disturbances import Disturbance, SineFrom
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Status, Trajectory

SYSTEM, REGULATION = "two_link_arm", "two_link_arm regulation"
START = find_case(SYSTEM, "nominal").x0
LAWS = ("lqr", "pd", "grosmc")
PUSHES = (
    Disturbance("payload", (1.0, 0.0, -3.0, 0.0, 0.0, 0.0), SineFrom(9.0)),
    Disturbance("upper", (0.0, 0.0, 0.0, 0.0, 0.7, 0.0)),
)


@cache
def physics(*edits: BodyEdit) -> MujocoPlant:
    return MujocoPlant.load(SYSTEM, edits=edits)


@cache
def nominal() -> AnalyticPlant:
    return physics().analytic()


@cache
def law(name: str, design: str = SYSTEM) -> Controller:
    return chapter_controller(name, nominal(), case=design.partition(" ")[2] or "nominal")


def own(plant: AnalyticPlant) -> oracle.TwoLinkParameters:
    """The numbers of a plant for the equations by hand."""
    return oracle.TwoLinkParameters(**asdict(plant.parameters))


def random_state(rng: np.random.Generator) -> Array:
    return np.concatenate([rng.uniform(-math.pi, math.pi, 2), rng.normal(0, 3, 2)])


# The equations


def test_numbers_are_read_from_the_model() -> None:
    numbers = TwoLinkParameters(
        m1=1.5, l1=0.5, c1=0.25, I1=0.03125, m2=1.0, l2=0.4, c2=0.2, I2=0.16 / 12,
        mp=0.2, Ip=0.0, g=9.8,
    )  # fmt: skip
    assert asdict(nominal().parameters) == pytest.approx(asdict(numbers), rel=1e-15)
    edited = physics(BodyEdit("lower", 2.0, 1.5), BodyEdit("payload", 5.0)).analytic().parameters
    expected = replace(nominal().parameters, m2=2.0, l2=0.6, c2=0.3, I2=4.5 * 0.16 / 12, mp=1.0)
    assert asdict(edited) == pytest.approx(asdict(expected), rel=1e-14)


@pytest.mark.parametrize(
    ("part", "field", "value", "message"),
    [
        (lambda s: s.body("payload"), "ipos", [0.0, 0.0, 0.01], "payload's centre at the tip"),
        (lambda s: s.body("payload"), "ipos", [0.01, 0.0, 0.0], "payload's centre at the tip"),
        (lambda s: s.body("payload"), "pos", [0.4, 0.0, 0.05], "must lie on their x axes"),
        (lambda s: s.body("upper"), "ipos", [0.25, 0.0, 0.01], "must lie on their x axes"),
        (lambda s: s.joint("elbow"), "armature", 0.01, "must have no armature"),
        (lambda s: s.joint("elbow"), "damping", [0.01, 0, 0], r"joint 'elbow' has damping 0\.01"),
        (lambda s: s.actuator("elbow_torque"), "gear", [2.0, 0, 0, 0, 0, 0], "has gear 2"),
        (lambda s: s.option, "gravity", [0.1, 0.0, -9.8], "must point along -z"),
    ],
)
def test_model_that_the_equations_do_not_describe_is_refused(
    part: Callable[[Any], Any], field: str, value: Any, message: str
) -> None:
    spec = load_spec(SYSTEM)
    setattr(part(spec), field, value)
    with pytest.raises(ModelError, match=message):
        AnalyticPlant.from_model(TWO_LINK_ARM, spec.compile())


# Feedback linearization


@pytest.mark.parametrize("error", [TWO_LINK_JOINTS, TWO_LINK_TIP], ids=["joints", "tip"])
def test_relative_degree_is_two_and_two_and_the_chains_are_brunovskys(
    error: ErrorCoordinates,
) -> None:
    chains = error.linearization
    assert chains.relative_degree == (2, 2)
    assert chains.complete
    assert chains.zero_dynamics() is None
    np.testing.assert_array_equal(
        chains.A, [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]]
    )
    np.testing.assert_array_equal(chains.B, [[0, 0], [1, 0], [0, 0], [0, 1]])
    assert (chains.first_rows, chains.last_rows) == ((0, 2), (1, 3))


def tip_jacobian(x: Array, p: oracle.TwoLinkParameters) -> Array:
    """dy/dq by extrapolated central differences, (2, 2)."""

    def slope(h: float) -> Array:
        steps = h * np.eye(2)
        return np.array(
            [(oracle.tip(x[:2] + s, p) - oracle.tip(x[:2] - s, p)) / (2 * h) for s in steps]
        ).T

    return (4 * slope(5e-3) - slope(1e-2)) / 3


def test_decoupling_matrix_of_the_tip_is_jacobian_times_inverse_inertia() -> None:
    matrix = TWO_LINK_TIP.linearization.decoupling_matrix
    rng, p = np.random.default_rng(2), own(nominal())
    for _ in range(50):
        x = random_state(rng)
        E = np.reshape(matrix(x, nominal().parameters), (2, 2))
        expected = tip_jacobian(x, p) @ np.linalg.inv(oracle.inertia(x[:2], p))
        # The extrapolated differences lose h^4/480 = 2e-11 and rounding over h, 2e-14.
        np.testing.assert_allclose(E, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_place_is_inverse_kinematics() -> None:
    """The elbow-up state with that tip and that velocity of the tip, all around the circle."""
    rng, p, parameters = np.random.default_rng(5), own(nominal()), law("grosmc").parameters
    for t in np.linspace(0, 2, 9).tolist():
        z = rng.uniform(-1, 1, 4) * [0.1, 0.3, 0.1, 0.3]
        x = TWO_LINK_TIP.place(t, z, parameters)
        circle, angle = TWO_LINK_CIRCLE, TWO_LINK_CIRCLE.frequency * t
        point = np.array([circle.centre1, circle.centre2]) + circle.radius * np.array(
            [math.cos(angle), math.sin(angle)]
        )
        moving = circle.radius * circle.frequency * np.array([-math.sin(angle), math.cos(angle)])
        np.testing.assert_allclose(x[:2], oracle.elbow_up(point + z[::2], p), atol=1e-9)
        np.testing.assert_allclose(tip_jacobian(x, p) @ x[2:], moving + z[1::2], atol=1e-9)
        np.testing.assert_allclose(TWO_LINK_TIP.error_state(t, x, parameters), z, atol=1e-9)


# The closed loop


def run(
    name: str, case: str = "nominal", *, on_physics: bool = True, h: float = 1e-3, **options: Any
) -> tuple[Trajectory, Controller]:
    found = find_case(SYSTEM, case)
    plant: Any = MujocoPlant.load(SYSTEM, edits=found.edits, timestep=h)
    options = {"duration": found.duration, "disturbances": found.disturbances, **options}
    if not on_physics:
        plant, options["timestep"] = plant.analytic(), h
    ctl = law(name, found.controllers)
    return simulate(plant, ctl, found.x0, **options), ctl


def deviation(found: tuple[Trajectory, Controller]) -> float:
    """max |y - y*| over the start's error."""
    comparison = compare_with_optimum(*found)
    return float(np.abs(comparison.deviation).max() / comparison.error[0])


@pytest.mark.slow
@pytest.mark.parametrize("case", ["nominal", "regulation"])
@pytest.mark.parametrize("name", ["lqr", "grosmc"])
def test_nominal_loop_is_the_nominal_optimum_up_to_the_control_period(name: str, case: str) -> None:
    """z follows exp((A - BK) t) z0 of both chains; the held input errs by O(h)."""
    periods = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)
    errors = [deviation(run(name, case, h=h, duration=2.0)) for h in periods]
    assert errors[-1] < 0.003
    order = float(np.polyfit(np.log(periods), np.log(errors), 1)[0])
    # Where in a period s turns is chance, and worth a factor of 1.6 at any one of them: over four
    # octaves that is 0.17 of the order at either end.
    assert order == pytest.approx(1, abs=0.05 if name == "lqr" else 0.35)


@pytest.mark.parametrize(("name", "case"), [("lqr", "case1"), ("pd", "case2")])
def test_physics_is_the_equations_to_rounding(name: str, case: str) -> None:
    """Both take the same fourth-order steps, so that only accelerations can differ."""
    runs = [run(name, case, on_physics=each, duration=2.0)[0] for each in (True, False)]
    np.testing.assert_allclose(runs[0].state, runs[1].state, rtol=0, atol=1e-10)


FIELDS = ("state", "command", "input", "sliding", "weighed", "wrench", "physics", "valid_until")


def assert_same(a: Trajectory, b: Trajectory) -> None:
    """Bit for bit in all that is recorded."""
    for field in FIELDS:
        x, y = getattr(a, field), getattr(b, field)
        assert (x is None) == (y is None), field
        if x is not None:
            np.testing.assert_array_equal(x, y, field)


@pytest.mark.parametrize(
    ("name", "design", "on_physics"),
    [("lqr", SYSTEM, True), ("grosmc", REGULATION, True), ("pd", REGULATION, False)],
)
def test_engines_agree_bit_for_bit(name: str, design: str, *, on_physics: bool) -> None:
    plant: Any = physics(BodyEdit("payload", 2.0))
    options: dict[str, Any] = {"duration": 0.15, "control_period": 2e-3, "disturbances": PUSHES}
    plant = plant if on_physics else plant.analytic()
    start = START if design == SYSTEM else find_case(SYSTEM, "regulation").x0
    native = simulate(plant, law(name, design), start, **options)
    python = simulate(plant, law(name, design), start, engine="python", **options)
    assert native.status is Status.COMPLETED
    assert_same(native, python)


def test_limited_actuator_reports_what_it_applied() -> None:
    """Each actuator has its own range; physics moves by ``input``, not by ``command``."""
    spec = load_spec(SYSTEM)
    ranges = {"shoulder_torque": (0.0, 14.0), "elbow_torque": (0.5, 4.0)}
    for name, limits in ranges.items():
        spec.actuator(name).ctrllimited, spec.actuator(name).ctrlrange = True, np.array(limits)
    plant, start = MujocoPlant(TWO_LINK_ARM, spec), (math.pi / 3 + 0.01, -math.pi / 2, 0.0, 0.0)
    ctl = law("grosmc", REGULATION)
    found = simulate(plant, ctl, start, duration=0.2, engine="python")
    low, high = np.array(list(ranges.values())).T
    np.testing.assert_array_equal(found.input, np.clip(found.command, low, high))
    # Not vacuous: each is asked for more than it has, on either side.
    assert np.all(found.command.min(axis=0) < low)
    assert np.all(found.command.max(axis=0) > high)
    assert_same(found, simulate(plant, ctl, start, duration=0.2))
    data = mujoco.MjData(plant.model)
    data.qpos[:], data.qvel[:] = found.state[0, :2], found.state[0, 2:]
    for row in range(20):
        data.ctrl[:] = found.input[row]
        mujoco.mj_step(plant.model, data)
        np.testing.assert_array_equal(found.state[row + 1], [*data.qpos, *data.qvel])


# The switching gains of several inputs


def rates_beside_the_surface(
    ctl: Controller, plant: AnalyticPlant, z: Array, sides: Array, w: Array
) -> Array:
    """s' sgn(s) of each entry next to the surfaces, by the true plant's own accelerations, (2,)."""
    p = ctl.parameters
    x = TWO_LINK_JOINTS.place(0.0, z, p)
    memory = ctl.memory()
    assert isinstance(memory, SurfaceMemory)
    memory.z0[:], memory.t = z - np.linalg.pinv(p.G) @ (1e-6 * sides), 1.0
    u = ctl.input_at(1.0, x, memory)
    assert np.sign(memory.s).tolist() == sides.tolist()
    dq, ddq = plant.derivative(x, u, w).reshape(2, 2)
    dz = np.array([dq[0], ddq[0], dq[1], ddq[1]])
    return sides * (p.G @ dz - p.S @ z)


def family(count: int) -> Iterator[tuple[AnalyticPlant, Array, Array]]:
    """Plants, states and wrenches: corners of the declared family and random points within."""
    declared, rng = TWO_LINK_UNCERTAINTY, np.random.default_rng(7)
    (low, high), region = declared.scales["mp"], np.array(declared.region)
    corners = [region * sign for sign in itertools.product((-1.0, 0.0, 1.0), repeat=4)]
    pairs = [(scale, z) for scale in (low, high) for z in corners]
    pairs += [(rng.uniform(low, high), region * rng.uniform(-1, 1, 4)) for _ in range(count)]
    for scale, z in pairs:
        parameters = replace(nominal().parameters, mp=scale * nominal().parameters.mp)
        for sign in (-1.0, 1.0):
            yield replace(nominal(), parameters=parameters), z, sign * np.array(declared.wrench)


def worst_rate(ctl: Controller, count: int) -> float:
    return max(
        float(rates_beside_the_surface(ctl, plant, z, np.array(sides), w).max())
        for plant, z, w in family(count)
        for sides in itertools.product((-1.0, 1.0), repeat=2)
    )


def test_each_s_falls_at_the_declared_rate_for_the_whole_declared_family() -> None:
    """s_i' sgn(s_i) <= -eta for both, whatever the sides: what the margin and the gains are for."""
    assert worst_rate(law("grosmc", REGULATION), 60) <= -TWO_LINK_UNCERTAINTY.reaching_rate


def test_without_uncertainty_each_s_falls_at_exactly_the_asked_rate() -> None:
    """R is the identity: nothing is lost, and rho is eta."""
    certain = replace(TWO_LINK_UNCERTAINTY, scales={}, wrench=(0.0,) * 18)
    ctl = regulating_grosmc(task_of(REGULATION, nominal()), certain, TWO_LINK_G)
    assert (ctl.parameters.gamma0, ctl.parameters.gamma1) == (0.0, 0.0)
    for z in np.random.default_rng(8).uniform(-0.5, 0.5, (5, 4)):
        for sides in itertools.product((-1.0, 1.0), repeat=2):
            found = rates_beside_the_surface(ctl, nominal(), z, np.array(sides), np.zeros(18))
            # rho is eta for the rate of s; what it is worth on top is |G B E|'s, for gamma only.
            np.testing.assert_allclose(found, -0.2, rtol=1e-9)


def test_gain_margin_is_the_worst_share_over_all_sides() -> None:
    """min_i (R sgn(s))_i sgn(s_i) over the four sides, by trying them."""
    rng = np.random.default_rng(9)
    for _ in range(50):
        steered, believed = rng.normal(0, 1, (2, 2, 2))
        R = steered @ np.linalg.inv(believed)
        shares = [
            (R @ side) * side for side in map(np.array, itertools.product((-1.0, 1.0), repeat=2))
        ]
        assert gain_margin(steered @ np.linalg.inv(believed)) == pytest.approx(
            np.min(shares), rel=1e-9
        )


def least_margin(weight: float, payload: float) -> float:
    """Over the poses of the declared region, with G = [0 1 0 0; 0 0 0 weight], by hand."""
    p, G_r = own(nominal()), np.diag([1.0, weight])
    heavy, found = replace(p, mp=payload), []
    for turn in np.linspace(-0.6, 0.6, 25):
        q = np.array([0.0, -math.pi / 2 + turn])
        R = np.linalg.inv(oracle.inertia(q, heavy)) @ oracle.inertia(q, p)
        R = G_r @ R @ np.linalg.inv(G_r)
        found.append(np.min(np.diag(R) - np.abs(R - np.diag(np.diag(R))).sum(axis=1)))
    return float(min(found))


def test_gain_ratio_of_the_design_is_that_of_the_heaviest_payload() -> None:
    ctl = law("grosmc", REGULATION)
    ratio = TWO_LINK_UNCERTAINTY.reaching_rate / ctl.parameters.eta
    # The grid of states is coarser than the one by hand, but both have the region's edges.
    assert ratio == pytest.approx(least_margin(1 / 3, 0.6), rel=1e-9)


def test_family_without_dominance_is_refused() -> None:
    """Up to 1 kg under G = B+: no gain helps, and none is given."""
    heavier, ctl = replace(TWO_LINK_UNCERTAINTY, scales={"mp": (1.0, 5.0)}), law("lqr", REGULATION)
    with pytest.raises(GainError, match="no switching gain can make up"):
        heavier.gains(ctl.designed, ctl.parameters)


# Computed torque


@pytest.mark.parametrize("design", [SYSTEM, REGULATION])
def test_pd_has_two_poles_of_that_frequency_and_damping_for_each_output(design: str) -> None:
    task = task_of(design, nominal())
    optimum = computed_torque_pd(task, 4.0, 0.6).designed.lqr
    assert optimum is not None
    expected = -2.4 + 3.2j * np.array([-1, -1, 1, 1])
    np.testing.assert_allclose(np.sort_complex(optimum.poles), np.sort_complex(expected), rtol=1e-6)


@pytest.mark.parametrize("name", ["pd", "lqr"])
def test_price_of_a_law_is_what_its_nominal_loop_costs(name: str) -> None:
    """z0' P z0 / 2, from Lyapunov's equation or Riccati's, against the index along physics.

    The held input errs by O(h): extrapolated from 1 ms and 0.5 ms. 5 s leave exp(-10) of it.
    """
    costs, price = [], math.nan
    for h in (1e-3, 5e-4):
        found, ctl = run(name, "regulation", h=h, duration=5.0)
        z = compare_with_optimum(found, ctl).z
        v = found.weighed
        of_state = trapezoid(np.einsum("ti,ij,tj->t", z, ctl.designed.lqr.Q, z), found.time)
        of_input = float(np.einsum("ti,ij,tj->t", v, ctl.designed.lqr.R, v).sum() * h)
        costs.append(0.5 * (of_state + of_input))
        price = ctl.designed.lqr.optimal_cost(z[0])
    assert 2 * costs[1] - costs[0] == pytest.approx(price, rel=2e-5)
