"""The timestep that a fast pole needs under RK4, and the advice where a run has it too long."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq

import grosmc_mj as gm
from grosmc_mj.ground.errors import DivergenceError
from grosmc_mj.ground.units import number_in
from grosmc_mj.simulation.stability import fastest_damped_pole, longest_timestep, written_timestep
from grosmc_mj.theory.control.kinds.pid import Pid

PERIOD = 1e-3


def growth(z: complex) -> float:
    return abs(sum(z**k / math.factorial(k) for k in range(5)))


def test_the_bound_of_a_real_pole_is_that_of_rk4() -> None:
    bound: Any = brentq(lambda h: growth(-h) - 1, 2.0, 3.0)
    assert longest_timestep(complex(-40.0)) == pytest.approx(bound / 40, rel=1e-3)


@pytest.mark.parametrize("pole", [-1 + 1j, -0.1 + 1j, -0.01 - 1j, complex(-1.5e6)])
def test_a_pole_grows_beyond_its_bound_and_not_below(pole: complex) -> None:
    h = longest_timestep(pole)
    assert growth(pole * h) <= 1
    assert growth(pole * 1.001 * h) > 1


@pytest.mark.parametrize(
    ("longest", "period", "written"),
    [
        (1.92e-6, 1e-3, "1 us"),
        (7.3e-6, 1e-3, "5 us"),
        (2.5e-3, 1e-2, "2 ms"),
        # No round number divides it.
        (4.0e-4, 7.7e-4, "385 us"),
    ],
)
def test_the_size_divides_the_control_period(longest: float, period: float, written: str) -> None:
    assert written_timestep(longest, period) == written
    timestep = number_in(written, "s")
    assert timestep <= longest
    assert period / timestep == pytest.approx(round(period / timestep))


def lag_under_pi(pole: float, kp: float = 2.0) -> tuple[gm.AnalyticPlant, gm.Controller]:
    """x' = -a (x - q), q' = u: a sensor's lag on an integrator."""
    q, x, a = sp.symbols("q x a")
    plant = gm.affine_plant(
        "lag",
        states={"q": "1", "x": "1"},
        inputs={"u": "1"},
        f=[0 * q, -a * (x - q)],
        g=[1, 0],
        h=[x],
        parameters={"a": pole},
    )
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    task = gm.Task(plant, error, gm.control.Setpoint(1.0), Q=np.eye(2), R=1.0)
    return plant, Pid(kp=kp, ki=0.5).design(task)


@pytest.mark.parametrize("pole", [3e3, 3.3e4, 1e6])
def test_a_run_with_too_long_a_timestep_names_one_that_works(pole: float) -> None:
    plant, law = lag_under_pi(pole)
    timing: Any = {"duration": 0.5, "control_period": PERIOD}
    words = r'a pole at .* 1/s, for which RK4 needs .*: take timestep = "(.*?)" with'
    with pytest.raises(DivergenceError, match=words) as raised:
        gm.simulate(plant, law, [0.0, 0.0], timestep=PERIOD, **timing)

    found = re.search(words, str(raised.value))
    assert found is not None
    timestep = number_in(found[1], "s")
    run = gm.simulate(plant, law, [0.0, 0.0], timestep=timestep, **timing)
    # The lag is gone after a few microseconds: x follows q' = 2 (1 - x) + the integral.
    slow = gm.simulate(*lag_under_pi(1e3), [0.0, 0.0], timestep=1e-4, **timing)
    assert run.state[-1, 1] == pytest.approx(slow.state[-1, 1], rel=5e-3)


def test_the_fastest_damped_pole_is_none_that_grows() -> None:
    """x1' = -3 x1, x2' = -40 x2, x3' = 50 x3."""
    x1, x2, x3 = sp.symbols("x1 x2 x3")
    plant = gm.affine_plant(
        "modes",
        states={"x1": "1", "x2": "1", "x3": "1"},
        inputs={"u": "1"},
        f=[-3 * x1, -40 * x2, 50 * x3],
        g=[0, 0, 1],
        h=[x3],
        parameters={},
    )
    assert fastest_damped_pole(plant, np.zeros(3)) == pytest.approx(-40)


def test_an_unstable_loop_on_a_slow_plant_is_not_put_down_to_its_poles() -> None:
    plant, law = lag_under_pi(10.0, kp=-1e6)
    with pytest.raises(
        DivergenceError, match="the loop is unstable, or its control period or timestep is too long"
    ):
        gm.simulate(plant, law, [0.0, 0.0], duration=1.0, control_period=PERIOD, timestep=PERIOD)
