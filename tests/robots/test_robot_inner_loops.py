"""Robots whose MJCF has inner controllers, servos behind lags, or coupled joints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from grosmc_mj import cli
from grosmc_mj.arrays import Array
from grosmc_mj.control.design import tracking_grosmc
from grosmc_mj.control.references import Setpoints, setpoints
from grosmc_mj.errors import ModelError
from grosmc_mj.physics.edits import AddedMass
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.dynamics import bias, inertia
from grosmc_mj.robots.robot import Robot
from grosmc_mj.simulation.simulate import simulate

ONE = """<mujoco model="one"><option timestep="0.001" integrator="implicitfast"/>
<worldbody><body name="link"><joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator>{}</actuator></mujoco>"""
MOTOR = (
    '<dcmotor name="drive" joint="hinge" motorconst="0.05" resistance="2" inductance="0.01" '
    'gear="{gear}" {more}/>'
)
K, R, GEAR, SUPPLY = 0.05, 2.0, 50.0, 24.0
# Proportional, integral, derivative, slew rate, clamp of the integral, supply.
INNER = {
    "position": 'input="pos" controller="3 2 1 7 4 24" ctrlrange="-1 1"',
    "velocity": 'input="vel" controller="0 0 2 0 0 24" ctrlrange="-1 1"',
    "both": 'input="pos vel ff" controller="3 0 1 0 0 24"',
    "current": 'input="ff" controller="0 0 0 0 0 24"',
}
HEAVY = AddedMass("link", 1e9, (0.0, 0.0, 0.5))


def motor(more: str, gear: float = GEAR) -> str:
    return ONE.format(MOTOR.format(more=more, gear=gear))


def torques(plant: MujocoPlant, u: float, steps: int, q: float = 0.0, v: float = 0.0) -> Array:
    """Torque of the drive at the hinge, held at a place and speed, after each step."""
    model, rows = plant.model, []
    data = mujoco.MjData(model)
    data.ctrl[0] = u
    for _ in range(steps):
        data.qpos[0], data.qvel[0] = q, v
        mujoco.mj_step(model, data)
        rows.append(data.qfrc_actuator[0])
    return np.array(rows)


# --- DC motors with inner controllers ---


@pytest.mark.parametrize("inner", INNER.values(), ids=list(INNER))
@pytest.mark.parametrize("gear", [GEAR, -GEAR])
def test_the_inner_controller_goes_and_motor_and_driver_stay(inner: str, gear: float) -> None:
    """The torque that is asked for, wherever the joint is, as far as the supply holds it."""
    built = Robot.from_mjcf(motor(inner, gear)).built.edited(HEAVY)
    assert built.model.na == 1
    for q, v in ((0.0, 0.0), (0.7, 0.0), (0.7, 4.0), (-0.2, -4.0)):
        assert torques(built, 2.0, 400, q, v)[-1] == pytest.approx(2.0, rel=1e-6)
    v = 8.0
    holds = GEAR * K * (SUPPLY - K * GEAR * v) / R
    assert torques(built, 20.0, 400, v=v)[-1] == pytest.approx(holds, rel=1e-6)
    # The winding is the model's: L/R.
    left = 1 - torques(built, 1.0, 20)
    np.testing.assert_allclose(left[1:] / left[:-1], math.exp(-1e-3 * R / 0.01), rtol=1e-6)


def test_a_supply_beside_an_input_in_volts_limits_nothing_as_in_mujoco() -> None:
    made = Robot.from_mjcf(motor('controller="0 0 0 0 0 24"'))
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-np.inf, np.inf]])
    assert torques(made.built.edited(HEAVY), 100.0, 400)[-1] == pytest.approx(100.0, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("position", "instead of the inner position controller (kp 3, ki 2, kd 1)"),
        ("velocity", "instead of the inner velocity controller (kd 2)"),
        ("current", "torque control within [-30, 30] N m"),
    ],
)
def test_what_was_replaced_is_told(name: str, said: str) -> None:
    made = Robot.from_mjcf(motor(INNER[name]))
    assert "has a DC motor with a driver of its current within 24 V, which no" in made.notes[0]
    assert said in made.notes[0]
    assert made.plant.model.na == 0


FRICTION = 'cogging="0.01 6 0.2" lugre="100 1 0.02 0.03 0.01" saturation="0.5 0 2000"'


@pytest.mark.parametrize("gear", [30.0, -30.0])
@pytest.mark.parametrize("inner", ["", 'input="ff" controller="0 0 0 0 0 24"'])
def test_a_motor_at_its_joint_moves_it_as_the_models_own_did(inner: str, gear: float) -> None:
    """With cogging, bristles and all limits; once asked in the model's unit, once in N m."""
    text = motor(f"{FRICTION} {inner}", gear)
    original = mujoco.MjModel.from_xml_string(text)
    unit = gear if inner else gear * K / R
    built, runs = Robot.from_mjcf(text).built.model, []
    for model, factor in ((original, 1 / unit), (built, 1.0)):
        data, rows = mujoco.MjData(model), []
        for step in range(800):
            data.ctrl[0] = factor * 12 * math.sin(0.02 * step)
            mujoco.mj_step(model, data)
            rows.append((data.qpos[0], data.qvel[0], data.qfrc_actuator[0]))
        runs.append(np.array(rows))
    assert np.abs(runs[0][:, 0]).max() > 0.1
    np.testing.assert_allclose(runs[1], runs[0], rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("inner", ["", *INNER.values()], ids=["voltage", *INNER])
def test_a_negative_gear_gives_the_same_torque_to_the_bit(inner: str) -> None:
    """The motor turns the other way and so does its current: what is asked for is torque."""
    plants = [Robot.from_mjcf(motor(inner, gear)).built for gear in (GEAR, -GEAR)]
    runs = []
    for plant in plants:
        data, rows = mujoco.MjData(plant.model), []
        for step in range(500):
            data.ctrl[0] = 5 * math.sin(0.03 * step)
            mujoco.mj_step(plant.model, data)
            rows.append((data.qpos[0], data.qvel[0], data.qfrc_actuator[0]))
        runs.append(np.array(rows))
    np.testing.assert_array_equal(runs[0], runs[1])


# --- servos behind lags ---

POSITION = (
    '<position name="drive" joint="hinge" kp="30" kv="2" timeconst="0.02" gear="2" '
    'ctrlrange="-1 1" forcerange="-4 4"/>'
)


def test_a_servo_behind_a_lag_is_torque_behind_that_lag() -> None:
    made = Robot.from_mjcf(ONE.format(POSITION))
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-8, 8]])
    assert made.plant.model.na == 0
    # Neither its place nor its speed pulls, and a torque of 5 is not a place beyond 1.
    for q, v in ((0.0, 0.0), (0.6, 3.0)):
        found = torques(made.built, 5.0, 600, q, v)
        assert found[-1] == pytest.approx(5.0, rel=1e-9)
        np.testing.assert_allclose(
            (5 - found[1:20]) / (5 - found[:19]), math.exp(-1e-3 / 0.02), rtol=1e-9
        )
    assert torques(made.built, 100.0, 600)[-1] == 8
    assert made.notes[0] == (
        "actuator 'drive': the plant has a lag of 0.02 s, which no law knows; torque control "
        "within [-8, 8] N m instead of the position servo (kp 30, kv 2)"
    )


