"""A robot from its MJCF alone: its dynamics, its laws and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from mjcf import ONE, TREE

from grosmc_mj.arrays import Array
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import (
    computed_torque_pd,
    linear_lqr,
    linearized_lqr,
    regulating_grosmc,
    tracking_grosmc,
)
from grosmc_mj.control.references import FourierSeries, Setpoints, fourier_series, setpoints
from grosmc_mj.control.rivals.adaptive import adaptive
from grosmc_mj.control.task import Task
from grosmc_mj.control.uncertainty import Uncertainty
from grosmc_mj.errors import ArgumentError, ModelError, PremiseError
from grosmc_mj.loop.design_model import design_model
from grosmc_mj.physics.edits import BodyEdit
from grosmc_mj.physics.files import load_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import TWO_LINK_ARM
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.robots.robot import Robot

N = 3


@cache
def tree(old: str = "", new: str = "") -> Robot:
    return Robot.from_mjcf(TREE.replace(old, new) if old else TREE)


@cache
def two_link() -> Robot:
    return Robot.from_mjcf(load_spec("two_link_arm"))


def weights(n: int) -> tuple[Array, Array]:
    return np.kron(np.eye(n), np.diag([100.0, 0.0])), np.eye(n)


@cache
def tree_task() -> Task:
    sine = np.array([[0.3], [0.2], [0.05]])
    series = FourierSeries(2.0, np.array([0.1, 0.2, 0.0]), np.zeros((N, 1)), sine)
    return tree().task(fourier_series(N, 1), series, *weights(N))


def two_link_task() -> Task:
    return two_link().task(setpoints(2, 2), Setpoints(0.3, -0.4), *weights(2))


def states(n: int, count: int = 5) -> Array:
    return np.random.default_rng(7).uniform(-1, 1, (count, 2 * n))


def at(model: mujoco.MjModel, x: Array, **fields: Any) -> mujoco.MjData:
    """MuJoCo's forward dynamics of a model in a state."""
    data, n = mujoco.MjData(model), len(x) // 2
    data.qpos[:], data.qvel[:] = x[:n], x[n:]
    for name, value in fields.items():
        getattr(data, name)[:] = value
    mujoco.mj_forward(model, data)
    return data


def test_inertia_and_bias_are_those_of_lagranges_equations() -> None:
    """h = M' q' - d(q' M q'/2)/dq + dV/dq, less springs and damping; by central differences."""
    robot, model, unit, e = tree(), tree().plant.model, np.eye(N), 1e-5
    damping = np.array([joint.damping[0] for joint in robot.plant.spec.joints])

    def energy(q: Array, dq: Array) -> Array:
        data = at(model, np.append(q, dq))
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        return data.energy.copy()

    for x in states(N):
        q, dq = x[:N], x[N:]
        # (a + b)'M(a + b) - (a - b)'M(a - b) = 4 a'M b, and the energy is half of it.
        twice = [[energy(q, a + b)[1] - energy(q, a - b)[1] for b in unit] for a in unit]
        M = inertia(robot.nominal, q)
        np.testing.assert_allclose(M, np.array(twice) / 2, rtol=0, atol=1e-13)
        ends = [(q + e * row, q - e * row) for row in unit]
        slopes = [
            np.subtract(*(inertia(robot.nominal, q) for q in pair)) / (2 * e) for pair in ends
        ]
        # The springs' energy is part of MuJoCo's potential.
        force = [np.subtract(*(energy(q, 0 * q)[0] for q in pair)) / (2 * e) for pair in ends]
        coriolis = np.einsum("kij,k,j->i", slopes, dq, dq)
        coriolis -= 0.5 * np.einsum("ijk,j,k->i", slopes, dq, dq)
        # The differences' rounding is eps/e of the energy, their curvature e^2.
        expected = coriolis + force + damping * dq
        np.testing.assert_allclose(bias(robot.nominal, q, dq), expected, rtol=0, atol=1e-8)


