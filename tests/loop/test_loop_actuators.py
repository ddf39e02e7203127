"""What actuators may never do, whatever they are asked for; delays are exact."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from looped import CURRENT, H, behind, played, scripted

from grosmc_mj.loop import Actuator, Computing, Loop, in_loop
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import SERVO
from grosmc_mj.simulation.simulate import simulate

EPS = np.finfo(float).eps
asked = st.lists(st.floats(-5, 5), min_size=1, max_size=30)
EXAMPLES = settings(max_examples=40)


@EXAMPLES
@given(u=asked, limit=st.floats(0.01, 6))
def test_the_limit_cuts_and_does_no_more(u: list[float], limit: float) -> None:
    np.testing.assert_array_equal(behind(u, limit=limit), np.clip(u, -limit, limit))


@EXAMPLES
@given(u=asked, rate=st.floats(1, 1e4))
def test_the_rate_limit_is_kept_and_used(u: list[float], rate: float) -> None:
    """From rest on; what comes out goes as far as it may towards what is asked for."""
    found, change = behind(u, rate_limit=rate), rate * H
    before = np.concatenate([[0.0], found[:-1]])
    # A sum of two numbers is rounded once.
    rounding = EPS * (np.abs(found) + np.abs(before) + change)
    assert np.all(np.abs(found - before) <= change + rounding)
    missing = np.abs(u - before)
    np.testing.assert_array_less(
        np.abs(np.abs(found - before) - np.minimum(missing, change)), rounding + 1e-300
    )


@EXAMPLES
@given(u=asked, dead=st.floats(0.01, 6))
def test_the_dead_zone_gives_what_is_beyond_it(u: list[float], dead: float) -> None:
    wanted = [v - dead if v > dead else v + dead if v < -dead else 0.0 for v in u]
    np.testing.assert_array_equal(behind(u, dead_zone=dead), wanted)


@EXAMPLES
@given(u=asked, q=st.floats(1e-3, 2))
def test_the_resolution_gives_the_nearest_multiple(u: list[float], q: float) -> None:
    found = behind(u, resolution=q)
    np.testing.assert_array_equal(found, q * np.round(found / q))
    assert np.all(np.abs(found - u) <= 0.5 * q * (1 + 2 * EPS) + 2 * EPS * np.abs(u))


@EXAMPLES
@given(
    u=asked,
    limit=st.floats(0.1, 6),
    rate=st.floats(10, 1e4),
    lag=st.floats(1e-4, 1e-2),
    order=st.sampled_from([1, 2]),
    dead=st.floats(0, 0.5),
    delay=st.integers(0, 5),
)
def test_all_of_it_together_keeps_limit_and_rate(
    u: list[float], limit: float, rate: float, lag: float, order: int, dead: float, delay: int
) -> None:
    """A lag's output is a mean of its input; its integral is a difference of numbers times lag."""
    found = behind(
        u, limit=limit, rate_limit=rate, lag=lag, order=order, dead_zone=dead, delay=delay * H,
        resolution=0.01,
    )  # fmt: skip
    rounding = 16 * EPS * limit * (1 + lag / H)
    assert np.all(np.abs(found) <= limit + rounding)
    assert np.all(np.abs(np.diff(found, prepend=0.0)) <= rate * H + 2 * rounding)


@EXAMPLES
@given(
    u=asked, computer=st.integers(0, 7), actuator=st.integers(0, 7), stride=st.sampled_from([1, 3])
)
def test_a_delay_is_exact_in_timesteps(
    u: list[float], computer: int, actuator: int, stride: int
) -> None:
    loop = Loop(Computing(delay=computer * H), actuators=(Actuator(CURRENT, delay=actuator * H),))
    run, dead = played(u, loop, stride=stride), computer + actuator
    np.testing.assert_array_equal(run.command, np.repeat(u, stride))
    late = np.concatenate([np.zeros(dead), run.command])[: len(run.command)]
    np.testing.assert_array_equal(run.input, late)


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_a_delay_is_mujoco_s_own(steps: int) -> None:
    """MuJoCo's attribute ``delay`` of an actuator; by Euler, whose step asks for the input once."""
    u = np.random.default_rng(1).normal(size=60)
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
    for each in u:
        data.ctrl[0] = each
        mujoco.mj_step(model, data)
        theirs.append((data.qpos[0], data.qvel[0]))
    np.testing.assert_array_equal(ours.state, theirs)
    assert np.ptp(ours.state[:, 1]) > 0
