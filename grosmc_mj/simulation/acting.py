"""Inputs as they act: of a motor the torque at its joint, not what its amplifier is asked for.

A motor gives the demanded torque at rest and cold only: back-EMF, a warm winding, a limit of its
current and cogging come between.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Annotated, Any, NamedTuple

import mujoco
import numpy as np
from numba import types

from grosmc_mj.ground.arrays import Array, as_rows
from grosmc_mj.ground.compilation.compiler import compile_c
from grosmc_mj.ground.compilation.structures import Vector, pointer, structure_at, structure_of
from grosmc_mj.mechanics.machine.motor import Motor
from grosmc_mj.simulation.guard import c_address, guard
from grosmc_mj.simulation.kernel import READ, STEP
from grosmc_mj.simulation.trajectory import Trajectory
from grosmc_mj.theory.plants import Plant

_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


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
    ideal = plant.rigid.model
    places = [model.actuator(motor.input).id for motor in motors]
    scales = [motor.input_of_force(ideal) for motor in motors]

    forces = _forces(model, physics, disturbed)
    acting = given.copy()
    acting[:, places] = forces[:, places] * scales
    return acting


class _ForceRun(NamedTuple):
    """A model that is put into one state after the other: addresses of functions and memory.

    Attributes:
        write: MuJoCo's ``mj_setState``: (model, data, address, kind of state).
        position: MuJoCo's ``mj_fwdPosition``: (model, data).
        velocity: MuJoCo's ``mj_fwdVelocity``.
        actuation: MuJoCo's ``mj_fwdActuation``.
        model: mjModel.
        data: mjData.
        states: The N states, one after the other.
        width: Bytes of a state.
        inputs: Inputs, (N, m).
        forces: Forces of the k actuators, (N, k), which are written.
        ctrl: Inputs of the data, (m,).
        force: Forces of its actuators, (k,): friction of a drive is one without an input.
    """

    write: Annotated[Any, types.FunctionType(READ)]
    position: Annotated[Any, types.FunctionType(STEP)]
    velocity: Annotated[Any, types.FunctionType(STEP)]
    actuation: Annotated[Any, types.FunctionType(STEP)]
    model: Annotated[Any, types.int64]
    data: Annotated[Any, types.int64]
    states: Annotated[Any, types.int64]
    width: Annotated[Any, types.int64]
    inputs: Annotated[Array, types.Array(types.float64, 2, "C")]
    forces: Annotated[Array, types.Array(types.float64, 2, "C")]
    ctrl: Vector
    force: Vector


_run_at = structure_at(_ForceRun)


@cache
def _compiled_forces() -> Any:
    """Compile the computation of all forces to a C function of a ``_ForceRun``, see ``Guard``."""

    def entry(_model: int, _data: int, _number: int, run: int) -> None:
        r = _run_at(pointer(run))
        for i in range(len(r.inputs)):
            r.write(r.model, r.data, r.states + i * r.width, _STATE)
            for k in range(len(r.ctrl)):
                r.ctrl[k] = r.inputs[i, k]
            r.position(r.model, r.data)
            r.velocity(r.model, r.data)
            r.actuation(r.model, r.data)
            for k in range(len(r.force)):
                r.forces[i, k] = r.force[k]

    return compile_c(entry, types.int64, types.int64, types.int64, types.int64)


def _forces(model: mujoco.MjModel, physics: Array, inputs: Array) -> Array:
    """Return the forces of a model's k actuators in some states, (N, k).

    Args:
        model: The model.
        physics: States as MuJoCo has them, (N, size).
        inputs: Inputs, (N, m).
    """
    data = mujoco.MjData(model)
    states = np.ascontiguousarray(physics)
    run = _ForceRun(
        write=c_address("mj_setState"),
        position=c_address("mj_fwdPosition"),
        velocity=c_address("mj_fwdVelocity"),
        actuation=c_address("mj_fwdActuation"),
        model=model._address,
        data=data._address,
        states=states.ctypes.data,
        width=states.strides[0],
        inputs=np.ascontiguousarray(inputs),
        forces=np.zeros((len(inputs), len(data.actuator_force))),
        ctrl=data.ctrl,
        force=data.actuator_force,
    )
    structure = structure_of(run)
    with guard() as thread_guard:
        thread_guard.call(_compiled_forces().address, structure.ctypes.data)
    return run.forces