def test_inertia_and_bias_are_mujocos_with_gravity_compensation_and_fluid() -> None:
    """Bodies are not fused then: a body's own force would be lost."""
    for robot in (
        tree(),
        tree('timestep="0.001"', 'timestep="0.001" density="1000" viscosity="0.1"'),
        tree('name="tool"', 'name="tool" gravcomp="1"'),
    ):
        for x in states(N, 2):
            data, M = at(robot.plant.model, x), np.zeros((N, N))
            expected = data.qfrc_bias - data.qfrc_passive
            np.testing.assert_allclose(
                bias(robot.nominal, x[:N], x[N:]), expected, rtol=0, atol=1e-12
            )
            mujoco.mj_fullM(robot.plant.model, data, M)
            np.testing.assert_allclose(inertia(robot.nominal, x[:N]), M, rtol=0, atol=1e-13)


def test_limits_and_contacts_are_no_part_of_the_nominal_dynamics() -> None:
    """Beyond its limit and within the floor, which a fluid's model keeps as it keeps all geoms."""
    floor = "<worldbody><geom type='plane' size='9 9 1'/>"
    limited = one_joint("range='-1 1' limited='true'")
    for fluid in ("", "<option density='1'/>"):
        robot = Robot.from_mjcf(limited.replace("<worldbody>", fluid + floor))
        for model, constrained in ((robot.plant.model, True), (robot.nominal, False)):
            assert bool(at(model, np.array([1.5, 0.0])).nefc) is constrained


def test_computed_torque_gives_the_acceleration_that_it_is_computed_for() -> None:
    """On the nominal plant, by mj_forward of all bodies: no fused one is missing."""
    law = linearized_lqr(tree_task())
    error, p = law.coordinates, law.parameters
    for x in states(N):
        memory, _kept = law.begin()
        u = np.atleast_1d(law.input_at(0.3, x, memory))
        expected = -p.K @ np.array(error.error_state(0.3, x, p))
        expected += np.array(error.reference(0.3, p.reference))[2::3]
        qacc = at(tree().plant.model, x, qfrc_applied=u).qacc
        # The torques are up to 30 N m, on inertias down to 0.2 kg m^2.
        np.testing.assert_allclose(qacc, expected, rtol=0, atol=1e-12)


def test_error_coordinates_agree_with_the_symbolic_ones() -> None:
    law = tracking_grosmc(two_link_task(), 10.0, 30.0)
    ours, p = law.coordinates, law.parameters
    plant = MujocoPlant.load("two_link_arm")
    theirs = ErrorCoordinates(TWO_LINK_ARM, setpoints(2, 2))
    symbolic = replace(p, plant=plant.analytic().parameters)
    heavier, w = BodyEdit("payload", mass_scale=3.0), np.random.default_rng(1).uniform(-5, 5, 18)
    true, twin = two_link().plant.edited(heavier), plant.edited(heavier).analytic()
    assert (ours.size, ours.units, ours.output_rows) == (4, theirs.units, theirs.output_rows)
    for x in states(2):
        z, u = np.array(ours.error_state(1.0, x, p)), np.random.default_rng(2).normal(0, 5, (1, 2))
        pairs: list[Any] = [
            (z, theirs.error_state(1.0, x, symbolic)),
            *zip(ours.dynamics(1.0, x, p), theirs.dynamics(1.0, x, symbolic), strict=True),
            (ours.place(1.0, z, p), x),
            (ours.along([1.0], x[None], p)[0], z),
        ]
        motions = [
            ours.error_dynamics([1.0], x[None], p, true, w[None], more) for more in (None, u)
        ]
        other = theirs.error_dynamics([1.0], x[None], symbolic, twin, w[None])
        pairs += (pair for motion in motions for pair in zip(motion, other, strict=True))
        for a, b in pairs:
            np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(ours.unmatched(z, motions[0][0][0]), 0, atol=1e-15)


