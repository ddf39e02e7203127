"""A robot from its MJCF alone: its dynamics, its laws and models that are refused."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import ONE, TREE

from grosmc_mj.ground.arrays import Array
from grosmc_mj.ground.errors import ArgumentError, ModelError, PremiseError
from grosmc_mj.ground.files import LARGEST_TEXT
from grosmc_mj.mechanics.physics.edits import AddedMass, BodyEdit
from grosmc_mj.mechanics.physics.files import load_spec
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.robots.model import read_spec
from grosmc_mj.mechanics.robots.nominal import bias, inertia
from grosmc_mj.mechanics.robots.robot import Robot
from grosmc_mj.simulation.loop.design_model import design_model
from grosmc_mj.theory.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.theory.control.design import (
    computed_torque_pd,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    tracking_grosmc,
)
from grosmc_mj.theory.control.kinds.adaptive import Adaptive
from grosmc_mj.theory.control.references import FourierSeries, Setpoints, fourier_series, setpoints
from grosmc_mj.theory.control.task import Task
from grosmc_mj.theory.control.uncertainty.outputs import Uncertainty
from grosmc_mj.theory.plants import TWO_LINK_ARM

N = 3


@cache
def tree() -> Robot:
    return Robot.from_mjcf(TREE)


@cache
def tree_in_fluid() -> Robot:
    spec = tree_spec()
    spec.option.density = 1000
    spec.option.viscosity = 0.1
    return Robot.from_mjcf(spec)


@cache
def tree_with_gravity_compensation() -> Robot:
    spec = tree_spec()
    spec.body("tool").gravcomp = 1
    return Robot.from_mjcf(spec)


@cache
def underactuated() -> Robot:
    return Robot.from_mjcf(TREE, actuators=["turn_servo", "lift_servo"])


@cache
def two_link() -> Robot:
    return Robot.from_mjcf(load_spec("two_link_arm"))


def tree_spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(TREE)


def weights(n: int) -> tuple[Array, Array]:
    Q = np.kron(np.eye(n), np.diag([100.0, 0.0]))
    return Q, np.eye(n)


@cache
def tree_task() -> Task:
    sine = np.array([[0.3], [0.2], [0.05]])
    series = FourierSeries(2.0, np.array([0.1, 0.2, 0.0]), np.zeros((N, 1)), sine)
    return tree().task(fourier_series(N, 1), series, *weights(N))


@cache
def two_link_task() -> Task:
    return two_link().task(setpoints(2, 2), Setpoints(0.3, -0.4), *weights(2))


def states(n: int, count: int = 5) -> Array:
    return np.random.default_rng(7).uniform(-1, 1, (count, 2 * n))


def forward(model: mujoco.MjModel, x: Array, **fields: Any) -> mujoco.MjData:
    """MuJoCo's forward dynamics of a model in a state."""
    n = len(x) // 2
    data = mujoco.MjData(model)
    data.qpos[:] = x[:n]
    data.qvel[:] = x[n:]
    for name, value in fields.items():
        getattr(data, name)[:] = value
    mujoco.mj_forward(model, data)
    return data


# Dynamics

# Step of central differences.
STEP = 1e-5


def energy(q: Array, dq: Array) -> Array:
    """Potential and kinetic energy of the tree; springs have a part in the potential."""
    model = tree().plant.model
    data = forward(model, np.append(q, dq))
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return data.energy.copy()


def slope(function: Any, q: Array) -> Array:
    """Derivatives of a function of q by central differences, a row for each joint."""
    rows = [function(q + e) - function(q - e) for e in STEP * np.eye(len(q))]
    return np.array(rows) / (2 * STEP)


@pytest.mark.parametrize("x", states(N))
def test_inertia_is_that_of_the_kinetic_energy(x: Array) -> None:
    """(a + b)'M(a + b) - (a - b)'M(a - b) = 4 a'M b, and the energy is half of it."""
    q = x[:N]
    unit = np.eye(N)
    twice = [[energy(q, a + b)[1] - energy(q, a - b)[1] for b in unit] for a in unit]
    M = inertia(tree().nominal, q)
    np.testing.assert_allclose(M, np.array(twice) / 2, rtol=0, atol=1e-13)


