"""Disturbances: when they act, where, and that they are gone afterwards."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from conftest import held

import grosmc_mj as gm
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.ground.compilation.jitable import jitable
from grosmc_mj.ground.errors import ArgumentError
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.simulation.disturbances import (
    AnyDisturbance,
    Constant,
    Disturbance,
    InputDisturbance,
    OutputDisturbance,
    Pulse,
    RateDisturbance,
    SineFrom,
    Table,
    course,
    disturb,
    packed,
    widths,
)
from grosmc_mj.simulation.loop import Actuator, Estimator, Loop, Sensor
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.plants import Plant

PUSH = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize("per_second", [3, 7, 100, 333, 400, 1000, 3000])
def test_pulse_has_exactly_its_number_of_instants(per_second: int) -> None:
    """Edges at k/n seconds fall on instants k*(1/n), which differ from k/n by rounding."""
    timestep = np.float64(1 / per_second)
    pulses = np.random.default_rng(0).integers(1, 2000, (20, 2))
    for start, length in pulses.tolist():
        end = start + length
        pulse = Pulse(start / per_second, end / per_second)
        values = [pulse(k * timestep) for k in range(end + 2)]
        assert values == [0.0] * start + [1.0] * length + [0.0] * 2


def test_sine_from_an_onset_keeps_the_phase_of_the_run() -> None:
    """d(t) = 0.01 sin 2t from 9 s begins with sin 18, not with sin 0."""
    sine = SineFrom(2.0, onset=9.0)
    assert sine(8.999) == 0.0
    assert sine(9000 * 1e-3) == math.sin(18.0)


def test_the_phase_of_a_sine_is_its_angle_at_zero() -> None:
    assert SineFrom(2.0, phase=math.pi / 2)(0.0) == 1.0


@pytest.mark.parametrize(
    ("profile", "window"),
    [
        (SineFrom(2.0, onset=9.0), (9.0, math.inf)),
        (Pulse(1, 3), (1.0, 3.0)),
        (Constant(), (0.0, math.inf)),
    ],
)
def test_the_window_of_a_disturbance_is_that_of_its_profile(
    profile: Any, window: tuple[float, float]
) -> None:
    assert Disturbance("rotor", PUSH, profile).window == window


class Louder(SineFrom):
    """A profile that is a known one by its class, but not by its values."""

    def __call__(self, t: float) -> float:
        return 2.0 * super().__call__(t)


# Edges on instants, between them, and at k h that differs from the number by rounding.
PROFILES: list[Any] = [
    Constant(),
    Pulse(0.05, 0.08),
    Pulse(-math.inf, 0.0305),
    Pulse(3 * 0.1, math.inf),
    SineFrom(9.0, 0.05),
    SineFrom(-313.7, 0.0705, phase=2.0),
    math.cos,
    Louder(40.0),
]


def numbers_of(disturbances: list[Any], system: Any, steps: range) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of disturbances and their values at timesteps of 1 ms."""
    return packed(disturbances, system, widths(disturbances, system), steps, 1e-3)


def bodies_alone(*bodies: str) -> Any:
    """A system of which nothing but the names of its bodies matters."""
    return SimpleNamespace(bodies=bodies, inputs=(), states=())


def test_wrenches_add_up_in_the_columns_of_their_bodies() -> None:
    bodies = ("hub", "link")
    times = (np.arange(1000) * 1e-3).tolist()
    expected = np.zeros((1000, 2, 6))
    disturbances = []
    for i, profile in enumerate(PROFILES):
        column = i % 2
        values = [profile(t) for t in times]
        if type(profile) in (Pulse, SineFrom):
            kind, a, b, c = profile.numbers
            values = [course(kind, t, a, b, c, 1e-3) for t in times]
        expected[:, column] += np.outer(values, PUSH)
        disturbances.append(Disturbance(bodies[column], PUSH, profile))

    numbers, values = numbers_of(disturbances, bodies_alone(*bodies), range(1000))
    row = np.ones(12)
    for i, t in enumerate(times):
        disturb(numbers, values, i, t, 1e-3, row)
        np.testing.assert_array_equal(row, expected[i].ravel())


