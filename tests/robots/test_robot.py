"""A robot from its MJCF alone: its dynamics, its laws and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj.arrays import Array
from grosmc_mj.assumptions.balance import balance
from grosmc_mj.control.controller import Controller
from grosmc_mj.control.coordinates.symbolic import ErrorCoordinates
from grosmc_mj.control.design import (
    computed_torque_pd,
    linear_lqr,
    linearized_lqr,
    realized,
    regulating_grosmc,
    tracking_grosmc,
)
from grosmc_mj.control.references import (
    FourierSeries,
    Setpoints,
    fourier_series,
    setpoints,
)
from grosmc_mj.control.switching import find_switching
from grosmc_mj.control.task import Realization, Task
from grosmc_mj.control.uncertainty import Uncertainty
from grosmc_mj.errors import ArgumentError, ModelError, UndefinedLawError
from grosmc_mj.loop.design_model import design_model
from grosmc_mj.physics.edits import AddedMass, BodyEdit
from grosmc_mj.physics.files import load_spec
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.plants import TWO_LINK_ARM
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.disturbances import Disturbance
from grosmc_mj.simulation.simulate import simulate

# A branched tree of hinges and a slide, with all that belongs to the nominal dynamics: armature,
# damping, a spring and a body that does not move against its parent.
TREE = """
<mujoco model="tree">
  <option timestep="0.001"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <joint name="turn" axis="0 0 1" damping="0.3" armature="0.2"/>
      <geom type="box" size="0.1 0.2 0.05" mass="2"/>
      <body name="boom" pos="0.2 0 0">
        <joint name="lift" axis="0 -1 0" damping="0.1" stiffness="3" springref="0.4"/>
        <geom type="capsule" fromto="0 0 0 0.5 0 0.1" size="0.03" mass="1.5"/>
        <body name="tool" pos="0.3 0.1 0" euler="20 30 0">
          <geom type="ellipsoid" size="0.05 0.1 0.07" mass="0.7"/>
        </body>
      </body>
      <body name="tray" pos="-0.1 0.1 0">
        <joint name="push" type="slide" axis="0 1 1" armature="0.1"/>
        <geom type="box" size="0.1 0.02 0.03" pos="0 0 0.1" mass="0.9"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="push_force" joint="push" gear="-20" ctrlrange="-1 0.5"/>
    <position name="turn_servo" joint="turn" kp="50" kv="5" forcerange="-30 30"/>
    <velocity name="lift_servo" joint="lift" kv="9"/>
  </actuator>
</mujoco>
"""
N = 3


@cache
def tree() -> Robot:
    return Robot.from_mjcf(TREE)


@cache
def two_link() -> Robot:
    return Robot.from_mjcf(load_spec("two_link_arm"))


def weights(n: int) -> tuple[Array, Array]:
    return np.kron(np.eye(n), np.diag([100.0, 0.0])), np.eye(n)


@cache
def tree_task() -> Task:
    series = FourierSeries(
        2.0, np.array([0.1, 0.2, 0.0]), np.zeros((N, 1)), np.array([[0.3], [0.2], [0.05]])
    )
    return tree().task(fourier_series(N, 1), series, *weights(N))


@cache
def two_link_law() -> Controller:
    task = two_link().task(setpoints(2, 2), Setpoints(0.3, -0.4), *weights(2))
    return tracking_grosmc(task, 10.0, 30.0)


def states(n: int, count: int = 5) -> Array:
    return np.random.default_rng(7).uniform(-1, 1, (count, 2 * n))


def control(law: Controller, t: float, x: Array) -> Array:
    """What a law asks for in the first sample of a run."""
    memory, _kept = law.begin()
    return np.atleast_1d(law.input_at(t, x, memory))


def energies(model: mujoco.MjModel, q: Array, dq: Array) -> tuple[float, float]:
    """Potential (without springs) and kinetic energy, as MuJoCo's own model has them."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, dq
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    mujoco.mj_energyVel(model, data)
    return float(data.energy[0]), float(data.energy[1])


# --- the dynamics ---


