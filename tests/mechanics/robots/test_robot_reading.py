"""Reading a robot's MJCF: its inputs, what is left out, and models that are refused."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import ONE, TREE

from grosmc_mj.ground.errors import ModelError
from grosmc_mj.ground.files import LARGEST_TEXT
from grosmc_mj.mechanics.physics.edits import AddedMass
from grosmc_mj.mechanics.robots.model import read_spec
from grosmc_mj.mechanics.robots.nominal import inertia
from grosmc_mj.mechanics.robots.robot import Robot


@pytest.fixture(scope="module")
def tree() -> Robot:
    return Robot.from_mjcf(TREE)


def test_inputs_are_in_the_order_of_the_joints_and_have_their_units(tree: Robot) -> None:
    """Two hinges before a slide."""
    system = tree.plant.system
    assert system.joints == ("turn", "lift", "push")
    assert system.actuators == ("turn_servo", "lift_servo", "push_force")
    assert [signal.unit for signal in system.inputs] == ["N m", "N m", "N"]
    units = [signal.unit for signal in system.states]
    assert units == ["rad", "rad", "m", "rad/s", "rad/s", "m/s"]


def test_limits_of_actuators_become_limits_of_torques(tree: Robot) -> None:
    """The limits of a control are times the gear of its actuator, which becomes 1."""
    limits = [[-30, 30], [-math.inf, math.inf], [-10, 20]]
    np.testing.assert_array_equal(tree.plant.input_limits.T, limits)
    assert np.all(tree.plant.model.actuator_gear[:, 0] == 1)


def test_notes_say_what_was_changed(tree: Robot) -> None:
    assert tree.notes == (
        "actuator 'push_force': its input is torque at the joint, with its gear -20 and gain 1 in "
        "the limits, within [-10, 20] N",
        "actuator 'turn_servo': the position servo (kp 50, kv 5) is left out, torque control "
        "within [-30, 30] N m instead",
        "actuator 'lift_servo': the velocity servo (kv 9) is left out, torque control without "
        "limits instead",
        "not compensated by the law, a disturbance to it: contacts",
    )


def test_a_joint_without_an_actuator_makes_a_robot_underactuated() -> None:
    robot = Robot.from_mjcf(TREE, actuators=["turn_servo", "lift_servo"])
    assert robot.underactuated
    assert len(robot.plant.input_limits.T) == 2
    assert any(note.startswith("no actuator drives push: ") for note in robot.notes)


def test_a_joint_without_a_name_gets_one_that_nothing_has() -> None:
    """The third joint would be called as the first is."""
    ball = '<geom size="0.1" pos="0.3 0 0"/>'
    model = Robot.from_mjcf(f"""<mujoco><worldbody>
      <body><joint name="joint3"/>{ball}<body><joint name="lift"/>{ball}
      <body><joint/>{ball}</body></body></body></worldbody>
      <actuator><motor joint="joint3"/><motor joint="lift"/></actuator></mujoco>""").plant.model
    assert [model.joint(i).name for i in range(3)] == ["joint3", "lift", "joint3_"]


# Locked joints.


@pytest.fixture(scope="module")
def partly_locked() -> Robot:
    """The tree with sensors of two joints and a keyframe, one of these joints locked."""
    spec = mujoco.MjSpec.from_string(TREE)
    joint = {"type": mujoco.mjtSensor.mjSENS_JOINTPOS, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
    spec.add_sensor(objname="turn", **joint)
    spec.add_sensor(objname="push", **joint)
    spec.add_key(qpos=[0.1, 0.2, 0.3])
    return Robot.from_mjcf(spec, joints=["lift", "turn"])


def test_joints_that_are_not_named_are_locked(partly_locked: Robot, tree: Robot) -> None:
    assert partly_locked.plant.system.joints == ("turn", "lift")
    assert partly_locked.plant.system.actuators == ("turn_servo", "lift_servo")
    assert partly_locked.notes[:2] == (
        "locked where the model has them: joints push",
        "left out: actuators push_force",
    )
    M = inertia(partly_locked.nominal, [0.3, -0.2])
    expected = inertia(tree.nominal, [0.3, -0.2, 0.0])[:2, :2]
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-14)


def test_sensors_and_keyframes_of_locked_joints_go(partly_locked: Robot) -> None:
    model = partly_locked.plant.model
    assert model.sensor_objid.tolist() == [model.joint("turn").id]
    assert model.nkey == 0


# An arm of one joint with two fingers; holes for what refers to them.
GRIPPER = """
<mujoco><compiler autolimits="true"/><worldbody>
  <body name="arm" pos="0 0 1"><joint name="shoulder" axis="0 1 0" damping="1"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>
    <body name="left" pos="0.3 0 0"><joint name="finger1" type="slide" axis="0 1 0"/>
      <geom type="box" size="0.02 0.005 0.01" mass="0.02"/><site name="left tip"/></body>
    <body name="right" pos="0.3 0 0"><joint name="finger2" type="slide" axis="0 -1 0"/>
      <geom type="box" size="0.02 0.005 0.01" mass="0.02"/><site name="right tip"/></body>
  </body></worldbody>
  {}
  <actuator><motor name="drive" joint="shoulder" ctrlrange="-40 40"/>{}</actuator></mujoco>