@pytest.mark.parametrize(
    ("start", "stop"),
    # Within a step, over an edge, over several, from edge to edge, from before the run.
    [(0.0012, 0.0017), (0.0017, 0.0022), (0.0012, 0.0091), (0.003, 0.007), (-1.0, 0.0005)],
)
def test_a_pulse_has_its_area_wherever_its_edges_lie(start: float, stop: float) -> None:
    pulse = Disturbance("rotor", PUSH, Pulse(start, stop))
    run = simulate(
        MujocoPlant.load("servo"), held(0.0), [1.0, 0.0], duration=0.01, disturbances=[pulse]
    )
    assert run.wrench is not None
    area = run.wrench[:, 0].sum() * 1e-3
    assert area == pytest.approx(PUSH[0] * (stop - max(start, 0.0)), rel=1e-9)


def test_a_pulse_from_step_to_step_acts_in_full() -> None:
    kind, start, stop, _ = Pulse(0.3, 0.4).numbers
    values = [course(kind, 0.1 * k, start, stop, 0.0, 0.1) for k in range(6)]
    assert values == [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]


def test_a_sine_begins_with_its_share_of_the_step_of_its_onset() -> None:
    kind, frequency, onset, phase = SineFrom(2.0, 0.00025, phase=1.0).numbers
    value = course(kind, 0.0, frequency, onset, phase, 1e-3)
    assert value == pytest.approx(0.75 * math.sin(2.0 * 0.00025 + 1.0), rel=1e-6)


@pytest.mark.parametrize(
    ("frequency", "carried"), [(1570.0, True), (-1570.0, True), (1572.0, False)]
)
def test_a_sine_of_fewer_than_four_timesteps_a_period_is_refused(
    frequency: float, carried: bool
) -> None:
    """6282 rad/s would act as -1 rad/s at 1 ms."""
    sine = Disturbance("rotor", PUSH, SineFrom(frequency))
    if carried:
        numbers_of([sine], bodies_alone("rotor"), range(10))
        return
    with pytest.raises(ArgumentError, match=r"take a timestep of 0\.000999 s or less"):
        numbers_of([sine], bodies_alone("rotor"), range(10))


def test_without_disturbances_the_wrench_is_zero() -> None:
    numbers, values = numbers_of([], bodies_alone("hub", "link"), range(9))
    row = np.ones(12)
    disturb(numbers, values, 0, 0.0, 1e-3, row)
    assert not row.any()


@pytest.mark.parametrize("record", [False, True])
def test_a_profile_of_the_users_own_is_called_once_for_each_timestep(record: bool) -> None:
    """It may not answer twice alike."""
    calls: list[float] = []

    def profile(t: float) -> float:
        calls.append(t)
        return float(len(calls))

    disturbances = [
        Disturbance("rotor", PUSH, profile),
        Disturbance("rotor", PUSH, Pulse(0.0, 0.01)),
    ]
    run = simulate(
        MujocoPlant.load("servo"),
        held(0.0),
        [1.0, 0.0],
        duration=0.02,
        disturbances=disturbances,
        record=record,
    )
    assert calls == (np.arange(20) * 1e-3).tolist()
    assert run.wrench is not None
    np.testing.assert_array_equal(run.wrench[-1], 20.0 * np.array(PUSH))


KICK = Disturbance("payload", (0.2, 0.1, -0.3, 0.4, 0.5, 0.6), Pulse(0.05, 0.08))
HELD_ARM = held((0.3, 0.2))
ARM_START = [-0.4, -0.1, 0.2, 0.5]
each_kind = pytest.mark.parametrize("kind", ["physics", "analytic"])
each_engine = pytest.mark.parametrize("engine", ["python", "native"])


@cache
def arm(kind: str) -> Plant:
    plant = MujocoPlant.load("two_link_arm")
    if kind == "physics":
        return plant
    return plant.analytic()


def kicked_arm(kind: str) -> gm.Trajectory:
    """The arm under held torques, with a wrench from 0.05 s to 0.08 s."""
    return simulate(arm(kind), HELD_ARM, ARM_START, duration=0.1, disturbances=[KICK])


@each_kind
def test_wrench_acts_from_the_start_of_its_window(kind: str) -> None:
    """Before it the run is the undisturbed one, bit by bit."""
    kicked = kicked_arm(kind)
    free = simulate(arm(kind), HELD_ARM, ARM_START, duration=0.1)
    np.testing.assert_array_equal(kicked.state[:51], free.state[:51])
    assert np.all(np.any(kicked.state[51:] != free.state[51:], axis=1))


