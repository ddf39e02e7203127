"""Dry friction that holds, and the creep of dry friction that does not.

MuJoCo's ``frictionloss`` is a soft constraint: a joint under a steady force u that is less than its
friction creeps, at

    v = (1 - d)/d  w u / b,    b = 2/(d_max T),

with the impedance d, the time constant T of ``solref`` and the inverse inertia w of the joint. With
MuJoCo's defaults, d = 0.9 and T = 20 ms, that is 1 mm/s for each m/s^2 that u gives the free joint.
"""

from __future__ import annotations

import math

import mujoco

# ``solimp`` with MuJoCo's largest impedance at every depth: a constraint moves as its spring and
# damper say.
STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2.0)
# MuJoCo takes two timesteps for any shorter time constant: a joint stops within two of them.
_TIME_CONSTANT = 1e-9

# Dry friction creeps if a joint under half of it moves by more than this [rad] or [m] ...
_CREEP = 1e-3
# ... in so many seconds.
_HELD_FOR = 10.0


def set_dry_friction(spec: mujoco.MjSpec, joint: mujoco.MjsJoint, friction: float) -> None:
    """Give a joint dry friction as rigid as MuJoCo has it.

    At a timestep h it creeps by 1e-4 h w u: by 25 urad in 10 s where the defaults move by 0.26 rad.
    MuJoCo's ``noslip_iterations`` stop that too, but soften each reversal, and cost time.

    Args:
        spec: Model of the joint.
        joint: The joint.
        friction: Dry friction [N m] or [N]; without any the joint stays as it is.
    """
    joint.frictionloss = friction
    if friction == 0:
        return
    time_constant = _TIME_CONSTANT
    if spec.option.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
        time_constant = 2 * spec.option.timestep
    joint.solimp_friction = STIFFEST
    joint.solref_friction = (time_constant, 1.0)


def creeping_joints(model: mujoco.MjModel) -> dict[str, float]:
    """Return the joints whose dry friction creeps, with their motion under half of it.

    Args:
        model: Compiled model.

    Returns:
        Distance in 10 s [rad] or [m], by the names of the joints.
    """
    if model.opt.noslip_iterations:
        return {}

    distances: dict[str, float] = {}
    for dof in range(model.nv):
        friction = float(model.dof_frictionloss[dof])
        if friction == 0:
            continue
        distance = _HELD_FOR * _creep_speed(model, dof, friction / 2)
        if distance > _CREEP:
            name = model.joint(int(model.dof_jntid[dof])).name
            distances[name] = max(distance, distances.get(name, 0.0))
    return distances


def _creep_speed(model: mujoco.MjModel, dof: int, force: float) -> float:
    """Speed at which a joint creeps under a force [N m] or [N] that its friction should hold."""
    softness, damping = constraint_of(model, dof)
    if damping <= 0:
        return math.inf
    return softness * force / damping


def constraint_of(model: mujoco.MjModel, dof: int) -> tuple[float, float]:
    """Numbers of the soft constraint that is dry friction.

    Below its limit the friction is -(a + damping v)/softness at an acceleration a and a speed v.

    Args:
        model: Compiled model.
        dof: Degree of freedom.

    Returns:
        Softness (1 - d)/d w [1/(kg m^2) or 1/kg] and damping b [1/s], see the module.
    """
    least, largest = model.dof_solimp[dof, :2]
    time_constant, damping_ratio = model.dof_solref[dof]
    if time_constant > 0:
        if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
            time_constant = max(time_constant, 2 * model.opt.timestep)
        damping = 2 / (largest * time_constant)
    else:
        # A negative solref gives stiffness and damping themselves.
        damping = -damping_ratio / largest

    softness = (1 - least) / least * float(model.dof_invweight0[dof])
    return softness, float(damping)
