"""Where plants rest."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import grosmc_mj as gm
from grosmc_mj.errors import ModelError, PremiseError
from grosmc_mj.plants import equilibrium

SPRING = """
<mujoco><worldbody><body name="b"><joint name="j" type="slide" axis="0 0 1" stiffness="100"/>
<geom size="0.1" mass="2"/></body></worldbody>
<actuator><motor name="m" joint="j" ctrllimited="true" ctrlrange="-5 5"/></actuator></mujoco>
"""


def tank(near: float = 1.0) -> gm.AnalyticPlant:
    """h' = u - c sqrt(h): not defined below zero."""
    h, c = sp.symbols("h c")
    return gm.affine_plant("tank", states={"h": "m"}, inputs={"u": "m/s"}, f=[-c * sp.sqrt(h)],
                           g=[1], h=[h], parameters={"c": 0.3}, near={"h": near})  # fmt: skip


def test_the_input_follows_from_a_held_state() -> None:
    point = equilibrium(tank(), {0: 4.0})
    np.testing.assert_allclose(point.u, [0.6], rtol=1e-9)
    assert point.x.tolist() == [4.0]


def test_nothing_moves_where_it_rests_already() -> None:
    plant = gm.MujocoPlant.load("cart_pendulum")
    point = equilibrium(plant, {0: 0.3})
    assert point.x.tolist() == [0.3, 0.0, 0.0, 0.0]
    assert point.u.tolist() == [0.0]


def test_a_load_is_borne_by_the_spring_or_by_the_motor() -> None:
    robot = gm.Robot.from_mjcf(SPRING)
    held = equilibrium(robot.plant, {0: -0.16})
    np.testing.assert_allclose(held.u, [2 * 9.81 - 16.0], rtol=1e-6)
    with pytest.raises(PremiseError, match=r"under inputs cut to \[-5\.0\] ... \[5\.0\]"):
        equilibrium(robot.plant, {0: 0.0})


def test_where_there_is_none_it_says_what_is_left() -> None:
    plant = gm.MujocoPlant.load("cart_pendulum")
    with pytest.raises(PremiseError, match=r"rests nowhere near .* with pole angle = 0\.5"):
        equilibrium(plant, {1: 0.5, 3: 0.0, 2: 0.0})


def test_the_search_begins_where_the_plant_is_used() -> None:
    x = sp.Symbol("x")
    plant = [
        gm.affine_plant(
            "w",
            states={"x": "1"},
            inputs={"u": "1"},
            f=[x**3 - x],
            g=[0 * x],
            h=[x],
            parameters={},
            near={"x": near},
        )
        for near in (0.8, -0.8)
    ]
    assert [round(equilibrium(each).x[0], 6) for each in plant] == [1.0, -1.0]
    with pytest.raises(ModelError, match="near: unknown state 'y'"):
        gm.affine_plant("w", states={"x": "1"}, inputs={"u": "1"}, f=[x], g=[1], h=[x],
                        parameters={}, near={"y": 1.0})  # fmt: skip


def test_an_input_in_the_drift_is_refused_with_what_to_do() -> None:
    x, u = sp.symbols("x u")
    with pytest.raises(ModelError, match=r"u: an input outside of g.*make it a state"):
        gm.affine_plant("w", states={"x": "1"}, inputs={"u": "1"}, f=[x * u**2], g=[1], h=[x],
                        parameters={})  # fmt: skip
