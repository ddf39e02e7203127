"""States that no law sees: coordinates of motors, currents, bristles, heat.

mjSTATE_FULLPHYSICS is [time, qpos, qvel, act, ...]; the system's own joints come first in qpos and
qvel, and those that parts of a machine add come after them.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.edit import Edit, HiddenState
from grosmc_mj.theory.plants import System


def motor_joint(joint: str) -> str:
    """Name of the coordinate, and of the body, of a motor behind a transmission."""
    return f"{joint} motor"


def hidden_states(
    model: mujoco.MjModel, system: System, edits: Sequence[Edit]
) -> tuple[HiddenState, ...]:
    """List the hidden states of a model, in the order of mjSTATE_FULLPHYSICS.

    Args:
        model: Compiled, with the edits.
        system: Its states are not hidden.
        edits: They name the states that are theirs.
    """
    states: list[HiddenState] = []
    for joint in range(system.degrees_of_freedom, model.njnt):
        state = HiddenState(model.joint(joint).name, _unit(model, joint), "load", 1 + joint)
        states.append(state)
    # Without nu, for an actuator that has no input is not counted there.
    for actuator in range(len(model.actuator_actadr)):
        states += _actuator_states(model, actuator)

    for edit in edits:
        states = [edit.hidden(state, model) for state in states]
    return tuple(states)


def _actuator_states(model: mujoco.MjModel, actuator: int) -> list[HiddenState]:
    """Activations of an actuator as hidden states."""
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, actuator)
    first_column = 1 + model.nq + model.nv + int(model.actuator_actadr[actuator])
    units = {"temperature": "K", "bristle": _unit(model, model.actuator_trnid[actuator, 0])}
    return [
        HiddenState(f"{name} {kind}", units.get(kind, "1"), kind, column)
        for column, kind in enumerate(_activations(model, actuator), start=first_column)
    ]


def _activations(model: mujoco.MjModel, actuator: int) -> list[str]:
    """Kinds of an actuator's activations; those of a motor in MuJoCo's order."""
    dynamics = mujoco.mjtDyn(int(model.actuator_dyntype[actuator]))
    numbers = model.actuator_dynprm[actuator]
    kinds: list[str] = []
    if dynamics in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT):
        kinds.append("lag")
    if dynamics == mujoco.mjtDyn.mjDYN_DCMOTOR:
        if numbers[2] > 0:
            kinds.append("temperature")
        if numbers[5] > 0:
            kinds.append("bristle")
        if numbers[0] > 0:
            kinds.append("current")

    # Activations of other kinds have numbers for names.
    count = int(model.actuator_actnum[actuator])
    if len(kinds) != count:
        return [f"activation {i + 1}" for i in range(count)]
    return kinds


def _unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a joint's coordinate."""
    slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
    return "m" if slides else "rad"


def starts(model: mujoco.MjModel, system: System, x0: Array) -> tuple[Array, Array]:
    """Compute qpos and qvel of simulations that start in states of the system.

    Motors begin with their joints, without twist.

    Args:
        model: Compiled.
        system: Its degrees of freedom come first.
        x0: States, (nsim, n).

    Returns:
        (nsim, nq) and (nsim, nv).
    """
    n = system.degrees_of_freedom
    qpos = np.tile(model.qpos0, (len(x0), 1))
    qvel = np.zeros((len(x0), model.nv))
    qpos[:, :n] = x0[:, :n]
    qvel[:, :n] = x0[:, n:]

    driven_joints = {motor_joint(joint): index for index, joint in enumerate(system.joints)}
    for joint in range(n, model.njnt):
        driven = driven_joints.get(model.joint(joint).name)
        if driven is not None:
            qpos[:, joint] = x0[:, driven]
            qvel[:, joint] = x0[:, n + driven]
    return qpos, qvel
