"""PID as people write it: its own recursion, its limits, and the ways to its gains."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from case_texts import load
from shipped import task_of

import grosmc_mj as gm
from grosmc_mj.ground.errors import ArgumentError, GainError
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.theory.control.controller import Controller
from grosmc_mj.theory.control.kinds.pid import Pid
from grosmc_mj.theory.control.pid_tuning import (
    PidGains,
    PidLoop,
    Tuning,
    pid_loop,
    placed_gains,
    tuned_gains,
    without_fast_poles,
)

PERIOD = 5e-3
NUMBERS = {"kp": 8.0, "ki": 10.0, "kd": 1.5, "filter": 0.02}
WEIGHTS = {"setpoint_weight": 0.6, "rate_setpoint_weight": 0.3}
# Of the servo about 1 rad: a start off the origin, where the setpoint's weight counts from.
START = (0.4, -0.2)

SERVO = """
[plant]
system = "servo"
compare = ["physics"]
[run]
duration = "20 ms"
engine = "python"
[[controller]]
law = "pid"
"""


def run_servo(engine: Engine = "python", duration: float = 0.5, **numbers: Any) -> gm.Trajectory:
    task = task_of("servo")
    law = Pid(**{**NUMBERS, **WEIGHTS, **numbers}).design(task)
    return simulate(
        task.plant,
        law,
        START,
        duration=duration,
        engine=engine,
        control_period=PERIOD,
        timestep=PERIOD,
    )


def by_hand(y: list[float], limit: float = math.inf, tracking_time: float = 0.0) -> list[float]:
    """Inputs of the textbook's recursion for measured outputs y and the setpoint 1."""
    r, b, c = 1.0, WEIGHTS["setpoint_weight"], WEIGHTS["rate_setpoint_weight"]
    kp, ki, kd, filter_time = NUMBERS.values()
    integral = rate = 0.0
    inputs = []
    # The setpoint steps from the output at the start.
    last = c * y[0] - y[0]
    for now in y:
        # rate' = (c r - y)' through 1/(T_f s + 1), by backward Euler.
        rate = (filter_time * rate + (c * r - now) - last) / (filter_time + PERIOD)
        last = c * r - now
        wanted = kp * (b * (r - y[0]) - (now - y[0])) + integral + kd * rate
        u = float(np.clip(wanted, -limit, limit))
        inputs.append(u)
        excess = wanted - u
        if tracking_time:
            integral += PERIOD * (ki * (r - now) - excess / tracking_time)
        elif excess * (r - now) <= 0:
            integral += PERIOD * ki * (r - now)
    return inputs


@pytest.mark.parametrize(
    "limits", [{}, {"limit": 2.0}, {"limit": 2.0, "tracking_time": 0.1}, {"limit": 0.5}]
)
def test_inputs_are_those_of_the_textbooks_recursion(limits: dict[str, Any]) -> None:
    run = run_servo(**limits)
    expected = by_hand(run.state[:-1, 0].tolist(), **limits)
    np.testing.assert_allclose(run.input[: len(expected)], expected, rtol=1e-9, atol=1e-12)


def test_both_engines_run_it_alike() -> None:
    python = run_servo("python", limit=2.0)
    native = run_servo("native", limit=2.0)
    np.testing.assert_allclose(native.state, python.state, rtol=1e-9, atol=1e-12)


def test_without_its_weight_the_rate_of_a_setpoint_does_not_count() -> None:
    """With c = 0 the arm's moving reference leaves -kd y' alone, the difference of two samples."""
    task = task_of("arm")
    law = Pid(kp=0.0, kd=2.0, rate_setpoint_weight=0.0).design(task)
    timing: Any = {"duration": 0.05, "control_period": PERIOD, "timestep": PERIOD}
    run = simulate(task.plant, law, (0.3, 0.1), engine="python", **timing)
    y = run.state[:-1, 0]
    assert run.input[0] == 0
    assert run.input[1:] == pytest.approx(-2.0 * np.diff(y) / PERIOD, abs=1e-9)


