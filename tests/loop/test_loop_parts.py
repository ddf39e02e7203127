"""Sensors, computer and actuators: what each tells, holds and gives, beside SciPy and MuJoCo."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from looped import ANGLE, CURRENT, SPEED, H, applied, behind, played, scripted, seen

from grosmc_mj.arrays import Array
from grosmc_mj.loop import Actuator, Computing, Loop, Sensor, in_loop
from grosmc_mj.loop.actuators import actuate
from grosmc_mj.loop.counter import normal
from grosmc_mj.loop.delay import send
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate
from grosmc_mj.simulation.trajectory import Trajectory

EPS = np.finfo(float).eps
EXAMPLES = settings(max_examples=25)
# Of a mean of many independent numbers: one in 10^6 is beyond.
SIGMAS = 5.0
commands = st.lists(st.floats(-5, 5), min_size=1, max_size=30)
seeds = st.integers(0, 2**53 - 1)


def watched(*sensors: Sensor) -> Trajectory:
    """The servo as it is braked, and the readings of its sensors."""
    return played(np.linspace(0.0, -5.0, 60), Loop(sensors=sensors), x0=(0.4, 3.0))


# --- sensors ---


@EXAMPLES
@given(q=st.floats(1e-4, 1.0), noise=st.floats(0, 0.3))
def test_an_encoder_tells_the_nearest_multiple(q: float, noise: float) -> None:
    run = watched(Sensor(ANGLE, q, noise=noise))
    told, exact = seen(run)[:, 0], seen(watched(Sensor(ANGLE, noise=noise)))[:, 0]
    np.testing.assert_array_equal(told, q * np.round(told / q))
    assert np.all(np.abs(told - exact) <= 0.5 * q * (1 + 2 * EPS) + 2 * EPS * np.abs(told))
    # A state without a sensor is known exactly.
    np.testing.assert_array_equal(seen(run)[:, 1], run.state[:-1, 1])


def test_beyond_2_52_multiples_a_reading_is_as_it_is() -> None:
    run = played(np.zeros(3), Loop(sensors=(Sensor(ANGLE, 1e-9),)), x0=(1e8 + 0.3, 0.0))
    np.testing.assert_array_equal(seen(run)[:, 0], 1e8 + 0.3)


def test_scale_bias_and_drift_add_up() -> None:
    run = watched(Sensor(SPEED, scale=1.5, bias=0.25, drift=-8.0))
    expected = 1.5 * run.state[:-1, 1] + 0.25 - 8.0 * run.time[:-1]
    np.testing.assert_allclose(seen(run)[:, 1], expected, rtol=0, atol=8 * EPS * 4)


@EXAMPLES
@given(
    delay=st.integers(0, 9),
    period=st.integers(0, 9),
    stride=st.sampled_from([1, 2, 5]),
    number=st.sampled_from([0, 1, 2**40]),
)
def test_a_sensor_tells_of_its_own_last_sample_with_the_noise_of_its_run(
    delay: int, period: int, stride: int, number: int
) -> None:
    """Its samples are at multiples of its period, each with one noise; before them is the start."""
    late = {"delay": delay * H, "period": period * H}
    loop = Loop(sensors=(Sensor(ANGLE, noise=0.1, **late), Sensor(SPEED, noise=0.7)), seed=3)
    run = played(np.linspace(0, -5, 30), loop, x0=(0.4, 3.0), stride=stride, run=number)
    now = np.arange(len(run.time) - 1) // stride * stride
    at = np.maximum(now - delay, 0)
    at -= at % period if period else 0
    for signal, (rows, noise) in enumerate(((at, 0.1), (now, 0.7))):
        drawn = [
            run.state[k, signal] + noise * normal(3.0, number, signal, k) for k in rows.tolist()
        ]
        np.testing.assert_allclose(seen(run)[:, signal], drawn, rtol=0, atol=8 * EPS * 4)


# --- the computer ---


def computed(samples: int, stride: int, seed: int = 0, **numbers: float) -> Trajectory:
    """A script that demands 1, 2, 3 ...: a number tells its sample."""
    loop = Loop(Computing(**numbers), seed=seed)
    return played(np.arange(1.0, samples + 1), loop, stride=stride, x0=(0.0, 1.0))


def instants(run: Trajectory) -> Any:
    """The timesteps in which samples were taken."""
    return np.flatnonzero(np.diff(run.memory["samples"], prepend=0.0))


@EXAMPLES
@given(missed=st.floats(0, 0.95), seed=seeds, stride=st.sampled_from([1, 3]))
def test_a_missed_sample_holds_the_output_before(missed: float, seed: int, stride: int) -> None:
    run = computed(40, stride, seed, missed=missed)
    np.testing.assert_array_equal(run.command, np.repeat(np.arange(1.0, 41), stride))
    outputs, before = run.input.reshape(40, stride), 0.0
    assert np.all(outputs == outputs[:, :1])
    for demand, output in enumerate(outputs[:, 0].tolist(), start=1):
        assert output in (demand, before)
        before = output


@EXAMPLES
@given(late=st.integers(0, 6), seed=seeds, delay=st.integers(0, 9))
def test_a_sample_is_late_by_timesteps_within_the_bound(late: int, seed: int, delay: int) -> None:
    stride = 7
    run = computed(40, stride, seed, jitter=late * H, delay=delay * H)
    at = instants(run)
    lateness = at - stride * np.arange(len(at))
    assert lateness[0] == 0
    assert np.all((lateness >= 0) & (lateness <= late))
    # Sensors are read when it is late, and the law believes that it is not.
    last = np.repeat(at, np.diff(at, append=len(run.command)))
    np.testing.assert_array_equal(seen(run), run.state[last])
    demand = 1.0 * np.searchsorted(at, np.arange(len(run.command)), side="right")
    np.testing.assert_array_equal(run.command, demand)
    np.testing.assert_array_equal(run.input, np.append(np.zeros(delay), demand)[: len(demand)])


def test_missed_and_late_samples_are_as_frequent_as_they_should_be() -> None:
    """Of N samples sqrt(N p (1 - p)) more or less; lateness is even."""
    N, p, late = 3000, 0.3, 3
    run = computed(N, 1, missed=p)
    missed = np.sum(run.input != run.command)
    assert abs(missed - N * p) < SIGMAS * math.sqrt(N * p * (1 - p))
    at = instants(computed(N // 4, 4, jitter=late * H))
    counts, share = np.bincount(at - 4 * np.arange(len(at))), 1 / (late + 1)
    assert len(counts) == late + 1
    spread = SIGMAS * math.sqrt(N / 4 * share * (1 - share))
    assert np.all(np.abs(counts - N / 4 * share) < spread)


def test_noise_lateness_and_missed_samples_are_drawn_independently() -> None:
    """Sample k demands k + 1: commands tell when it was taken, inputs whether it was missed.

    Series of N numbers have a correlation of 1/sqrt(N); one in 10^6 is beyond five of it.
    """
    samples, stride = 2000, 3
    sensors = (Sensor(ANGLE, noise=0.2), Sensor(SPEED, noise=0.7))
    demand = np.arange(1.0, samples + 1)
    run = played(demand, Loop(Computing(jitter=H, missed=0.5), sensors), stride=stride)
    at = np.flatnonzero(np.diff(run.command, prepend=0.0))
    late, missed = at - stride * np.arange(samples), run.input[at] != run.command[at]
    series = np.vstack([late, missed, (seen(run)[at] - run.state[at]).T])
    assert set(late) == {0, 1}
    assert np.abs(np.corrcoef(series) - np.eye(4)).max() < SIGMAS / math.sqrt(samples)


# --- actuators ---


@EXAMPLES
@given(u=commands, size=st.floats(0.01, 6))
def test_limit_dead_zone_and_resolution(u: list[float], size: float) -> None:
    np.testing.assert_array_equal(behind(u, limit=size), np.clip(u, -size, size))
    beyond = [v - size if v > size else v + size if v < -size else 0.0 for v in u]
    np.testing.assert_array_equal(behind(u, dead_zone=size), beyond)
    rounded = behind(u, resolution=size)
    np.testing.assert_array_equal(rounded, size * np.round(rounded / size))
    bound = 0.5 * size * (1 + 2 * EPS) + 2 * EPS * np.abs(u)
    assert np.all(np.abs(rounded - u) <= bound)


@EXAMPLES
@given(u=commands, rate=st.floats(1, 1e4))
def test_the_rate_limit_is_kept_and_used(u: list[float], rate: float) -> None:
    """From rest on; the output goes as far as it may towards the command."""
    output, change = behind(u, rate_limit=rate), rate * H
    before = np.append(0.0, output[:-1])
    # A sum of two numbers is rounded once.
    rounding = EPS * (np.abs(output) + np.abs(before) + change)
    steps = np.abs(output - before)
    assert np.all(steps <= change + rounding)
    assert np.all(np.abs(steps - np.minimum(np.abs(u - before), change)) <= rounding)


@EXAMPLES
@given(
    u=commands,
    computer=st.integers(0, 7),
    actuator=st.integers(0, 7),
    stride=st.sampled_from([1, 3]),
)
def test_a_delay_is_exact_in_timesteps(
    u: list[float], computer: int, actuator: int, stride: int
) -> None:
    loop = Loop(Computing(delay=computer * H), actuators=(Actuator(CURRENT, delay=actuator * H),))
    run = played(u, loop, stride=stride)
    np.testing.assert_array_equal(run.command, np.repeat(u, stride))
    late = np.append(np.zeros(computer + actuator), run.command)[: len(run.command)]
    np.testing.assert_array_equal(run.input, late)


def test_a_delay_is_mujoco_s_own() -> None:
    """MuJoCo's attribute ``delay`` of an actuator; by Euler, whose step asks for the input once."""
    u, steps = np.random.default_rng(1).normal(size=60), 7
    plant = MujocoPlant.load("servo", integrator="Euler")
    law = in_loop(scripted(u), Loop(actuators=(Actuator(CURRENT, delay=steps * H),)), SERVO)
    ours = simulate(plant, law, [0.3, -0.2], duration=len(u) * H, engine="python")
    spec: Any = plant.spec.copy()
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.actuators[0].delay, spec.actuators[0].nsample = steps * H, steps
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = 0.3, -0.2
    theirs = [(0.3, -0.2)]
    for command in u:
        data.ctrl[0] = command
        mujoco.mj_step(model, data)
        theirs.append((data.qpos[0], data.qvel[0]))
    np.testing.assert_array_equal(ours.state, theirs)
    assert np.ptp(ours.state[:, 1]) > 0


