"""Notes on loads: wrenches that move no joint, and loads that no input matches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from cases import case
from mjcf import TREE
from own_files import LEG

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
PYTHON = {"engine": "python"}


def motor(folder: Path, law: str = "lqr", **tables: Any) -> Experiment:
    """The motor under a law."""
    (folder / "own.py").write_text(MOTOR, encoding="utf-8")
    task = {"Q": [100, 1, 1], "R": 1}
    return case("own:motor", law=law, folder=folder, **({"run": PYTHON, "task": task} | tables))


def leg(folder: Path, *loads: dict[str, Any]) -> Experiment:
    """A robot of two joints in a vertical plane."""
    (folder / "leg.xml").write_text(LEG, encoding="utf-8")
    return case(
        "leg.xml",
        folder=folder,
        run={"start": {"hip": "10 deg"}} | PYTHON,
        task={"Q": {"hip": 100, "knee": 100}, "R": 1},
        disturbance=list(loads),
    )


def servo(load: dict[str, Any], plant: str = "physics", law: str = "lqr", **more: Any) -> Any:
    """The servo under a load."""
    run = {"start": {"rotor angle": "0.1 rad"}} | PYTHON
    return case("servo", law=law, plant={"compare": [plant]}, run=run, disturbance=load, **more)


def idle_and_unmatched(experiment: Experiment) -> tuple[list[str], list[str]]:
    """Notes on loads that move no joint, and on those that no input matches."""
    runs = list(experiment.runs())
    return idle_loads(runs), unmatched(experiment, runs)


def torque(x: float = 0, y: float = 0, z: float = 0, body: str = "rotor") -> dict[str, Any]:
    return {"body": body, "torque": [f"{x} N m", f"{y} N m", f"{z} N m"]}


def force(x: float = 0, y: float = 0, z: float = 0, body: str = "shank") -> dict[str, Any]:
    return {"body": body, "force": [f"{x} N", f"{y} N", f"{z} N"]}


TRANSMISSION = {
    "transmission": {"joint": "shaft", "inertia": "2e-3 kg m^2", "stiffness": "100 N m/rad"}
}
NOTHING = "the torque about z on rotor moves no joint: the disturbance does nothing"
PART = "the torque about z on rotor moves no joint: the rest of the disturbance acts"


@pytest.mark.parametrize("machine", [{}, TRANSMISSION], ids=["rigid", "machine"])
@pytest.mark.parametrize("plant", ["corrected", "physics"])
@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (torque(y=0.1), []),
        (torque(z=0.1), [NOTHING]),
        (torque(y=0.1, z=0.1), [PART]),
        (torque(), []),
    ],
)
def test_a_torque_across_the_axis_of_the_rotor_moves_no_joint(
    plant, machine, load, expected
) -> None:
    idle, _ = idle_and_unmatched(servo(load, plant, **machine))
    assert idle == expected


@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (force(z=1), []),
        (
            force(y=1),
            ["the force along y on shank moves no joint: the disturbance does nothing"],
        ),
        (
            torque(x=1, z=1, body="shank"),
            [
                "the torque about x and the torque about z on shank move no joint: the "
                "disturbance does nothing"
            ],
        ),
    ],
)
def test_a_wrench_out_of_the_plane_of_a_robot_moves_no_joint(tmp_path, load, expected) -> None:
    """With a torque at each joint every load is matched."""
    assert idle_and_unmatched(leg(tmp_path, load)) == (expected, [])


def test_a_pulse_after_the_run_is_no_load_of_it() -> None:
    pulse = {"profile": "pulse", "start": "5 s", "stop": "6 s"}
    assert idle_and_unmatched(servo(torque(z=0.1) | pulse)) == ([], [])


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
    # They stay when those of another state are asked for.
    joint_axes(plant, np.zeros(6))
    np.testing.assert_allclose(axes["turn"], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(axes["lift"], [np.sin(turn), -np.cos(turn), 0], atol=1e-12)


ON_SPEED = {"state": "speed", "amplitude": "4 rad/s^2"}
ON_VOLTAGE = {"input": "voltage", "amplitude": "1 V"}


@pytest.mark.parametrize("law", ["lqr", "fl-lqr"])
@pytest.mark.parametrize(
    ("load", "expected"),
    [
        (
            ON_SPEED,
            [
                "the load on speed is unmatched: no switching term rejects it (up to 4 rad/s^2 in "
                "z' where no input acts)"
            ],
        ),
        ({"state": "current", "amplitude": "4 A/s"}, []),
        (ON_VOLTAGE, []),
    ],
)
def test_a_load_of_a_plant_of_ones_own_is_matched_where_its_input_acts(
    tmp_path, law, load, expected
) -> None:
    assert idle_and_unmatched(motor(tmp_path, law, disturbance=load)) == ([], expected)


@pytest.mark.parametrize(
    ("law", "plant"), [("grosmc", "corrected"), ("grosmc", "physics"), ("lqr", "physics")]
)
def test_a_disturbance_of_an_input_is_matched_on_every_plant(law: str, plant: str) -> None:
    load = {"input": "current", "amplitude": "1 A"}
    assert idle_and_unmatched(servo(load, plant, law)) == ([], [])


def test_a_disturbance_of_a_robot_s_input_is_matched(tmp_path) -> None:
    load = {"input": "hip", "amplitude": "1 N m"}
    assert idle_and_unmatched(leg(tmp_path, force(), load)) == ([], [])


@pytest.mark.parametrize(("load", "holds"), [(ON_SPEED, False), (ON_VOLTAGE, True)])
def test_a_load_where_no_input_acts_breaks_the_premise_of_matching(tmp_path, load, holds) -> None:
    audit = run_audit(motor(tmp_path, "fl-lqr", disturbance=load).run())
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
    edit = {"parameter": parameter, "scale": 1.1}
    run = {"start": {"current": "1 A"}} | PYTHON
    _, not_matched = idle_and_unmatched(motor(tmp_path, "fl-lqr", run=run, edit=edit))
    change = "the difference of the plant from the one that laws know is unmatched"
    assert [line.partition(":")[0] for line in not_matched] == [change] * (not matched)


HELD = """
import sympy as sp
import grosmc_mj as gm
a, b, k = sp.symbols("a b k")
def held():
    return gm.affine_plant(
        "held", states={"a": "m", "b": "m"}, inputs={"u": "m/s"}, f=[-2 * a, -b], g=[k, 1],
        h=[b], parameters={"k": 1},
    )
