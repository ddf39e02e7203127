"""Dry friction: it holds a joint, it stops and lets go as in an exact integration."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from machined import GEAR, J, servo, stepped

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.machine import Transmission
from grosmc_mj.mechanics.physics.dry_friction import creeping_joints
from grosmc_mj.mechanics.physics.edits import JointEdit
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant

FRICTION = 0.3
# 4,096 counts a turn.
ENCODER_STEP = 2 * math.pi / 4096


def dry_servo(friction: float, timestep: float, integrator: Any) -> MujocoPlant:
    """The servo with dry friction in place of its damping."""
    edit = JointEdit("shaft", damping=0.0, friction=friction)
    return MujocoPlant.load("servo", edits=(edit,), timestep=timestep, integrator=integrator)


def angle(data: mujoco.MjData) -> float:
    return data.qpos[0]


@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
@pytest.mark.parametrize("timestep", [1e-3, 4e-3])
def test_dry_friction_holds_a_joint_under_half_of_it(integrator: Any, timestep: float) -> None:
    plant = dry_servo(FRICTION, timestep, integrator)
    angles = stepped(plant, 10.0, angle, u=FRICTION / 2 / GEAR)
    assert np.abs(angles).max() < ENCODER_STEP / 10


def test_dry_friction_holds_a_motor_behind_its_transmission() -> None:
    """The joint is held through the twist, here of 1 mrad."""
    part = Transmission("shaft", 0.01, stiffness=150.0, damping=1.0, friction=FRICTION)
    plant = servo(part, timestep=1e-3)
    motor = stepped(plant, 10.0, lambda data: data.qpos[1], u=FRICTION / 2 / GEAR)
    assert np.abs(motor).max() < ENCODER_STEP / 10


def exact_angles(amplitude: float, frequency: float, duration: float, timestep: float) -> Array:
    """Angles of the servo with dry friction under a sine of torque, by steps of 5 us.

    A joint at rest stays while the torque is within the friction; its speed ends where it changes
    its sign.
    """
    h = 5e-6
    every = round(timestep / h)
    x = 0.0
    v = 0.0
    angles = [x]
    for step in range(round(duration / h)):
        # The torque is held over a timestep of the plant.
        t = step // every * timestep
        torque = amplitude * math.sin(2 * math.pi * frequency * t)
        direction = math.copysign(1.0, v) if v else math.copysign(1.0, torque)
        if v or abs(torque) > FRICTION:
            rate = v + h * (torque - direction * FRICTION) / J
            v = rate if rate * direction > 0 else 0.0
        x += h * v
        if (step + 1) % every == 0:
            angles.append(x)
    return np.array(angles[1:])


@pytest.mark.parametrize(
    ("integrator", "share"),
    # RK4 looks at a reversal in the middle of a step, too.
    [("implicitfast", 2e-3), ("RK4", 4e-3)],
)
def test_a_joint_with_dry_friction_reverses_as_in_an_exact_integration(
    integrator: Any, share: float
) -> None:
    timestep = 1e-3
    exact = exact_angles(0.5, 1.0, 2.0, timestep)
    plant = dry_servo(FRICTION, timestep, integrator)

    def current(t: float) -> float:
        return 0.5 * math.sin(2 * math.pi * t) / GEAR

    angles = stepped(plant, 2.0, angle, u=current)
    assert np.abs(angles - exact).max() < share * np.ptp(exact)


def test_a_joint_without_dry_friction_keeps_its_constraint() -> None:
    model = dry_servo(0.0, 1e-3, "RK4").model
    assert model.dof_solref[0] == pytest.approx([0.02, 1.0])


# Models of somebody else

HINGE = """
<mujoco><option timestep="0.001" {option}/><worldbody><body>
<joint name="hinge" frictionloss="0.5" {joint}/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>
"""
RIGID = 'solreffriction="1e-9 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'


def foreign(option: str = "", joint: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(HINGE.format(option=option, joint=joint))


@pytest.mark.parametrize("joint", ["", 'solreffriction="-100 -100"', 'solreffriction="0.1 1"'])
def test_a_joint_creeps_by_the_way_that_its_constraint_tells(joint: str) -> None:
    model = foreign(joint=joint)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 0.25
    mujoco.mj_step(model, data, nstep=10_000)
    assert creeping_joints(model) == {"hinge": pytest.approx(data.qpos[0], rel=0.02)}


@pytest.mark.parametrize(
    ("option", "joint"),
    [("", RIGID), ('noslip_iterations="5"', ""), ("", 'frictionloss="0"')],
)
def test_a_joint_whose_friction_holds_does_not_creep(option: str, joint: str) -> None:
    text = HINGE
    if "frictionloss" in joint:
        text = text.replace('frictionloss="0.5" ', "")
    model = mujoco.MjModel.from_xml_string(text.format(option=option, joint=joint))
    assert creeping_joints(model) == {}