@each_kind
def test_wrench_leaves_no_trace(kind: str) -> None:
    """After its window the run is an undisturbed restart, bit by bit."""
    kicked = kicked_arm(kind)
    restarted = simulate(arm(kind), HELD_ARM, kicked.state[80], duration=0.02)
    np.testing.assert_array_equal(kicked.state[80:], restarted.state)


@each_kind
def test_wrench_is_recorded_in_its_window(kind: str) -> None:
    kicked = kicked_arm(kind)
    assert kicked.wrench is not None
    expected = np.zeros((100, 6))
    expected[50:80] = KICK.wrench
    np.testing.assert_array_equal(kicked.wrench.reshape(100, -1, 6)[:, -1], expected)


@cache
def cart(belt: float = 0.0) -> gm.AnalyticPlant:
    """A cart of 2 kg on a belt that runs at so many m/s."""
    p, v, m, b = sp.symbols("p v m b")
    return gm.affine_plant(
        "cart",
        states={"p": "m", "v": "m/s"},
        inputs={"F": "N"},
        f=[v + b, 0],
        g=[0, 1 / m],
        h=[p],
        parameters={"m": 2.0, "b": belt},
    )


def disturbed_cart(engine: Any = "native") -> gm.Trajectory:
    """The cart under 4 N on a belt of 3 m/s."""
    disturbances = [InputDisturbance("F", 4.0), RateDisturbance("p", 3.0)]
    return simulate(
        cart(), held(0.0), [0.0, 0.0], duration=0.5, disturbances=disturbances, engine=engine
    )


def test_equations_are_disturbed_at_an_input() -> None:
    """v = 2 t."""
    run = disturbed_cart()
    np.testing.assert_allclose(run.state[:, 1], 2 * run.time, rtol=1e-12, atol=1e-15)


def test_equations_are_disturbed_at_a_rate() -> None:
    """p = t^2 + 3 t, which RK4 has exactly."""
    run = disturbed_cart()
    expected = run.time**2 + 3 * run.time
    np.testing.assert_allclose(run.state[:, 0], expected, rtol=1e-12, atol=1e-15)


@each_engine
def test_a_disturbance_of_a_rate_is_a_term_of_the_drift(engine: Any) -> None:
    """v + b and v + 0 + d round alike."""
    belt = simulate(cart(3.0), held(1.0), [0.0, 0.5], duration=0.1, engine=engine)
    disturbance = RateDisturbance("p", 3.0)
    disturbed = simulate(
        cart(), held(1.0), [0.0, 0.5], duration=0.1, disturbances=[disturbance], engine=engine
    )
    np.testing.assert_array_equal(disturbed.state, belt.state)


def test_disturbances_of_equations_are_kept_in_a_file(tmp_path: Path) -> None:
    run = disturbed_cart()
    loaded = gm.load_trajectory(run.save(tmp_path / "run.parquet"))
    table = loaded.to_arrow()
    assert table["disturbance of F"].to_pylist()[:2] == [4.0, 4.0]
    assert table["disturbance of the rate of p"].to_pylist()[:2] == [3.0, 3.0]
    assert table.field("disturbance of the rate of v").metadata[b"unit"] == b"m/s^2"
    np.testing.assert_array_equal(loaded.input_disturbance, run.input_disturbance)
    np.testing.assert_array_equal(loaded.rate_disturbance, run.rate_disturbance)
    assert loaded.wrench is None
    assert loaded.output_disturbance is None


@cache
def servo(kind: str) -> Plant:
    plant = MujocoPlant.load("servo")
    if kind == "physics":
        return plant
    return plant.analytic()


@dataclass(frozen=True)
class Nothing:
    """No numbers."""


def law_of(law: Any) -> gm.Controller:
    """Controller of a law without numbers."""
    return gm.Controller(law.__name__, law, Nothing())


@cache
def regulator() -> gm.Controller:
    """LQR of the servo."""
    return chapter_controller("lqr", servo("analytic"))


def gust(t: float) -> float:
    """A value for each time."""
    return math.sin(7.0 * t) - 0.3