"""


def test_the_input_that_holds_a_plant_acts_once_in_what_is_unmatched(tmp_path: Path) -> None:
    """By hand: u = 2 m/s acts along (1.5, 1) for (1, 1); of (1, 0) m/s 0.46 m/s are beside it."""
    (tmp_path / "own.py").write_text(HELD, encoding="utf-8")
    experiment = case(
        "own:held",
        folder=tmp_path,
        plant={"at": {"b": "2 m"}},
        run=PYTHON,
        task={"Q": [1, 1], "R": 1e6},
        edit={"parameter": "k", "scale": 1.5},
    )
    _, (line,) = idle_and_unmatched(experiment)
    assert "(up to 0.46" in line


UNMATCHED = "the load on pole is unmatched for cart-ism: no switching term rejects it"


@pytest.mark.parametrize(("body", "told"), [("pole", [UNMATCHED]), ("cart", [])])
def test_a_force_on_the_pole_is_matched_for_its_angle_and_not_for_all_states(
    body: str, told: list[str]
) -> None:
    experiment = case(
        "cart_pendulum",
        plant={"compare": ["physics"]},
        run={"start": {"pole angle": "2 deg"}} | PYTHON,
        controller=[{"law": "grosmc"}, {"law": "cart-ism"}],
        disturbance=force(x=1, body=body),
    )
    _, not_matched = idle_and_unmatched(experiment)
    assert [line.partition(" (up to")[0] for line in not_matched] == told