def test_the_inertia_matrix_is_that_of_the_kinetic_energy() -> None:
    robot, model, unit = tree(), tree().plant.model, np.eye(N)
    for x in states(N):
        twice = np.array(
            [
                [energies(model, x[:N], a + b)[1] - energies(model, x[:N], a - b)[1] for b in unit]
                for a in unit
            ]
        )
        # (a + b)'M(a + b) - (a - b)'M(a - b) = 4 a'M b, and the energy is half of each.
        np.testing.assert_allclose(inertia(robot.nominal, x[:N]), twice / 2, rtol=0, atol=1e-13)


def test_the_bias_is_that_of_lagranges_equations() -> None:
    """h = M' q' - d(q' M q'/2)/dq + dV/dq, less springs and damping; by central differences."""
    robot, model, e = tree(), tree().plant.model, 1e-5
    damping = np.array([joint.damping[0] for joint in robot.plant.spec.joints])
    for x in states(N):
        q, dq = x[:N], x[N:]
        ends = [(q + e * row, q - e * row) for row in np.eye(N)]
        slopes = [
            (inertia(robot.nominal, a) - inertia(robot.nominal, b)) / (2 * e) for a, b in ends
        ]
        # The springs' energy is part of MuJoCo's potential.
        potential = [[energies(model, at, 0 * q)[0] for at in pair] for pair in ends]
        force = -np.diff(potential)[:, 0] / (2 * e)
        coriolis = np.einsum("kij,k,j->i", slopes, dq, dq) - 0.5 * np.einsum(
            "ijk,j,k->i", slopes, dq, dq
        )
        # The differences' rounding is eps/e of the energy, their curvature e^2.
        np.testing.assert_allclose(
            bias(robot.nominal, q, dq), coriolis + force + damping * dq, rtol=0, atol=1e-8
        )


def test_computed_torque_gives_the_acceleration_that_it_asks_for() -> None:
    """On the nominal plant, by mj_forward of the whole model: no fused body is missing."""
    law, robot = linearized_lqr(tree_task()), tree()
    model = robot.plant.model
    error, p = law.coordinates, law.parameters
    for x in states(N):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = x[:N], x[N:]
        data.qfrc_applied[:] = control(law, 0.3, x)
        mujoco.mj_forward(model, data)
        wanted = -p.K @ np.array(error.error_state(0.3, x, p))
        raised = np.array(error.reference(0.3, p.reference))[2::3]
        # The torques are up to 30 N m, on inertias down to 0.2 kg m^2.
        np.testing.assert_allclose(data.qacc - raised, wanted, rtol=0, atol=1e-12)


def test_error_coordinates_agree_with_the_symbolic_ones() -> None:
    ours, p = two_link_law().coordinates, two_link_law().parameters
    theirs, plant = (
        ErrorCoordinates(TWO_LINK_ARM, setpoints(2, 2)),
        MujocoPlant.load("two_link_arm"),
    )
    symbolic = replace(p, plant=plant.analytic().parameters)
    heavier = BodyEdit("payload", mass_scale=3.0)
    true, twin = two_link().plant.edited(heavier), plant.edited(heavier).analytic()
    w = np.random.default_rng(1).uniform(-5, 5, 18)
    assert (ours.size, ours.units, ours.output_rows) == (4, theirs.units, theirs.output_rows)
    for x in states(2):
        close: Any = {"rtol": 1e-11, "atol": 1e-12}
        np.testing.assert_allclose(
            ours.error_state(1.0, x, p), theirs.error_state(1.0, x, symbolic), **close
        )
        for mine, other in (
            (ours.dynamics(1.0, x, p), theirs.dynamics(1.0, x, symbolic)),
            (
                ours.error_dynamics([1.0], x[None], p, true, w[None]),
                theirs.error_dynamics([1.0], x[None], symbolic, twin, w[None]),
            ),
        ):
            for a, b in zip(mine, other, strict=True):
                np.testing.assert_allclose(a, b, **close)
        z = np.array(ours.error_state(1.0, x, p))
        np.testing.assert_allclose(ours.place(1.0, z, p), x, **close)
        np.testing.assert_allclose(ours.along([1.0], x[None], p)[0], z, **close)
        (drift,), _ = ours.error_dynamics([1.0], x[None], p, true, w[None])
        np.testing.assert_allclose(ours.unmatched(z, drift), 0, atol=1e-15)