@jitable
def steered(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """A course of the input."""
    u[0] = 0.2 * math.cos(5.0 * t)


@jitable
def steered_in_the_gust(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """The same course with 1.5 times the gust on it."""
    u[0] = 0.2 * math.cos(5.0 * t) + 1.5 * (math.sin(7.0 * t) - 0.3)


@each_kind
@each_engine
def test_a_disturbance_of_an_input_is_added_to_what_the_law_gives(kind: str, engine: Any) -> None:
    """The run is that of a law that adds it itself, and its input is that without it."""
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.2, "engine": engine}
    disturbance = InputDisturbance("current", 1.5, gust)
    disturbed = simulate(servo(kind), law_of(steered), disturbances=[disturbance], **setting)
    expected = simulate(servo(kind), law_of(steered_in_the_gust), **setting)
    free = simulate(servo(kind), law_of(steered), **setting)
    np.testing.assert_array_equal(disturbed.state, expected.state)
    np.testing.assert_array_equal(disturbed.input, free.input)
    assert disturbed.input_disturbance is not None
    np.testing.assert_array_equal(disturbed.input + disturbed.input_disturbance, expected.input)


@each_kind
def test_a_disturbance_of_an_input_comes_after_its_actuator(kind: str) -> None:
    """A limit of 0.1 A bounds the command alone: 0.1 A and 0.5 A are 0.6 A."""
    loop = Loop(actuators=(Actuator("current", limit=0.1),))
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.05}
    disturbances = [InputDisturbance("current", 0.5)]
    run = simulate(servo(kind), held(2.0), loop=loop, disturbances=disturbances, **setting)
    expected = simulate(servo(kind), held(0.6), **setting)
    np.testing.assert_array_equal(run.state, expected.state)
    np.testing.assert_array_equal(run.input, np.full(50, 0.1))


def test_the_gain_of_an_actuator_is_before_its_limit() -> None:
    """2 times 0.2 A are 0.4 A, and 2 times 0.3 A are cut at 0.5 A."""
    loop = Loop(actuators=(Actuator("current", gain=2.0, limit=0.5),))
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.05}
    within = simulate(servo("physics"), held(0.2), loop=loop, **setting)
    cut = simulate(servo("physics"), held(0.3), loop=loop, **setting)
    np.testing.assert_array_equal(within.input, np.full(50, 0.4))
    np.testing.assert_array_equal(cut.input, np.full(50, 0.5))


@each_kind
@each_engine
def test_an_input_is_disturbed_between_the_samples_of_a_law(kind: str, engine: Any) -> None:
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.05, "engine": engine}
    disturbances = [InputDisturbance("current", 1.5, gust)]
    slow = simulate(
        servo(kind), held(0.2), control_period=5e-3, disturbances=disturbances, **setting
    )
    fast = simulate(servo(kind), held(0.2), disturbances=disturbances, **setting)
    np.testing.assert_array_equal(slow.state, fast.state)


MEASURED = ("rotor angle", "rotor speed")


def sensors(bias: float = 0.0, **numbers: Any) -> tuple[Sensor, ...]:
    """Sensors of both states of the servo; that of the angle has a bias."""
    return Sensor(MEASURED[0], bias=bias, **numbers), Sensor(MEASURED[1], **numbers)


BIASED_LOOPS = {
    "ideal sensors": (lambda bias: Loop(sensors=sensors(bias))),
    "late, coarse and noisy": (
        lambda bias: Loop(sensors=sensors(bias, delay=2e-3, resolution=1e-3, noise=1e-2))
    ),
    "a differenced rate": (
        lambda bias: Loop(sensors=(Sensor(MEASURED[0], bias=bias, delay=1e-3),))
    ),
    "a settled Kalman filter": (
        lambda bias: Loop(
            sensors=sensors(bias, noise=1e-2),
            estimators=(Estimator(MEASURED, law="kalman", load=1.0),),
        )
    ),
}


