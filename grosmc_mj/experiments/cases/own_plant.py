"""A plant, a controller and a law of one's own: change them."""

import math

import numpy as np
import sympy as sp

import grosmc_mj as gm

# A pendulum driven by a torque, with viscous friction: J q'' = u - b q' - M sin q.
q, w = sp.symbols("q w")
J, b, M = sp.symbols("J b M")


def my_plant():
    """x' = f(x) + g(x) u with output h(x), and a number for every other symbol."""
    return gm.affine_plant(
        "driven pendulum",
        states={"q": "rad", "w": "rad/s"},
        inputs={"torque": "N m"},
        f=[w, (-b * w - M * sp.sin(q)) / J],
        g=[0, 1 / J],
        h=[q],
        parameters={"J": 0.02, "b": 0.01, "M": 0.5},
    )


def my_controller(plant, k=10.0, epsilon=40.0):
    """A controller designed for the nominal plant; its numbers are keys of the file."""
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    task = gm.Task(plant, error, gm.control.Setpoint(0.5), Q=np.diag([100.0, 1.0]), R=1.0)
    return gm.tracking_grosmc(task, k=k, epsilon=epsilon)


def my_law(t, x, memory, p):
    """A law of one's own: the input from time [s], state, memory and numbers.

    p.plant has the nominal parameters, p.stiffness and p.damping come from the file. Plain Python
    that numba compiles; with engine = "python" in the file's [run] anything goes.
    """
    q, w = x[0], x[1]
    return p.plant.M * math.sin(q) - p.stiffness * (q - 0.5) - p.damping * w