@pytest.mark.parametrize(("weight", "kick"), [(1.0, 0.6 * 1.5 / PERIOD), (0.5, 0.3 * 1.5 / PERIOD)])
def test_a_step_at_the_start_kicks_as_its_weight_says(weight: float, kick: float) -> None:
    """The setpoint steps by 0.6 rad in a period: u = kd c (r - y_0) / T."""
    run = run_servo(kp=0.0, ki=0.0, kd=1.5, filter=0.0, rate_setpoint_weight=weight)
    assert run.input[0] == pytest.approx(kick)


def test_an_operating_point_that_is_held_does_not_kick(tmp_path: Path) -> None:
    """It has always been the setpoint; only the pole's own motion counts."""
    run = load(tmp_path, CARTPOLE.replace("kp = 20", "kp = 20\nkd = 1")).run().trajectory
    assert run.input[0] == pytest.approx(-20 * math.radians(3))


def test_an_integral_that_held_overshoots_less_than_one_that_wound_up() -> None:
    """A tracking time of an hour is as good as none."""
    wound_up = run_servo(duration=6.0, limit=0.4, tracking_time=3600.0)
    held = run_servo(duration=6.0, limit=0.4)
    assert wound_up.state[:, 0].max() > held.state[:, 0].max() + 0.05


def loop_of(design: str, rows: list[int], filter_time: float = 0.0) -> PidLoop:
    return pid_loop(task_of(design), rows, filter_time)


@pytest.mark.parametrize("design", ["servo", "arm", "cart_pendulum"])
def test_placed_poles_are_at_the_frequency(design: str) -> None:
    """The arm's setpoint needs a torque, and the pole's plant is unstable."""
    loop = loop_of(design, [0])
    gains = placed_gains(loop, 3.0)
    assert gains is not None
    # The rate is not filtered, so the filter's own state is no part of the loop.
    closed = loop.closed(gains)[:3, :3]
    np.testing.assert_allclose(np.linalg.eigvals(closed), -3.0, atol=3e-4)


SPEED = """
outputs = { formulas = ["rotor speed"], unit = "rad/s" }
reference = ["2"]
sign = 1
Q = [10]
R = 1
"""


def test_a_plant_of_order_one_gets_pi_with_a_double_pole(tmp_path: Path) -> None:
    text = SERVO + "frequency = 4\n[task]" + SPEED
    law = load(tmp_path, text).law("physics", "pid")
    p = law.parameters
    plant = p.plant
    # J w' = Kt u - B w: the closed loop is s^2 + (B + Kt kp)/J s + Kt ki/J.
    linear = (plant.B + plant.Kt * p.kp[0]) / plant.J
    assert linear == pytest.approx(8.0)
    assert plant.Kt * p.ki[0] / plant.J == pytest.approx(16.0)
    assert p.kd[0] == 0.0


@pytest.mark.parametrize("design", ["servo", "arm", "cart_pendulum", "two_link_arm regulation"])
def test_tuned_loops_settle_in_time(design: str) -> None:
    rows = [0, 2] if design.startswith("two") else [0]
    loop = loop_of(design, rows)
    gains = tuned_gains(loop, Tuning(settles_within=2.0))
    assert loop.tail(gains, 1.6) <= 0.02
    # No slower gains of the same kind would do: half the frequency, an eighth of ki.
    slower = PidGains(gains.kp / 4, gains.ki / 8, gains.kd / 2)
    assert loop.tail(slower, 1.6) > 0.02
    assert loop.sensitivity(gains, np.geomspace(1e-2, 1e3, 50)) <= 2.0


def test_a_search_finds_gains_where_no_poles_can_be_placed() -> None:
    """1/(s + 1)^3 has three poles, and a filter of the rate a fourth."""
    A = np.array([[0.0, 1, 0], [0, 0, 1], [-1, -3, -3]])
    loop = PidLoop(A, np.array([[0.0], [0], [1]]), np.eye(3)[:1], 0.01, (slice(0, 3),))
    assert placed_gains(loop, 1.0) is None
    gains = tuned_gains(loop, Tuning(settles_within=6.0))
    assert np.linalg.eigvals(loop.closed(gains)).real.max() < 0
    assert loop.tail(gains, 4.8) <= 0.02


