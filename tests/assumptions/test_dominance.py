"""What takes away the dominance of a robot's input gain, and what restores it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.assumptions.robot import robot_audit
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.physics.edits import AddedMass, BodyEdit, JointEdit

MODEL = """
<mujoco model="three"><option timestep="0.001" integrator="RK4"/><compiler angle="radian"/>
<default><geom type="capsule" contype="0" conaffinity="0"/><joint axis="0 1 0"/></default>
<worldbody><body name="a"><joint name="j1"/><geom fromto="0 0 0 0.4 0 0" size="0.03" mass="1"/>
<body name="b" pos="0.4 0 0"><joint name="j2"/><geom fromto="0 0 0 0.3 0 0" size="0.03" mass="0.7"/>
<body name="c" pos="0.3 0 0"><joint name="j3"/><geom fromto="0 0 0 0.2 0 0" size="0.02" mass="0.3"/>
</body></body></body></worldbody>
<actuator><motor name="m1" joint="j1"/><motor name="m2" joint="j2"/><motor name="m3" joint="j3"/>
</actuator></mujoco>
"""
CASE = """
[plant]
model = "three.xml"
[run]
duration = "0.05 s"
[task]
reference = ["0.5", "-0.5", "0.3"]
Q = [100, 20, 100, 20, 100, 20]
R = 1
[[edit]]
body = "c"
mass_scale = {scale}
[[controller]]
law = "grosmc"
k = 5
epsilon = 60
switching = "implicit"
"""


def experiment(folder: Path, scale: float) -> Experiment:
    (folder / "three.xml").write_text(MODEL)
    (folder / "three.toml").write_text(CASE.format(scale=scale))
    return Experiment.load(folder / "three.toml")


def test_the_row_is_named_and_the_payload_that_restores_it(tmp_path: Path) -> None:
    failed = {each.name: each for each in robot_audit(experiment(tmp_path, 4.0).run()).failed()}
    gain, rate = failed["input gain"], failed["epsilon"]
    assert "in the row of j3 0.25 is its own" in gain.note
    assert "most of it j1's" in gain.note
    assert rate.restores == "no ρ, while r is not positive: see the input gain"
    part = float(gain.restores.split(" at ")[1].split(" %")[0]) / 100
    # As much is borne, and a little more is not.
    for much, holds in ((part - 0.01, True), (part + 0.02, False)):
        lighter = experiment(tmp_path, 1 + much * 3.0)
        found = [each for each in robot_audit(lighter.run()).premises if each.name == "input gain"]
        assert found[0].holds == holds


def test_dominance_is_by_rows() -> None:
    assert gain_margin(np.array([[1.0, -0.4], [0.9, 0.5]])) == pytest.approx(-0.4)


def test_parts_of_edits() -> None:
    assert BodyEdit("b", 3.0, 0.5).shrunk(0.5) == BodyEdit("b", 2.0, 0.75)
    assert AddedMass("b", 2.0, (0.1, 0.0, 0.0)).shrunk(0.25) == AddedMass("b", 0.5, (0.1, 0.0, 0.0))
    joint = JointEdit("j", damping=2.0)
    assert joint.shrunk(0.1) is joint
