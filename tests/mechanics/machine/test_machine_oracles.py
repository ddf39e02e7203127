"""Parts of a machine against closed forms: textbooks' frequencies, curves and energies."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest
from machined import HEAVY, J, servo, stepped

from grosmc_mj.mechanics.machine import LuGre, Stop, Transmission, Wall
from grosmc_mj.mechanics.machine.bounces import restitution_of
from grosmc_mj.mechanics.machine.part import Oscillation
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

# Transmissions. The motor's inertia, and the stiffness and damping of the twist.

J_M = 0.01
STIFFNESS = 500.0
DAMPING = 0.2


def elastic_servo(backlash: float) -> MujocoPlant:
    return servo(Transmission("shaft", J_M, STIFFNESS, DAMPING, backlash))


def twist(data: mujoco.MjData) -> float:
    return data.qpos[1] - data.qpos[0]


def twist_rate(data: mujoco.MjData) -> float:
    return data.qvel[1] - data.qvel[0]


def twist_after(plant: MujocoPlant, steps: int) -> float:
    """Twist [rad] after steps of 0.1 ms that begin with a rate of 1 rad/s."""
    data = mujoco.MjData(plant.model)
    data.qvel[1] = 1.0
    mujoco.mj_step(plant.model, data, nstep=steps)
    return twist(data)


def test_a_twist_is_a_damped_oscillation() -> None:
    """twist'' = -(k twist + d twist')(1/J + 1/J_m)."""
    t = 0.05
    stiff = STIFFNESS * (1 / J + 1 / J_M)
    damped = DAMPING * (1 / J + 1 / J_M)
    omega = math.sqrt(stiff - damped**2 / 4)
    expected = math.exp(-damped / 2 * t) * math.sin(omega * t) / omega
    assert twist_after(elastic_servo(0.0), 500) == pytest.approx(expected, rel=1e-6)


def test_a_twist_is_damped_within_the_backlash() -> None:
    """twist'' = -d twist' (1/J + 1/J_m)."""
    t = 0.05
    damped = DAMPING * (1 / J + 1 / J_M)
    expected = (1 - math.exp(-damped * t)) / damped
    assert twist_after(elastic_servo(0.2), 500) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("angle", "torque"), [(0.3, -100.0), (-0.3, 100.0), (0.05, 0.0)])
def test_a_transmission_pulls_by_its_stiffness_beyond_its_backlash(
    angle: float, torque: float
) -> None:
    model = elastic_servo(0.2).model
    data = mujoco.MjData(model)
    data.qpos[1] = angle
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[:2] == pytest.approx([-torque, torque], abs=1e-9)


RIGID_TEETH = Transmission("shaft", inertia=0.01, backlash=0.2)


def test_rigid_teeth_do_not_pull_within_their_play() -> None:
    twists = stepped(servo(RIGID_TEETH), 0.2, twist, start=0.05)
    assert np.ptp(twists) == 0


@pytest.mark.parametrize(("restitution", "duration"), [(0.1, 4e-3), (0.5, 2e-3), (0.3, 4e-3)])
def test_rigid_teeth_give_back_their_restitution(restitution: float, duration: float) -> None:
    teeth = Transmission(
        "shaft", inertia=0.01, backlash=0.2, restitution=restitution, duration=duration
    )
    plant = servo(teeth)
    data = mujoco.MjData(plant.model)
    data.qvel[1] = 1.0
    # The teeth meet after 0.1 s; a bounce of 4 ms is one of 40 timesteps.
    mujoco.mj_step(plant.model, data, nstep=1100)
    assert twist_rate(data) == pytest.approx(-restitution, rel=0.05)
    assert 0.09 < twist(data) < 0.1


# Timesteps

EULER = mujoco.mjtIntegrator.mjINT_EULER
RK4 = mujoco.mjtIntegrator.mjINT_RK4


