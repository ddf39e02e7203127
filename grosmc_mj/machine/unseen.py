"""What of a machine no law sees: coordinates of motors and loads, currents, bristles, heat.

mjSTATE_FULLPHYSICS is [time, qpos, qvel, act, ...]; the system's own joints come first in qpos and
qvel, and what parts of a machine add comes after them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.machine.motors import amperes
from grosmc_mj.machine.names import motor_joint
from grosmc_mj.machine.parts import MachinePart, Motor, Transmission
from grosmc_mj.plants import System


@dataclass(frozen=True)
class UnseenState:
    """One number of a machine that laws do not see.

    Attributes:
        name: Such as ``shaft motor``.
        unit: Of it.
        kind: ``twist``, ``load``, ``winding``, ``temperature``, ``bristle``, or what else MuJoCo's
            actuators remember.
        column: Where it stands in mjSTATE_FULLPHYSICS.
        scale: Factor from there to the unit.
        minus: The column that is taken off, for a motor's twist against its joint.
        play: Within which a twist meets no spring, the whole of it; 0 for all others.
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


def starts(model: mujoco.MjModel, system: System, x0: Array) -> tuple[Array, Array]:
    """qpos and qvel of simulations that start in states of the system.

    Motors begin with their joints, without twist; what swings hangs at rest, what slides rests.

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
    for extra in range(n, model.njnt):
        name = model.joint(extra).name
        for index, joint in enumerate(system.joints):
            if name == motor_joint(joint):
                qpos[:, extra], qvel[:, extra] = x0[:, index], x0[:, n + index]
        if model.body(model.jnt_bodyid[extra]).name.rstrip("0123456789").endswith(" swing"):
            qpos[:, extra] = [_hanging(model, extra, row) for row in qpos]
    return qpos, qvel


def _hanging(model: mujoco.MjModel, joint: int, qpos: Array) -> float:
    """The angle at which what hangs on a hinge is straight below it."""
    data, body = mujoco.MjData(model), int(model.jnt_bodyid[joint])
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    axis, arm = data.xaxis[joint], data.xipos[body] - data.xanchor[joint]
    down = model.opt.gravity - (model.opt.gravity @ axis) * axis
    return float(qpos[joint] + np.arctan2(axis @ np.cross(arm, down), arm @ down))


def unseen_states(
    model: mujoco.MjModel, system: System, parts: Sequence[MachinePart]
) -> tuple[UnseenState, ...]:
    """All of them, in the order of mjSTATE_FULLPHYSICS.

    Args:
        model: Compiled.
        system: Whose states laws do see.
        parts: Of the machine.
    """
    n, found = system.degrees_of_freedom, []
    plays = {part.joint: part.backlash for part in parts if isinstance(part, Transmission)}
    for extra in range(n, model.njnt):
        name = model.joint(extra).name
        of = [i for i, joint in enumerate(system.joints) if name == motor_joint(joint)]
        unit, column = _unit(model, extra), 1 + extra
        if of:
            joint = system.joints[of[0]]
            minus, play = 1 + of[0], plays.get(joint, 0.0)
            found.append(
                UnseenState(f"{joint} twist", unit, "twist", column, minus=minus, play=play)
            )
        else:
            found.append(UnseenState(name, unit, "load", column))
    first = 1 + model.nq + model.nv
    motors = {part.input: part for part in parts if isinstance(part, Motor)}
    for i in range(len(model.actuator_actnum)):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, i)
        for column, kind in enumerate(_kinds(model, i), first + int(model.actuator_actadr[i])):
            if kind == "current" and name in motors:
                scale = amperes(motors[name], model, i)
                found.append(UnseenState(f"{name} winding", "A", "winding", column, scale))
                continue
            unit = {"temperature": "K"}.get(kind, "1")
            if kind == "bristle":
                unit = _unit(model, int(model.actuator_trnid[i, 0]))
            found.append(UnseenState(f"{name} {kind}", unit, kind, column))
    return tuple(found)


def _unit(model: mujoco.MjModel, joint: int) -> str:
    """Of a joint's coordinate."""
    return "m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"


def _kinds(model: mujoco.MjModel, index: int) -> list[str]:
    """What the activations of an actuator are: of a motor in MuJoCo's order."""
    kind, found = mujoco.mjtDyn(int(model.actuator_dyntype[index])), list[str]()
    if kind in (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT):
        found = ["lag"]
    if kind == mujoco.mjtDyn.mjDYN_DCMOTOR:
        numbers = model.actuator_dynprm[index]
        present = (("temperature", numbers[2]), ("bristle", numbers[5]), ("current", numbers[0]))
        found = [name for name, number in present if number > 0]
    count = int(model.actuator_actnum[index])
    return found if len(found) == count else [f"activation {i + 1}" for i in range(count)]
