"""Models without what is only drawn: what runs compute with."""

from __future__ import annotations

import mujoco


def undrawn(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """The same model without geoms, materials, textures, meshes, cameras and lights.

    What has a part in the motion stays: geoms that can touch or that a fluid pushes, and what a
    sensor, a tendon or a contact pair names. A body whose inertia came from its geoms keeps every
    bit of it; a model that MuJoCo cannot part from its geoms, such as one with ``inertiafromgeom``,
    stays as it is.

    Args:
        spec: The model, which stays as it is.
    """
    bare: mujoco.MjSpec = spec.copy()
    if bare.option.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        for geom in bare.geoms:
            geom.contype = geom.conaffinity = 0
    try:
        bare.discard_visual()
    except ValueError:
        return spec
    named = {name for each in bare.sensors for name in (each.objname, each.refname)}
    for part in (*bare.cameras, *bare.lights):
        if part.name not in named:
            bare.delete(part)
    return bare
