"""Plants without what is only drawn: the same motion for a fraction of the time and memory."""

from __future__ import annotations

from dataclasses import replace

import mujoco

from grosmc_mj.simulation.mujoco_plant import MujocoPlant


def undrawn(plant: MujocoPlant) -> MujocoPlant:
    """The same plant without geoms, materials, textures, meshes, cameras and lights.

    What has a part in the motion stays: geoms that can touch or that a fluid pushes, and what a
    sensor, a tendon or a contact pair names. A body whose inertia came from its geoms keeps every
    bit of it; a model that MuJoCo cannot part from its geoms, such as one with ``inertiafromgeom``,
    stays as it is.
    """
    spec = plant.spec.copy()
    if spec.option.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 0
    try:
        spec.discard_visual()
    except ValueError:
        return plant
    named = {name for each in spec.sensors for name in (each.objname, each.refname)}
    for part in (*spec.cameras, *spec.lights):
        if part.name not in named:
            spec.delete(part)
    return replace(plant, spec=spec)
