"""The path of a robot's tip in a film: where it has been, and dotted where it should be."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np

from grosmc_mj.arrays import Array
from grosmc_mj.films.board import Trace
from grosmc_mj.films.camera import visible_height
from grosmc_mj.films.marks import add_connector, add_dot
from grosmc_mj.report.palette import OPTIMUM, red_green_blue

_NAME = "tip"
# Sizes as parts of the picture's height.
_THICK, _DOT = 0.0035, 0.0045
_APART, _LOOKS = 0.022, 1000
# A longer trail has its older part left out: as many frames.
_TRAIL = 400


def trace_site(model: mujoco.MjModel) -> int:
    """Id of the site whose path a film may draw, named ``tip`` or ``.../tip``; -1 if none is."""
    names = [model.site(index).name.split("/")[-1] for index in range(model.nsite)]
    return names.index(_NAME) if _NAME in names else -1


def site_path(model: mujoco.MjModel, site: int, qpos: Array) -> Array:
    """Where a site is at positions (N, nq); returns (N, 3)."""
    data, path = mujoco.MjData(model), np.empty((len(qpos), 3))
    for row, q in zip(path, qpos, strict=True):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        row[:] = data.site_xpos[site]
    return path


def add_trace(scene: mujoco.MjvScene, trace: Trace, frame: int) -> None:
    """Draw where the site has been up to a frame as a line, and where it should be as dots.

    Args:
        scene: An updated scene.
        trace: The paths.
        frame: The last one that is drawn.
    """
    been, wanted = trace.been[max(0, frame + 1 - _TRAIL) : frame + 1], trace.wanted
    unit = visible_height(scene.camera[0], trace.been[0])
    if wanted is not None:
        for point in _apart(wanted[:: len(wanted) // _LOOKS + 1], _APART * unit):
            add_dot(scene, _DOT * unit, point, (*red_green_blue(OPTIMUM), 1.0))
    paint = (*red_green_blue(trace.colour), 1.0)
    for start, end in itertools.pairwise(been):
        # A capsule without length has no direction.
        if np.any(start != end):
            add_connector(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, _THICK * unit, start, end, paint)


def _apart(path: Array, least: float) -> list[Array]:
    """The points of a path that are this far from all before; its second round adds none."""
    kept = [path[0]]
    for point in path[1:]:
        if np.linalg.norm(np.array(kept) - point, axis=1).min() >= least:
            kept.append(point)
    return kept
