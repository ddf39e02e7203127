"""Both engines give the same bits, whatever is run: a plant, a law, an integrator, a loop."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import numpy as np
import pytest

from grosmc_mj.control.controller import Controller
from grosmc_mj.control.design import linearized_lqr, tracking_grosmc
from grosmc_mj.control.references import FourierSeries, fourier_series
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.loop import Actuator, Computing, Estimator, Loop, Sensor, in_loop
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import Plant
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance, SineFrom
from grosmc_mj.simulation.simulate import simulate

H, PERIOD, STEPS = 1e-3, 2e-3, 50
CRANE = """<mujoco model="crane"><option timestep="0.001"/><worldbody>
<body name="mast"><joint name="turn" axis="0 0 1" damping="0.3" armature="0.2"/>
<geom type="box" size="0.1 0.2 0.05" mass="2" pos="0.05 0 0"/>
<body name="boom" pos="0.2 0 0" euler="0 10 20"><joint name="lift" axis="0 -1 0" stiffness="3"/>
<geom type="capsule" fromto="0.1 0 0 0.5 0 0.1" size="0.03" mass="1.5"/></body></body></worldbody>
<actuator><motor joint="turn"/><motor joint="lift"/></actuator></mujoco>"""
SYSTEMS = ("servo", "cart_pendulum", "arm", "two_link_arm", "crane")
INTEGRATORS = ("equations", "Euler", "implicit", "implicitfast", "RK4")
# A robot has no equations.
PLANTS = [
    pair for pair in itertools.product(SYSTEMS, INTEGRATORS) if pair != ("crane", "equations")
]


@cache
def robot() -> Robot:
    return Robot.from_mjcf(CRANE)


@cache
def plant_of(system: str, integrator: Any) -> Plant:
    if system == "crane":
        return Robot.from_mjcf(CRANE, integrator=integrator).plant
    if integrator == "equations":
        return MujocoPlant.load(system).analytic()
    return MujocoPlant.load(system, timestep=H, integrator=integrator)


@cache
def law_of(system: str, law: str) -> Controller:
    if system != "crane":
        return Experiment.load(f"{system}/nominal").law("corrected", law)
    sine = np.array([[0.3], [0.2]])
    series = FourierSeries(2.0, np.array([0.1, 0.2]), np.zeros((2, 1)), sine)
    Q = np.kron(np.eye(2), np.diag([100.0, 0.0]))
    task = robot().task(fourier_series(2, 1), series, Q, np.eye(2))
    return linearized_lqr(task, "lqr") if law == "lqr" else tracking_grosmc(task, 5.0, 2.0)


def looped(law: Controller, plant: Plant) -> Controller:
    """A law that predicts, in a loop where every part does something."""
    n = len(plant.system.states) // 2
    positions, rates = plant.system.states[:n], plant.system.states[n:]
    loop = Loop(
        Computing(delay=2 * H, jitter=H, missed=0.05),
        tuple(Sensor(x.name, 1e-5, noise=1e-5, bias=1e-5, delay=H) for x in positions),
        (Estimator(tuple(x.name for x in rates), "eso", bandwidth=150.0),),
        tuple(
            Actuator(u.name, H, 1e-3, limit=60.0, rate_limit=1e4, lag=1.5e-3, dead_zone=1e-3)
            for u in plant.system.inputs
        ),
        seed=1,
    )
    periods: dict[str, Any] = {"control_period": PERIOD, "timestep": H}
    return in_loop(law, loop, plant.system, predict=True, **periods)


@pytest.mark.slow
@pytest.mark.parametrize("loop", ["ideal", "loop"])
@pytest.mark.parametrize("law", ["lqr", "grosmc"])
@pytest.mark.parametrize(("system", "integrator"), PLANTS)
def test_both_engines_agree_in_every_bit(system: str, integrator: str, law: str, loop: str) -> None:
    """Both take their functions from one libm, in one order of operations."""
    plant, bare = plant_of(system, integrator), law_of(system, law)
    start = 0.1 * (1.0 + np.arange(len(plant.system.states)))
    push = Disturbance(plant.system.bodies[-1], (0.3, 0, -0.2, 0, 0.1, 0), SineFrom(20.0, 0.01))
    native, python = (
        simulate(
            plant,
            bare if loop == "ideal" else looped(bare, plant),
            start,
            duration=STEPS * H,
            control_period=PERIOD,
            timestep=H,
            disturbances=[push],
            engine=engine,
        )
        for engine in ("native", "python")
    )
    assert len(native.time) == STEPS + 1
    assert np.all(np.ptp(native.state, axis=0) > 0)
    for field in ("state", "command", "input", "sliding", "seen", "wrench", "physics"):
        np.testing.assert_array_equal(getattr(native, field), getattr(python, field), err_msg=field)