@pytest.mark.parametrize(
    ("square", "damping", "integrator", "longest"),
    [
        (25.0, 0.0, EULER, 2 / 5),
        (0.0, 5.0, EULER, 2 / 5),
        (25.0, 0.0, RK4, 2 * math.sqrt(2) / 5),
        # The root of 1 - z + z^2/2 - z^3/6 + z^4/24 = 1.
        (0.0, 5.0, RK4, 2.785293563405282 / 5),
    ],
)
def test_the_longest_stable_timestep_is_the_textbooks(
    square: float, damping: float, integrator: mujoco.mjtIntegrator, longest: float
) -> None:
    """At the ends of the regions of stability of semi-implicit Euler and of RK4."""
    oscillation = Oscillation(square, damping)
    assert oscillation.longest_timestep(1.5, integrator) == pytest.approx(longest, rel=1e-5)


# Friction and bounces


@pytest.mark.parametrize("v", [0.01, -0.05])
def test_lugre_has_its_force_at_a_held_speed(v: float) -> None:
    """z = g/s0 (1 - e), F = s0 z + s1 v e with e = exp(-s0 |v| t/g); of a step (0.01)^3 is lost."""
    part = LuGre("shaft", coulomb=0.1, static=0.15, stiffness=200.0, damping=0.5, stribeck=0.01)
    plant = servo(HEAVY, part)
    rows = stepped(plant, 0.2, lambda d: (d.time, d.qfrc_actuator[0]), speed=v, held=True)
    t, force = rows.T

    g = 0.1 + 0.05 * math.exp(-((v / 0.01) ** 2))
    e = np.exp(-200.0 * abs(v) * t / g)
    expected = -math.copysign(g, v) * (1 - e) - 0.5 * v * e
    np.testing.assert_allclose(force, expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("restitution", [0.05, 0.6])
def test_a_stop_gives_back_its_restitution(restitution: float) -> None:
    plant = servo(Stop("shaft", -1.0, 0.5, restitution=restitution))
    speeds = stepped(plant, 1.0, lambda d: d.qvel[0], speed=1.0)
    assert -speeds[-1] == pytest.approx(restitution, rel=0.02)


def test_restitution_falls_with_the_damping_ratio() -> None:
    ratios = (0.0, 0.1, 0.5, 0.999999, 1.0, 1.000001, 2.0, 5.0)
    restitutions = [restitution_of(ratio) for ratio in ratios]
    assert restitutions[0] == 1.0
    assert np.all(np.diff(restitutions) < 0)


@pytest.mark.parametrize("ratio", [0.999999, 1.000001])
def test_restitution_is_continuous_at_critical_damping(ratio: float) -> None:
    assert restitution_of(ratio) == pytest.approx(math.exp(-2), rel=1e-5)


def test_a_wall_gives_back_its_restitution() -> None:
    """1 m above the hinge of a pole, which turns as well: the speed of the ball counts."""
    part = Wall("pole", 0.02, at=(0, 0, 1), point=(0.5, 0, 0), normal=(-1, 0, 0), restitution=0.5)
    model = MujocoPlant.load("cart_pendulum", edits=(part,), timestep=1e-4).model
    model.opt.gravity[:] = 0
    ball = model.geom("bumper 1").id
    data = mujoco.MjData(model)
    data.qvel[0] = 1.0

    touched = False
    before = 0.0
    while not touched or data.ncon > 0:
        before = data.geom_xpos[ball, 0]
        mujoco.mj_step(model, data)
        touched = touched or data.ncon > 0
        assert data.time < 1
    assert (data.geom_xpos[ball, 0] - before) / 1e-4 == pytest.approx(-0.5, rel=0.02)
    hinge = data.body("pole").xpos
    assert data.geom_xpos[ball] - [0.48, *hinge[1:]] == pytest.approx([0, 0, 1], abs=5e-3)
    assert abs(data.qvel[1]) > 0.1