"""
SPLIT = """<tendon><fixed name="split"{}><joint joint="finger1" coef="0.5"/>
  <joint joint="{}" coef="0.5"/></fixed></tendon>"""
FINGERS = SPLIT.format("", "finger2")
GRIP = '<position name="grip" tendon="split" kp="100"/>'
CLOSED = "<connect site1='left tip' site2='right tip'/>"
LOCKED = "locked where the model has them: joints finger1, finger2"
NO_GRIP = "left out: actuators grip"
NO_SPLIT = "left out: tendons split"


@pytest.mark.parametrize(
    ("parts", "actuators", "notes"),
    [
        ("", "<motor name='grip' joint='finger1'/>", [NO_GRIP]),
        ("", "<motor name='grip' jointinparent='finger1'/>", [NO_GRIP]),
        (SPLIT.format(' stiffness="9"', "finger2"), "", [NO_SPLIT]),
        (
            FINGERS + "<sensor><tendonpos tendon='split'/><actuatorfrc actuator='grip'/>"
            "<jointpos joint='finger1'/></sensor>",
            GRIP,
            [NO_SPLIT, NO_GRIP],
        ),
        (
            FINGERS + "<custom><tuple name='hand'><element objtype='joint' objname='finger2'/>"
            "<element objtype='body' objname='left'/></tuple></custom>",
            GRIP,
            [NO_SPLIT, NO_GRIP],
        ),
        (
            FINGERS + "<equality><tendon tendon1='split'/>"
            "<joint joint1='finger1' joint2='finger2'/></equality>",
            GRIP,
            [NO_SPLIT, NO_GRIP, "left out: the coupling (equality) of 'finger1' and 'finger2'"],
        ),
        (
            f"<equality>{CLOSED}<weld body1='left' body2='arm'/></equality>",
            "",
            [
                "left out: the constraint (connect) of 'left tip' and 'right tip', between which "
                "no joint moves",
                "left out: the constraint (weld) of 'left' and 'arm', between which no joint moves",
            ],
        ),
    ],
)
def test_all_that_refers_to_a_gripper_is_left_out_with_it(
    parts: str, actuators: str, notes: list[str]
) -> None:
    """The rest is the arm with rigid fingers, to the bit."""
    robot = Robot.from_mjcf(GRIPPER.format(parts, actuators), joints=["shoulder"])
    bare = Robot.from_mjcf(GRIPPER.format("", ""), joints=["shoulder"])
    assert robot.plant.digest == bare.plant.digest
    assert robot.built is robot.plant
    assert robot.notes == (LOCKED, *notes, *bare.notes[1:])


def test_a_sensor_of_a_body_with_a_fingers_name_stays() -> None:
    """Names are those of a kind: a body may be called as a joint."""
    parts = "<sensor><framepos objtype='body' objname='finger1'/></sensor>"
    model = GRIPPER.format(parts, "").replace('body name="left"', 'body name="finger1"')
    robot = Robot.from_mjcf(model, joints=["shoulder"])
    assert robot.plant.undrawn_model.nsensor == 1


@pytest.mark.parametrize(
    ("parts", "names", "words"),
    [
        (
            FINGERS,
            {"actuators": ["drive", "grip"]},
            "'grip' pulls the tendon 'split' of finger1, finger2, which joints=... leaves out",
        ),
        (
            SPLIT.format("", "shoulder"),
            {},
            "tendon 'split' joins finger1, shoulder, of which joints=... leaves out finger1",
        ),
        (
            FINGERS + "<equality><connect body1='left' body2='world' anchor='0 0 0'/></equality>",
            {},
            "they close loops",
        ),
    ],
)
def test_a_gripper_that_cannot_be_left_out_is_refused(
    parts: str, names: dict[str, Any], words: str
) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(GRIPPER.format(parts, GRIP), joints=["shoulder"], **names)


# Refusals.


def link(
    actuators: str = "<motor joint='j'/>",
    joint: str = "<joint name='j'/>",
    mass: float = 1.0,
    more: str = "",
) -> str:
    """A link of one joint with a site."""
    return f"""