def test_limits_of_a_servos_activation_are_places_and_no_torques() -> None:
    text = POSITION.replace('timeconst="0.02"', "").replace("<position", "<general")
    text = text.replace('kp="30" kv="2"', 'gainprm="30" biastype="affine" biasprm="0 -30 -2"')
    lagging = 'dyntype="filterexact" dynprm="0.02" actlimited="true" actrange="-0.1 0.1" />'
    made = Robot.from_mjcf(ONE.format(text.replace("/>", lagging)))
    np.testing.assert_array_equal(made.plant.input_limits.T, [[-8, 8]])
    assert torques(made.built, 7.0, 600)[-1] == pytest.approx(7.0, rel=1e-9)


@pytest.mark.parametrize(
    "actuator",
    [
        '<intvelocity name="drive" joint="hinge" kp="30" actrange="-1 1"/>',
        '<pid name="drive" joint="hinge" kp="30" ki="4" kv="2"/>',
        '<pid name="drive" joint="hinge" kp="30" kv="2" delay="0.01" nsample="12"/>',
        '<intvelocity name="d" joint="hinge" kp="30" actrange="-1 1" delay="0.01" nsample="12"/>',
    ],
)
def test_servos_with_integrals_lose_them(actuator: str) -> None:
    made = Robot.from_mjcf(ONE.format(actuator))
    assert "position servo (kp 30" in made.notes[0]
    for plant in (made.plant, made.built):
        assert plant.model.na == 0
        assert torques(plant, 3.0, 30, q=0.4, v=1.0)[-1] == pytest.approx(3.0, rel=1e-12)


# --- coupled joints ---

TWO = """<mujoco model="two"><option timestep="0.001" integrator="implicitfast"/><worldbody>
<body name="a"><joint name="first" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.5" mass="1"/></body>
<body name="b" pos="0 1 0"><joint name="second" axis="0 1 0"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 -0.3" mass="2"/></body></worldbody>
<actuator><motor name="one" joint="first"/>{}</actuator><equality>{}</equality></mujoco>"""
SECOND = '<motor name="two" joint="second"/>'
COUPLED = '<joint joint1="first" joint2="second" polycoef="0 2 0 0 0" {}/>'
KINDS = {"stiff": COUPLED.format(""), "compliant": COUPLED.format('solref="-40 -2"')}


