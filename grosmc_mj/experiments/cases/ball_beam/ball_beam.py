"""A ball that rolls on a beam whose angular acceleration is the input, and what laws make of it.

Feedback linearization is not possible next to rest: the input appears in y''' with the factor
2 B r w, which vanishes where the beam stands still. Without the centrifugal term B r w^2 it
appears in y'''' with -B g cos(theta), which is Hauser, Sastry and Kokotovic's approximation
(IEEE Transactions on Automatic Control 37, 1992).
"""

import sympy as sp

from grosmc_mj import affine_plant


def plant():
    """The ball and the beam."""
    return _ball_and_beam("ball_beam", centrifugal=1)


def approximation():
    """Plant without the centrifugal term: of relative degree four."""
    return _ball_and_beam("ball_beam_approximated", centrifugal=0)


def _ball_and_beam(name, centrifugal):
    """x = [position, speed, angle, turn rate]; B = 5/7 of a solid ball that rolls."""
    r, speed, angle, turn = sp.symbols("position speed angle turn")
    B, g = sp.symbols("B g")
    acceleration = B * (centrifugal * r * turn**2 - g * sp.sin(angle))
    return affine_plant(
        name,
        states={"position": "m", "speed": "m/s", "angle": "rad", "turn": "rad/s"},
        inputs={"acceleration": "rad/s^2"},
        f=[speed, acceleration, turn, 0],
        g=[0, 0, 0, 1],
        h=[r],
        parameters={"B": 5 / 7, "g": 9.81},
        region=sp.And(-sp.pi / 2 < angle, angle < sp.pi / 2),
        where="the beam less than upright",
    )