# A small DC motor, whose voltage moves its shaft: inertia, damping, constant, resistance.
J, DAMPING, CONSTANT, OHM = 3.2284e-6, 3.5077e-6, 0.0274, 4.0


def motor_loop(inductance: float) -> PidLoop:
    """Loop of the motor's angle, rate and acceleration, with the pole of its winding."""
    JL = J * inductance
    a1 = (DAMPING * OHM + CONSTANT**2) / JL
    a2 = (DAMPING * inductance + J * OHM) / JL
    A = np.array([[0.0, 1, 0], [0, 0, 1], [0, -a1, -a2]])
    B = np.array([[0.0], [0], [CONSTANT / JL]])
    return PidLoop(A, B, np.eye(3)[:1], 0.0, (slice(0, 3),))


def test_the_pole_of_a_winding_is_left_out() -> None:
    """With i = (u - K w)/R the motor is J w' = K (u - K w)/R - b w, and (s + w)^3 has its gains."""
    slow = without_fast_poles(motor_loop(2.75e-6), 100.0)
    assert slow.neglected == pytest.approx((-OHM / 2.75e-6,), rel=1e-3)
    w = 100.0
    gains = placed_gains(slow, w)
    assert gains is not None
    b = CONSTANT / (OHM * J)
    damping = (DAMPING + CONSTANT**2 / OHM) / J
    found = np.array([gains.kp[0], gains.ki[0], gains.kd[0]])
    np.testing.assert_allclose(found, [3 * w**2 / b, w**3 / b, (3 * w - damping) / b], rtol=1e-4)


def test_a_tuned_loop_settles_with_the_pole_that_was_left_out() -> None:
    loop = motor_loop(2.75e-6)
    gains = tuned_gains(loop, Tuning(settles_within=0.1))
    assert loop.tail(gains, 0.08) <= 0.02
    poles = np.linalg.eigvals(loop.closed(gains))
    assert poles.real.max() < 1e-9


@pytest.mark.parametrize(
    ("inductance", "bandwidth"),
    [
        # R/L of 60 rad/s, and a bandwidth that comes near R/L.
        (4.0 / 60, 100.0),
        (2.75e-6, 1e5),
    ],
)
def test_a_pole_near_the_bandwidth_stays(inductance: float, bandwidth: float) -> None:
    loop = motor_loop(inductance)
    assert without_fast_poles(loop, bandwidth) is loop
    assert placed_gains(without_fast_poles(loop, bandwidth), bandwidth) is None


def test_a_fast_pole_that_grows_is_not_left_out() -> None:
    A = np.array([[0.0, 1, 0], [0, 0, 1], [0, 0, 1e6]])
    loop = PidLoop(A, np.eye(3)[:, 2:], np.eye(3)[:1], 0.0, (slice(0, 3),))
    assert without_fast_poles(loop, 1.0) is loop


def test_the_outputs_of_two_motors_keep_their_chains() -> None:
    """Each joint's winding is left out, and the second joint has twice the inertia."""
    one = motor_loop(2.75e-6)
    A: Any = scipy.linalg.block_diag(one.A, one.A)
    B: Any = scipy.linalg.block_diag(one.B, one.B / 2)
    C: Any = scipy.linalg.block_diag(one.C, one.C)
    slow = without_fast_poles(PidLoop(A, B, C, 0.0, (slice(0, 3), slice(3, 6))), 100.0)
    assert slow.chains == (slice(0, 2), slice(2, 4))
    gains = placed_gains(slow, 100.0)
    alone = placed_gains(without_fast_poles(one, 100.0), 100.0)
    assert gains is not None
    assert alone is not None
    np.testing.assert_allclose(gains.kp, alone.kp * [1, 2], rtol=1e-9)


def test_a_tail_is_that_of_a_simulation() -> None:
    """A first-order loop without integral: e = exp(-(1 + kp) t)."""
    loop = PidLoop(-np.eye(1), np.eye(1), np.eye(1), 0.0, None)
    gains = PidGains(np.array([2.0]), np.zeros(1), np.zeros(1))
    assert loop.tail(gains, 1.5) == pytest.approx(math.exp(-4.5))