@pytest.mark.parametrize("x", states(N))
def test_bias_is_that_of_lagranges_equations(x: Array) -> None:
    """h = M' q' - d(q' M q'/2)/dq + dV/dq, less springs and damping.

    The differences' rounding is eps/e of the energy, their curvature e^2.
    """
    q = x[:N]
    dq = x[N:]
    damping = np.array([joint.damping[0] for joint in tree().plant.spec.joints])
    inertia_slope = slope(lambda q: inertia(tree().nominal, q), q)
    force = slope(lambda q: energy(q, np.zeros(N))[0], q)
    coriolis = np.einsum("kij,k,j->i", inertia_slope, dq, dq)
    coriolis -= 0.5 * np.einsum("ijk,j,k->i", inertia_slope, dq, dq)
    expected = coriolis + force + damping * dq
    np.testing.assert_allclose(bias(tree().nominal, q, dq), expected, rtol=0, atol=1e-8)


each_tree = pytest.mark.parametrize("make", [tree, tree_with_gravity_compensation])


@each_tree
@pytest.mark.parametrize("x", states(N, 2))
def test_inertia_is_mujocos(make: Any, x: Array) -> None:
    robot = make()
    data = forward(robot.plant.model, x)
    M = np.zeros((N, N))
    mujoco.mj_fullM(robot.plant.model, data, M)
    np.testing.assert_allclose(inertia(robot.nominal, x[:N]), M, rtol=0, atol=1e-13)


def test_no_law_knows_of_a_fluid() -> None:
    robot = tree_in_fluid()
    x = states(N, 1)[0]
    np.testing.assert_array_equal(
        bias(robot.nominal, x[:N], x[N:]), bias(tree().nominal, x[:N], x[N:])
    )
    assert any("the fluid (density, viscosity)" in note for note in robot.notes)


@each_tree
@pytest.mark.parametrize("x", states(N, 2))
def test_bias_is_mujocos(make: Any, x: Array) -> None:
    robot = make()
    data = forward(robot.plant.model, x)
    expected = data.qfrc_bias - data.qfrc_passive
    actual = bias(robot.nominal, x[:N], x[N:])
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12)


