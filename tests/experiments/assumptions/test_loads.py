"""Notes on loads: wrenches that move no joint, and loads that no input matches."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from case_texts import LEG_MODEL, short_run, short_step
from mjcf import TREE

from grosmc_mj.experiments.assumptions.audit import run_audit
from grosmc_mj.experiments.assumptions.loads import idle_loads
from grosmc_mj.experiments.assumptions.matching import unmatched
from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.ground.arrays import Array
from grosmc_mj.mechanics.physics.mujoco_plant import MujocoPlant
from grosmc_mj.mechanics.physics.wrenches import generalized_forces, joint_axes
from grosmc_mj.mechanics.robots.robot import Robot

# A motor that turns a load: the voltage acts on the current alone.
MOTOR = """
import sympy as sp
import grosmc_mj as gm
q, w, i = sp.symbols("angle speed current")
k, R = sp.symbols("k R")
def motor():
    return gm.affine_plant(
        "motor", states={"angle": "rad", "speed": "rad/s", "current": "A"},
        inputs={"voltage": "V"}, f=[w, k * i - w, -R * i - 3 * w], g=[0, 0, 50], h=[q],
        parameters={"k": 5, "R": 50},
    )
"""
OWN = """
[plant]
plant = "own:motor"
[run]
duration = "0.1 s"
engine = "python"
[task]
Q = [100, 1, 1]
R = 1
[[controller]]
law = "{law}"
{load}
"""
TRANSMISSION = """
[[transmission]]
joint = "shaft"
inertia = "2e-3 kg m^2"
stiffness = "100 N m/rad"
"""
LEG = """
[plant]
model = "leg.xml"
[run]
start = {{ hip = "10 deg" }}
duration = "0.05 s"
engine = "python"
[task]
Q = {{ hip = 100, knee = 100 }}
R = 1
[[controller]]
law = "lqr"
[[disturbance]]
body = "shank"
{wrench}
"""


def servo(wrench: str, plant: str = "physics") -> str:
    """Servo under a wrench on its rotor."""
    return short_step(plant=plant) + f'[[disturbance]]\nbody = "rotor"\n{wrench}\n'


def lines(folder: Path, text: str) -> tuple[list[str], list[str]]:
    """Notes on idle and on unmatched loads of a case file."""
    (folder / "own.py").write_text(MOTOR, encoding="utf-8")
    (folder / "leg.xml").write_text(LEG_MODEL, encoding="utf-8")
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    experiment = Experiment.load(path)
    runs = list(experiment.runs())
    return idle_loads(runs), unmatched(experiment, runs)


ACTS = 'torque = ["0 N m", "0.1 N m", "0 N m"]'
IDLE = 'torque = ["0 N m", "0 N m", "0.1 N m"]'
BOTH = 'torque = ["0 N m", "0.1 N m", "0.1 N m"]'
NOTHING = "the torque about z on rotor moves no joint: the disturbance does nothing"
PART = "the torque about z on rotor moves no joint: the rest of the disturbance acts"


@pytest.mark.parametrize("machine", ["", TRANSMISSION])
@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(
    ("wrench", "expected"),
    [(ACTS, []), (IDLE, [NOTHING]), (BOTH, [PART]), ('torque = ["0 N m", "0 N m", "0 N m"]', [])],
)
def test_a_torque_across_the_axis_of_the_rotor_moves_no_joint(
    tmp_path, plant, machine, wrench, expected
) -> None:
    idle, _ = lines(tmp_path, servo(wrench, plant) + machine)
    assert idle == expected


@pytest.mark.parametrize(
    ("wrench", "expected"),
    [
        ('force = ["0 N", "0 N", "1 N"]', []),
        (
            'force = ["0 N", "1 N", "0 N"]',
            ["the force along y on shank moves no joint: the disturbance does nothing"],
        ),
        (
            'torque = ["1 N m", "0 N m", "1 N m"]',
            [
                "the torque about x and the torque about z on shank move no joint: the "
                "disturbance does nothing"
            ],
        ),
    ],
)
def test_a_wrench_out_of_the_plane_of_a_robot_moves_no_joint(tmp_path, wrench, expected) -> None:
    idle, _ = lines(tmp_path, LEG.format(wrench=wrench))
    assert idle == expected


def test_a_pulse_after_the_run_is_no_load_of_it(tmp_path) -> None:
    pulse = f'{IDLE}\nprofile = "pulse"\nstart = "5 s"\nstop = "6 s"'
    assert lines(tmp_path, servo(pulse)) == ([], [])


def test_generalized_forces_are_the_work_of_a_wrench_on_small_motions() -> None:
    """Jᵀ w = dW/dq: the places of the centre of mass differ by h J e along each joint."""
    plant = Robot.from_mjcf(TREE).plant
    x = np.array([0.3, -0.4, 0.1, 0.0, 0.0, 0.0])
    (effects,) = generalized_forces(plant, "tool", [x])
    h = 1e-6
    slopes = []
    for joint in range(3):
        moved = [x + sign * h * np.eye(6)[joint] for sign in (1, -1)]
        places = [_centre(plant, state, "tool") for state in moved]
        slopes.append((places[0] - places[1]) / (2 * h))
    # Central differences: rounding over h.
    np.testing.assert_allclose(effects[:, :3], slopes, atol=1e-9)


def _centre(plant: MujocoPlant, x: Array, body: str) -> Array:
    """Place of a body's centre of mass by MuJoCo's kinematics."""
    data = mujoco.MjData(plant.model)
    data.qpos[:] = x[:3]
    mujoco.mj_forward(plant.model, data)
    return data.body(body).xipos.copy()


def test_axes_of_joints_turn_with_their_bodies() -> None:
    """The lift turns about the boom's -y, which the base turns about z."""
    plant = Robot.from_mjcf(TREE).plant
    turn = 0.5
    axes = joint_axes(plant, [turn, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(axes["turn"], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(axes["lift"], [np.sin(turn), -np.cos(turn), 0], atol=1e-12)


LOAD_ON_SPEED = '[[disturbance]]\nstate = "speed"\namplitude = "4 rad/s^2"'
LOAD_ON_CURRENT = '[[disturbance]]\nstate = "current"\namplitude = "4 A/s"'
LOAD_ON_INPUT = '[[disturbance]]\ninput = "voltage"\namplitude = "1 V"'


@pytest.mark.parametrize("law", ["lqr", "fl-lqr"])
@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (
            LOAD_ON_SPEED,
            [
                "the load on speed is unmatched: no switching term rejects it (up to 4 rad/s^2 in "
                "z' where no input acts)"
            ],
        ),
        (LOAD_ON_CURRENT, []),
        (LOAD_ON_INPUT, []),
    ],
)
def test_a_load_of_a_plant_of_ones_own_is_matched_where_its_input_acts(
    tmp_path, law, load, expected
) -> None:
    idle, not_matched = lines(tmp_path, OWN.format(law=law, load=load))
    assert idle == []
    assert not_matched == expected


ON_CURRENT = '[[disturbance]]\ninput = "current"\namplitude = "1 A"\n'
ON_HIP = 'force = ["0 N", "0 N", "0 N"]\n[[disturbance]]\ninput = "hip"\namplitude = "1 N m"'


@pytest.mark.parametrize(
    "text",
    [
        short_step("grosmc", "corrected") + ON_CURRENT,
        short_step("grosmc", "physics") + ON_CURRENT,
        short_step("lqr", "physics") + ON_CURRENT,
        LEG.format(wrench=ON_HIP),
    ],
    ids=["equations", "GROSMC in MuJoCo", "LQR in MuJoCo", "a robot"],
)
def test_a_disturbance_of_an_input_is_matched_on_every_plant(tmp_path, text) -> None:
    assert lines(tmp_path, text) == ([], [])


@pytest.mark.parametrize(("load", "holds"), [(LOAD_ON_SPEED, False), (LOAD_ON_INPUT, True)])
def test_a_load_where_no_input_acts_breaks_the_premise_of_matching(tmp_path, load, holds) -> None:
    (tmp_path / "own.py").write_text(MOTOR, encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(OWN.format(law="fl-lqr", load=load), encoding="utf-8")
    audit = run_audit(Experiment.load(path).run())
    (matching,) = [premise for premise in audit.premises if premise.name == "matching"]
    assert matching.region is not None
    assert matching.along is not None
    assert (matching.region.margin >= 0) is holds
    assert (matching.along.margin >= 0) is holds


@pytest.mark.parametrize(("parameter", "matched"), [("R", True), ("k", False)])
def test_a_change_of_a_plant_of_ones_own_is_matched_where_its_input_acts(
    tmp_path, parameter, matched
) -> None:
    """The winding's resistance acts where the voltage does; the torque constant on the speed."""
    edit = f'[run.start]\ncurrent = "1 A"\n[[edit]]\nparameter = "{parameter}"\nscale = 1.1'
    _, not_matched = lines(tmp_path, OWN.format(law="fl-lqr", load=edit))
    change = "the difference of the plant from the one that laws know is unmatched"
    assert [line.partition(":")[0] for line in not_matched] == [change] * (not matched)


@pytest.mark.parametrize(
    ("law", "body", "matched"),
    [
        ("grosmc", "pole", True),
        ("cart-ism", "pole", False),
        ("cart-ism", "cart", True),
    ],
)
def test_a_force_on_the_pole_is_matched_for_its_angle_and_not_for_all_states(
    tmp_path, law, body, matched
) -> None:
    cart = short_run("cart_pendulum", '"pole angle" = "2 deg"', "0.05 s", law=law, engine="python")
    force = f'[[disturbance]]\nbody = "{body}"\nforce = ["1 N", "0 N", "0 N"]\n'
    _, not_matched = lines(tmp_path, cart + force)
    assert (not_matched == []) == matched


def test_a_load_on_a_robot_with_a_torque_at_each_joint_is_matched(tmp_path) -> None:
    _, not_matched = lines(tmp_path, LEG.format(wrench='force = ["0 N", "0 N", "1 N"]'))
    assert not_matched == []