def test_a_filter_of_the_rate_begins_at_the_output() -> None:
    """y' = -y - kp y - kd d, d = (y - f)/T, f' = d: from y = f = 1 there is no kick."""
    kp, kd, T = 2.0, 3.0, 0.5
    loop = PidLoop(-np.eye(1), np.eye(1), np.eye(1), T, None)
    motion = np.array([[-1 - kp - kd / T, kd / T], [1 / T, -1 / T]])
    y, _ = scipy.linalg.expm(0.6 * motion) @ [1, 1]
    gains = PidGains(np.array([kp]), np.zeros(1), np.array([kd]))
    assert loop.tail(gains, 0.6) == pytest.approx(y)


def test_a_sensitivity_is_that_of_the_transfer_function() -> None:
    """S = 1/(1 + (kp + ki/s + kd s/(1 + T s)) / (s (s + 2)))."""
    loop = PidLoop(np.array([[0.0, 1], [0, -2]]), np.array([[0.0], [1]]), np.eye(2)[:1], 0.1, None)
    gains = PidGains(np.array([3.0]), np.array([4.0]), np.array([5.0]))
    w = np.array([0.7, 2.0, 11.0])
    s = 1j * w
    law = 3 + 4 / s + 5 * s / (1 + 0.1 * s)
    expected = np.abs(1 / (1 + law / (s * (s + 2)))).max()
    assert loop.sensitivity(gains, w) == pytest.approx(expected)


def test_no_gains_are_found_for_four_integrators() -> None:
    """s^5 + kd s^2 + kp s + ki has no s^4: it is never stable."""
    loop = PidLoop(np.eye(4, k=1), np.eye(4)[:, 3:], np.eye(4)[:1], 0.0, (slice(0, 4),))
    with pytest.raises(GainError, match=r"tune found no gains .* settles within 2 s"):
        tuned_gains(loop, Tuning(settles_within=2.0))


def law_of(folder: Path, numbers: str) -> Controller:
    return load(folder, SERVO + numbers).law("physics", "pid")


def test_a_file_gives_its_numbers_with_units(tmp_path: Path) -> None:
    law = law_of(tmp_path, 'kp = 8\nki = 10\nfilter = "10 ms"\ntracking_time = "0.5 s"\nlimit = 3')
    p = law.parameters
    assert (p.kp[0], p.ki[0], p.kd[0]) == (8, 10, 0)
    assert (p.filter, p.tracking_time, p.low[0], p.high[0]) == (0.01, 0.5, -3, 3)
    assert law.designed.gains == {"kp": 8, "ki": 10, "kd": 0}


ACTUATOR = """
[[actuator]]
of = "current"
limit = "0.3 A"
"""


@pytest.mark.parametrize(
    ("numbers", "largest"),
    [
        ("kp = 1", math.inf),
        ("kp = 1" + ACTUATOR, 0.3),
        ("kp = 1" + ACTUATOR + "gain = 0.5", 0.6),
        ("kp = 1" + ACTUATOR + "gain = -2", 0.15),
        ("kp = 1" + ACTUATOR + "gain = 0", math.inf),
        ('kp = 1\nlimit = "250 mA"' + ACTUATOR, 0.25),
    ],
)
def test_its_limits_are_the_commands_that_the_actuator_does_not_cut_off(
    tmp_path: Path, numbers: str, largest: float
) -> None:
    p = law_of(tmp_path, numbers).parameters
    assert (p.low[0], p.high[0]) == (-largest, largest)


@pytest.mark.parametrize(("limit", "largest"), [("4 N", 4.0), ("40 N", 10.0)])
def test_its_limits_are_the_least_of_plant_and_actuator(
    tmp_path: Path, limit: str, largest: float
) -> None:
    """dm_control's cartpole has a range of 10 N."""
    actuator = f'\n[[actuator]]\nof = "slide"\nlimit = "{limit}"\n'
    case = load(tmp_path, CARTPOLE + actuator)
    p = case.law("physics", "pid").parameters
    assert (p.low[0], p.high[0]) == (-largest, largest)
    # The sliding mode law leaves a tenth of the same room to its switching term.
    sliding = case.law("physics", "grosmc").parameters
    assert sliding.limit == pytest.approx(0.9 * largest)