ON_A_FLOOR = """
<mujoco><worldbody><geom type="plane" size="9 9 1"/>
  <body name="link"><joint name="j" range="-1 1" limited="true"/>
    <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
ON_A_FLOOR_WITHOUT_WEIGHT = ON_A_FLOOR.replace('name="link"', 'name="link" gravcomp="1"')


@pytest.mark.parametrize("text", [ON_A_FLOOR, ON_A_FLOOR_WITHOUT_WEIGHT])
def test_constraints_are_no_part_of_the_nominal_dynamics(text: str) -> None:
    """Neither a limit nor a contact acts, beyond the limit and within the floor.

    A model with gravity compensation keeps the floor as it keeps all geoms.
    """
    robot = Robot.from_mjcf(text)
    x = np.array([1.5, 0.0])
    assert forward(robot.plant.model, x).nefc > 0
    assert forward(robot.nominal, x).nefc == 0


# Laws


@pytest.mark.parametrize("x", states(N))
def test_computed_torque_gives_the_acceleration_that_it_is_computed_for(x: Array) -> None:
    """On the nominal plant, by mj_forward of all bodies: no fused one is missing."""
    law = linearized_lqr(tree_task())
    error = law.coordinates
    p = law.parameters
    memory = law.memory()
    u = np.atleast_1d(law.input_at(0.3, x, memory))

    z = np.array(error.error_state(0.3, x, p))
    expected = -p.K @ z + np.array(error.reference(0.3, p.reference))[2::3]
    qacc = forward(tree().plant.model, x, qfrc_applied=u).qacc
    # The torques are up to 30 N m, on inertias down to 0.2 kg m^2.
    np.testing.assert_allclose(qacc, expected, rtol=0, atol=1e-12)


class Pair:
    """Coordinates of the two-link arm by MuJoCo and in symbols, each with its parameters."""

    def __init__(self) -> None:
        law = tracking_grosmc(two_link_task(), 10.0, 30.0)
        self.robot: Any = law.coordinates
        self.p: Any = law.parameters
        self.symbolic = ErrorCoordinates(TWO_LINK_ARM, setpoints(2, 2))
        nominal = MujocoPlant.load("two_link_arm").analytic()
        self.symbolic_p: Any = replace(self.p, plant=nominal.parameters)


@pytest.fixture(scope="module")
def pair() -> Pair:
    return Pair()


def require_close(actual: Any, expected: Any) -> None:
    for ours, theirs in zip(actual, expected, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12)


def test_coordinates_are_two_for_each_joint(pair: Pair) -> None:
    assert pair.robot.size == 4


def test_coordinates_have_the_units_of_the_symbolic_ones(pair: Pair) -> None:
    assert pair.robot.units == pair.symbolic.units


def test_outputs_are_the_rows_of_the_symbolic_ones(pair: Pair) -> None:
    assert pair.robot.output_rows == pair.symbolic.output_rows


each_two_link_state = pytest.mark.parametrize("x", states(2))


@each_two_link_state
def test_the_error_is_that_of_the_symbolic_coordinates(pair: Pair, x: Array) -> None:
    z = pair.robot.error_state(1.0, x, pair.p)
    require_close(z, pair.symbolic.error_state(1.0, x, pair.symbolic_p))
    require_close(pair.robot.along([1.0], x[None], pair.p)[0], z)


@each_two_link_state
def test_place_is_the_inverse_of_the_error(pair: Pair, x: Array) -> None:
    z = np.array(pair.robot.error_state(1.0, x, pair.p))
    require_close(pair.robot.place(1.0, z, pair.p), x)


@each_two_link_state
def test_the_dynamics_are_those_of_the_symbolic_coordinates(pair: Pair, x: Array) -> None:
    expected = pair.symbolic.dynamics(1.0, x, pair.symbolic_p)
    require_close(pair.robot.dynamics(1.0, x, pair.p), expected)


@pytest.mark.parametrize("u", [None, np.random.default_rng(2).normal(0, 5, (1, 2))])
@each_two_link_state
def test_the_motion_of_another_plant_is_that_of_the_symbolic_coordinates(
    pair: Pair, x: Array, u: Array | None
) -> None:
    heavier = BodyEdit("payload", mass_scale=3.0)
    w = np.random.default_rng(1).uniform(-5, 5, (1, 18))
    true_plant = two_link().plant.changed(heavier)
    twin = MujocoPlant.load("two_link_arm").changed(heavier).analytic()
    motion = pair.robot.error_dynamics([1.0], x[None], pair.p, true_plant, w, u)
    expected = pair.symbolic.error_dynamics([1.0], x[None], pair.symbolic_p, twin, w)
    require_close(motion, expected)

    z = np.array(pair.robot.error_state(1.0, x, pair.p))
    drift = motion[0][0]
    np.testing.assert_allclose(pair.robot.unmatched(z, drift), 0, atol=1e-15)


@pytest.mark.parametrize("x", states(N))
def test_the_design_model_moves_by_mujocos_accelerations(x: Array) -> None:
    h = 1e-3
    u = np.array([0.4, -0.3, 0.2])
    task = replace(tree_task(), error=replace(tree_task().error, sign=-1))
    law = computed_torque_pd(task, 9.0, 6.0)
    memory = law.memory()
    model = design_model(law, "this test")
    moved = x.copy()
    model.advance(0.3, moved, u, h, memory, law.parameters, model.own)

    qacc = forward(tree().plant.model, x, ctrl=u).qacc
    q = x[:N] + h * x[N:] + 0.5 * h**2 * qacc
    dq = x[N:] + h * qacc
    np.testing.assert_allclose(moved, [*q, *dq], rtol=1e-9)


# Reading


def test_inputs_are_in_the_order_of_the_joints() -> None:
    system = tree().plant.system
    assert system.joints == ("turn", "lift", "push")
    assert system.actuators == ("turn_servo", "lift_servo", "push_force")


def test_inputs_have_the_units_of_their_joints() -> None:
    """Two hinges before a slide."""
    units = [signal.unit for signal in tree().plant.system.inputs]
    assert units == ["N m", "N m", "N"]


def test_states_have_the_units_of_their_joints() -> None:
    units = [signal.unit for signal in tree().plant.system.states]
    assert units == ["rad", "rad", "m", "rad/s", "rad/s", "m/s"]


def test_limits_of_actuators_become_limits_of_torques() -> None:
    """The limits of a control are times the gear of its actuator."""
    limits = [[-30, 30], [-math.inf, math.inf], [-10, 20]]
    np.testing.assert_array_equal(tree().plant.input_limits.T, limits)


def test_every_gear_becomes_one() -> None:
    assert np.all(tree().plant.model.actuator_gear[:, 0] == 1)


@pytest.mark.parametrize(
    "words",
    [
        "position servo (kp 50, kv 5) is left out",
        "gear -20",
        "contacts",
        "velocity servo (kv 9) is left out, torque control without limits",
    ],
)
def test_notes_say_what_was_changed(words: str) -> None:
    assert words in "\n".join(tree().notes)


@pytest.fixture(scope="module")
def partly_locked() -> Robot:
    """The tree with sensors of two joints and a keyframe, one of these joints locked."""
    spec = tree_spec()
    for name in ("turn", "push"):
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_JOINTPOS,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
    spec.add_key(qpos=[0.1, 0.2, 0.3])
    return Robot.from_mjcf(spec, joints=["lift", "turn"])


def test_joints_that_are_not_named_are_locked(partly_locked: Robot) -> None:
    assert partly_locked.plant.system.joints == ("turn", "lift")
    assert partly_locked.plant.system.actuators == ("turn_servo", "lift_servo")
    assert "locked where the model has them: joints push" in partly_locked.notes
    assert "left out: actuators push_force" in partly_locked.notes


def test_a_locked_joint_leaves_the_inertia_of_the_others(partly_locked: Robot) -> None:
    M = inertia(partly_locked.nominal, [0.3, -0.2])
    expected = inertia(tree().nominal, [0.3, -0.2, 0.0])[:2, :2]
    np.testing.assert_allclose(M, expected, rtol=0, atol=1e-14)


def test_sensors_of_locked_joints_go(partly_locked: Robot) -> None:
    model = partly_locked.plant.model
    assert model.nsensor == 1
    assert model.sensor_objid[0] == model.joint("turn").id


def test_keyframes_of_a_model_with_locked_joints_go(partly_locked: Robot) -> None:
    assert partly_locked.plant.model.nkey == 0


THREE_JOINTS = """
<mujoco><worldbody>
  <body><joint name="joint3"/><geom size="0.1" pos="0.3 0 0"/>
  <body><joint name="lift"/><geom size="0.1" pos="0.3 0 0"/>
  <body><joint/><geom size="0.1" pos="0.3 0 0"/></body></body></body></worldbody>
  <actuator><motor joint="joint3"/><motor joint="lift"/></actuator></mujoco>
