"""Disturbances: when they act, where, and that they are gone afterwards."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from open_loop import held

import grosmc_mj as gm
from grosmc_mj.experiments.catalogue import chapter_controller
from grosmc_mj.ground.arrays import Array
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
)
from grosmc_mj.simulation.loop import Actuator, Estimator, Loop, Sensor
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.theory.plants import Plant

H = 1e-3
PUSH = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
ANGLE, SPEED = "rotor angle", "rotor speed"
each_kind = pytest.mark.parametrize("kind", ["physics", "analytic"])
each_engine = pytest.mark.parametrize("engine", ["python", "native"])


@cache
def plant_of(system: str, kind: str) -> Plant:
    plant = MujocoPlant.load(system)
    return plant if kind == "physics" else plant.analytic()


def run_servo(
    *disturbances: AnyDisturbance,
    steps: int = 20,
    law: Any = None,
    kind: str = "physics",
    **options: Any,
) -> gm.Trajectory:
    """A servo that begins at 1 rad, by default under an input of zero."""
    return simulate(
        plant_of("servo", kind),
        law or held(0.0),
        [1.0, 0.0],
        duration=steps * H,
        disturbances=disturbances,
        **options,
    )


@cache
def regulator() -> gm.Controller:
    """LQR of the servo."""
    return chapter_controller("lqr", plant_of("servo", "analytic"))


def gust(t: float) -> float:
    """A value for each time."""
    return math.sin(7.0 * t) - 0.3


# Courses in time


@pytest.mark.parametrize("held_for", [0.0, 1.0])
@pytest.mark.parametrize(("per_second", "start", "stop"), [(10, 3, 6), (7, 5, 9), (3000, 14, 28)])
def test_a_pulse_has_exactly_its_number_of_instants(
    per_second: int, start: int, stop: int, held_for: float
) -> None:
    """Edges at k/n seconds fall on instants k*(1/n), which differ from k/n by rounding."""
    h = 1 / per_second
    kind, a, b, c = Pulse(start / per_second, stop / per_second).numbers
    values = [course(kind, k * h, a, b, c, held_for * h) for k in range(stop + 2)]
    assert values == [0.0] * start + [1.0] * (stop - start) + [0.0] * 2


@pytest.mark.parametrize(
    ("start", "stop"),
    # Within a step, over an edge, over several, from edge to edge, from before the run.
    [(0.0012, 0.0017), (0.0017, 0.0022), (0.0012, 0.0091), (0.003, 0.007), (-1.0, 0.0005)],
)
def test_a_pulse_has_its_area_wherever_its_edges_lie(start: float, stop: float) -> None:
    run = run_servo(Disturbance("rotor", PUSH, Pulse(start, stop)))
    assert run.wrench is not None
    area = run.wrench[:, 0].sum() * H
    assert area == pytest.approx(PUSH[0] * (stop - max(start, 0.0)), rel=1e-9)


def test_a_sine_from_an_onset_keeps_the_phase_of_the_run() -> None:
    """sin(2 t + 0.5) from 9 s begins with sin 18.5, not with sin 0.5."""
    sine = SineFrom(2.0, onset=9.0, phase=0.5)
    assert sine(8.999) == 0.0
    assert sine(9000 * H) == math.sin(18.5)


def test_a_sine_begins_with_its_share_of_the_step_of_its_onset() -> None:
    kind, frequency, onset, phase = SineFrom(2.0, 0.00025, phase=1.0).numbers
    value = course(kind, 0.0, frequency, onset, phase, H)
    assert value == pytest.approx(0.75 * math.sin(2.0 * 0.00025 + 1.0), rel=1e-6)


@pytest.mark.parametrize("frequency", [1570.0, -1570.0])
def test_a_sine_of_four_timesteps_a_period_acts(frequency: float) -> None:
    run = run_servo(InputDisturbance("current", 1.0, SineFrom(frequency)))
    assert run.input_disturbance is not None
    np.testing.assert_allclose(run.input_disturbance, np.sin(frequency * run.time[:-1]))


TABLE = (1.0, -2.0, 0.5)
# Each value for 4 timesteps.
ONCE = np.r_[np.repeat(TABLE, 4), np.zeros(18)]


@pytest.mark.parametrize(
    ("periodic", "values"), [(False, ONCE), (True, np.resize(np.repeat(TABLE, 4), 30))]
)
def test_a_table_holds_each_value_once_or_again_and_again(periodic: bool, values: Array) -> None:
    table = Table(TABLE, 4 * H, periodic)
    run: Any = run_servo(*everywhere([table] * 4, "analytic"), steps=30, kind="analytic")
    assert [table(t) for t in run.time[:-1].tolist()] == values.tolist()
    for signal, amplitude in [
        (run.wrench[:, 4], 0.1),
        (run.input_disturbance, 0.3),
        (run.output_disturbance[:, 0], 0.01),
        (run.rate_disturbance[:, 0], 0.2),
    ]:
        np.testing.assert_allclose(signal, amplitude * values)


def test_a_table_is_zero_before_its_first_value_and_after_its_last() -> None:
    table = Table(TABLE, 0.5)
    assert [table(t) for t in (-0.2, 0.0, 1.4, 1.5)] == [0.0, TABLE[0], TABLE[-1], 0.0]


def everywhere(profiles: list[Any], kind: str) -> list[Any]:
    """A disturbance at every place, each with a course of its own."""
    wrench, at_input, at_output, at_rate = profiles
    disturbances = [
        Disturbance("rotor", (0, 0, 0, 0, 0.05, 0), wrench, scale=2.0),
        InputDisturbance("current", 0.1, at_input, scale=3.0),
        OutputDisturbance(ANGLE, 0.01, at_output),
    ]
    if kind == "analytic":
        disturbances.append(RateDisturbance(ANGLE, 0.2, at_rate))
    return disturbances


@pytest.mark.parametrize("record", [False, True])
def test_a_profile_of_the_users_own_is_called_once_for_each_timestep(record: bool) -> None:
    """It may not answer twice alike."""
    calls: list[float] = []

    def profile(t: float) -> float:
        calls.append(t)
        return float(len(calls))

    pulse = Disturbance("rotor", PUSH, Pulse(0.0, 0.01))
    run = run_servo(Disturbance("rotor", PUSH, profile), pulse, record=record)
    assert calls == (np.arange(20) * H).tolist()
    assert run.wrench is not None
    np.testing.assert_array_equal(run.wrench[-1], 20.0 * np.array(PUSH))


@pytest.mark.parametrize(
    ("profile", "window"),
    [
        (SineFrom(2.0, onset=9.0), (9.0, math.inf)),
        (Pulse(1, 3), (1.0, 3.0)),
        (Constant(), (0.0, math.inf)),
        # A table acts from its first value that is not zero.
        (Table((0.0, 1.0), 0.5), (0.5, 1.0)),
        (Table((1.0, 0.0), 0.5), (0.0, 1.0)),
        (Table((0.0, 1.0), 0.5, periodic=True), (0.5, math.inf)),
        (Table((0.0, 0.0), 0.5), (0.0, 1.0)),
    ],
)
def test_the_window_of_a_disturbance_is_that_of_its_profile(profile: Any, window: Any) -> None:
    assert Disturbance("rotor", PUSH, profile).window == window


def test_a_run_says_in_which_intervals_it_is_disturbed() -> None:
    pulse = InputDisturbance("current", 1.0, Pulse(0.002, 0.004))
    table = OutputDisturbance(SPEED, 1.0, Table((0.0, 1.0), 5e-3))
    run = run_servo(pulse, table, steps=12)
    assert run.disturbed is not None
    assert np.flatnonzero(run.disturbed).tolist() == [2, 3, 5, 6, 7, 8, 9]


# Wrenches


class Louder(SineFrom):
    """A profile that is a known one by its class, but not by its values."""

    def __call__(self, t: float) -> float:
        return 2.0 * super().__call__(t)


def test_wrenches_add_up_in_the_columns_of_their_bodies() -> None:
    on_hub = [Constant(), Pulse(3 * 0.01, math.inf), SineFrom(-313.7, 0.07, phase=2.0)]
    on_link = [Pulse(-math.inf, 0.03), math.cos, Louder(40.0)]
    disturbances = [Disturbance("hub", PUSH, profile) for profile in on_hub]
    disturbances += [Disturbance("link", PUSH, profile) for profile in on_link]
    arm = plant_of("arm", "analytic")
    run: Any = simulate(arm, held(0.0), [0, 0], duration=0.1, disturbances=disturbances)
    hub, link = [
        [sum(profile(t) for profile in profiles) for t in run.time[:-1].tolist()]
        for profiles in (on_hub, on_link)
    ]
    np.testing.assert_allclose(run.wrench, np.hstack([np.outer(hub, PUSH), np.outer(link, PUSH)]))


KICK = Disturbance("payload", (0.2, 0.1, -0.3, 0.4, 0.5, 0.6), Pulse(0.05, 0.08))


def run_arm(kind: str, start: Any = (-0.4, -0.1, 0.2, 0.5), *kicks: Disturbance) -> gm.Trajectory:
    """The two-link arm under held torques."""
    law = held((0.3, 0.2))
    return simulate(plant_of("two_link_arm", kind), law, start, duration=0.1, disturbances=kicks)


@cache
def kicked_arm(kind: str) -> Any:
    """The arm with a wrench from 0.05 s to 0.08 s."""
    return run_arm(kind, (-0.4, -0.1, 0.2, 0.5), KICK)


@each_kind
def test_a_wrench_acts_from_the_start_of_its_window(kind: str) -> None:
    """Before it the run is the undisturbed one, bit by bit."""
    kicked = kicked_arm(kind).state
    free = run_arm(kind).state
    np.testing.assert_array_equal(kicked[:51], free[:51])
    assert np.all(np.any(kicked[51:] != free[51:], axis=1))


@each_kind
def test_a_wrench_leaves_no_trace(kind: str) -> None:
    """After its window the run is an undisturbed restart, bit by bit."""
    kicked = kicked_arm(kind).state
    np.testing.assert_array_equal(kicked[80:], run_arm(kind, kicked[80]).state[:21])


@each_kind
def test_a_wrench_is_recorded_in_its_window(kind: str) -> None:
    expected = np.zeros((100, 6))
    expected[50:80] = KICK.wrench
    np.testing.assert_array_equal(kicked_arm(kind).wrench[:, -6:], expected)


# Equations


@cache
def disturbed_cart(engine: Any) -> gm.Trajectory:
    """A cart of 2 kg under 4 N on a belt of 3 m/s."""
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
    disturbances = [InputDisturbance("F", 4.0), RateDisturbance("p", 3.0)]
    return simulate(cart, held(0.0), [0, 0], duration=0.1, disturbances=disturbances, engine=engine)


@each_engine
def test_equations_are_disturbed_at_an_input_and_at_a_rate(engine: Any) -> None:
    """v = 2 t and p = t^2 + 3 t, which RK4 has exactly."""
    run = disturbed_cart(engine)
    t = run.time
    np.testing.assert_allclose(run.state, np.c_[t**2 + 3 * t, 2 * t], rtol=1e-12, atol=1e-15)


def test_columns_of_a_wrench_have_the_units_of_forces_and_torques() -> None:
    schema = run_servo(Disturbance("rotor", PUSH)).to_arrow().schema
    assert schema.field("force x on rotor").metadata[b"unit"] == b"N"
    assert schema.field("torque z on rotor").metadata[b"unit"] == b"N m"


def test_disturbances_of_equations_are_kept_in_a_file(tmp_path: Path) -> None:
    run = disturbed_cart("native")
    loaded = gm.load_trajectory(run.save(tmp_path / "run.parquet"))
    table = loaded.to_arrow()
    assert table["disturbance of F"].to_pylist()[:2] == [4.0, 4.0]
    assert table["disturbance of the rate of p"].to_pylist()[:2] == [3.0, 3.0]
    assert table.field("disturbance of the rate of v").metadata[b"unit"] == b"m/s^2"
    np.testing.assert_array_equal(loaded.rate_disturbance, run.rate_disturbance)
    assert loaded.wrench is None
    assert loaded.output_disturbance is None


# Inputs and measurements


@each_kind
@each_engine
def test_a_disturbance_of_an_input_comes_after_its_actuator(kind: str, engine: Any) -> None:
    """A limit of 0.1 A bounds the command alone: 0.1 A and 0.5 A are 0.6 A at the plant."""
    loop = Loop(actuators=(Actuator("current", limit=0.1),))
    push = InputDisturbance("current", 0.5)
    run = run_servo(push, law=held(2.0), kind=kind, loop=loop, engine=engine)
    expected = run_servo(law=held(0.6), kind=kind, engine=engine)
    np.testing.assert_array_equal(run.state, expected.state)
    np.testing.assert_array_equal(run.input, np.full(20, 0.1))


@each_kind
def test_an_input_is_disturbed_between_the_samples_of_a_law(kind: str) -> None:
    push = InputDisturbance("current", 1.5, gust)
    slow = run_servo(push, law=held(0.2), kind=kind, control_period=5e-3)
    fast = run_servo(push, law=held(0.2), kind=kind)
    np.testing.assert_array_equal(slow.state, fast.state)
    assert slow.input_disturbance is not None
    expected = [1.5 * gust(t) for t in slow.time[:-1].tolist()]
    np.testing.assert_allclose(slow.input_disturbance, expected)


def sensors(bias: float = 0.0, **numbers: Any) -> tuple[Sensor, ...]:
    """Sensors of both states of the servo; that of the angle has a bias."""
    return Sensor(ANGLE, bias=bias, **numbers), Sensor(SPEED, **numbers)


def late_coarse_and_noisy(bias: float) -> Loop:
    return Loop(sensors=sensors(bias, delay=2e-3, resolution=1e-3, noise=1e-2))


def with_a_differenced_rate(bias: float) -> Loop:
    return Loop(sensors=(Sensor(ANGLE, bias=bias, delay=H),))


def with_a_settled_kalman_filter(bias: float) -> Loop:
    estimator = Estimator((ANGLE, SPEED), law="kalman", load=1.0)
    return Loop(sensors=sensors(bias, noise=1e-2), estimators=(estimator,))


@pytest.mark.parametrize(
    "loop", [late_coarse_and_noisy, with_a_differenced_rate, with_a_settled_kalman_filter]
)
def test_a_constant_disturbance_of_a_measurement_is_a_bias(loop: Any) -> None:
    options: dict[str, Any] = {"law": regulator(), "steps": 50, "engine": "python"}
    biased = run_servo(loop=loop(0.125), **options)
    disturbed = run_servo(OutputDisturbance(ANGLE, 0.125), loop=loop(0.0), **options)
    np.testing.assert_array_equal(disturbed.state, biased.state)
    np.testing.assert_array_equal(disturbed.seen, biased.seen)


def test_a_late_sensor_tells_the_disturbance_of_the_time_at_which_it_measured() -> None:
    kick = OutputDisturbance(ANGLE, 1.0, Pulse(0.005, 0.006))
    run = run_servo(kick, loop=Loop(sensors=sensors(delay=3e-3)))
    expected = np.ones(20)
    expected[8] = 2.0
    assert run.seen is not None
    np.testing.assert_array_equal(run.seen[:, 0], expected)


def proportional(t: float, x: Any, memory: Any, p: Any) -> float:
    return -x[0]


def test_without_a_loop_a_law_gets_the_disturbed_state() -> None:
    """u = -x + 0.25 is the law of x - 0.25 under a gain of one."""
    law = gm.custom_controller("proportional", proportional, regulator(), {"k": 1.0})
    run = run_servo(OutputDisturbance(ANGLE, -0.25), law=law, engine="python")
    np.testing.assert_array_equal(run.command, -(run.state[:-1, 0] - 0.25))
    assert run.output_disturbance is not None
    np.testing.assert_array_equal(run.output_disturbance[0], [-0.25, 0.0])


@each_kind
@pytest.mark.parametrize("loop", [None, Loop(sensors=sensors(delay=H, noise=1e-3))])
def test_both_engines_disturb_alike(kind: str, loop: Loop | None) -> None:
    profiles = [SineFrom(40.0, 0.0205), Table(TABLE, 4 * H, periodic=True), gust, Pulse(0.01, 0.03)]
    options: dict[str, Any] = {"law": regulator(), "steps": 50, "control_period": 2 * H}
    native, python = [
        run_servo(*everywhere(profiles, kind), kind=kind, loop=loop, engine=engine, **options)
        for engine in ("native", "python")
    ]
    np.testing.assert_array_equal(native.state, python.state)
    np.testing.assert_array_equal(native.command, python.command)


def test_simulations_of_a_batch_have_their_own_disturbances() -> None:
    push = InputDisturbance("current", 1.0)
    measured = OutputDisturbance(SPEED, 1.0, Table((1.0, 2.0), H))
    lists = [[push], [], [measured]]
    servo = plant_of("servo", "physics")
    batch = simulate(servo, regulator(), [1.0, 0.0], duration=0.02, disturbances=lists)
    assert batch.wrench is None
    alone = [run_servo(*disturbances, law=regulator()).state for disturbances in lists]
    np.testing.assert_array_equal(batch.state, alone)


# Refusals

RETURNS = r"t \[s\] (that returns|and return) a number"


def with_profile(profile: Any) -> Disturbance:
    return Disturbance("rotor", PUSH, profile)


def not_finite_later(t: float) -> float:
    return math.nan if t > 0.25 else 1.0


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Disturbance("rotr", PUSH), r"unknown body 'rotr': did you mean 'rotor'\?"),
        (lambda: InputDisturbance("curent", 1.0), "unknown input 'curent': did you mean 'current'"),
        (lambda: OutputDisturbance("angle", 1.0), "unknown state 'angle': "),
        (lambda: RateDisturbance(ANGLE, 1.0), "servo runs in MuJoCo, where no rate is disturbed"),
        (lambda: InputDisturbance("current", 1.0, Table((1.0,), 1.5e-3)), "no multiple of the"),
        # 6282 rad/s would act as -1 rad/s at 1 ms.
        (lambda: with_profile(SineFrom(-1572.0)), r"take a timestep of 0\.000999 s or less"),
        # The phase overflows from t = 0.1 s on.
        (lambda: with_profile(SineFrom(1.7e308, phase=1.7e308)), RETURNS),
        (lambda: with_profile(1.0), RETURNS),
        (lambda: with_profile(lambda t: None), RETURNS),
        (lambda: with_profile(not_finite_later), r"'rotor' is not finite at t = 0\.251 s"),
        (
            lambda: Disturbance("rotor", (0, 0, math.nan, 0, 0, 0)),
            r"wrench = .* must be 6 finite numbers",
        ),
        # It would pass for a disturbance that the controller rejected.
        (lambda: Pulse(3.0, 1.0), "pulse from 3 to 1 s never acts"),
    ],
)
def test_a_disturbance_that_fits_nowhere_is_refused(make: Any, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        run_servo(make(), steps=1000)
