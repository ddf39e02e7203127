"""Disturbances: when they act, where, and that they are gone afterwards."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import CartPendulumParameters
from grosmc_mj.plants.cart_pendulum import pole_torque
from grosmc_mj.simulation.disturbances import (
    Constant,
    Disturbance,
    Pulse,
    SineFrom,
    packed,
    push,
)
from grosmc_mj.simulation.simulate import Engine, simulate

OpenLoop = Callable[[float | tuple[float, float]], Controller]

PUSH = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ENGINES: tuple[Engine, ...] = ("python", "native")
every_engine = pytest.mark.parametrize("engine", ENGINES)
every_kind = pytest.mark.parametrize("kind", ["physics", "analytic"])


def instants(count: int, h: float) -> Array:
    """As the engines count them: k h, never a running sum."""
    return np.arange(count, dtype=np.float64) * np.float64(h)


# When


@given(
    start=st.integers(0, 2000),
    length=st.integers(1, 2000),
    per_second=st.sampled_from([3, 7, 100, 333, 400, 1000, 3000]),
)
def test_pulse_has_exactly_its_number_of_instants(start: int, length: int, per_second: int) -> None:
    """Edges at k/n seconds fall on instants k*(1/n), which differ from k/n by rounding."""
    pulse = Pulse(start / per_second, (start + length) / per_second)
    values = [pulse(t) for t in instants(start + length + 2, 1 / per_second)]
    assert values == [0.0] * start + [1.0] * length + [0.0] * 2


@pytest.mark.parametrize("h", [1e-3, 2.5e-3, 1e-2, 0.1])
def test_pulse_of_10_to_13_seconds_at_every_timestep(h: float) -> None:
    """The servo's load: on at the instant 10 s, off at the instant 13 s."""
    time = instants(round(18 / h) + 1, h)
    on = np.flatnonzero(np.array([Pulse(10.0, 13.0)(t) for t in time]))
    assert (on[0], on[-1] + 1) == (round(10 / h), round(13 / h))


def test_adjacent_pulses_neither_overlap_nor_leave_a_gap() -> None:
    first, second = Pulse(0.0, 0.3), Pulse(0.3, 0.9)  # 3 * 0.1 > 0.3 in floating point
    assert [first(t) + second(t) for t in instants(9, 0.1)] == [1.0] * 9


def test_sine_from_an_onset_keeps_the_phase_of_the_run() -> None:
    """d(t) = 0.01 sin 2t from 9 s begins with sin 18, not with sin 0."""
    sine = SineFrom(2.0, onset=9.0)
    assert sine(8.999) == 0.0
    assert sine(9000 * 1e-3) == math.sin(18.0)
    assert SineFrom(2.0, phase=math.pi / 2)(0.0) == 1.0


def test_constant_is_one_at_all_times() -> None:
    assert {Constant()(t) for t in (0.0, 0.5, 1e6)} == {1.0}


@pytest.mark.parametrize(
    ("profile", "window"),
    [
        (Pulse(10.0, 13.0), (10.0, 13.0)),
        (SineFrom(2.0, onset=9.0), (9.0, math.inf)),
        (Constant(), (0.0, math.inf)),
        (lambda t: math.exp(-t), (0.0, math.inf)),
    ],
)
def test_window_holds_every_instant_at_which_it_acts(
    profile: Callable[[float], float], window: tuple[float, float]
) -> None:
    disturbance = Disturbance("rotor", PUSH, profile)
    assert disturbance.window == window
    outside = [t for t in instants(1500, 0.01) if not window[0] <= t < window[1]]
    assert all(profile(t) == 0 for t in outside)


# How much


def wrenches(items: list[Disturbance], bodies: tuple[str, ...], time: Array) -> Array:
    """What acts on the bodies at these instants, (len(time), 6 * bodies)."""
    pushes, values = packed(items, bodies, range(len(time)), time[1])
    table = np.ones((len(time), 6 * len(bodies)))
    for i, t in enumerate(time.tolist()):
        push(pushes, values, i, t, table[i])
    return table


def test_table_is_wrench_times_profile_in_the_column_of_its_body() -> None:
    time = instants(50, 0.1)
    table = wrenches([Disturbance("pole", PUSH, math.cos)], ("cart", "pole"), time)
    np.testing.assert_array_equal(table[:, :6], 0)
    np.testing.assert_array_equal(
        table[:, 6:], np.array([math.cos(t) for t in time])[:, None] * PUSH
    )


def test_disturbances_on_one_body_add_up() -> None:
    time = instants(10, 0.1)
    both = [Disturbance("rotor", PUSH), Disturbance("rotor", PUSH, Pulse(0.5, 1.0))]
    table = wrenches(both, ("rotor",), time)
    expected = np.where(np.arange(10) < 5, 1.0, 2.0)[:, None] * PUSH
    np.testing.assert_array_equal(table, expected)


