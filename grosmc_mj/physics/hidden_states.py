"""States that no law sees: coordinates of motors and loads, currents, bristles, heat.

mjSTATE_FULLPHYSICS is [time, qpos, qvel, act, ...]; the system's own joints come first in qpos and
qvel, and those that parts of a machine add come after them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.physics.edits import Edit
from grosmc_mj.plants import System


@dataclass(frozen=True)
class HiddenState:
    """A number of a machine that laws do not see.

    Attributes:
        name: Such as ``shaft twist``.
        unit: Of it.
        kind: ``twist``, ``load``, ``winding``, ``temperature``, ``bristle``, or another memory of
            MuJoCo's actuators.
        column: Where it stands in mjSTATE_FULLPHYSICS.
        scale: Factor from there to the unit.
        minus: The column that is taken off, for a motor's twist against its joint.
        play: The whole range within which a twist meets no spring; 0 for all others.
    """

    name: str
    unit: str
    kind: str
    column: int
    scale: float = 1.0
    minus: int | None = None
    play: float = 0.0

    def of(self, physics: Array) -> Array:
        """Its values in rows of mjSTATE_FULLPHYSICS, (..., size) to (...)."""
        value = physics[..., self.column]
        return self.scale * (value if self.minus is None else value - physics[..., self.minus])


def motor_joint(joint: str) -> str:
    """Name of the coordinate, and of the body, of a motor behind a transmission."""
    return f"{joint} motor"


def hidden_states(
    model: mujoco.MjModel, system: System, edits: Sequence[Edit]
) -> tuple[HiddenState, ...]:
    """All of them, in the order of mjSTATE_FULLPHYSICS.

    Args:
        model: Compiled, with the edits.
        system: Whose states laws do see.
        edits: They name the states that are theirs.
    """
    added = range(system.degrees_of_freedom, model.njnt)
    states = [HiddenState(model.joint(i).name, _unit(model, i), "load", 1 + i) for i in added]
    for i, first in enumerate(1 + model.nq + model.nv + model.actuator_actadr.astype(int)):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
        units = {"temperature": "K", "bristle": _unit(model, model.actuator_trnid[i, 0])}
        states += [
            HiddenState(f"{name} {kind}", units.get(kind, "1"), kind, int(first) + offset)
            for offset, kind in enumerate(_activations(model, i))
        ]
    for edit in edits:
        states = [edit.hidden(state, model) for state in states]
    return tuple(states)


def _activations(model: mujoco.MjModel, index: int) -> list[str]:
    """The kinds of an actuator's activations: of a motor in MuJoCo's order."""
    dynamics, numbers = (
        mujoco.mjtDyn(int(model.actuator_dyntype[index])),
        model.actuator_dynprm[index],
    )
    motor = dynamics == mujoco.mjtDyn.mjDYN_DCMOTOR
    present = {
        "lag": dynamics in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT),
        "temperature": motor and numbers[2] > 0,
        "bristle": motor and numbers[5] > 0,
        "current": motor and numbers[0] > 0,
    }
    kinds, count = (
        [kind for kind, is_there in present.items() if is_there],
        model.actuator_actnum[index],
    )
    return kinds if len(kinds) == count else [f"activation {i + 1}" for i in range(count)]


def _unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a joint's coordinate."""
    return "m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"


def starts(model: mujoco.MjModel, system: System, x0: Array) -> tuple[Array, Array]:
    """qpos and qvel of simulations that start in states of the system.

    Motors begin with their joints, without twist; loads that swing hang at rest, those that slide
    rest.

    Args:
        model: Compiled.
        system: Whose states they are.
        x0: (nsim, n).

    Returns:
        (nsim, nq) and (nsim, nv).
    """
    n = system.degrees_of_freedom
    qpos = np.tile(model.qpos0, (len(x0), 1))
    qvel = np.zeros((len(x0), model.nv))
    qpos[:, :n], qvel[:, :n] = x0[:, :n], x0[:, n:]
    driven = {motor_joint(joint): index for index, joint in enumerate(system.joints)}
    for joint in range(n, model.njnt):
        if (index := driven.get(model.joint(joint).name)) is not None:
            qpos[:, joint], qvel[:, joint] = x0[:, index], x0[:, n + index]
        elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
            qpos[:, joint] = [_hanging(model, joint, row) for row in qpos]
    return qpos, qvel


def _hanging(model: mujoco.MjModel, joint: int, qpos: Array) -> float:
    """The angle at which a body on a hinge hangs straight below it [rad]."""
    data, body = mujoco.MjData(model), int(model.jnt_bodyid[joint])
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    axis, arm = data.xaxis[joint], data.xipos[body] - data.xanchor[joint]
    down = model.opt.gravity - (model.opt.gravity @ axis) * axis
    return float(qpos[joint] + np.arctan2(axis @ np.cross(arm, down), arm @ down))
