"""Inputs as they act: of a motor the torque at its joint, not what its amplifier is asked for.

A motor gives the demanded torque at rest and cold only: back-EMF, a warm winding, a limit of its
current and cogging come between.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco

from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.plants import Plant

_FULL_PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


def motors_of(plant: Plant) -> list[Motor]:
    """Return the motors of a plant that is a machine as built."""
    parts = getattr(plant, "parts", ())
    return [part for part in parts if isinstance(part, Motor)]


def with_acting(run: Trajectory, plant: Plant) -> Trajectory:
    """Return one run with its inputs as they act; the run itself on a plant without motors.

    Args:
        run: The run, of this plant in MuJoCo.
        plant: The plant.
    """
    motors = motors_of(plant)
    if not motors or run.physics is None:
        return run
    given = as_rows(run.input)
    disturbed = given
    if run.input_disturbance is not None:
        disturbed = given + as_rows(run.input_disturbance)

    acting = _acting(plant, motors, run.physics, given, disturbed)
    return replace(run, acting=acting.reshape(run.input.shape))


def _acting(
    plant: Any, motors: list[Motor], physics: Array, given: Array, disturbed: Array
) -> Array:
    """Return the inputs at each instant, (N, m), in their units.

    The force of MuJoCo's motor is computed from the state and the input at the instant, as a
    timestep from there on does.
    """
    model = plant.model
    data = mujoco.MjData(model)
    ideal = plant.rigid.model
    places = [model.actuator(motor.input).id for motor in motors]
    scales = [motor.input_of_force(ideal) for motor in motors]

    acting = given.copy()
    for i, u in enumerate(disturbed):
        mujoco.mj_setState(model, data, physics[i], _FULL_PHYSICS)
        data.ctrl[:] = u
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        for place, scale in zip(places, scales, strict=True):
            acting[i, place] = scale * data.actuator_force[place]
    return acting