@pytest.mark.parametrize("name", BIASED_LOOPS)
@each_engine
def test_a_constant_disturbance_of_a_measurement_is_a_bias(name: str, engine: Any) -> None:
    loop = BIASED_LOOPS[name]
    setting: Any = {"x0": [1.0, 0.2], "duration": 0.1, "engine": engine}
    biased = simulate(servo("physics"), regulator(), loop=loop(0.125), **setting)
    disturbances = [OutputDisturbance(MEASURED[0], 0.125)]
    disturbed = simulate(
        servo("physics"), regulator(), loop=loop(0.0), disturbances=disturbances, **setting
    )
    np.testing.assert_array_equal(disturbed.state, biased.state)
    np.testing.assert_array_equal(disturbed.seen, biased.seen)


def test_a_late_sensor_tells_the_disturbance_of_the_time_at_which_it_measured() -> None:
    disturbances = [OutputDisturbance(MEASURED[0], 1.0, Pulse(0.005, 0.006))]
    loop = Loop(sensors=sensors(delay=3e-3))
    run = simulate(
        servo("physics"),
        held(0.0),
        [1.0, 0.0],
        duration=0.02,
        loop=loop,
        disturbances=disturbances,
    )
    expected = np.ones(20)
    expected[8] = 2.0
    assert run.seen is not None
    np.testing.assert_array_equal(run.seen[:, 0], expected)


@each_kind
@each_engine
def test_without_a_loop_a_law_gets_the_disturbed_state(kind: str, engine: Any) -> None:
    """u = -x + 0.25 is the law of x - 0.25 under a gain of one."""
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.1, "engine": engine}
    disturbances = [OutputDisturbance(MEASURED[0], -0.25)]
    run = simulate(servo(kind), law_of(proportional), disturbances=disturbances, **setting)
    np.testing.assert_array_equal(run.command, -(run.state[:-1, 0] - 0.25))
    assert run.output_disturbance is not None
    np.testing.assert_array_equal(run.output_disturbance[0], [-0.25, 0.0])


@jitable
def proportional(t: float, x: Any, memory: Any, p: Any, u: Any) -> None:
    """u = -x_1."""
    u[0] = -x[0]


def everywhere(profile: Any, kind: str) -> list[AnyDisturbance]:
    """A disturbance at every place, with one course."""
    disturbances: list[AnyDisturbance] = [
        Disturbance("rotor", (0, 0, 0, 0, 0.1, 0), profile),
        InputDisturbance("current", 0.3, profile),
        OutputDisturbance(MEASURED[0], 0.01, profile),
    ]
    if kind == "analytic":
        disturbances.append(RateDisturbance(MEASURED[0], 0.1, profile))
    return disturbances


TABLE = (1.0, -2.0, 0.5)
HOLD = 4e-3


def as_function(t: float) -> float:
    """The table once."""
    index = math.floor(t / HOLD + 1e-6)
    return TABLE[index] if index < 3 else 0.0


def as_periodic_function(t: float) -> float:
    """The table again and again."""
    return TABLE[math.floor(t / HOLD + 1e-6) % 3]


@pytest.mark.parametrize(
    ("periodic", "function"), [(False, as_function), (True, as_periodic_function)]
)
@each_kind
@each_engine
@pytest.mark.parametrize("looped", [False, True])
def test_a_table_is_the_function_of_time_with_its_values(
    kind: str, engine: Any, periodic: bool, function: Any, looped: bool
) -> None:
    loop = Loop(sensors=sensors(delay=1e-3)) if looped else None
    setting: Any = {"x0": [1.0, 0.0], "duration": 0.03, "engine": engine, "loop": loop}
    table = Table(TABLE, HOLD, periodic)
    runs = [
        simulate(servo(kind), regulator(), disturbances=everywhere(profile, kind), **setting)
        for profile in (table, function)
    ]
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    for name in ("wrench", "input_disturbance", "output_disturbance", "rate_disturbance"):
        np.testing.assert_array_equal(getattr(runs[0], name), getattr(runs[1], name))
    assert runs[0].input_disturbance is not None
    assert np.any(runs[0].input_disturbance[12:]) == periodic


@each_kind
@pytest.mark.parametrize("looped", [False, True])
def test_both_engines_disturb_alike(kind: str, looped: bool) -> None:
    loop = Loop(sensors=sensors(delay=1e-3, noise=1e-3)) if looped else None
    runs = [
        simulate(
            servo(kind),
            regulator(),
            [1.0, 0.0],
            duration=0.1,
            control_period=2e-3,
            loop=loop,
            disturbances=everywhere(SineFrom(40.0, 0.0205), kind),
            engine=engine,
        )
        for engine in ("python", "native")
    ]
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    np.testing.assert_array_equal(runs[0].command, runs[1].command)


