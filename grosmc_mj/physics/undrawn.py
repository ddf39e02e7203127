"""Models that runs compute with: without what is only drawn or can never constrain."""

from __future__ import annotations

import mujoco

_FLAGS = mujoco.mjtDisableBit


def undrawn(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """A copy of the model without geoms, materials, textures, meshes, cameras and lights.

    What has a part in the motion stays: geoms that can touch or that a fluid pushes, and what a
    sensor, a tendon or a contact pair names. A body whose inertia came from its geoms keeps every
    bit of it; a model that MuJoCo cannot part from its geoms, such as one with ``inertiafromgeom``,
    keeps them all.

    Args:
        spec: The model, which stays as it is.
    """
    bare: mujoco.MjSpec = spec.copy()
    if bare.option.disableflags & _FLAGS.mjDSBL_CONTACT:
        for geom in bare.geoms:
            geom.contype = geom.conaffinity = 0
    try:
        bare.discard_visual()
    except ValueError:
        return spec.copy()
    sensed = {name for sensor in bare.sensors for name in (sensor.objname, sensor.refname)}
    for item in (*bare.cameras, *bare.lights):
        if item.name not in sensed:
            bare.delete(item)
    return bare


def can_constrain(model: mujoco.MjModel) -> bool:
    """Whether a constraint can ever act: contact, a limit, dry friction, an equality.

    Where none can, MuJoCo's accelerations are the smooth ones, and with ``mjDSBL_CONSTRAINT`` a
    step has the same bits in nine tenths of the time.
    """
    limits = model.jnt_limited.any() or model.tendon_limited.any()
    friction = model.dof_frictionloss.any() or model.tendon_frictionloss.any()
    if model.neq or model.nflex or limits or friction:
        return True
    touching = model.npair or (model.geom_contype.any() and model.geom_conaffinity.any())
    return bool(touching) and not model.opt.disableflags & _FLAGS.mjDSBL_CONTACT