"""


def test_a_joint_without_a_name_gets_one_that_nothing_has() -> None:
    """The third joint would be called as the first is."""
    model = Robot.from_mjcf(THREE_JOINTS).plant.model
    assert [model.joint(i).name for i in range(N)] == ["joint3", "lift", "joint3_"]


def test_a_joint_without_an_actuator_makes_a_robot_underactuated() -> None:
    assert any("no actuator drives push" in note for note in underactuated().notes)
    assert underactuated().underactuated
    assert len(underactuated().plant.input_limits.T) == 2


# Refusals: models of one link

BALL_JOINT = """
<mujoco><worldbody><body name="link"><joint name="j" type="ball"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
FREE_JOINT = """
<mujoco><worldbody><body name="link"><freejoint name="j"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
NO_JOINT = """
<mujoco><worldbody><body name="link"><geom size="0.1" pos="0.3 0 0"/></body></worldbody></mujoco>
"""
GRAVITY_ON_ACTUATOR = """
<mujoco><worldbody><body name="link"><joint name="j" actuatorgravcomp="true"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
CURVED_DAMPER = """
<mujoco><worldbody><body name="link"><joint name="j" damping="1 0.1"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
NO_MASS = """
<mujoco><worldbody><body name="link"><joint name="j"/>
  <geom size="0.1" mass="0" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
