"""Dry friction: it holds a joint, it stops and lets go as in an exact integration."""

from __future__ import annotations

import math
from functools import cache
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
from grosmc_mj.theory.plants import SERVO

FRICTION = 0.3
# 4,096 counts a turn.
ENCODER_STEP = 2 * math.pi / 4096


def dry_servo(friction: float, timestep: float, integrator: Any) -> MujocoPlant:
    """The servo with dry friction in place of its damping."""
    edit = JointEdit("shaft", damping=0.0, friction=friction)
    return MujocoPlant.load("servo", edits=(edit,), timestep=timestep, integrator=integrator)


def angle(data: mujoco.MjData) -> float:
    return data.qpos[0]


@pytest.mark.parametrize(("integrator", "timestep"), [("implicitfast", 4e-3), ("RK4", 1e-3)])
def test_dry_friction_holds_a_joint_under_half_of_it(integrator: Any, timestep: float) -> None:
    plant = dry_servo(FRICTION, timestep, integrator)
    angles = stepped(plant, 2.0, angle, u=FRICTION / 2 / GEAR)
    assert np.abs(angles).max() < ENCODER_STEP / 50


def test_dry_friction_holds_a_joint_of_a_model_whose_time_constants_are_taken_as_they_are() -> None:
    spec = MujocoPlant.load("servo", timestep=TIMESTEP).spec.copy()
    spec.option.timestep = TIMESTEP
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    edit = JointEdit("shaft", damping=0.0, friction=FRICTION)
    plant = MujocoPlant(SERVO, spec, (edit,), integrator="RK4")
    angles = stepped(plant, 2.0, angle, u=FRICTION / 2 / GEAR)
    assert np.abs(angles).max() < ENCODER_STEP / 50


def test_dry_friction_holds_a_motor_behind_its_transmission() -> None:
    """The joint is held through the twist, here of 1 mrad."""
    part = Transmission("shaft", 0.01, stiffness=150.0, damping=1.0, friction=FRICTION)
    plant = servo(part, timestep=1e-3)
    motor = stepped(plant, 2.0, lambda data: data.qpos[1], u=FRICTION / 2 / GEAR)
    assert np.abs(motor).max() < ENCODER_STEP / 50


TIMESTEP = 1e-3


def torque_at(t: float) -> float:
    """Torque [N m] that is within the friction at first and at each reversal."""
    return 0.5 * math.sin(2 * math.pi * t)


@cache
def exact_angles() -> Array:
    """Angles of the servo with dry friction in 2 s, by steps of 10 us.

    A joint at rest stays while the torque is within the friction; its speed ends where it changes
    its sign.
    """
    h = 1e-5
    every = round(TIMESTEP / h)
    x = 0.0
    v = 0.0
    angles = []
    for step in range(round(2.0 / h)):
        # The torque is held over a timestep of the plant.
        torque = torque_at(step // every * TIMESTEP)
        direction = math.copysign(1.0, v) if v else math.copysign(1.0, torque)
        if v or abs(torque) > FRICTION:
            rate = v + h * (torque - direction * FRICTION) / J
            v = rate if rate * direction > 0 else 0.0
        x += h * v
        if (step + 1) % every == 0:
            angles.append(x)
    return np.array(angles)


@pytest.mark.parametrize(
    ("integrator", "share"),
    # RK4 looks at a reversal in the middle of a step, too.
    [("implicitfast", 2e-3), ("RK4", 4e-3)],
)
def test_a_joint_with_dry_friction_reverses_as_in_an_exact_integration(
    integrator: Any, share: float
) -> None:
    plant = dry_servo(FRICTION, TIMESTEP, integrator)
    angles = stepped(plant, 2.0, angle, u=lambda t: torque_at(t) / GEAR)
    assert np.abs(angles - exact_angles()).max() < share * np.ptp(exact_angles())


def test_a_joint_without_dry_friction_keeps_its_constraint() -> None:
    model = dry_servo(0.0, 1e-3, "RK4").model
    assert model.dof_solref[0] == pytest.approx([0.02, 1.0])


# Models of somebody else

RIGID = 'solreffriction="1e-9 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'


def foreign(joint: str = "", option: str = "", friction: float = 0.5) -> mujoco.MjModel:
    """A hinge with dry friction."""
    return mujoco.MjModel.from_xml_string(f"""
      <mujoco><option timestep="0.001" {option}/><worldbody><body>
      <joint name="hinge" frictionloss="{friction}" {joint}/>
      <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody></mujoco>""")


@pytest.mark.parametrize("joint", ["", 'solreffriction="-100 -100"', 'solreffriction="0.1 1"'])
def test_a_joint_creeps_by_the_way_that_its_constraint_tells(joint: str) -> None:
    """In 10 s, under half of its friction."""
    model = foreign(joint)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 0.25
    mujoco.mj_step(model, data, nstep=10_000)
    assert creeping_joints(model) == {"hinge": pytest.approx(data.qpos[0], rel=0.02)}


@pytest.mark.parametrize(
    "model", [foreign(RIGID), foreign(option='noslip_iterations="5"'), foreign(friction=0)]
)
def test_a_joint_whose_friction_holds_does_not_creep(model: mujoco.MjModel) -> None:
    assert creeping_joints(model) == {}