def test_without_disturbances_nothing_acts() -> None:
    assert not wrenches([], ("rotor",), instants(3, 0.1)).any()


# What is refused

WRONG: Any = [(1.0, 2.0, 3.0), (0.0,) * 7, ((0.0,) * 6,) * 2, 1.0, None]


@pytest.mark.parametrize("wrench", [*WRONG, (0, 0, math.nan, 0, 0, 0), (0, 0, 0, math.inf, 0, 0)])
def test_wrench_must_be_six_finite_numbers(wrench: Any) -> None:
    with pytest.raises(ArgumentError, match="6 finite numbers"):
        Disturbance("rotor", wrench)


def test_profile_that_becomes_nan_is_refused_with_the_instant() -> None:
    disturbance = Disturbance("rotor", PUSH, lambda t: math.nan if t > 0.25 else 1.0)
    with pytest.raises(ArgumentError, match=r"'rotor' is not finite at t = 0.3 s"):
        wrenches([disturbance], ("rotor",), instants(10, 0.1))


NO_PROFILES: Any = [1.0, lambda: 1.0, lambda t: None, lambda t: (1.0, 2.0)]


@pytest.mark.parametrize("profile", NO_PROFILES)
def test_profile_must_take_t_and_return_a_number(profile: Any) -> None:
    with pytest.raises(
        ArgumentError, match=r"profile .* t \[s\] (that returns|and return) a number"
    ):
        wrenches([Disturbance("rotor", PUSH, profile)], ("rotor",), instants(3, 0.1))


@pytest.mark.parametrize(("start", "stop"), [(math.nan, 1.0), (0.0, math.nan), (3.0, 1.0)])
def test_pulse_that_can_never_act_is_refused(start: float, stop: float) -> None:
    """It would pass for a disturbance that the controller rejected."""
    with pytest.raises(ArgumentError):
        Pulse(start, stop)


@pytest.mark.parametrize("wrong", ["rotr", "world", "pole"])
def test_unknown_body_is_refused_with_the_valid_ones(open_loop: OpenLoop, wrong: str) -> None:
    with pytest.raises(ArgumentError, match=f"unknown body {wrong!r}.*valid: rotor"):
        simulate(
            MujocoPlant.load("servo"),
            open_loop(0.0),
            [0.0, 0.0],
            duration=0.01,
            disturbances=[Disturbance(wrong, PUSH)],
            engine="python",
        )


# Where: at the centre of mass, in world axes

# Speeds of 1 differ after one Euler step of h by h qacc, so that qacc has rounding 1e-16/h.
H = 1e-3