def test_the_acceleration_that_an_input_was_computed_for_is_found_again() -> None:
    law = two_link_law()
    error, p, v = law.coordinates, law.parameters, np.array([1.5, -0.7])
    memory, _kept = law.begin()
    for x in states(2):
        u, back = np.zeros(2), np.zeros(2)
        error.feedback(0.3, x, v, memory, p, u)
        error.virtual_input(0.3, x, u, memory, p, back)
        np.testing.assert_allclose(back, v, rtol=1e-10)


def test_the_design_model_moves_by_mujocos_accelerations() -> None:
    """Of a law that steers against a moving reference, and whose error is reversed."""
    task = replace(tree_task(), error=replace(tree_task().error, sign=-1))
    law, h = computed_torque_pd(task, 9.0, 6.0), 1e-3
    (memory, _kept), moves = law.begin(), design_model(law, "this test")
    model = tree().plant.model
    data, u = mujoco.MjData(model), np.array([0.4, -0.3, 0.2])
    for x in states(N):
        data.qpos[:], data.qvel[:], data.ctrl[:] = x[:N], x[N:], u
        mujoco.mj_forward(model, data)
        moved = x.copy()
        moves.advance(0.3, moved, u, h, memory, law.parameters, moves.own)
        q = x[:N] + h * x[N:] + 0.5 * h**2 * data.qacc
        np.testing.assert_allclose(moved, [*q, *(x[N:] + h * data.qacc)], rtol=1e-9)


def test_the_balance_of_the_reaching_condition_takes_a_robot() -> None:
    law, x = two_link_law(), states(2)[0]
    nominal = balance(law, two_link().plant, 0.0, x, np.zeros(18))
    assert nominal.gain_ratio == pytest.approx(1.0)
    assert nominal.push < 1e-10
    assert nominal.configured == 30.0


# --- runs ---


@pytest.mark.slow
def test_both_engines_run_the_same_law() -> None:
    law = realized(tracking_grosmc(tree_task(), 5.0, 20.0), Realization(find_switching("implicit")))
    true = tree().plant.edited(AddedMass("tool", 0.5, (0.1, 0.0, 0.0)))
    push = [Disturbance("tool", (3.0, 0.0, -2.0, 0.0, 0.1, 0.0))]
    runs = [
        simulate(true, law, np.zeros(2 * N), duration=0.5, disturbances=push, engine=engine)
        for engine in ("native", "python")
    ]
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    np.testing.assert_array_equal(runs[0].command, runs[1].command)
    assert runs[0].sliding is not None
    assert np.abs(runs[0].sliding).max() < 0.1


ONE = """
<mujoco model="one"><option timestep="0.001" integrator="RK4"/><worldbody><body name="link">
<joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge" ctrlrange="-20 20" gear="1"/></actuator></mujoco>
"""


@cache
def one() -> Robot:
    return Robot.from_mjcf(ONE)


BROKEN = [
    ('timestep="0.001"', 'timestep="0"', "one: its timestep is 0 s, must lie between"),
    ('timestep="0.001"', 'timestep="1e9"', r"timestep is 1e\+09 s"),
    ('gear="1"', 'gear="nan"', r"actuator_gear\[0, 0\] = nan must be finite"),
    ('"-20 20"', '"-20 inf"', r"actuator_ctrlrange\[0, 1\] = inf must be finite"),
    ('damping="0.1"', 'damping="nan"', r"dof_damping\[0\] = nan must be finite"),
    ('mass="1"', 'mass="inf"', "one: .*'link'"),
    ('timestep="0.001"', 'gravity="0 0 nan"', r"gravity\[2\] = nan must be finite"),
]


@pytest.mark.parametrize(("good", "bad", "said"), BROKEN)
def test_a_number_that_nobody_can_simulate_is_refused_with_its_owner(
    good: str, bad: str, said: str
) -> None:
    assert good in ONE
    with pytest.raises(ModelError, match=said) as told:
        Robot.from_mjcf(ONE.replace(good, bad))
    assert "\n" not in str(told.value)


def test_a_law_without_its_workspace_is_undefined_and_touches_no_memory() -> None:
    law = two_link_law()
    memory = law.memory()
    assert np.all(np.array(law.input_at(0.0, np.zeros(4), memory)) == 0)
    assert memory.undefined == 1
    with pytest.raises(UndefinedLawError):
        simulate(two_link().plant, replace(law, design=None), np.zeros(4), duration=0.01)


def two_link_law_task() -> Task:
    return two_link().task(setpoints(2, 2), Setpoints(0.3, -0.4), *weights(2))