TENDON_MOTOR = """
<mujoco><worldbody><body name="link"><joint name="j"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
  <actuator><motor tendon="t"/></actuator></mujoco>
"""
DAMPED_TENDON = """
<mujoco><worldbody><body name="link"><joint name="j"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <tendon><fixed name="t" damping="2"><joint joint="j" coef="1"/></fixed></tendon>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
NO_TIMESTEP = """
<mujoco model="one"><option timestep="0"/><worldbody><body name="link"><joint name="j"/>
  <geom size="0.1" pos="0.3 0 0"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>
"""
INFINITE_RANGE = '<motor name="motor" joint="hinge" ctrlrange="-20 inf" gear="1"/>'


@pytest.mark.parametrize(
    ("model", "words"),
    [
        pytest.param(BALL_JOINT, "'j' is a ball joint", id="ball"),
        pytest.param(FREE_JOINT, "is a free joint", id="free"),
        pytest.param(NO_JOINT, "no joint that a law could move", id="no joint"),
        pytest.param(GRAVITY_ON_ACTUATOR, "actuatorgravcomp", id="gravity on the actuator"),
        pytest.param(NO_MASS, "mass and inertia", id="no mass"),
        pytest.param(TENDON_MOTOR, "pulls a tendon", id="tendon"),
        pytest.param(DAMPED_TENDON, "tendons with stiffness", id="damped tendon"),
        pytest.param(CURVED_DAMPER, "is not linear", id="damper that is not linear"),
        pytest.param(NO_TIMESTEP, "one: its timestep is 0 s, must lie between", id="no timestep"),
        pytest.param(
            ONE.format("", INFINITE_RANGE),
            r"actuator_ctrlrange\[0, 1\] = inf must be finite",
            id="infinite range",
        ),
        pytest.param("nowhere.xml", "the MJCF cannot be read: .*nowhere.xml", id="missing file"),
    ],
)
def test_a_model_that_is_no_robot_is_refused(model: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(model)


# A link; a hole for its actuators.
LINK = """
<mujoco><worldbody><body name="link"><joint name="j"/>
  <geom size="0.1" pos="0.3 0 0"/><site name="s" pos="0.5 0 0"/></body></worldbody>
  <actuator>{}</actuator></mujoco>
