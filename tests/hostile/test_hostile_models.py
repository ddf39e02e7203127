"""Mutated MJCF models under a law of computed torque: kept, a verdict, or one line."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from mutation import NUMBERS, TEXTS
from trial import TIMES, trial

pytestmark = [pytest.mark.slow, pytest.mark.apart]

MODEL = """<mujoco model="two">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" gravity="0 0 -9.81" integrator="implicitfast"/>
  <default><geom type="capsule" size="0.02" contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" type="hinge" axis="0 1 0" damping="0.1" armature="0.01" range="-2 2"/>
      <geom name="upper" fromto="0 0 0 0 0 0.3" mass="1"/>
      <body name="lower" pos="0 0 0.3">
        <joint name="elbow" type="hinge" axis="0 1 0" frictionloss="0.01"/>
        <geom name="lower" fromto="0 0 0 0 0 0.3" density="500"/>
        <site name="tip" pos="0 0 0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="s" joint="shoulder" gear="1" ctrlrange="-50 50"/>
    <position name="e" joint="elbow" kp="10" forcerange="-20 20"/>
  </actuator>
</mujoco>
"""
CASE = """
[plant]
model = "robot.xml"
[run]
start = { shoulder = "0.1 rad" }
duration = "0.01 s"
[task]
Q = 10
R = 1
[[controller]]
law = "lqr"
[[controller]]
law = "grosmc"
k = 5
epsilon = 2
"""
_VALUE = re.compile(r'(?<==")[^"]*(?=")')
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_ELEMENT = re.compile(r"<(\w+)[^<>]*/>")
_ELEMENTS = (
    '<freejoint/>', '<joint type="ball"/>', '<joint type="slide" axis="0 0 0"/>', "<nothing/>",
    '<geom type="mesh" mesh="none"/>', '<include file="robot.xml"/>', '<include file="/dev/zero"/>',
    '<replicate count="2"/>', '<geom size="0.1" mass="-1"/>', '<inertial pos="0 0 0" mass="0"/>',
    '<plugin plugin="nothing"/>', '<frame euler="nan 0 0"/>', '<body name="upper"/>', "<!-- ",
)  # fmt: skip
_TRIED = 45 * TIMES


def mutated(text: str, rng: random.Random) -> tuple[str, str]:
    """A mutated model and the kind of its mutation."""
    kind = rng.choice(("value", "value", "number", "number", "element", "added", "line", "cut"))
    if kind == "cut":
        return kind, text[: rng.randrange(len(text))]
    if kind == "line":
        lines = text.splitlines(keepends=True)
        del lines[rng.randrange(len(lines))]
        return kind, "".join(lines)
    pattern = {"value": _VALUE, "number": _NUMBER}.get(kind, _ELEMENT)
    place = rng.choice(list(pattern.finditer(text)))
    new = {
        "value": rng.choice((*TEXTS, *NUMBERS)).replace('"', "'").replace("<", ""),
        "number": rng.choice([each for each in NUMBERS if each[0] not in '"[{']),
        "element": "",
        "added": place[0] + rng.choice(_ELEMENTS),
    }[kind]
    return kind, text[: place.start()] + new + text[place.end() :]


def test_mutated_models(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    rng, model, case = random.Random(4), tmp_path / "robot.xml", tmp_path / "case.toml"
    case.write_text(CASE)
    with trial(capfd, tmp_path) as hostile:
        for index in range(_TRIED):
            kind, changed = mutated(MODEL, rng)
            model.write_text(changed, encoding="utf-8")
            hostile.run(f"{kind} {index}", "run", case, "--no-figures", "--out", tmp_path / "out")
    hostile.finish(_TRIED)
