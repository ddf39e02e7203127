"""Files of a user's own, beside a case: a pendulum and its laws in Python, and a leg in MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cases import case

from grosmc_mj.experiments.experiment import Experiment

PYTHON = """
import math
import numpy as np
import sympy as sp
import grosmc_mj as gm
q, w = sp.symbols("q w")
m = sp.Symbol("m")
def pendulum():
    return gm.affine_plant("pendulum", states={"q": "rad", "w": "rad/s"}, inputs={"u": "N m"},
        f=[w, -m * sp.sin(q)], g=[0, 1], h=[q], parameters={"m": 2.0})
def law(t, x, memory, p):
    return p.plant.m * math.sin(x[0]) - p.a * x[0] - p.b * x[1]
def made(plant, epsilon=5.0):
    error = gm.control.ErrorCoordinates(plant.system, gm.control.setpoints(2))
    task = gm.Task(plant, error, gm.control.Setpoint(0.0), Q=np.eye(2), R=1.0)
    return gm.tracking_grosmc(task, k=5.0, epsilon=epsilon)
pair = (gm.control.reference([sp.sin(gm.control.TIME)]), gm.control.Setpoint())
wrong = 3
"""
# The pendulum under its law, with 1.5 times the m that the law knows.
OWN: dict[str, Any] = {
    "run": {"start": {"q": "10 deg"}, "duration": "0.2 s", "engine": "python"},
    "edit": {"parameter": "m", "scale": 1.5},
    "task": {"Q": [1, 1], "R": 1},
    "controller": {"law": "own:law", "a": 4, "b": 4},
}

# A robot of two joints.
LEG = """
<mujoco model="leg">
  <option timestep="0.001" integrator="RK4"><flag contact="disable"/></option>
  <worldbody><body name="thigh" pos="0 0 1">
    <joint name="hip" axis="0 -1 0" damping="0.1"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
    <body name="shank" pos="0.4 0 0"><joint name="knee" axis="0 -1 0"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/></body>
  </body></worldbody>
  <actuator><motor name="hip" joint="hip" gear="10"/>
    <position name="knee" joint="knee" kp="50"/></actuator>
</mujoco>
"""


def pendulum(folder: Path, python: str = PYTHON, **tables: Any) -> Experiment:
    """Return a case of the pendulum, with tables in place of those of ``OWN``."""
    (folder / "own.py").write_text(python, encoding="utf-8")
    return case("own:pendulum", folder=folder, **(OWN | tables))