# --- what is converted ---


def test_gears_gains_and_servos_become_torques_in_the_order_of_the_joints() -> None:
    robot = tree()
    system, model = robot.plant.system, robot.plant.model
    assert system.joints == ("turn", "lift", "push")
    assert system.actuators == ("turn_servo", "lift_servo", "push_force")
    assert [signal.unit for signal in system.inputs] == ["N m", "N m", "N"]
    assert [signal.unit for signal in system.states] == ["rad", "rad", "m", "rad/s", "rad/s", "m/s"]
    np.testing.assert_array_equal(
        robot.plant.input_limits.T, [[-30, 30], [-math.inf, math.inf], [-10, 20]]
    )
    assert np.all(model.actuator_gear[:, 0] == 1)
    text = "\n".join(robot.notes)
    assert "position servo (kp 50, kv 5) is left out" in text
    assert "velocity servo (kv 9) is left out, torque control without limits" in text
    assert "gear -20" in text
    assert "contacts" in text


def test_joints_that_are_not_named_are_locked() -> None:
    robot = Robot.from_mjcf(TREE, joints=["lift", "turn"])
    assert robot.plant.system.joints == ("turn", "lift")
    assert robot.plant.system.actuators == ("turn_servo", "lift_servo")
    assert "locked where the model has them: joints push" in robot.notes
    assert "left out: actuators push_force" in robot.notes
    q = [0.3, -0.2]
    locked = inertia(tree().nominal, [*q, 0.0])[:2, :2]
    np.testing.assert_allclose(inertia(robot.nominal, q), locked, rtol=0, atol=1e-14)


def test_what_a_model_says_of_a_joint_that_is_left_out_goes_with_it() -> None:
    """Its sensors, and keyframes, which have a number for each joint."""
    sensors = "".join(f'<jointpos joint="{name}"/>' for name in ("turn", "push"))
    more = f'<sensor>{sensors}</sensor><keyframe><key qpos="0.1 0.2 0.3"/></keyframe></mujoco>'
    model = Robot.from_mjcf(TREE.replace("</mujoco>", more), joints=["lift", "turn"]).plant.model
    assert (model.nsensor, model.sensor_objid[0], model.nkey) == (1, model.joint("turn").id, 0)


def test_parts_without_a_name_get_one_that_nothing_has() -> None:
    """The third joint would be called as the first is."""
    named = TREE.replace('"turn"', '"joint3"').replace('<joint name="push" ', "<joint ")
    push = '    <motor name="push_force" joint="push" gear="-20" ctrlrange="-1 0.5"/>\n'
    assert push in named
    model = Robot.from_mjcf(named.replace(push, "")).plant.model
    assert [model.joint(i).name for i in range(N)] == ["joint3", "lift", "joint3_"]


def test_gravity_compensation_and_fluid_are_part_of_the_nominal_dynamics() -> None:
    """Bodies are not fused then: a body's own force would be lost."""
    for changed in (
        TREE.replace('name="tool"', 'name="tool" gravcomp="1"'),
        TREE.replace('timestep="0.001"', 'timestep="0.001" density="1000" viscosity="0.1"'),
    ):
        robot = Robot.from_mjcf(changed)
        model = robot.plant.model
        for x in states(N, 2):
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = x[:N], x[N:]
            mujoco.mj_forward(model, data)
            whole = data.qfrc_bias - data.qfrc_passive
            np.testing.assert_allclose(bias(robot.nominal, x[:N], x[N:]), whole, rtol=0, atol=1e-12)


def test_limits_and_contacts_are_no_part_of_the_nominal_dynamics() -> None:
    """Beyond its limit and within the floor, which a fluid's model keeps as it keeps all geoms."""
    floor = "<worldbody><geom type='plane' size='9 9 1'/>"
    for fluid in ("", "<option density='1'/>"):
        xml = one_joint("range='-1 1' limited='true'").replace("<worldbody>", fluid + floor)
        robot = Robot.from_mjcf(xml)
        for model, constrained in ((robot.plant.model, True), (robot.nominal, False)):
            data = mujoco.MjData(model)
            data.qpos[:] = 1.5
            mujoco.mj_forward(model, data)
            assert bool(data.nefc) is constrained


# --- what is refused ---


