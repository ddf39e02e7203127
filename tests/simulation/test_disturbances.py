"""Disturbances: when they act, where, and that they are gone afterwards."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, cast

import mujoco
import numpy as np
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st
from shipped import find_case

import grosmc_mj as gm
from grosmc_mj.arrays import Array
from grosmc_mj.control.controller import Controller
from grosmc_mj.errors import ArgumentError
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import CartPendulumParameters
from grosmc_mj.plants.cart_pendulum import pole_torque
from grosmc_mj.simulation.disturbances import (
    Constant,
    Disturbance,
    Profile,
    Pulse,
    SineFrom,
    packed,
    push,
)
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.simulation.trajectory import Trajectory

OpenLoop = Callable[[float | tuple[float, float]], Controller]

PUSH = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
OTHER = (-0.1, 0.0, 0.2, 0.0, -0.03, 0.0)
every_engine = pytest.mark.parametrize("engine", ["python", "native"])


@cache
def physics(system: str, integrator: Any = None) -> MujocoPlant:
    return MujocoPlant.load(system, integrator=integrator)


@cache
def grosmc(system: str) -> Controller:
    return chapter_controller("grosmc", physics(system).analytic())


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


def test_sine_from_an_onset_keeps_the_phase_of_the_run() -> None:
    """d(t) = 0.01 sin 2t from 9 s begins with sin 18, not with sin 0."""
    sine = SineFrom(2.0, onset=9.0)
    assert sine(8.999) == 0.0
    assert sine(9000 * 1e-3) == math.sin(18.0)
    assert SineFrom(2.0, phase=math.pi / 2)(0.0) == 1.0
    windows = [Disturbance("rotor", PUSH, one).window for one in (sine, Pulse(1, 3), Constant())]
    assert windows == [(9.0, math.inf), (1.0, 3.0), (0.0, math.inf)]


# How much


def wrenches(items: Sequence[Disturbance], bodies: tuple[str, ...], time: Array) -> Array:
    """What acts on the bodies at these instants, (len(time), 6 * bodies)."""
    pushes, values = packed(items, bodies, range(len(time)), time[1])
    table = np.ones((len(time), 6 * len(bodies)))
    for i, t in enumerate(time.tolist()):
        push(pushes, values, i, t, table[i])
    return table


class Louder(SineFrom):
    """A profile that is a known one by its class, but not by its values."""

    def __call__(self, t: float) -> float:
        return 2.0 * super().__call__(t)


# Edges on instants, between them, and at k h that differs from the number by rounding.
PROFILES: tuple[Profile, ...] = (
    Constant(),
    Pulse(0.05, 0.08),
    Pulse(-math.inf, 0.0305),
    Pulse(3 * 0.1, math.inf),
    SineFrom(9.0, 0.05),
    SineFrom(-313.7, 0.0705, phase=2.0),
    SineFrom(1e15),
    math.cos,
    Louder(40.0),
)


def test_wrenches_add_up_in_the_columns_of_their_bodies() -> None:
    bodies, time = ("hub", "link"), instants(1000, 1e-3)
    items = [Disturbance(bodies[i % 2], PUSH, each) for i, each in enumerate(PROFILES)]
    expected = np.zeros((1000, 2, 6))
    for i, profile in enumerate(PROFILES):
        values = np.array([profile(t) for t in time.tolist()])
        expected[:, i % 2] += values[:, None] * PUSH
    table = wrenches(items, bodies, time)
    np.testing.assert_array_equal(table, expected.reshape(1000, 12))
    values = packed(items, bodies, range(1000), 1e-3)[1]
    assert values.shape == (2, 1000)
    assert not wrenches([], bodies, time).any()


def hidden(disturbances: Sequence[Disturbance]) -> list[Disturbance]:
    """The same ones by functions that compiled code does not know: a table is made of them."""
    return [replace(one, profile=lambda t, own=one.profile: own(t)) for one in disturbances]


def assert_equal(a: Trajectory, b: Trajectory) -> None:
    for name in ("state", "command", "input", "memory", "wrench", "status", "valid_until"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


LIST = [
    Disturbance("pole", OTHER, SineFrom(7.0)),
    Disturbance("cart", OTHER, Pulse(0.01, 0.03)),
    Disturbance("pole", OTHER),
]


def test_runs_of_a_batch_have_their_own_disturbances_and_as_many_as_they_like() -> None:
    """Among them none at all; by formulas, by tables and alone."""
    scales = [0.5, 1.0, 1.5, 2.0]
    plants = [physics("cart_pendulum").edited(BodyEdit("pole", a, a)) for a in scales]
    lists = [
        [replace(LIST[0], profile=SineFrom(7 * a, 0.01 * a, a)), *LIST[1:]][:i]
        for i, a in enumerate(scales)
    ]
    x0, law = find_case("cart_pendulum", "nominal").x0, grosmc("cart_pendulum")
    options: dict[str, Any] = {"duration": 0.1, "record": False}
    together = simulate(plants, law, x0, disturbances=lists, threads=2, **options)
    assert_equal(together, simulate(plants, law, x0, disturbances=[*map(hidden, lists)], **options))
    for run, plant, items in zip(together.state, plants, lists, strict=True):
        alone = simulate(plant, law, x0, disturbances=items, **options)
        np.testing.assert_array_equal(run, alone.state)


@dataclass(frozen=True)
class Gain:
    k: float


@pytest.mark.parametrize("record", [False, True])
def test_a_profile_of_the_users_own_is_called_once_for_each_timestep(record: bool) -> None:
    """It may not answer twice alike."""
    called: list[float] = []

    def profile(t: float) -> float:
        called.append(t)
        return float(len(called))

    own = [Disturbance("rotor", PUSH, profile), Disturbance("rotor", PUSH, Pulse(0.0, 0.01))]
    run = simulate(
        physics("servo"), grosmc("servo"), [1.0, 0.0], duration=0.02, disturbances=own,
        record=record,
    )  # fmt: skip
    assert called == (np.arange(20) * 1e-3).tolist()
    assert run.wrench is not None
    np.testing.assert_array_equal(run.wrench[-1], 20.0 * np.array(PUSH))


# What is refused


def servo_under(*disturbances: Disturbance) -> None:
    """A second of the servo under them."""
    simulate(physics("servo"), grosmc("servo"), [0.0, 0.0], duration=1.0, disturbances=disturbances)


NUMBERS, RETURNS = (
    "wrench = .* must be 6 finite numbers",
    r"t \[s\] (that returns|and return) a number",
)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        *(
            (lambda wrong=wrong: Disturbance("rotor", cast(Any, wrong)), NUMBERS)
            for wrong in ((0.0,) * 7, 1.0, (0, 0, math.nan, 0, 0, 0))
        ),
        *(
            (lambda wrong=wrong: servo_under(Disturbance("rotor", PUSH, cast(Any, wrong))), RETURNS)
            for wrong in (1.0, lambda t: None,
                          # The phase overflows from t = 0.1 s on.
                          SineFrom(1.7e308, phase=1.7e308))
        ),
        (lambda: servo_under(Disturbance("rotor", PUSH, lambda t: math.nan if t > 0.25 else 1.0)),
         r"'rotor' is not finite at t = 0\.251 s"),
        (lambda: Pulse(math.nan, 1.0), "start = nan must be finite"),
        # It would pass for a disturbance that the controller rejected.
        (lambda: Pulse(3.0, 1.0), "pulse from 3 to 1 s never acts"),
        (lambda: servo_under(Disturbance("rotr", PUSH)),
         "unknown body 'rotr': did you mean 'rotor'. valid: rotor"),
    ],
)  # fmt: skip
def test_a_wrong_disturbance_is_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        make()


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


# Gone after its window

STARTS = {
    "servo": [0.3, 1.0],
    "cart_pendulum": [0.0, 0.2, 0.0, 0.5],
    "arm": [-0.4, 1.0],
    "two_link_arm": [-1.2, 0.4, 0.5, -0.3],
}
WRENCH = (0.2, 0.1, -0.3, 0.4, 0.5, 0.6)


@every_engine
@pytest.mark.parametrize("kind", ["physics", "analytic"])
def test_wrench_acts_in_its_window_and_leaves_no_trace(
    plant: MujocoPlant, open_loop: OpenLoop, kind: str, engine: Engine
) -> None:
    """Bit by bit the undisturbed run before its window, and an undisturbed restart after it."""
    name, model = plant.system.name, plant if kind == "physics" else plant.analytic()
    kick = Disturbance(plant.system.bodies[-1], WRENCH, Pulse(0.05, 0.08))
    u = 0.3 if len(plant.system.inputs) == 1 else (0.3, 0.2)
    control = open_loop(u)
    pushed = simulate(
        model, control, STARTS[name], duration=0.2, disturbances=[kick], engine=engine
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
@pytest.mark.parametrize("kind", ["physics", "analytic"])
def test_the_next_run_of_a_batch_begins_without_wrench(kind: str, engine: Engine) -> None:
    """Both keep a wrench until it is written again."""
    where = physics("servo") if kind == "physics" else physics("servo").analytic()
    kick = Disturbance("rotor", (0, 0, 0, 0, 0.1, 0))
    still = Controller("none", lambda t, x, memory, p: 0.0, Gain(0.0))
    run = simulate(where, still, np.zeros((2, 2)), duration=0.03, threads=1,
                   disturbances=[[kick], []], engine=engine)  # fmt: skip
    assert run.state[0, -1, 1] != 0
    assert not run.state[1].any()


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


@every_engine
def test_equations_are_pushed_at_an_input_and_at_a_rate(
    engine: Engine, open_loop: OpenLoop, tmp_path: Path
) -> None:
    """2 kg under 4 N on a belt of 3 m/s: p = t^2 + 3 t, which RK4 has exactly."""
    p, v, m = sp.symbols("p v m")
    cart = gm.affine_plant(
        "cart", states={"p": "m", "v": "m/s"}, inputs={"F": "N"}, f=[v, 0], g=[0, 1 / m], h=[p],
        parameters={"m": 2.0},
    ).pushed(("F", "rate of p"))  # fmt: skip
    pushes = [
        Disturbance("F", (4.0, 0, 0, 0, 0, 0)),
        Disturbance("rate of p", (3.0, 0, 0, 0, 0, 0)),
    ]
    run = simulate(
        cart, open_loop(0.0), [0.0, 0.0], duration=0.5, disturbances=pushes, engine=engine
    )
    t = run.time
    np.testing.assert_allclose(run.state.T, [t**2 + 3 * t, 2 * t], rtol=1e-12, atol=1e-15)
    again = gm.load_trajectory(run.save(tmp_path / "run.npz"))
    assert again.to_arrow()["disturbance of F"].to_pylist()[:2] == [4.0, 4.0]
    np.testing.assert_array_equal(again.wrench, run.wrench)
