"""Sensors, computer and actuators: against their description, SciPy and MuJoCo."""

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
from grosmc_mj.loop.counter import normal, uniform
from grosmc_mj.loop.delay import send
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate

EPS = np.finfo(float).eps
late = st.integers(0, 9).map(lambda steps: steps * H)
size = st.floats(1e-4, 6)


def rounded(value: float, q: float) -> float:
    return q * math.floor(value / q + 0.5) if q else value


@settings(max_examples=60)
@given(
    sensor=st.fixed_dictionaries(
        {"resolution": st.just(0.0) | size, "scale": size, "noise": st.floats(0, 0.3),
         "bias": st.floats(-1, 1), "drift": st.floats(-9, 9), "delay": late, "period": late}
    ),
    computing=st.fixed_dictionaries({"delay": late, "missed": st.floats(0, 0.95)}),
    jitter=st.integers(0, 6),
    actuator=st.fixed_dictionaries(
        {"delay": late, "resolution": st.just(0.0) | size, "limit": size,
         "rate_limit": st.floats(1, 1e4), "dead_zone": st.just(0.0) | st.floats(0.01, 1)}
    ),
    u=st.lists(st.floats(-5, 5), min_size=1, max_size=20),
    stride=st.sampled_from([1, 3, 7]),
    seed=st.integers(0, 2**53 - 1),
    number=st.sampled_from([0, 1, 2**40]),
)  # fmt: skip
def test_a_loop_is_its_description_sample_by_sample(
    sensor: Any, computing: Any, jitter: int, actuator: Any, u: Any, stride: int, seed: int,
    number: int,
) -> None:  # fmt: skip
    """Exactly, from the true states and the script: each random number is that of its sample."""
    jitter = min(jitter, stride - 1)
    loop = Loop(
        Computing(jitter=jitter * H, **computing),
        (Sensor(ANGLE, **sensor), Sensor(SPEED, noise=0.7)),
        actuators=(Actuator(CURRENT, **actuator),),
        seed=seed,
    )
    run = played(u, loop, x0=(0.4, 3.0), stride=stride, run=number)
    steps, states = len(run.command), len(SERVO.states)
    taken = [
        k * stride + (k > 0) * math.floor(uniform(seed, number, states, k) * (jitter + 1))
        for k in range(len(u))
    ]
    outputs, output = [], 0.0
    for k, demand in enumerate(u):
        if uniform(seed, number, states + 1, k) >= computing["missed"]:
            output = demand
        outputs.append(output)
    sampled = np.searchsorted(taken, np.arange(steps), side="right") - 1
    np.testing.assert_array_equal(run.command, np.array(u)[sampled])

    # The sensor's own samples are at multiples of its period; before them is the start.
    delay, period = round(sensor["delay"] / H), round(sensor["period"] / H)
    for i, k in enumerate(sampled.tolist()):
        at = max(taken[k] - delay, 0)
        at -= at % period if period else 0
        noise = sensor["noise"] * normal(seed, number, 0, at) if sensor["noise"] else 0.0
        offset = sensor["bias"] + sensor["drift"] * (at * H)
        angle = sensor["scale"] * run.state[at, 0] + offset + noise
        speed = run.state[taken[k], 1] + 0.7 * normal(seed, number, 1, taken[k])
        assert seen(run)[i].tolist() == [rounded(angle, sensor["resolution"]), speed]

    # A sum of two numbers is rounded once in the rate limit.
    behind = round(computing["delay"] / H) + round(actuator["delay"] / H)
    limit, dead, rated = actuator["limit"], actuator["dead_zone"], 0.0
    for i in range(steps):
        demand = outputs[sampled[i - behind]] if i >= behind else 0.0
        demand = np.clip(rounded(demand, actuator["resolution"]), -limit, limit)
        change = actuator["rate_limit"] * H
        rated += np.clip(demand - rated, -change, change)
        given_out = math.copysign(max(abs(rated) - dead, 0.0), rated)
        assert run.input[i] == pytest.approx(given_out, rel=0, abs=100 * EPS * 6)


def test_beyond_2_52_multiples_a_reading_is_as_it_is() -> None:
    run = played(np.zeros(3), Loop(sensors=(Sensor(ANGLE, 1e-9),)), x0=(1e8 + 0.3, 0.0))
    np.testing.assert_array_equal(seen(run)[:, 0], 1e8 + 0.3)


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
