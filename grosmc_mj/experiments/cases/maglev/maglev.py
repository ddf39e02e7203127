"""A steel ball below an electromagnet that a voltage drives."""

import sympy as sp

from grosmc_mj import affine_plant


def plant():
    """States gap y below the magnet, its rate and the coil's current; the ball falls for y > 0.

    The magnet pulls with C (i/y)^2 and the coil has i' = (V - R i)/L.
    """
    gap, rate, current = sp.symbols("gap rate current")
    m, g, C, R, L = sp.symbols("m g C R L")
    return affine_plant(
        "maglev",
        states={"gap": "m", "rate": "m/s", "current": "A"},
        inputs={"voltage": "V"},
        f=[rate, g - C * current**2 / (m * gap**2), -R * current / L],
        g=[0, 0, 1 / L],
        h=[gap],
        parameters={"m": 0.05, "g": 9.81, "C": 1e-4, "R": 2.0, "L": 0.02},
        region=sp.And(gap > 0, current > 0),
        where="gap and current positive",
        # Without current nothing holds the ball: look where there is one.
        near={"gap": 0.01, "current": 0.5},
    )
