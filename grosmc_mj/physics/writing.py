"""What edits and parts of a machine write alike into an editable model."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from grosmc_mj.arrays import Array

# Added parts are drawn in a colour of their own, with the density of stone [kg/m^3].
COLOUR = (0.85, 0.33, 0.1, 1.0)
_DENSITY = 2500.0


def write_inertia(body: mujoco.MjsBody, mass: float, like: mujoco.MjModel, index: int) -> None:
    """Give a body the inertia of a compiled one, explicit from now on, with another mass."""
    body.explicitinertial = True
    body.mass = mass
    body.inertia, body.ipos = like.body_inertia[index], like.body_ipos[index]
    body.iquat, body.fullinertia = like.body_iquat[index], np.full(6, np.nan)


def linear(coefficient: float, like: Any) -> Array:
    """A spring's or damper's polynomial in MuJoCo that has a linear coefficient only.

    Args:
        coefficient: Of a deflection or a speed.
        like: What stands there, for its size.
    """
    return coefficient * np.eye(np.size(like))[0]


def drawn(body: mujoco.MjsBody, kind: mujoco.mjtGeom, size: list[float], **place: Any) -> None:
    """Draw a geom that neither weighs nor touches."""
    body.add_geom(type=kind, size=size, rgba=COLOUR, contype=0, conaffinity=0, mass=0, **place)


def ball_radius(mass: float) -> float:
    """Radius of the ball that a point mass [kg] is drawn as [m]."""
    return float((3 * mass / (4 * math.pi * _DENSITY)) ** (1 / 3))


def draw_ball(body: mujoco.MjsBody, mass: float, **place: Any) -> None:
    """Draw a point mass [kg]."""
    drawn(body, mujoco.mjtGeom.mjGEOM_SPHERE, [ball_radius(mass), 0.0, 0.0], **place)
