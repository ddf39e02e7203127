"""Models in which nothing can be constrained: what a step need not look for."""

from __future__ import annotations

import mujoco


def can_constrain(model: mujoco.MjModel) -> bool:
    """Whether a constraint can ever act: contact, a limit, dry friction, an equality.

    Where none can, MuJoCo's accelerations are the smooth ones, and with ``mjDSBL_CONSTRAINT`` a
    step has the same bits in nine tenths of the time.
    """
    flags = mujoco.mjtDisableBit
    if model.neq or model.nflex or model.jnt_limited.any() or model.tendon_limited.any():
        return True
    if model.dof_frictionloss.any() or model.tendon_frictionloss.any():
        return True
    if model.opt.disableflags & flags.mjDSBL_CONTACT:
        return False
    return bool(model.npair or (model.geom_contype.any() and model.geom_conaffinity.any()))