"""


@pytest.mark.parametrize(
    ("actuators", "words"),
    [
        ("", 'the model has no actuator: add <actuator> with <motor joint="j"/>'),
        ("<motor joint='j'/><motor joint='j'/>", "joint 'j' has 2 actuators"),
        ("<general joint='j' dyntype='integrator'/>", "activation"),
        ("<muscle joint='j' lengthrange='0 1'/>", "is a muscle, which pulls"),
        ("<motor site='s'/>", "acts on a site"),
        ("<adhesion body='link' ctrlrange='0 1'/>", "adhesion"),
        ("<motor jointinparent='j'/>", "parent's frame"),
        ("<damper joint='j' kv='1' ctrlrange='0 1'/>", "depends on the state"),
        ("<motor joint='j' gear='0'/>", "no gear"),
        ("<motor joint='j' armature='1'/>", "belongs to its joint"),
    ],
)
def test_an_actuator_that_no_torque_stands_for_is_refused(actuators: str, words: str) -> None:
    with pytest.raises(ModelError, match=words):
        Robot.from_mjcf(LINK.format(actuators))


def test_a_mass_at_a_site_is_told_the_body_and_the_place() -> None:
    plant = Robot.from_mjcf(LINK.format("<motor joint='j'/>")).plant
    words = r"""'s' is a site: write body = "link", and at = \["0.5 m", "0 m", "0 m"\]"""
    with pytest.raises(ModelError, match=words):
        _ = plant.changed(AddedMass("s", 1.0)).model


@pytest.mark.parametrize(
    ("actuators", "words"),
    [
        ("<motor joint='j'>", r"bad.xml:4: the MJCF cannot be read: XML parse error"),
        ("\n<motor joint='k'/>", r"bad.xml:5: .*: unknown transmission target 'k'"),
        ("<motor joint='j' gear='0'/>", "bad.xml: actuator 'actuator1' has no gear"),
        ("", "bad.xml: the model has no actuator"),
    ],
)
def test_a_refused_file_is_named_with_the_line_of_the_mistake(
    tmp_path: Path, actuators: str, words: str
) -> None:
    path = tmp_path / "bad.xml"
    path.write_text(LINK.format(actuators))
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


# Removal of a gripper

# An arm of one joint with two fingers; a hole for what refers to them.
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
SPLIT = """<tendon><fixed name="split"><joint joint="finger1" coef="0.5"/>
  <joint joint="finger2" coef="0.5"/></fixed></tendon>"""
GRIP = '<position name="grip" tendon="split" kp="100"/>'
LEFT_OUT = [
    pytest.param("", "<motor name='grip' joint='finger1'/>", id="motor of a finger"),
    pytest.param("", "<motor name='grip' jointinparent='finger1'/>", id="motor in the parent"),
    pytest.param(SPLIT, "", id="tendon"),
    pytest.param(SPLIT.replace("<fixed", '<fixed stiffness="9"'), "", id="stiff tendon"),
    pytest.param(SPLIT, GRIP, id="motor of a tendon"),
    pytest.param(
        SPLIT + "<sensor><tendonpos tendon='split'/><actuatorfrc actuator='grip'/>"
        "<jointpos joint='finger1'/></sensor>",
        GRIP,
        id="sensors",
    ),
    pytest.param(
        SPLIT + "<custom><tuple name='hand'><element objtype='joint' objname='finger2'/>"
        "<element objtype='body' objname='left'/></tuple></custom>",
        GRIP,
        id="tuple",
    ),
    pytest.param(
        SPLIT + "<equality><tendon tendon1='split'/><joint joint1='finger1' joint2='finger2'/>"
        "</equality>",
        GRIP,
        id="couplings",
    ),
    pytest.param(
        "<equality><connect site1='left tip' site2='right tip'/><weld body1='left' body2='arm'/>"
        "</equality>",
        "",
        id="closed loop",
    ),
    pytest.param(
        SPLIT + "<keyframe><key name='home' qpos='0 0.01 0.01'/></keyframe>",
        GRIP,
        id="keyframe",
    ),
]


@pytest.mark.parametrize(("parts", "actuators"), LEFT_OUT)
def test_all_that_refers_to_a_gripper_is_left_out_with_it(parts: str, actuators: str) -> None:
    """What is left is the arm with rigid fingers, to the bit."""
    robot = Robot.from_mjcf(GRIPPER.format(parts, actuators), joints=["shoulder"])
    bare = Robot.from_mjcf(GRIPPER.format("", ""), joints=["shoulder"])
    assert robot.plant.digest == bare.plant.digest
    assert robot.built is robot.plant
    assert robot.notes[0] == "locked where the model has them: joints finger1, finger2"


@pytest.mark.parametrize(
    ("parts", "actuators", "note"),
    [
        (SPLIT, GRIP, "left out: tendons split"),
        (SPLIT, GRIP, "left out: actuators grip"),
        (
            "<equality><connect site1='left tip' site2='right tip'/></equality>",
            "",
            "left out: the constraint (connect) of 'left tip' and 'right tip', between which no "
            "joint moves",
        ),
    ],
)
def test_a_note_says_what_is_left_out(parts: str, actuators: str, note: str) -> None:
    robot = Robot.from_mjcf(GRIPPER.format(parts, actuators), joints=["shoulder"])
    assert note in robot.notes


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
            SPLIT,
            {"actuators": ["drive", "grip"]},
            "'grip' pulls the tendon 'split' of finger1, finger2, which joints=... leaves out",
        ),
        (
            SPLIT.replace("finger2", "shoulder"),
            {},
            "tendon 'split' joins finger1, shoulder, of which joints=... leaves out finger1",
        ),
        (
            SPLIT + "<equality><connect body1='left' body2='world' anchor='0 0 0'/></equality>",
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


# Refusals: designs


def test_joints_of_an_underactuated_robot_cannot_all_be_led() -> None:
    with pytest.raises(ModelError, match=r"2 torques for 3 joints.*take a state_task"):
        underactuated().task(setpoints(3, 2), Setpoints(0.0, 0.0), np.eye(6), 1.0)


UNCERTAINTY = Uncertainty({}, (1.0,) * 18, (1.0,) * 4, 1.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: linear_lqr(two_link_task()),
        lambda: regulating_grosmc(two_link_task(), UNCERTAINTY),
        lambda: two_link().plant.analytic(),
    ],
)
def test_a_robot_has_no_equations_in_symbols(call: Any) -> None:
    with pytest.raises((ModelError, ArgumentError), match="no equations in symbols"):
        call()


def test_the_adaptive_law_needs_torques_in_symbols() -> None:
    words = "two_link_arm has no torques Y theta in symbols.*: take lqi, fl-pid or adrc"
    with pytest.raises(PremiseError, match=words):
        Adaptive(1.0, 1.0).design(two_link_task())


# Files that a model names


@pytest.mark.parametrize(
    ("element", "file"),
    [
        ('<include file="parts/odd"/>', "parts/odd"),
        ('<include file="part.xml"/>', "odd"),
        ('<asset><model name="a" file="odd"/></asset>', "odd"),
        ('<asset><mesh name="a" file="odd.stl"/></asset>', "assets/odd.stl"),
        ('<asset><hfield name="a" file="odd.png" size="1 1 1 1"/></asset>', "assets/odd.png"),
        ('<asset><texture name="a" type="2d" file="odd.png"/></asset>', "pictures/odd.png"),
        ('<asset><texture name="a" type="cube" fileup="odd.png"/></asset>', "pictures/odd.png"),
    ],
)
@pytest.mark.parametrize("large", [False, True])
def test_a_pipe_or_a_huge_file_that_a_model_names_is_not_read(
    element: str, file: str, large: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A message cuts long paths.
    monkeypatch.chdir(tmp_path)
    compiler = '<compiler meshdir="assets" texturedir="pictures"/>'
    model = Path("robot.xml")
    model.write_text(f"<mujoco>{compiler}{element}</mujoco>")
    Path("part.xml").write_text('<mujoco><include file="odd"/></mujoco>')
    odd = Path(file)
    odd.parent.mkdir(exist_ok=True)
    words = "is a folder, a pipe, a socket or a device: give a regular file"
    if large:
        with odd.open("wb") as stream:
            stream.truncate(LARGEST_TEXT + 1)
        words = "has 256 MB: at most 256 MB are read"
    else:
        os.mkfifo(odd)
    with pytest.raises(ModelError, match=f"the MJCF cannot be read: {file} {words}"):
        read_spec(model)