def test_the_design_model_moves_by_mujocos_accelerations() -> None:
    task = replace(tree_task(), error=replace(tree_task().error, sign=-1))
    law, h, u = computed_torque_pd(task, 9.0, 6.0), 1e-3, np.array([0.4, -0.3, 0.2])
    (memory, _kept), moves = law.begin(), design_model(law, "this test")
    for x in states(N):
        moved, qacc = x.copy(), at(tree().plant.model, x, ctrl=u).qacc
        moves.advance(0.3, moved, u, h, memory, law.parameters, moves.own)
        q = x[:N] + h * x[N:] + 0.5 * h**2 * qacc
        np.testing.assert_allclose(moved, [*q, *(x[N:] + h * qacc)], rtol=1e-9)


def test_gears_gains_and_servos_become_torques_in_the_order_of_the_joints() -> None:
    robot = tree()
    system, model = robot.plant.system, robot.plant.model
    assert system.joints == ("turn", "lift", "push")
    assert system.actuators == ("turn_servo", "lift_servo", "push_force")
    units = [signal.unit for signal in (*system.inputs, *system.states)]
    assert units == ["N m", "N m", "N", "rad", "rad", "m", "rad/s", "rad/s", "m/s"]
    limits = [[-30, 30], [-math.inf, math.inf], [-10, 20]]
    np.testing.assert_array_equal(robot.plant.input_limits.T, limits)
    assert np.all(model.actuator_gear[:, 0] == 1)
    text = "\n".join(robot.notes)
    for words in ("position servo (kp 50, kv 5) is left out", "gear -20", "contacts",
                  "velocity servo (kv 9) is left out, torque control without limits"):  # fmt: skip
        assert words in text


def test_joints_that_are_not_named_are_locked_with_their_sensors_and_keyframes() -> None:
    sensors = "".join(f'<jointpos joint="{name}"/>' for name in ("turn", "push"))
    more = f'<sensor>{sensors}</sensor><keyframe><key qpos="0.1 0.2 0.3"/></keyframe></mujoco>'
    robot = Robot.from_mjcf(TREE.replace("</mujoco>", more), joints=["lift", "turn"])
    assert robot.plant.system.joints == ("turn", "lift")
    assert robot.plant.system.actuators == ("turn_servo", "lift_servo")
    assert "locked where the model has them: joints push" in robot.notes
    assert "left out: actuators push_force" in robot.notes
    locked = inertia(tree().nominal, [0.3, -0.2, 0.0])[:2, :2]
    np.testing.assert_allclose(inertia(robot.nominal, [0.3, -0.2]), locked, rtol=0, atol=1e-14)
    model = robot.plant.model
    assert (model.nsensor, model.sensor_objid[0], model.nkey) == (1, model.joint("turn").id, 0)


def test_parts_without_a_name_get_one_that_nothing_has() -> None:
    """The third joint would be called as the first is."""
    named = TREE.replace('"turn"', '"joint3"').replace('<joint name="push" ', "<joint ")
    push = '    <motor name="push_force" joint="push" gear="-20" ctrlrange="-1 0.5"/>\n'
    assert push in named
    model = Robot.from_mjcf(named.replace(push, "")).plant.model
    assert [model.joint(i).name for i in range(N)] == ["joint3", "lift", "joint3_"]
    # A joint without an actuator.
    assert any("no actuator drives push" in note for note in underactuated().notes)
    assert underactuated().underactuated
    assert len(underactuated().plant.input_limits.T) == 2


def underactuated() -> Robot:
    return Robot.from_mjcf(TREE, actuators=["turn_servo", "lift_servo"])


def one_joint(joint: str = "", actuator: str = "<motor joint='j'/>", more: str = "") -> str:
    return (
        f"<mujoco><worldbody><body name='link'><joint name='j' {joint}/>"
        "<geom size='0.1' pos='0.3 0 0'/><site name='s' pos='0.5 0 0'/></body></worldbody>"
        f"<actuator>{actuator}</actuator>{more}</mujoco>"
    )


