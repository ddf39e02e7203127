"""Parts of a machine in case files, and edits that laws know."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from case_texts import LUGRE, MOTOR, PARTS_OF, PLAY, load, written

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.mechanics.machine import (
    DriveFriction,
    LuGre,
    Motor,
    Stop,
    Transmission,
    Wall,
)
from grosmc_mj.mechanics.physics.edits import BodyEdit, InputEdit, JointEdit
from grosmc_mj.mechanics.robots.nominal import bias

DEGREE = math.pi / 180


def read(folder: Path, text: str) -> Experiment:
    """The experiment of parts of a servo."""
    return load(folder, PARTS_OF.format("servo") + text)


def table(kind: str, **keys: Any) -> str:
    """A table of a case file."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    return "\n".join([f"[[{kind}]]", *lines, ""])


READ = [
    (
        "servo",
        table(
            "transmission",
            joint="shaft",
            inertia="10 g m^2",
            stiffness="0.5 kN m/rad",
            damping="20 mN m s/rad",
            backlash="0.3 deg",
            friction="5 mN m",
            added=False,
        ),
        Transmission(
            "shaft",
            inertia=0.01,
            stiffness=500.0,
            damping=0.02,
            backlash=0.3 * DEGREE,
            friction=0.005,
            added=False,
        ),
    ),
    (
        "cart_pendulum",
        table(
            "transmission",
            joint="slider",
            inertia="71 g",
            stiffness="50 N/mm",
            backlash="0.1 mm",
        ),
        Transmission("slider", inertia=0.071, stiffness=5e4, backlash=1e-4),
    ),
    (
        "servo",
        table(
            "stop",
            joint="shaft",
            low="-90 deg",
            high="2 rad",
            restitution=0.3,
            duration="10 ms",
        ),
        Stop("shaft", low=-math.pi / 2, high=2.0, restitution=0.3, duration=0.01),
    ),
    (
        "servo",
        table(
            "drive_friction",
            joint="shaft",
            coulomb="20 mN m",
            viscous="50 mN m s/rad",
            load_motor=0.2,
            load_external=0.02,
            stribeck_force="0.12 N m",
            stribeck_motor=0.19,
            stribeck_external=0.09,
            quadratic_motor="0.01 N^-1 m^-1",
            quadratic_external="7e-5 N^-1 m^-1",
            stribeck_speed="100 deg/s",
            stribeck_exponent=1.14,
            assumed=["coulomb", "stribeck_exponent"],
        ),
        DriveFriction(
            "shaft",
            coulomb=0.02,
            viscous=0.05,
            load_motor=0.2,
            load_external=0.02,
            stribeck_force=0.12,
            stribeck_motor=0.19,
            stribeck_external=0.09,
            quadratic_motor=0.01,
            quadratic_external=7e-5,
            stribeck_speed=100 * DEGREE,
            stribeck_exponent=1.14,
        ),
    ),
    (
        "cart_pendulum",
        table(
            "drive_friction",
            joint="slider",
            coulomb="2 N",
            quadratic_motor="0.01 N^-1",
            stribeck_speed="2 cm/s",
        ),
        DriveFriction("slider", coulomb=2.0, quadratic_motor=0.01, stribeck_speed=0.02),
    ),
    (
        "servo",
        table(
            "motor",
            input="current",
            constant="7.68 mN m/A",
            resistance="2.6 ohm",
            inductance="0.18 mH",
            ratio=70,
            efficiency=0.6,
            voltage="24 V",
            current="4 A",
            inertia="4 g cm^2",
            cogging="1 mN m",
            cogging_periods=24,
            thermal_resistance="5 K/W",
            heat_capacity="20 J/K",
            added=False,
        ),
        Motor(
            "current",
            constant=7.68e-3,
            resistance=2.6,
            inductance=1.8e-4,
            ratio=70.0,
            efficiency=0.6,
            voltage=24.0,
            current=4.0,
            inertia=4e-7,
            cogging=1e-3,
            cogging_periods=24.0,
            thermal_resistance=5.0,
            heat_capacity=20.0,
            added=False,
        ),
    ),
    (
        # An input by its name in words; the model has another name.
        "two_link_arm",
        table(
            "motor",
            input="elbow torque",
            constant="7.68 mN m/A",
            resistance="2.6 ohm",
            bandwidth="1 kHz",
        ),
        Motor("elbow_torque", constant=7.68e-3, resistance=2.6, bandwidth=2e3 * math.pi),
    ),
    (
        "servo",
        table(
            "wall",
            body="rotor",
            radius="4 cm",
            at=["20 cm", "0 m", "0 m"],
            point=["0 m", "0 m", "1 m"],
            normal=[0, 0, -1],
            restitution=0.2,
            duration="15 ms",
        ),
        Wall(
            "rotor",
            radius=0.04,
            at=(0.2, 0.0, 0.0),
            point=(0.0, 0.0, 1.0),
            normal=(0.0, 0.0, -1.0),
            restitution=0.2,
            duration=0.015,
        ),
    ),
    (
        "servo",
        table("edit", input="current", gear=0.3),
        InputEdit("current", 0.3),
    ),
]


