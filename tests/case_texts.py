"""Texts of case files that the tests of experiments share, and the files beside them."""

from __future__ import annotations

from pathlib import Path

from grosmc_mj.experiments.experiment import Experiment

ARM = """
title = "sound"
[plant]
system = "arm"
[run]
start = { "joint angle" = "10 deg" }
duration = "1 s"
[[edit]]
body = "link"
mass_scale = 2
[[disturbance]]
body = "link"
torque = ["0 N m", "0.1 N m", "0 N m"]
profile = "sine"
frequency = "1 Hz"
[[controller]]
law = "grosmc"
k = 18
[[requirement]]
deviation_below = "10 mrad"
"""
# Equations, laws and profiles of one's own, and their file.
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
OWN = """
[plant]
plant = "own:pendulum"
[run]
start = { q = "10 deg" }
duration = "0.2 s"
engine = "python"
[[edit]]
parameter = "m"
scale = 1.5
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "own:law"
a = 4
b = 4
"""
OWN_NATIVE = """
[plant]
plant = "own:pendulum"
[run]
start = { q = "10 deg" }
duration = "0.2 s"
engine = "native"
[[edit]]
parameter = "m"
scale = 1.5
[task]
Q = [1, 1]
R = 1
[[controller]]
law = "own:law"
a = 4
b = 4
"""
# A robot of two joints, and its file.
LEG_MODEL = """
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
LEG = """
[plant]
model = "leg.xml"
[run]
start = { hip = "10 deg" }
duration = "1 s"
[[edit]]
body = "shank"
added_mass = "0.5 kg"
at = ["0.4 m", "0 m", "0 m"]
[[edit]]
joint = "hip"
damping = 0.5
[task]
reference = ["0.3*sin(2*t)", "-1"]
Q = [100, 1, 100, 1]
R = 1
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
k = 5
epsilon = 60
switching = "implicit"
[[controller]]
law = "leg_law:law"
stiffness = 50
[[requirement]]
of = ["grosmc"]
deviation_below = "10 mrad"
"""
LEG_LAW = """
def law(t, x, memory, p):
    return (-p.stiffness * x[0] - x[2], -p.stiffness * (x[1] + 1) - x[3])
"""
# Parts of a machine, below a plant of the package.
PARTS_OF = """
[plant]
system = "{}"
[run]
duration = "20 ms"
control_period = "1 ms"
timestep = "0.25 ms"
[[controller]]
law = "lqr"
"""
SERVO = PARTS_OF.format("servo")
TRANSMISSION = """
[[transmission]]
joint = "shaft"
inertia = "10 g m^2"
"""
PLAY = f'{TRANSMISSION}backlash = "0.3 deg"\n'
LUGRE = """
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
"""
MOTOR = """
[[motor]]
input = "current"
constant = "7.68 mN m/A"
resistance = "2.6 ohm"
"""
# Plants at operating points, and their laws.
POINT = """
[plant]
{}
[run]
duration = "0.01 s"
[task]
Q = {}
R = {}
[[controller]]
law = "{}"
"""
LEVITATED = 'plant = "grosmc_mj.experiments.cases.maglev.maglev:plant"\nat = { gap = "10 mm" }'
MAGLEV = POINT.format(LEVITATED, "[1e8, 1e5, 10]", "1e-3", "lqr")
BALL = "grosmc_mj.experiments.cases.ball_beam.ball_beam"
BEAM = POINT.format(f'plant = "{BALL}:plant"', "[10, 10, 1, 1]", "0.1", "fl-lqr")
FURUTA = POINT.format('model = "furuta.xml"', "[1, 5, 0.02, 0.02]", "100", "grosmc")
# One law with its numbers, which stand at the end.
RIVAL = """
[plant]
system = "arm"
compare = ["physics"]
[run]
duration = "0.1 s"
engine = "python"
[[controller]]
law = "lqi"
"""
# A servo's step of 1 rad in 6 s under two poles with a damping of 0.5.
STEP = """
[plant]
system = "servo"
[run]
duration = "6 s"
control_period = "1 ms"
timestep = "1 ms"
[task]
reference = ["1"]
sign = -1
Q = [1, 1]
R = 1
[[controller]]
law = "pd"
frequency = 3
damping = 0.5
[[requirement]]
"""


def short_run(
    system: str,
    start: str,
    duration: str,
    *,
    law: str = "lqr",
    plant: str = "physics",
    engine: str = "native",
) -> str:
    """Case of one law on one plant; ends with the law's table, so that further keys are its own."""
    return f"""
[plant]
system = "{system}"
compare = ["{plant}"]
[run]
start = {{ {start} }}
duration = "{duration}"
engine = "{engine}"
[[controller]]
law = "{law}"
"""


def short_step(law: str = "lqr", plant: str = "physics") -> str:
    """Twenty milliseconds of the servo, in plain Python."""
    start = '"rotor angle" = "0.1 rad"'
    return short_run("servo", start, "0.02 s", law=law, plant=plant, engine="python")


def written(folder: Path, text: str) -> Path:
    """A case file, beside everything that the texts above name."""
    furuta = Path(Experiment.load("furuta/heavier").path).with_name("furuta.xml")
    beside = {"own.py": PYTHON, "leg.xml": LEG_MODEL, "leg_law.py": LEG_LAW}
    beside["furuta.xml"] = furuta.read_text(encoding="utf-8")
    for name, content in beside.items():
        if not (folder / name).exists():
            (folder / name).write_text(content, encoding="utf-8")
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def load(folder: Path, text: str) -> Experiment:
    return Experiment.load(written(folder, text))