def test_a_law_keeps_the_limits_of_its_file_where_the_loop_is_varied(tmp_path: Path) -> None:
    case = load(tmp_path, SERVO + "kp = 1" + ACTUATOR)
    assert case.loop is not None
    weaker = case.changed(loop=case.loop.changed("actuator", "current", limit=0.1))
    assert weaker.law("physics", "pid").parameters.high[0] == 0.3
    rewritten = case.changed({"actuator.current.limit": "0.1 A"})
    assert rewritten.law("physics", "pid").parameters.high[0] == 0.1


FALLING = """
kp = 1e-6
ki = 0.1
[[actuator]]
of = "current"
limit = "0.3 A"
[task]
outputs = { formulas = ["rotor speed"], unit = "rad/s" }
reference = ["1000 - 1000 * step(t - 5)"]
sign = 1
Q = [10]
R = 1
"""


@pytest.mark.parametrize("engine", ["python", "native"])
def test_an_integral_at_the_actuators_limit_does_not_wind_up(tmp_path: Path, engine: Any) -> None:
    """It leaves the limit as soon as a setpoint out of reach has fallen below the output."""
    case = load(tmp_path, SERVO.replace("20 ms", "6 s") + FALLING).changed(engine=engine)
    run = case.run().trajectory
    fallen = round(5 / case.settings.control_period)
    np.testing.assert_allclose(run.command[fallen - 1], 0.3, rtol=1e-12)
    assert np.all(run.command <= 0.3)
    assert np.all(np.diff(run.command[fallen : fallen + 20]) < 0)


def test_a_file_asks_for_a_settling_time(tmp_path: Path) -> None:
    gains = law_of(tmp_path, 'tune = { settles_within = "2 s" }').designed.gains
    expected = tuned_gains(loop_of("servo", [0]), Tuning(settles_within=2.0))
    assert gains["kp"] == pytest.approx(expected.kp[0])


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ("", "pid needs kp .*, or frequency, or tune"),
        ("kp = 1\nfrequency = 2", "not kp and frequency"),
        ("ki = 1\nfrequency = 2", "ki and kd belong to kp, frequency computes them"),
        ("kp = [1, 2]", r"kp = \[1.0, 2.0\] must be a number or 1 numbers"),
        ('kp = "a"', "kp = 'a' must be a number"),
        ("kp = 1\nfilter = -1", "filter = -1.* must be finite and not negative"),
        ('kp = 1\nfilter = "3 kg"', "filter: .*kg"),
        ('tune = "2 s"', "tune = '2 s' must be a table such as"),
        ("tune = { settles_within = 2 }", "settles_within: 2 has no unit"),
        ('tune = { settles_within = "0 s" }', "tune: settles_within = 0.* must be"),
        ('tune = { settles_within = "1e99 s" }', "tune: settles_within = 1e\\+99 must be from"),
        ('tune = { settles_within = "2 s", overshoot = 1 }', "tune: .*overshoot"),
        ('kp = 1\ncontrols = ["speed"]', "controls: .*speed"),
        ("kp = 1\ncontrols = 3", "controls = 3 must be a list of names"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(tmp_path: Path, numbers: str, words: str) -> None:
    with pytest.raises(ArgumentError, match=words):
        law_of(tmp_path, numbers)


CARTPOLE = """
[plant]
model = "dm_control:suite/cartpole.xml"
[run]
start = { hinge_1 = "3 deg" }
duration = "20 ms"
timestep = "1 ms"
[task]
Q = [1, 1, 1, 1]
R = 1
[[controller]]
law = "pid"
kp = 20
"""


def test_one_input_controls_the_joint_without_an_actuator(tmp_path: Path) -> None:
    run = load(tmp_path, CARTPOLE).run().trajectory
    assert run.input[0] == pytest.approx(-20 * math.radians(3))


def test_a_file_names_what_is_controlled(tmp_path: Path) -> None:
    """The cart is at its setpoint."""
    run = load(tmp_path, CARTPOLE + 'controls = ["slider"]').run().trajectory
    assert run.input[0] == 0.0
