"""PID as people write it: its own recursion, its limits, and the ways to its gains."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from cases import case
from hand_written import two_link_inertia
from shipped import task_of

import grosmc_mj as gm
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.errors import GainError, GrosmcError
from grosmc_mj.simulation.simulate import Engine, simulate
from grosmc_mj.theory.control import pid_tuning
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


def run_pid(design: str, start: Any, duration: float, engine: Engine, law: Pid) -> gm.Trajectory:
    task = task_of(design)
    return simulate(
        task.plant,
        law.design(task),
        start,
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
    ("engine", "limits"),
    [
        ("python", {}),
        ("python", {"limit": 0.5}),
        ("python", {"limit": 2.0, "tracking_time": 0.1}),
        ("native", {"limit": 2.0}),
    ],
)
def test_inputs_are_those_of_the_textbooks_recursion(engine: Engine, limits: Any) -> None:
    """From a start off the origin, where the setpoint's weight counts from."""
    run = run_pid("servo", (0.4, -0.2), 0.5, engine, Pid(**NUMBERS, **WEIGHTS, **limits))
    expected = by_hand(run.state[:-1, 0].tolist(), **limits)
    np.testing.assert_allclose(run.input[: len(expected)], expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_the_rate_of_a_moving_setpoint_counts_by_its_weight(weight: float) -> None:
    """u is kd times the difference of c r - y over a period; before the first sample r is y."""
    law = Pid(kp=0.0, kd=2.0, rate_setpoint_weight=weight)
    run = run_pid("arm", (0.3, 0.1), 0.05, "python", law)
    y = run.state[:-1, 0]
    weighted = weight * np.sin(np.pi * run.time[:-1]) - y
    differences = np.diff(weighted, prepend=weight * y[0] - y[0])
    np.testing.assert_allclose(run.input, 2.0 * differences / PERIOD, atol=1e-9)


# The loop that gains are computed for


def loop_of(design: str, rows: list[int], filter_time: float = 0.0) -> PidLoop:
    return pid_loop(task_of(design), rows, filter_time)


def output_loop(A: Any, b: Any, filter_time: float = 0.0) -> PidLoop:
    """Loop of the first state of a plant in one chain."""
    n = len(A)
    column = np.array(b, float).reshape(n, 1)
    return PidLoop(np.array(A, float), column, np.eye(n)[:1], filter_time, (slice(0, n),))


def gains_of(kp: float, ki: float = 0.0, kd: float = 0.0) -> PidGains:
    return PidGains(np.array([kp]), np.array([ki]), np.array([kd]))


def test_a_tail_is_that_of_a_simulation() -> None:
    """A first-order loop without integral: e = exp(-(1 + kp) t)."""
    loop = output_loop([[-1]], [1])
    assert loop.tail(gains_of(2.0), 1.5) == pytest.approx(math.exp(-4.5))


def test_a_filter_of_the_rate_begins_at_the_output() -> None:
    """y' = -y - kp y - kd d, d = (y - f)/T, f' = d: from y = f = 1 there is no kick."""
    kp, kd, T = 2.0, 3.0, 0.5
    motion = np.array([[-1 - kp - kd / T, kd / T], [1 / T, -1 / T]])
    y, _ = scipy.linalg.expm(0.6 * motion) @ [1, 1]
    loop = output_loop([[-1]], [1], T)
    assert loop.tail(gains_of(kp, kd=kd), 0.6) == pytest.approx(y)


def test_a_sensitivity_is_that_of_the_transfer_function() -> None:
    """S = 1/(1 + (kp + ki/s + kd s/(1 + T s)) / (s (s + 2)))."""
    loop = output_loop([[0, 1], [0, -2]], [0, 1], 0.1)
    w = np.array([0.7, 2.0, 11.0])
    s = 1j * w
    law = 3 + 4 / s + 5 * s / (1 + 0.1 * s)
    expected = np.abs(1 / (1 + law / (s * (s + 2)))).max()
    assert loop.sensitivity(gains_of(3.0, 4.0, 5.0), w) == pytest.approx(expected)


# Poles that are placed


@pytest.mark.parametrize("design", ["arm", "cart_pendulum"])
def test_placed_poles_are_at_the_frequency(design: str) -> None:
    """The arm's setpoint needs a torque, and the pole's plant is unstable."""
    loop = loop_of(design, [0])
    gains = placed_gains(loop, 3.0)
    assert gains is not None
    # The rate is not filtered, so the filter's own state is no part of the loop.
    closed = loop.closed(gains)[:3, :3]
    np.testing.assert_allclose(np.linalg.eigvals(closed), -3.0, atol=3e-4)


def test_placed_gains_of_the_servo_are_those_by_hand() -> None:
    """J y'' = Kt u - B y' has (s + w)^3 with u = kp e + ki xi + kd e', e = r - y."""
    p: Any = task_of("servo").plant.parameters
    gains: Any = placed_gains(loop_of("servo", [0]), 3.0)
    by_hand = np.array([[27 * p.J], [27 * p.J], [9 * p.J - p.B]]) / p.Kt
    np.testing.assert_allclose([gains.kp, gains.ki, gains.kd], by_hand, rtol=1e-6)


def test_each_joint_is_placed_with_the_inertia_that_it_has_while_the_other_is_held() -> None:
    """ki = w^3 M_ii."""
    task = task_of("two_link_arm regulation")
    setpoint = np.array(task.outputs.reference(0.0, task.reference))[::3]
    M = two_link_inertia(setpoint, task.plant.parameters)
    gains: Any = placed_gains(pid_loop(task, [0, 2], 0.0), 3.0)
    np.testing.assert_allclose(gains.ki, 27 * np.diag(M), rtol=1e-6)


SPEED = {
    "outputs": {"formulas": ["rotor speed"], "unit": "rad/s"},
    "sign": 1,
    "Q": [10],
    "R": 1,
}


def test_a_plant_of_order_one_gets_pi_with_a_double_pole() -> None:
    """J w' = Kt u - B w: the closed loop is s^2 + (B + Kt kp)/J s + Kt ki/J."""
    law = case(controller={"law": "pid", "frequency": 4}, task=SPEED | {"reference": ["2"]}).law(
        "physics", "pid"
    )
    p = law.parameters
    plant = p.plant
    assert (plant.B + plant.Kt * p.kp[0]) / plant.J == pytest.approx(8.0)
    assert plant.Kt * p.ki[0] / plant.J == pytest.approx(16.0)
    assert p.kd[0] == 0.0


# A small DC motor, whose voltage moves its shaft: inertia, damping, constant, resistance.
J, DAMPING, CONSTANT, OHM = 3.2284e-6, 3.5077e-6, 0.0274, 4.0
INDUCTANCE = 2.75e-6


def motor_loop(inductance: float = INDUCTANCE) -> PidLoop:
    """Loop of the motor's angle, rate and acceleration, with the pole of its winding."""
    JL = J * inductance
    a1 = (DAMPING * OHM + CONSTANT**2) / JL
    a2 = (DAMPING * inductance + J * OHM) / JL
    return output_loop([[0, 1, 0], [0, 0, 1], [0, -a1, -a2]], [0, 0, CONSTANT / JL])


def test_the_pole_of_a_winding_is_left_out() -> None:
    """With i = (u - K w)/R the motor is J w' = K (u - K w)/R - b w, and (s + w)^3 has its gains."""
    slow = without_fast_poles(motor_loop(), 100.0)
    assert slow.neglected == pytest.approx((-OHM / INDUCTANCE,), rel=1e-3)
    w = 100.0
    gains = placed_gains(slow, w)
    assert gains is not None
    b = CONSTANT / (OHM * J)
    damping = (DAMPING + CONSTANT**2 / OHM) / J
    found = np.array([gains.kp[0], gains.ki[0], gains.kd[0]])
    np.testing.assert_allclose(found, [3 * w**2 / b, w**3 / b, (3 * w - damping) / b], rtol=1e-4)


@pytest.mark.parametrize(
    ("loop", "bandwidth"),
    [
        pytest.param(motor_loop(OHM / 60), 100.0, id="slow winding"),
        pytest.param(motor_loop(), 1e5, id="bandwidth near R/L"),
        pytest.param(output_loop([[0, 1, 0], [0, 0, 1], [0, 0, 1e6]], [0, 0, 1]), 1.0, id="grows"),
    ],
)
def test_a_pole_near_the_bandwidth_or_one_that_grows_stays(loop: PidLoop, bandwidth: float) -> None:
    """No gains place the poles of a plant of order three."""
    assert without_fast_poles(loop, bandwidth) is loop
    assert placed_gains(loop, bandwidth) is None


def test_the_outputs_of_two_motors_keep_their_chains() -> None:
    """Each joint's winding is left out, and the second joint has twice the inertia."""
    one = motor_loop()
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


# Gains from a settling time


def require_slowest(loop: PidLoop, gains: PidGains, aim: float) -> None:
    """The loop has settled by its aim, four fifths of the time asked for, and just so.

    Slower gains of the same kind, half the frequency and an eighth of ki, would not do.
    """
    assert loop.tail(gains, aim) <= 0.02
    slower = PidGains(gains.kp / 4, gains.ki / 8, gains.kd / 2)
    assert loop.tail(slower, aim) > 0.02


def test_tuned_loops_of_two_joints_settle_in_time() -> None:
    loop = loop_of("two_link_arm regulation", [0, 2])
    require_slowest(loop, tuned_gains(loop, Tuning(settles_within=2.0)), 1.6)


def test_a_file_asks_for_a_settling_time() -> None:
    law = case(controller={"law": "pid", "tune": {"settles_within": "500 ms"}}).law(
        "physics", "pid"
    )
    require_slowest(loop_of("servo", [0]), gains_of(**law.designed.gains), 0.4)


def test_a_tuned_loop_settles_with_the_pole_that_was_left_out() -> None:
    loop = motor_loop()
    gains = tuned_gains(loop, Tuning(settles_within=0.1))
    assert loop.tail(gains, 0.08) <= 0.02
    assert np.linalg.eigvals(loop.closed(gains)).real.max() < 1e-9


def test_a_search_finds_gains_where_no_poles_can_be_placed() -> None:
    """1/(s + 1)^3 has three poles, and a filter of the rate a fourth."""
    loop = output_loop([[0, 1, 0], [0, 0, 1], [-1, -3, -3]], [0, 0, 1], 0.01)
    assert placed_gains(loop, 1.0) is None
    gains = tuned_gains(loop, Tuning(settles_within=8.0))
    assert np.linalg.eigvals(loop.closed(gains)).real.max() < 0
    assert loop.tail(gains, 6.4) <= 0.02


@pytest.mark.slow
def test_gains_that_settle_with_a_peak_of_the_sensitivity_are_passed_over() -> None:
    """A slow filter takes phase from the poles that are placed without it: |S| of 3.6."""
    loop = output_loop([[0, 1], [0, 0]], [0, 1], 0.1)
    gains = tuned_gains(loop, Tuning(settles_within=2.0))
    assert loop.tail(gains, 1.6) <= 0.02
    assert 1.5 < loop.sensitivity(gains, np.geomspace(1e-2, 1e3, 400)) <= 2.0


def test_gains_that_miss_the_aim_are_refused_with_the_error_that_they_leave(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """exp(-2) of it, without any feedback."""
    monkeypatch.setattr(pid_tuning, "_searched", lambda *_: gains_of(0.0))
    loop = replace(output_loop([[-1]], [1]), chains=None)
    words = r"tune found no gains .* settles within 2 s .*: the best leave 13.5 % of the error"
    with pytest.raises(GainError, match=words):
        tuned_gains(loop, Tuning(settles_within=2.0))


# A law of a file


PLAIN = {"law": "pid", "kp": 1}


def servo_pid(controller: Any = PLAIN, **tables: Any) -> Experiment:
    return case(controller=controller, **tables)


def limits_of(experiment: Experiment) -> tuple[float, float]:
    p = experiment.law("physics", "pid").parameters
    return p.low[0], p.high[0]


def test_a_file_gives_its_numbers_with_units() -> None:
    numbers = {"kp": 8, "ki": 10, "filter": "10 ms", "tracking_time": "0.5 s", "limit": "250 mA"}
    law = servo_pid(controller=dict(law="pid", **numbers)).law("physics", "pid")
    p = law.parameters
    assert (p.filter, p.tracking_time, p.low[0], p.high[0]) == (0.01, 0.5, -0.25, 0.25)
    assert law.designed.gains == {"kp": 8, "ki": 10, "kd": 0}


WEAK = {"of": "current", "limit": "0.3 A"}


@pytest.mark.parametrize(
    ("tables", "largest"),
    [
        ({}, math.inf),
        ({"actuator": WEAK}, 0.3),
        ({"actuator": WEAK | {"gain": -2}}, 0.15),
        ({"actuator": WEAK | {"gain": 0}}, math.inf),
        ({"actuator": WEAK, "controller": {"law": "pid", "kp": 1, "limit": "250 mA"}}, 0.25),
    ],
)
def test_its_limits_are_the_commands_that_the_actuator_does_not_cut_off(
    tables: Any, largest: float
) -> None:
    assert limits_of(servo_pid(**tables)) == (-largest, largest)


def test_a_law_keeps_the_limits_of_its_file_where_the_loop_is_varied() -> None:
    experiment = servo_pid(actuator=WEAK)
    assert experiment.loop is not None
    weaker = experiment.changed(loop=experiment.loop.changed("actuator", "current", limit=0.1))
    assert limits_of(weaker) == (-0.3, 0.3)
    rewritten = experiment.changed({"actuator.current.limit": "0.1 A"})
    assert limits_of(rewritten) == (-0.1, 0.1)


def test_an_integral_at_the_actuators_limit_does_not_wind_up() -> None:
    """It leaves the limit as soon as a setpoint out of reach has fallen below the output."""
    experiment = case(
        run={"duration": "6 s", "control_period": "10 ms", "timestep": "10 ms", "engine": "python"},
        controller={"law": "pid", "kp": 1e-6, "ki": 0.1},
        actuator=WEAK,
        task=SPEED | {"reference": ["100 - 100 * step(t - 5)"]},
    )
    command = experiment.run().trajectory.command
    np.testing.assert_allclose(command[499], 0.3, rtol=1e-12)
    assert command.max() == pytest.approx(0.3)
    assert np.all(np.diff(command[500:520]) < 0)


def cartpole(**tables: Any) -> Experiment:
    """dm_control's cartpole, whose force has a range of 10 N, off its operating point."""
    return case(
        "dm_control:suite/cartpole.xml",
        run={
            "start": {"slider": "0.1 m", "hinge_1": "3 deg"},
            "timestep": "1 ms",
            "engine": "python",
        },
        task={"Q": [1, 1, 1, 1], "R": 1},
        **tables,
    )


@pytest.mark.parametrize(("controls", "y"), [([], math.radians(3)), (["slider"], 0.1)])
def test_one_input_controls_the_joint_without_an_actuator_or_what_a_file_names(
    controls: list[str], y: float
) -> None:
    """An operating point has always been the setpoint: the rate does not kick."""
    run = (
        cartpole(controller={"law": "pid", "kp": 20, "kd": 1, "controls": controls})
        .run()
        .trajectory
    )
    assert run.input[0] == pytest.approx(-20 * y)


@pytest.mark.parametrize(("limit", "largest"), [("4 N", 4.0), ("40 N", 10.0)])
def test_limits_are_the_least_of_plant_and_actuator(limit: str, largest: float) -> None:
    """The sliding mode law leaves a tenth of the same room to its switching term."""
    laws = [{"law": "pid", "kp": 20}, {"law": "grosmc"}]
    experiment = cartpole(controller=laws, actuator={"of": "slide", "limit": limit})
    assert limits_of(experiment) == (-largest, largest)
    sliding = experiment.law("physics", "grosmc").parameters
    assert sliding.limit == pytest.approx(0.9 * largest)


# Refusals


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({}, "pid needs kp .*, or frequency, or tune"),
        ({"kp": 1, "frequency": 2}, "not kp and frequency"),
        ({"ki": 1, "frequency": 2}, "ki and kd belong to kp, frequency computes them"),
        ({"kp": [1, 2]}, r"kp = \[1, 2\] must be a number or 1 numbers"),
        ({"kp": 1, "filter": -1}, "filter = -1.* must be finite and not negative"),
        ({"kp": 1, "controls": ["speed"]}, "controls: .*speed"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(numbers: dict[str, Any], words: str) -> None:
    with pytest.raises(GrosmcError, match=words):
        Pid(**numbers).design(task_of("servo"))


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"kp": "a"}, "kp = 'a' must be a number"),
        ({"kp": 1, "filter": "3 kg"}, "filter: .*kg"),
        ({"kp": 1, "controls": 3}, "controls = 3 must be a list of names"),
        ({"tune": "2 s"}, "tune = '2 s' must be a table such as"),
        ({"tune": {"settles_within": 2}}, "settles_within: 2 has no unit"),
        ({"tune": {"settles_within": "0 s"}}, "tune: settles_within = 0.* must be from"),
        ({"tune": {"settles_within": "2 s", "overshoot": 1}}, "tune: .*overshoot"),
    ],
)
def test_numbers_of_a_file_that_do_not_fit_are_refused(numbers: Any, words: str) -> None:
    with pytest.raises(GrosmcError, match=words):
        case(controller={"law": "pid", **numbers})


def test_an_input_that_does_not_act_on_its_output_is_refused() -> None:
    loop = PidLoop(-np.eye(2), np.eye(2)[:, 1:], np.eye(2)[:1], 0.0, None)
    with pytest.raises(GainError, match="input 1 does not act on output 1"):
        tuned_gains(loop, Tuning(settles_within=2.0))