def test_simulations_of_a_batch_have_their_own_disturbances() -> None:
    lists = [
        [InputDisturbance("current", 1.0)],
        [],
        [OutputDisturbance(MEASURED[1], 1.0, Table((1.0, 2.0), 1e-3))],
    ]
    batch = simulate(servo("physics"), regulator(), [1.0, 0.0], duration=0.05, disturbances=lists)
    assert batch.wrench is None
    for number, disturbances in enumerate(lists):
        alone = simulate(
            servo("physics"), regulator(), [1.0, 0.0], duration=0.05, disturbances=disturbances
        )
        np.testing.assert_array_equal(batch[number].state, alone.state)


@pytest.mark.parametrize(
    ("disturbance", "words"),
    [
        (Disturbance("rotr", PUSH), "unknown body 'rotr': did you mean 'rotor'?"),
        (InputDisturbance("curent", 1.0), "unknown input 'curent': did you mean 'current'?"),
        (OutputDisturbance("angle", 1.0), "unknown state 'angle': "),
        (RateDisturbance(MEASURED[0], 1.0), "servo runs in MuJoCo, where no rate is disturbed"),
        (InputDisturbance("current", 1.0, Table((1.0,), 1.5e-3)), "no multiple of the timestep"),
    ],
)
def test_a_disturbance_that_fits_nowhere_is_refused(disturbance: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=re.escape(words)):
        simulate(servo("physics"), held(0.0), [0.0, 0.0], duration=0.1, disturbances=[disturbance])


def test_a_run_says_in_which_intervals_it_is_disturbed() -> None:
    disturbances = [
        InputDisturbance("current", 1.0, Pulse(0.002, 0.004)),
        OutputDisturbance(MEASURED[1], 1.0, Table((0.0, 1.0), 5e-3)),
    ]
    run = simulate(
        servo("physics"), held(0.0), [0.0, 0.0], duration=0.012, disturbances=disturbances
    )
    assert run.disturbed is not None
    assert np.flatnonzero(run.disturbed).tolist() == [2, 3, 5, 6, 7, 8, 9]


@pytest.mark.parametrize(
    ("table", "window"),
    [
        (Table((0.0, 1.0), 0.5), (0.5, 1.0)),
        (Table((1.0, 0.0), 0.5), (0.0, 1.0)),
        (Table((0.0, 1.0), 0.5, periodic=True), (0.5, math.inf)),
        (Table((0.0, 0.0), 0.5), (0.0, 1.0)),
    ],
)
def test_a_table_acts_from_its_first_value_that_is_not_zero(
    table: Table, window: tuple[float, float]
) -> None:
    assert InputDisturbance("u", 1.0, table).window == window


RETURNS = r"t \[s\] (that returns|and return) a number"


@pytest.mark.parametrize(
    ("profile", "words"),
    [
        (1.0, RETURNS),
        (lambda t: None, RETURNS),
        # The phase overflows from t = 0.1 s on.
        (SineFrom(1.7e308, phase=1.7e308), RETURNS),
        (lambda t: math.nan if t > 0.25 else 1.0, r"'rotor' is not finite at t = 0\.251 s"),
    ],
)
def test_a_wrong_profile_is_refused(profile: Any, words: str) -> None:
    servo = MujocoPlant.load("servo")

    def simulate_a_second() -> None:
        disturbances = [Disturbance("rotor", PUSH, profile)]
        simulate(servo, held(0.0), [0.0, 0.0], duration=1, disturbances=disturbances)

    with pytest.raises(ArgumentError, match=words):
        simulate_a_second()


def test_a_wrench_that_is_not_finite_is_refused() -> None:
    wrench: Any = (0, 0, math.nan, 0, 0, 0)
    with pytest.raises(ArgumentError, match=r"wrench = .* must be 6 finite numbers"):
        Disturbance("rotor", wrench)


def test_a_pulse_that_never_acts_is_refused() -> None:
    """It would pass for a disturbance that the controller rejected."""
    with pytest.raises(ArgumentError, match="pulse from 3 to 1 s never acts"):
        Pulse(3.0, 1.0)
