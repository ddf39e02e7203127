"""Inertias of bodies in an editable model."""

from __future__ import annotations

import mujoco
import numpy as np


def write_inertia(body: mujoco.MjsBody, mass: float, like: mujoco.MjModel, index: int) -> None:
    """Give a body the inertia of a compiled one, explicit from now on, with another mass."""
    body.explicitinertial = True
    body.mass = mass
    body.inertia, body.ipos = like.body_inertia[index], like.body_ipos[index]
    body.iquat, body.fullinertia = like.body_iquat[index], np.full(6, np.nan)