LINK = ONE.format("", '<motor name="motor" joint="hinge" ctrlrange="-20 20" gear="1"/>')
TENDON = "<tendon><fixed name='t' {}><joint joint='j' coef='1'/></fixed></tendon>"
MODELS: list[tuple[Any, str]] = [
    (one_joint("type='ball'"), "'j' is a ball joint"),
    (one_joint().replace("<joint name='j' />", "<freejoint name='j'/>"), "is a free joint"),
    (one_joint().replace("<joint name='j' />", "").replace("<motor joint='j'/>", ""), "no joi"),
    (one_joint("actuatorgravcomp='true'"), "actuatorgravcomp"),
    (one_joint().replace("size='0.1'", "size='0.1' mass='0'"), "mass and inertia"),
    *((one_joint(actuator=actuator), words) for actuator, words in (
        ("", "no actuator drives 'j': name one with actuators"),
        ("<motor joint='j'/>" * 2, "joint 'j' has 2 actuators"),
        ("<general joint='j' dyntype='integrator'/>", "activation"),
        ("<muscle joint='j' lengthrange='0 1'/>", "is a muscle, which pulls"),
        ("<motor site='s'/>", "acts on a site"),
        ("<adhesion body='link' ctrlrange='0 1'/>", "adhesion"),
        ("<motor jointinparent='j'/>", "parent's frame"),
        ("<damper joint='j' kv='1' ctrlrange='0 1'/>", "depends on the state"),
        ("<motor joint='j' gear='0'/>", "no gear"),
        ("<motor joint='j' armature='1'/>", "belongs to its joint"),
    )),
    (one_joint(actuator="<motor tendon='t'/>", more=TENDON.format("")), "pulls a tendon"),
    (one_joint(more=TENDON.format("damping='2'")), "tendons with stiffness"),
    *((LINK.replace(good, bad), words) for good, bad, words in (
        ('timestep="0.001"', 'timestep="0"', "one: its timestep is 0 s, must lie between"),
        ('"-20 20"', '"-20 inf"', r"actuator_ctrlrange\[0, 1\] = inf must be finite"),
    )),
    ("nowhere.xml", "the MJCF cannot be read: .*nowhere.xml"),
]  # fmt: skip
WRONG_NAMES: list[tuple[dict[str, Any], str]] = [
    ({"actuators": ["lift_serv"]}, "did you mean 'lift_servo'"),
    ({"joints": ["lift", "lift"]}, "named twice"),
    ({"joints": ["lift"], "actuators": ["push_force"]}, "'push_force' drives the joint 'push'"),
    ({"actuators": []}, "no actuator drives"),
]
REFUSED: list[tuple[Callable[[], Any], str]] = [
    *((lambda xml=xml: Robot.from_mjcf(xml), words) for xml, words in MODELS),
    *((lambda names=names: Robot.from_mjcf(TREE, **names), words) for names, words in WRONG_NAMES),
    (lambda: underactuated().task(setpoints(3, 2), Setpoints(0.0, 0.0), np.eye(6), 1.0),
     r"2 torques for 3 joints.*take a state_task"),
    (lambda: linear_lqr(two_link_task()), "no equations in symbols"),
    (lambda: regulating_grosmc(two_link_task(), Uncertainty({}, (1.0,) * 18, (1.0,) * 4, 1.0)),
     "no equations in symbols"),
    (lambda: two_link().plant.analytic(), "no equations in symbols"),
    (lambda: adaptive(two_link_task(), 1.0, 1.0),
     "two_link_arm has no torques Y theta in symbols.*: take lqi, pid or adrc"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), REFUSED, ids=[words for _, words in REFUSED])
def test_no_robot_or_no_design_for_one_is_refused(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((ModelError, ArgumentError, PremiseError), match=words):
        call()
