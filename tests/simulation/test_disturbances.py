"""Disturbances: when they act, where, and that they are gone afterwards."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from conftest import held

import grosmc_mj as gm
from grosmc_mj.errors import ArgumentError
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.simulation.disturbances import (
    Constant,
    Disturbance,
    Pulse,
    SineFrom,
    course,
    packed,
    push,
)
from grosmc_mj.simulation.simulate import simulate

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

    pushes, values = packed(disturbances, bodies, range(1000), 1e-3)
    row = np.ones(12)
    for i, t in enumerate(times):
        push(pushes, values, i, t, 1e-3, row)
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
        packed([sine], ["rotor"], range(10), 1e-3)
        return
    with pytest.raises(ArgumentError, match=r"take a timestep of 0\.000999 s or less"):
        packed([sine], ["rotor"], range(10), 1e-3)


def test_without_disturbances_the_wrench_is_zero() -> None:
    pushes, values = packed([], ("hub", "link"), range(9), 1e-3)
    row = np.ones(12)
    push(pushes, values, 0, 0.0, 1e-3, row)
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
def pushed_cart() -> gm.Trajectory:
    """2 kg under 4 N on a belt of 3 m/s."""
    p, v, m = sp.symbols("p v m")
    cart = gm.affine_plant(
        "cart",
        states={"p": "m", "v": "m/s"},
        inputs={"F": "N"},
        f=[v, 0],
        g=[0, 1 / m],
        h=[p],
        parameters={"m": 2.0},
    )
    plant = cart.pushed(("F", "rate of p"))
    disturbances = [
        Disturbance("F", (4.0, 0, 0, 0, 0, 0)),
        Disturbance("rate of p", (3.0, 0, 0, 0, 0, 0)),
    ]
    return simulate(plant, held(0.0), [0.0, 0.0], duration=0.5, disturbances=disturbances)


def test_equations_are_pushed_at_an_input() -> None:
    """v = 2 t."""
    run = pushed_cart()
    np.testing.assert_allclose(run.state[:, 1], 2 * run.time, rtol=1e-12, atol=1e-15)


def test_equations_are_pushed_at_a_rate() -> None:
    """p = t^2 + 3 t, which RK4 has exactly."""
    run = pushed_cart()
    expected = run.time**2 + 3 * run.time
    np.testing.assert_allclose(run.state[:, 0], expected, rtol=1e-12, atol=1e-15)


def test_pushes_of_equations_are_kept_in_a_file(tmp_path: Path) -> None:
    run = pushed_cart()
    loaded = gm.load_trajectory(run.save(tmp_path / "run.parquet"))
    assert loaded.to_arrow()["disturbance of F"].to_pylist()[:2] == [4.0, 4.0]
    np.testing.assert_array_equal(loaded.wrench, run.wrench)


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