# --- lags ---

U = np.random.default_rng(2).uniform(-3, 3, 200)


def at_the_ends(lag: float, order: int) -> Array:
    """The lag's output at the end of each timestep."""
    actuators = (Actuator(CURRENT, lag=lag, order=order),)
    law = in_loop(scripted(U), Loop(actuators=actuators), SERVO)
    loop = applied(law).begin_uncompiled(law, law.memory(), np.zeros(2), np.zeros(2))
    ends = []
    for i, u in enumerate(U):
        send([u], loop)
        actuate(i, loop, np.zeros(1))
        ends.append((loop.actuators[0].first, loop.actuators[0].second)[order - 1])
    return np.array(ends)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("lag", [2e-4, 2.3e-3, 2e-2])
def test_lags_are_the_exact_discretization_and_their_output_is_its_mean(
    lag: float, order: int
) -> None:
    """The integral is a state more, whose rate is the lag's output."""
    A = np.array([[-1.0, 0.0], [1.0, -1.0]])[:order, :order] / lag
    B = np.array([[1.0], [0.0]])[:order] / lag
    discrete: Any = scipy.signal.cont2discrete((A, B, np.eye(order), np.zeros((order, 1))), H)
    with_integral = np.zeros((order + 2, order + 2))
    with_integral[:order, :order], with_integral[:order, -1:] = A, B
    with_integral[order, order - 1] = 1.0
    transition, x, ends, means = scipy.linalg.expm(with_integral * H), np.zeros(order), [], []
    for u in U:
        means.append((transition @ [*x, 0.0, u])[order] / H)
        x = discrete[0] @ x + discrete[1][:, 0] * u
        ends.append(x[-1])
    # Two ways to compute it differ by some roundings a timestep, which fade away.
    bound = 16 * EPS * 3 * (1 / -math.expm1(-H / lag)) ** order
    np.testing.assert_allclose(at_the_ends(lag, order), ends, rtol=0, atol=bound)
    # The mean is u less lag / H times the gain of the output.
    output = behind(U, lag=lag, order=order)
    np.testing.assert_allclose(output, means, rtol=0, atol=bound * (1 + 2 * lag / H))