def one_joint(joint: str = "", actuator: str = "<motor joint='j'/>", more: str = "") -> str:
    return (
        f"<mujoco><worldbody><body name='link'><joint name='j' {joint}/>"
        "<geom size='0.1' pos='0.3 0 0'/><site name='s' pos='0.5 0 0'/></body></worldbody>"
        f"<actuator>{actuator}</actuator>{more}</mujoco>"
    )


TENDON = "<tendon><fixed name='t' {}><joint joint='j' coef='1'/></fixed></tendon>"


@pytest.mark.parametrize(
    ("xml", "message"),
    [
        (one_joint("type='ball'"), "'j' is a ball joint"),
        (one_joint().replace("<joint name='j' />", "<freejoint name='j'/>"), "is a free joint"),
        (one_joint(actuator=""), "no actuator drives 'j': name one with actuators"),
        (one_joint(actuator="<motor joint='j'/>" * 2), "joint 'j' has 2 actuators"),
        (one_joint(actuator="<general joint='j' dyntype='integrator'/>"), "activation"),
        (one_joint(actuator="<muscle joint='j' lengthrange='0 1'/>"), "is a muscle, which pulls"),
        (one_joint(actuator="<motor tendon='t'/>", more=TENDON.format("")), "pulls a tendon"),
        (one_joint(actuator="<motor site='s'/>"), "acts on a site"),
        (one_joint(actuator="<adhesion body='link' ctrlrange='0 1'/>"), "adhesion"),
        (one_joint(actuator="<motor jointinparent='j'/>"), "parent's frame"),
        (one_joint(actuator="<damper joint='j' kv='1' ctrlrange='0 1'/>"), "depends on the state"),
        (one_joint(actuator="<motor joint='j' gear='0'/>"), "no gear"),
        (one_joint(actuator="<motor joint='j' armature='1'/>"), "belongs to its joint"),
        (one_joint("actuatorgravcomp='true'"), "actuatorgravcomp"),
        *(
            (one_joint(more=TENDON.format(numbers)), "tendons with stiffness")
            for numbers in ("damping='2'", "limited='true' range='-1 1'")
        ),
        (one_joint().replace("<joint name='j' />", "").replace("<motor joint='j'/>", ""), "no joi"),
        (one_joint().replace("size='0.1'", "size='0.1' mass='0'"), "mass and inertia"),
        ("<mujoco><nonsense/></mujoco>", "cannot be read"),
        ("nowhere.xml", "the MJCF cannot be read: .*nowhere.xml"),
        (mujoco.MjModel.from_xml_string(one_joint()), "a MjModel cannot be edited"),
        (3, "a int cannot be edited"),
    ],
)
def test_refused_with_the_reason(xml: Any, message: str) -> None:
    with pytest.raises(ModelError, match=message) as refused:
        Robot.from_mjcf(xml)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"joints": ["lif"]}, "did you mean 'lift'"),
        ({"actuators": ["lift_serv"]}, "did you mean 'lift_servo'"),
        ({"joints": ["lift", "lift"]}, "named twice"),
        ({"joints": ["lift"], "actuators": ["push_force"]}, "'push_force' drives the joint 'push'"),
        ({"actuators": []}, "no actuator drives"),
    ],
)
def test_wrong_names_are_told_with_the_nearest(names: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Robot.from_mjcf(TREE, **names)


def test_a_joint_without_an_actuator_is_told_and_cannot_be_led() -> None:
    robot = Robot.from_mjcf(TREE, actuators=["turn_servo", "lift_servo"])
    assert any("no actuator drives push" in said for said in robot.notes)
    assert robot.underactuated
    assert len(robot.plant.input_limits.T) == 2
    with pytest.raises(ModelError, match=r"2 torques for 3 joints.*take a state_task"):
        robot.task(setpoints(3, 2), Setpoints(0.0, 0.0), np.eye(6), 1.0)


def test_designs_that_need_symbols_say_so() -> None:
    task = two_link_law_task()
    with pytest.raises(ArgumentError, match="no equations in symbols"):
        linear_lqr(task)
    with pytest.raises(ArgumentError, match="no equations in symbols"):
        regulating_grosmc(task, Uncertainty({}, (1.0,) * 18, (1.0,) * 4, 1.0))
    with pytest.raises(ModelError, match="no equations in symbols"):
        two_link().plant.analytic().derivative(np.zeros(4))
