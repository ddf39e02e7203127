"""Parts of a machine against closed forms: textbooks' frequencies, curves and energies."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from machined import HEAVY, J, servo, stepped

from grosmc_mj.machine import LuGre, Stop, SwingingLoad, Transmission, Wall
from grosmc_mj.machine.bounces import restitution_of
from grosmc_mj.machine.part import Oscillation
from grosmc_mj.physics.hidden_states import starts
from grosmc_mj.physics.mujoco_plant import MujocoPlant


def test_a_transmission_pulls_by_its_stiffness_beyond_its_backlash_and_damps_the_twist() -> None:
    """twist'' = -(k twist + d twist')(1/J + 1/J_m); within the backlash there is no k."""
    motor, k, d, t = 0.01, 500.0, 0.2, 0.05
    stiff, damped = (number * (1 / J + 1 / motor) for number in (k, d))
    omega = math.sqrt(stiff - damped**2 / 4)
    free = (1 - math.exp(-damped * t)) / damped
    swinging = math.exp(-damped / 2 * t) * math.sin(omega * t) / omega
    for backlash, twist in ((0.0, swinging), (0.2, free)):
        part = Transmission("shaft", inertia=motor, stiffness=k, damping=d, backlash=backlash)
        plant = servo(part)
        data = mujoco.MjData(plant.model)
        data.qvel[1] = 1.0
        mujoco.mj_step(plant.model, data, nstep=500)
        assert data.qpos[1] - data.qpos[0] == pytest.approx(twist, rel=1e-6)
    for twist, torque in ((0.3, -100.0), (-0.3, 100.0), (0.05, 0.0)):
        data.qpos[:], data.qvel[:] = (0.0, twist), 0.0
        mujoco.mj_forward(plant.model, data)
        assert data.qfrc_passive[:2] == pytest.approx([-torque, torque], abs=1e-9)


def test_rigid_teeth_give_back_a_tenth_beyond_their_play() -> None:
    plant = servo(Transmission("shaft", inertia=0.01, backlash=0.2))
    twist = stepped(plant, 0.2, lambda d: d.qpos[1] - d.qpos[0], start=0.05)
    assert np.ptp(twist) == 0  # within the play nothing pulls
    data = mujoco.MjData(plant.model)
    data.qvel[1] = 1.0
    mujoco.mj_step(plant.model, data, nstep=1100)
    # A bounce of 4 ms is one of 40 timesteps.
    assert data.qvel[1] - data.qvel[0] == pytest.approx(-0.1, rel=0.05)
    assert 0.09 < data.qpos[1] - data.qpos[0] < 0.1


def test_the_longest_stable_timesteps_are_the_textbooks() -> None:
    """Of semi-implicit Euler and of RK4, at the ends of their regions of stability."""
    euler, rk4 = mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4
    for square, damping, integrator, longest in (
        (25.0, 0.0, euler, 2 / 5),
        (0.0, 5.0, euler, 2 / 5),
        (25.0, 0.0, rk4, 2 * math.sqrt(2) / 5),
        # Where 1 - z + z^2/2 - z^3/6 + z^4/24 = 1.
        (0.0, 5.0, rk4, 2.785293563405282 / 5),
    ):
        oscillation = Oscillation(square, damping)
        assert oscillation.longest_timestep(1.5, integrator) == pytest.approx(longest, rel=1e-5)


def test_lugre_has_its_force_at_a_held_speed() -> None:
    """z = g/s0 (1 - e), F = s0 z + s1 v e with e = exp(-s0 |v| t/g); of a step (0.01)^3 is lost."""
    part = LuGre("shaft", coulomb=0.1, static=0.15, stiffness=200.0, damping=0.5, stribeck=0.01)
    for v in (0.01, -0.05):
        rows = stepped(
            servo(HEAVY, part), 0.2, lambda d: (d.time, d.qfrc_actuator[0]), speed=v, held=True
        )
        t, force = rows.T
        g = 0.1 + 0.05 * math.exp(-((v / 0.01) ** 2))
        e = np.exp(-200.0 * abs(v) * t / g)
        expected = -math.copysign(g, v) * (1 - e) - 0.5 * v * e
        np.testing.assert_allclose(force, expected, rtol=0, atol=1e-7)


def test_a_stop_gives_back_its_restitution() -> None:
    for e in (0.05, 0.6):
        plant = servo(Stop("shaft", -1.0, 0.5, restitution=e))
        assert -stepped(plant, 1.0, lambda d: d.qvel[0], speed=1.0)[-1] == pytest.approx(
            e, rel=0.02
        )
    ratios = (0.0, 0.1, 0.5, 0.999999, 1.0, 1.000001, 2.0, 5.0)
    found = [restitution_of(ratio) for ratio in ratios]
    assert found[0] == 1.0
    assert np.all(np.diff(found) < 0)
    assert found[3:6:2] == pytest.approx([math.exp(-2)] * 2, rel=1e-5)


def test_a_wall_gives_back_its_restitution() -> None:
    part = Wall("pole", 0.02, at=(0, 0, 1), point=(0.5, 0, 0), normal=(-1, 0, 0), restitution=0.5)
    model = MujocoPlant.load("cart_pendulum", edits=(part,), timestep=1e-4).model
    model.opt.gravity[:] = 0
    data, ball = mujoco.MjData(model), model.geom("bumper 1").id
    data.qvel[0], touched, before = 1.0, False, 0.0
    while not (touched and data.ncon == 0):
        before = data.geom_xpos[ball, 0]
        mujoco.mj_step(model, data)
        touched = touched or data.ncon > 0
        assert data.time < 1
    # The pole turns as well: what counts is the ball's own speed.
    assert (data.geom_xpos[ball, 0] - before) / 1e-4 == pytest.approx(-0.5, rel=0.02)
    assert abs(data.qvel[1]) > 0.1


def test_a_swinging_load_begins_below_its_hinge() -> None:
    load = SwingingLoad("link", 1e-6, 0.3, at=(0.5, 0, 0))
    plant = MujocoPlant.load("arm", edits=(load,), timestep=1e-4)
    q, v = starts(plant.model, plant.system, np.array([[0.4, 0.0]]))
    model, data = plant.model, mujoco.MjData(plant.model)
    data.qpos[:], data.qvel[:] = q[0], v[0]
    mujoco.mj_kinematics(model, data)
    below = data.xipos[model.body("link swing").id] - data.xanchor[model.joint("link swing").id]
    assert below == pytest.approx([0.0, 0.0, -0.3], abs=1e-12)