@every_engine
@pytest.mark.parametrize("edit", [1.0, 2.0])
@pytest.mark.parametrize("theta", [0.0, 0.7, -2.5])
def test_wrench_acts_at_the_centre_of_mass_in_world_axes(
    open_loop: OpenLoop, engine: Engine, theta: float, edit: float
) -> None:
    """A leaning pole against Lagrange's equations with the virtual work of force and torque."""
    edits = (BodyEdit("pole", 1.0, edit),)
    plant = MujocoPlant.load("cart_pendulum", edits=edits, timestep=H, integrator="Euler")
    wrench = (0.9, 5.0, -0.6, 0.3, 0.2, -0.7)
    run = simulate(
        plant,
        open_loop(0.0),
        [0.0, theta, 0.0, 0.0],
        duration=H,
        disturbances=[Disturbance("pole", wrench)],
        engine=engine,
    )
    M, m, L, g = 1.0, 0.2, 0.5 * edit, 9.8
    s, c = math.sin(theta), math.cos(theta)
    # The centre moves by (-L cos, 0, -L sin) a radian and the pole turns about -y.
    Fx, _, Fz, _, Ty, _ = wrench
    forces = [Fx, -L * c * Fx - L * s * Fz - Ty + m * g * L * s]
    matrix = [[M + m, -m * L * c], [-m * L * c, m * (2 * L) ** 2 / 3]]
    expected = np.linalg.solve(matrix, forces)
    np.testing.assert_allclose(run.state[-1, 2:] / H, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("across", [(0, 1, 0, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 0, 1)])
def test_wrench_across_the_plane_does_nothing(
    plant: MujocoPlant, across: tuple[float, ...]
) -> None:
    data = mujoco.MjData(plant.model)
    data.qpos[-1] = 0.4
    mujoco.mj_forward(plant.model, data)
    before = data.qacc.copy()
    data.xfrc_applied[1:] = 10 * np.array(across)
    mujoco.mj_forward(plant.model, data)
    np.testing.assert_allclose(data.qacc, before, rtol=0, atol=1e-13)


# Gone after its window

STARTS = {
    "servo": [0.3, 1.0],
    "cart_pendulum": [0.0, 0.2, 0.0, 0.5],
    "arm": [-0.4, 1.0],
    "two_link_arm": [-1.2, 0.4, 0.5, -0.3],
}
WRENCH = (0.2, 0.1, -0.3, 0.4, 0.5, 0.6)


@every_engine
@every_kind
def test_wrench_acts_in_its_window_and_leaves_no_trace(
    plant: MujocoPlant, open_loop: OpenLoop, kind: str, engine: Engine
) -> None:
    """Bit by bit the undisturbed run before its window, and an undisturbed restart after it."""
    name, model = plant.system.name, plant if kind == "physics" else plant.analytic()
    push = Disturbance(plant.system.bodies[-1], WRENCH, Pulse(0.05, 0.08))
    u = 0.3 if len(plant.system.inputs) == 1 else (0.3, 0.2)
    control = open_loop(u)
    pushed = simulate(
        model, control, STARTS[name], duration=0.2, disturbances=[push], engine=engine
    )
    free = simulate(model, control, STARTS[name], duration=0.2, engine=engine)
    after = simulate(model, control, pushed.state[80], duration=0.12, engine=engine)

    np.testing.assert_array_equal(pushed.input, np.broadcast_to(u, pushed.input.shape))
    np.testing.assert_array_equal(pushed.state[:51], free.state[:51])
    assert np.all(np.any(pushed.state[51:] != free.state[51:], axis=1))
    np.testing.assert_array_equal(pushed.state[80:], after.state)
    assert pushed.wrench is not None
    acted = pushed.wrench.reshape(200, -1, 6)[:, -1]
    np.testing.assert_array_equal(acted[50:80], np.tile(WRENCH, (30, 1)))
    assert not acted[:50].any()
    assert not acted[80:].any()


@every_engine
def test_speed_of_the_free_rotor_is_the_impulse(open_loop: OpenLoop, engine: Engine) -> None:
    """In 0.1 s a load of 1 N m takes from the rotor what the exponential of B/J says, no more."""
    plant, J, B = MujocoPlant.load("servo"), 5.77e-2, 8.8e-3
    push = Disturbance("rotor", (0, 0, 0, 0, 1.0, 0), Pulse(0.1, 0.2))
    run = simulate(
        plant, open_loop(0.0), [0.0, 0.0], duration=0.3, disturbances=[push], engine=engine
    )
    expected = -(1 - math.exp(-B / J * 0.1)) / B * math.exp(-B / J * 0.1)
    # RK4 with steps of 1 ms of a time constant J/B = 6.6 s: (h B/J)^4/120 is below rounding.
    assert run.state[-1, 1] == pytest.approx(expected, rel=1e-12)


# The chapter's d(t) on the pendulum


def acceleration_of_pole(degrees: float, torque: float) -> tuple[float, float]:
    """What a torque on the pole adds to the accelerations of cart and pole, in MuJoCo."""
    model = MujocoPlant.load("cart_pendulum").model
    data = mujoco.MjData(model)
    data.qpos[1] = math.radians(degrees)
    mujoco.mj_forward(model, data)
    free = data.qacc.copy()
    data.xfrc_applied[model.body("pole").id, 4] = -torque  # the hinge is along -y
    mujoco.mj_forward(model, data)
    cart, pole = data.qacc - free
    return float(cart), float(pole)


NOMINAL = CartPendulumParameters(M=1.0, m=0.2, L=0.5, g=9.8)


@pytest.mark.parametrize("d", [0.01, -3.0])
def test_pole_torque_gives_the_upright_pole_exactly_d(d: float) -> None:
    cart, pole = acceleration_of_pole(0.0, pole_torque(d, NOMINAL))
    assert pole == pytest.approx(d, rel=1e-13)
    # It also pushes the cart: (M + m) p'' = m L theta''.
    assert cart == pytest.approx(0.1 * d / 1.2, rel=1e-13)


@pytest.mark.parametrize(("degrees", "bound"), [(1.0, 1e-4), (10.0, 5e-3)])
def test_pole_torque_of_a_leaning_pole_is_nearly_d(degrees: float, bound: float) -> None:
    """The relative error is a m sin^2 / (4/3 - a m cos^2), a = 1/(M+m): 4.4e-5 at 1 degree."""
    _, pole = acceleration_of_pole(degrees, pole_torque(1.0, NOMINAL))
    s, c, am = math.sin(math.radians(degrees)), math.cos(math.radians(degrees)), 0.2 / 1.2
    assert pole - 1 == pytest.approx(-am * s**2 / (4 / 3 - am * c**2), rel=1e-9)
    assert abs(pole - 1) < bound