<mujoco model="one">{more}<worldbody><body name="link">{joint}
  <geom size="0.1" mass="{mass}" pos="0.3 0 0"/><site name="s" pos="0.5 0 0"/></body></worldbody>
  <actuator>{actuators}</actuator></mujoco>"""


def tendon(**attributes: float) -> str:
    text = " ".join(f'{name}="{value}"' for name, value in attributes.items())
    return f"<tendon><fixed name='t' {text}><joint joint='j' coef='1'/></fixed></tendon>"


INFINITE_RANGE = '<motor name="motor" joint="hinge" ctrlrange="-20 inf" gear="1"/>'
NO_ACTUATOR = 'the model has no actuator: add <actuator> with <motor joint="j"/>'


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (link(joint="<joint name='j' type='ball'/>"), "'j' is a ball joint"),
        (link(joint="<freejoint name='j'/>"), "is a free joint"),
        (link("", joint=""), "no joint that a law could move"),
        (link(joint="<joint name='j' actuatorgravcomp='true'/>"), "actuatorgravcomp"),
        (link(joint="<joint name='j' damping='1 0.1'/>"), "is not linear"),
        (link(mass=0), "mass and inertia"),
        (link("<motor tendon='t'/>", more=tendon()), "pulls a tendon"),
        (link(more=tendon(damping=2)), "tendons with stiffness"),
        (link(more="<option timestep='0'/>"), "one: its timestep is 0 s, must lie between"),
        (ONE.format("", INFINITE_RANGE), r"actuator_ctrlrange\[0, 1\] = inf must be finite"),
        ("nowhere.xml", "the MJCF cannot be read: .*nowhere.xml"),
        (link(""), NO_ACTUATOR),
        (link("<motor joint='j'/><motor joint='j'/>"), "joint 'j' has 2 actuators"),
        (link("<general joint='j' dyntype='integrator'/>"), "activation"),
        (link("<muscle joint='j' lengthrange='0 1'/>"), "is a muscle, which pulls"),
        (link("<motor site='s'/>"), "acts on a site"),
        (link("<adhesion body='link' ctrlrange='0 1'/>"), "adhesion"),
        (link("<motor jointinparent='j'/>"), "parent's frame"),
        (link("<damper joint='j' kv='1' ctrlrange='0 1'/>"), "depends on the state"),
        (link("<motor joint='j' gear='0'/>"), "no gear"),
        (link("<motor joint='j' armature='1'/>"), "belongs to its joint"),
        (link("<general joint='j' damping='0.1'/>"), "damping of its own, which belongs to its jo"),
        (link("<general joint='j' dyntype='filter' dynprm='0'/>"), "has a lag of 0 s, which nothi"),
        (link("<general joint='j' gaintype='affine' gainprm='4 1'/>"), "gain that depends on"),
        (
            link("<dcmotor joint='j' motorconst='0.05' resistance='2'/>"),
            r"is a DC motor: make it a motor here, and give its winding in a \[\[motor\]\] table",
        ),
    ],
)
def test_a_model_that_is_no_robot_is_refused(model: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(model)


def test_a_mass_at_a_site_is_told_the_body_and_the_place() -> None:
    words = r"""'s' is a site: write body = "link", and at = \["0.5 m", "0 m", "0 m"\]"""
    with pytest.raises(ModelError, match=words):
        _ = Robot.from_mjcf(link()).plant.changed(AddedMass("s", 1.0)).model


@pytest.mark.parametrize(
    ("actuators", "words"),
    [
        ("<motor joint='j'>", r"bad.xml:4: the MJCF cannot be read: XML parse error"),
        ("\n<motor joint='k'/>", r"bad.xml:5: .*: unknown transmission target 'k'"),
        ("", f"bad.xml: {NO_ACTUATOR}"),
    ],
)
def test_a_refused_file_is_named_with_the_line_of_the_mistake(
    tmp_path: Path, actuators: str, words: str
) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(link(actuators))
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(path)


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ({"actuators": ["lift_serv"]}, "did you mean 'lift_servo'"),
        ({"joints": ["lift", "lift"]}, "named twice"),
        (
            {"joints": ["lift"], "actuators": ["push_force"]},
            "'push_force' drives the joint 'push'",
        ),
        ({"actuators": []}, "no actuator drives"),
    ],
)
def test_wrong_names_are_refused(names: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(TREE, **names)


def a_pipe(path: Path) -> str:
    os.mkfifo(path)
    return "is a folder, a pipe, a socket or a device: give a regular file"


def a_huge_file(path: Path) -> str:
    with path.open("wb") as stream:
        stream.truncate(LARGEST_TEXT + 1)
    return "has 256 MB: at most 256 MB are read"


@pytest.mark.parametrize(
    ("element", "file", "odd"),
    [
        ('<include file="parts/odd"/>', "parts/odd", a_pipe),
        ('<include file="part.xml"/>', "odd", a_pipe),
        ('<asset><model name="a" file="odd"/></asset>', "odd", a_huge_file),
        ('<asset><mesh name="a" file="odd.stl"/></asset>', "assets/odd.stl", a_pipe),
        ('<asset><mesh name="a" file="odd.stl"/></asset>', "assets/odd.stl", a_huge_file),
        ('<asset><hfield name="a" file="o.png" size="1 1 1 1"/></asset>', "assets/o.png", a_pipe),
        ('<asset><texture name="a" type="2d" file="o.png"/></asset>', "pictures/o.png", a_pipe),
        ('<asset><texture name="a" type="cube" fileup="o"/></asset>', "pictures/o", a_pipe),
    ],
)
def test_a_pipe_or_a_huge_file_that_a_model_names_is_not_read(
    element: str, file: str, odd: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A message cuts long paths.
    monkeypatch.chdir(tmp_path)
    model = Path("robot.xml")
    compiler = '<compiler meshdir="assets" texturedir="pictures"/>'
    model.write_text(f"<mujoco>{compiler}{element}</mujoco>")
    Path("part.xml").write_text('<mujoco><include file="odd"/></mujoco>')
    Path(file).parent.mkdir(exist_ok=True)
    words = odd(Path(file))
    with pytest.raises(ModelError, match=f"the MJCF cannot be read: {file} {words}"):
        read_spec(model)