@pytest.mark.parametrize(("system", "text", "part"), READ)
def test_a_part_is_read_with_its_units(system, text, part, tmp_path) -> None:
    path = written(tmp_path, PARTS_OF.format(system) + text)
    (edit,) = Experiment.of_file(read_case_file(path), path).edits
    assert type(edit) is type(part)
    for item in fields(part):
        expected = getattr(part, item.name)
        if type(expected) is float:
            # Within the rounding of a unit's conversion.
            expected = pytest.approx(expected, rel=1e-12)
        assert getattr(edit, item.name) == expected, item.name


def test_parts_of_a_file_are_those_of_its_plant(tmp_path) -> None:
    built = read(tmp_path, PLAY + LUGRE + MOTOR)
    assert [type(edit) for edit in built.edits] == [Transmission, LuGre, Motor]
    physics: Any = built.plant("physics")
    assert physics.parts == built.edits


@pytest.mark.parametrize("plant", ["corrected", "physics"])
def test_laws_do_not_know_the_parts_of_a_machine(tmp_path, plant) -> None:
    bare = read(tmp_path, "")
    built = read(tmp_path, PLAY + LUGRE + MOTOR)
    assert built.plant(plant).parameters == bare.plant(plant).parameters
    bare_law = bare.law(plant, "lqr").parameters
    built_law = built.law(plant, "lqr").parameters
    assert built_law.plant == bare_law.plant
    np.testing.assert_array_equal(built_law.K, bare_law.K)


KNOWN_AND_UNKNOWN = """
[[edit]]
known = true
input = "current"
gear = 0.3
[[edit]]
known = false
joint = "shaft"
damping = 0.1
[[edit]]
known = true
body = "rotor"
mass_scale = 2
[[lugre]]
joint = "shaft"
coulomb = "0.05 N m"
[[edit]]
known = false
body = "rotor"
mass_scale = 1.5
"""


def test_unknown_edits_are_the_cases(tmp_path) -> None:
    assert read(tmp_path, KNOWN_AND_UNKNOWN).edits == (
        JointEdit("shaft", damping=0.1),
        BodyEdit("rotor", 1.5),
        LuGre("shaft", 0.05),
    )


def test_a_law_knows_the_known_edits_only(tmp_path) -> None:
    experiment = read(tmp_path, KNOWN_AND_UNKNOWN)
    believed = experiment.law("physics", "lqr").parameters.plant
    assert (believed.Kt, believed.J, believed.B) == pytest.approx((0.3, 2 * 0.0577, 8.8e-3))


def test_an_unknown_edit_comes_on_top_of_the_known_ones(tmp_path) -> None:
    physics: Any = read(tmp_path, KNOWN_AND_UNKNOWN).plant("physics")
    true = physics.analytic().parameters
    assert (true.Kt, true.J, true.B) == pytest.approx((0.3, 3 * 0.0577, 0.1))


HINGE_MODEL = """
<mujoco>
  <option timestep="0.002"><flag contact="disable"/></option>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 -1 0" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
</mujoco>
"""
HINGE = """
[plant]
model = "arm.xml"
[run]
duration = "20 ms"
[[controller]]
law = "lqr"
[task]
reference = ["0.1"]
Q = [1, 1]
R = 1
[[edit]]
known = true
body = "link"
mass_scale = 2
[[edit]]
joint = "hinge"
damping = 0.5
[[lugre]]
joint = "hinge"
coulomb = "0.05 N m"
"""


@pytest.fixture
def hinge(tmp_path: Path) -> Experiment:
    """A robot of one joint with a damping of 0.1 N m s/rad, stepped by Euler's method."""
    (tmp_path / "arm.xml").write_text(HINGE_MODEL, encoding="utf-8")
    return load(tmp_path, HINGE)


def test_settings_of_a_model_count_where_the_file_has_none(hinge: Experiment) -> None:
    assert hinge.settings.timestep == 0.002
    # A slow timestep is the control period.
    assert hinge.settings.control_period == 0.002
    assert hinge.settings.integrator == "Euler"


def test_a_robots_known_edits_are_in_the_dynamics_of_its_laws(hinge: Experiment) -> None:
    robot = hinge.nominal.robot
    assert robot is not None
    assert robot.plant.model.body("link").mass[0] == 2


def test_a_robots_laws_believe_in_the_models_damping(hinge: Experiment) -> None:
    robot = hinge.nominal.robot
    assert robot is not None
    damping = bias(robot.nominal, [0.0], [1.0]) - bias(robot.nominal, [0.0], [0.0])
    assert damping == pytest.approx(0.1)


def test_a_robots_plant_has_all_edits(hinge: Experiment) -> None:
    physics: Any = hinge.plant("physics")
    assert physics.model.body("link").mass[0] == 2
    assert physics.model.dof_damping[0] == 0.5