@pytest.mark.parametrize("coupled", KINDS.values(), ids=list(KINDS))
def test_coupled_joints_are_the_plants_and_no_laws(coupled: str) -> None:
    text = TWO.format(SECOND, coupled)
    made, free = Robot.from_mjcf(text), Robot.from_mjcf(TWO.format(SECOND, ""))
    assert made.plant.model.neq == made.nominal.neq == 0
    assert made.built.model.neq == 1
    assert made.notes == (
        "the plant couples the joints 'first' and 'second' (equality), which no law knows: laws "
        "move each on its own",
        *free.notes,
    )
    q, dq = [0.2, -0.4], [1.0, 0.3]
    np.testing.assert_array_equal(inertia(made.nominal, q), inertia(free.nominal, q))
    np.testing.assert_array_equal(bias(made.nominal, q, dq), bias(free.nominal, q, dq))
    original, runs = mujoco.MjModel.from_xml_string(text), []
    for model in (original, made.built.model, made.plant.model):
        data, rows = mujoco.MjData(model), []
        for step in range(500):
            data.ctrl[:] = math.sin(0.01 * step), 0.0
            mujoco.mj_step(model, data)
            rows.append(data.qpos.copy())
        runs.append(np.array(rows))
    np.testing.assert_array_equal(runs[0], runs[1])
    slip = np.abs(runs[1][:, 0] - 2 * runs[1][:, 1]).max()
    free_slip = np.abs(runs[2][:, 0] - 2 * runs[2][:, 1]).max()
    assert slip < 0.5 * free_slip
    if coupled == KINDS["stiff"]:
        assert slip < 0.01 * free_slip


def test_both_engines_run_a_coupled_plant_alike_and_a_law_holds_what_agrees_with_it() -> None:
    made = Robot.from_mjcf(TWO.format(SECOND, KINDS["compliant"]))
    weights = np.diag([100.0, 0.0, 100.0, 0.0])
    task = made.task(setpoints(2, 2), Setpoints(0.4, 0.2), weights, 1.0)
    law = tracking_grosmc(task, 10, 5)
    runs = [
        simulate(made.built, law, np.zeros(4), duration=0.2, control_period=2e-3, engine=engine)
        for engine in ("native", "python")
    ]
    np.testing.assert_array_equal(runs[0].state, runs[1].state)
    # What the plant is coupled to is what the law leads it to.
    end = simulate(made.built, law, np.zeros(4), duration=4.0, control_period=2e-3).state[-1]
    np.testing.assert_allclose(end[:2], [0.4, 0.2], atol=0.02)


@pytest.mark.parametrize(
    ("constraint", "said"),
    [
        ('<connect body1="a" body2="b" anchor="0 0 0"/>', r"constraints \(connect\): they close"),
        ('<weld body1="a" body2="b"/>', r"constraints \(weld\): they close loops"),
    ],
)
def test_closed_loops_are_refused_in_one_line(constraint: str, said: str) -> None:
    with pytest.raises(ModelError, match=said) as told:
        Robot.from_mjcf(TWO.format(SECOND, constraint))
    assert "\n" not in str(told.value)
    off = constraint.replace("/>", ' active="false"/>')
    made = Robot.from_mjcf(TWO.format(SECOND, off))
    assert made.built is made.plant


def test_a_joint_that_only_its_coupling_moves_is_refused_and_may_be_left_out() -> None:
    text = TWO.format("", KINDS["stiff"])
    with pytest.raises(ModelError, match=r"joint 'second' is coupled .* leave it out of joints"):
        Robot.from_mjcf(text)
    made = Robot.from_mjcf(text, joints=["first"])
    assert made.built is made.plant
    assert "left out: the coupling (equality) of 'first' and 'second'" in made.notes


def test_one_joint_may_be_held() -> None:
    held = '<joint joint1="first" polycoef="0.1 0 0 0 0" solref="-40 -2"/>'
    made = Robot.from_mjcf(TWO.format(SECOND, held))
    assert made.notes[0].startswith("the plant holds the joint 'first' (equality), which no")


CASE = """
[plant]
model = "arm.xml"
[run]
start = { hinge = "0.1 rad" }
duration = "0.1 s"
[task]
reference = ["0.3"]
Q = [100, 0]
R = 1
[[controller]]
law = "grosmc"
k = 10
epsilon = 5
"""


@pytest.mark.parametrize("actuator", [MOTOR.format(more=INNER["position"], gear=-50), POSITION])
def test_a_file_runs_and_tells_what_no_law_knows(
    actuator: str, tmp_path: Path, capsys: pytest.CaptureFixture[Any]
) -> None:
    (tmp_path / "arm.xml").write_text(ONE.format(actuator), encoding="utf-8")
    file = tmp_path / "case.toml"
    file.write_text(CASE, encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        cli.main(["run", str(file), "--out", str(tmp_path)])
    assert stop.value.code == 0
    assert "which no law knows; torque control" in " ".join(capsys.readouterr().out.split())
