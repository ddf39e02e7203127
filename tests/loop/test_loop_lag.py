"""The lag of an actuator beside MuJoCo's, SciPy's and the integral."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from looped import CURRENT, H, behind, scripted

from grosmc_mj.arrays import Array
from grosmc_mj.loop import Actuator, Loop, in_loop
from grosmc_mj.loop.actuators import actuate
from grosmc_mj.loop.controllers import loop_of
from grosmc_mj.loop.delay import send
from grosmc_mj.plants import SERVO

EPS = np.finfo(float).eps
U = np.random.default_rng(2).uniform(-3, 3, 200)
LAGS = pytest.mark.parametrize("lag", [2e-4, 1e-3, 2.3e-3, 2e-2])


def at_the_ends(lag: float, order: int) -> Array:
    """The lag's output at the end of each timestep."""
    actuators = (Actuator(CURRENT, lag=lag, order=order),)
    law = in_loop(scripted(U), Loop(actuators=actuators), SERVO)
    loop = loop_of(law).begin_uncompiled(law, law.memory(), np.zeros(2), np.zeros(2))
    ends = []
    for i, u in enumerate(U):
        send([u], loop)
        actuate(i, loop, np.zeros(1))
        ends.append((loop.actuators[0].first, loop.actuators[0].second)[order - 1])
    return np.array(ends)


def rounding(lag: float, order: int) -> float:
    """What two ways to compute it may differ by: some roundings a timestep, which fade away."""
    return 16 * EPS * 3 * (1 / -math.expm1(-H / lag)) ** order


@LAGS
def test_one_lag_is_mujoco_s_exact_filter(lag: float) -> None:
    model = mujoco.MjModel.from_xml_string(f"""
        <mujoco><option timestep="{H}" integrator="Euler"/>
        <worldbody><body><joint name="j" type="slide"/><geom size="0.1"/></body></worldbody>
        <actuator><general joint="j" dyntype="filterexact" dynprm="{lag!r}"/></actuator></mujoco>
    """)
    data, theirs = mujoco.MjData(model), []
    for each in U:
        data.ctrl[0] = each
        mujoco.mj_step(model, data)
        theirs.append(data.act[0])
    np.testing.assert_allclose(at_the_ends(lag, 1), theirs, rtol=0, atol=rounding(lag, 1))


def of_the_plant(lag: float, order: int) -> tuple[Array, Array]:
    """x' = A x + B u of one lag or of two in a row."""
    A = np.array([[-1.0, 0.0], [1.0, -1.0]])[:order, :order] / lag
    return A, np.array([[1.0], [0.0]])[:order] / lag


@pytest.mark.parametrize("order", [1, 2])
@LAGS
def test_lags_are_scipy_s_exact_discretization(lag: float, order: int) -> None:
    A, B = of_the_plant(lag, order)
    found: Any = scipy.signal.cont2discrete((A, B, np.eye(order), np.zeros((order, 1))), H)
    x, theirs = np.zeros(order), []
    for each in U:
        x = found[0] @ x + found[1][:, 0] * each
        theirs.append(x[-1])
    np.testing.assert_allclose(at_the_ends(lag, order), theirs, rtol=0, atol=rounding(lag, order))


@pytest.mark.parametrize("order", [1, 2])
@LAGS
def test_what_comes_out_is_the_mean_of_a_timestep(lag: float, order: int) -> None:
    """The integral is a state more, whose rate is the lag's output."""
    A, B = of_the_plant(lag, order)
    whole = np.zeros((order + 2, order + 2))
    whole[:order, :order], whole[:order, -1:] = A, B
    whole[order, order - 1] = 1.0
    transition, x, theirs = scipy.linalg.expm(whole * H), np.zeros(order), []
    for each in U:
        after = transition @ np.concatenate([x, [0.0, each]])
        x = after[:order]
        theirs.append(after[order] / H)
    # The mean is u less lag / H times what the output has gained.
    bound = rounding(lag, order) * (1 + 2 * lag / H)
    np.testing.assert_allclose(behind(U, lag=lag, order=order), theirs, rtol=0, atol=bound)


@pytest.mark.parametrize("order", [1, 2])
def test_a_lag_that_vanishes_leaves_the_ideal_actuator(order: int) -> None:
    """The mean is off by lag / H times what the output gains: at most 2 max |u| for each lag."""
    for lag in (1e-4, 1e-6, 1e-9, 1e-15):
        off = np.abs(behind(U, lag=lag, order=order) - U).max()
        assert off <= order * lag / H * 6 * (1 + 1e-9) + 8 * EPS
    np.testing.assert_array_equal(behind(U, lag=0.0, order=order), U)


@pytest.mark.parametrize("order", [1, 2])
def test_a_held_input_comes_through_whole(order: int) -> None:
    """The transient of (t/lag)^(order - 1) e^(-t/lag) is below a rounding after 50 lags."""
    found = behind(np.full(100, 2.5), lag=2 * H, order=order)
    assert np.all(np.diff(found[:20]) > 0)
    assert found[-1] == pytest.approx(2.5, rel=8 * EPS)
