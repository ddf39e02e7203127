"""What takes away the dominance of a robot's input gain, and what restores it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from grosmc_mj.assumptions.robot import robot_audit
from grosmc_mj.control.reaching import gain_margin
from grosmc_mj.experiments.experiment import Experiment

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


def test_the_row_is_named_and_a_smaller_payload_restores_it(tmp_path: Path) -> None:
    failed = {each.name: each for each in robot_audit(experiment(tmp_path, 4.0).run()).failed()}
    gain, rate = failed["input gain"], failed["epsilon"]
    assert "in the row of j3 0.25 is its own" in gain.note
    assert "most of it j1's" in gain.note
    assert rate.restores == "no ρ, while r is not positive: see the input gain"
    assert gain.restores.startswith(("a unit-vector switching law", "another G, smaller edits"))
    lighter = robot_audit(experiment(tmp_path, 1.01).run())
    assert "input gain" not in [premise.name for premise in lighter.failed()]


def test_dominance_is_by_rows() -> None:
    assert gain_margin(np.array([[1.0, -0.4], [0.9, 0.5]])) == pytest.approx(-0.4)
