"""Parts of a machine in case files, and edits that laws know."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import cases
import numpy as np
import pytest
from cases import case

from grosmc_mj.experiments.experiment import Experiment
from grosmc_mj.experiments.file.reading import parse_case_file
from grosmc_mj.experiments.plants import PlantName
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


def table(kind: str, **keys: Any) -> dict[str, Any]:
    """A table of a part."""
    return {kind: keys}


# A timestep for stiff parts.
STEPS = {"control_period": "1 ms", "timestep": "0.25 ms"}


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


@pytest.mark.parametrize(("system", "tables", "part"), READ)
def test_a_part_is_read_with_its_units(system: str, tables: dict[str, Any], part: Any) -> None:
    path = Path("mine.toml")
    file = parse_case_file(cases.text(system, run=STEPS, **tables), path)
    (edit,) = Experiment.of_file(file, path).edits
    assert type(edit) is type(part)
    # Within the rounding of a unit's conversion.
    expected = {
        name: pytest.approx(value, rel=1e-12) if type(value) is float else value
        for name, value in vars(part).items()
    }
    assert vars(edit) == expected


PARTS: dict[str, Any] = {
    "transmission": {"joint": "shaft", "inertia": "10 g m^2", "backlash": "0.3 deg"},
    "lugre": {"joint": "shaft", "coulomb": "0.05 N m"},
    "motor": {"input": "current", "constant": "7.68 mN m/A", "resistance": "2.6 ohm"},
}


@pytest.mark.parametrize("name", ["corrected", "physics"])
def test_laws_do_not_know_the_parts_of_a_machine(name: PlantName) -> None:
    bare = case("servo", run=STEPS)
    built = case("servo", run=STEPS, **PARTS)
    assert [type(edit) for edit in built.edits] == [Transmission, LuGre, Motor]
    physics: Any = built.plant("physics")
    assert physics.parts == built.edits
    assert built.plant(name).parameters == bare.plant(name).parameters
    laws = [experiment.law(name, "lqr").parameters for experiment in (bare, built)]
    assert laws[0].plant == laws[1].plant
    np.testing.assert_array_equal(laws[0].K, laws[1].K)


def test_a_law_knows_the_known_edits_and_its_plant_has_the_others_too() -> None:
    """An unknown edit comes on top of the known ones."""
    experiment = case(
        "servo",
        run=STEPS,
        edit=[
            {"known": True, "input": "current", "gear": 0.3},
            {"known": False, "joint": "shaft", "damping": 0.1},
            {"known": True, "body": "rotor", "mass_scale": 2},
            {"known": False, "body": "rotor", "mass_scale": 1.5},
        ],
        lugre=PARTS["lugre"],
    )
    assert experiment.edits == (
        JointEdit("shaft", damping=0.1),
        BodyEdit("rotor", 1.5),
        LuGre("shaft", 0.05),
    )
    believed = experiment.law("physics", "lqr").parameters.plant
    assert (believed.Kt, believed.J, believed.B) == pytest.approx((0.3, 2 * 0.0577, 8.8e-3))
    physics: Any = experiment.plant("physics")
    true = physics.analytic().parameters
    assert (true.Kt, true.J, true.B) == pytest.approx((0.3, 3 * 0.0577, 0.1))


# A robot of one joint with a damping of 0.1 N m s/rad, stepped by Euler's method.
HINGE = """
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


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """The robot with a known mass, and with damping and dry friction that its laws do not know."""
    folder = tmp_path_factory.mktemp("hinge")
    (folder / "arm.xml").write_text(HINGE, encoding="utf-8")
    edits = [
        {"known": True, "body": "link", "mass_scale": 2},
        {"joint": "hinge", "damping": 0.5},
    ]
    friction = {"joint": "hinge", "coulomb": "0.05 N m"}
    task = {"reference": ["0.1"], "Q": [1, 1], "R": 1}
    return case("arm.xml", folder=folder, task=task, edit=edits, lugre=friction)


def test_settings_of_a_model_count_where_the_file_has_none(hinge: Experiment) -> None:
    settings = hinge.settings
    # A slow timestep is the control period.
    assert (settings.timestep, settings.control_period) == (0.002, 0.002)
    assert settings.integrator == "Euler"


def test_a_robots_laws_know_its_known_edits_only_and_its_plant_has_all(hinge: Experiment) -> None:
    robot = hinge.nominal.robot
    assert robot is not None
    assert robot.plant.model.body("link").mass[0] == 2
    damping = bias(robot.nominal, [0.0], [1.0]) - bias(robot.nominal, [0.0], [0.0])
    assert damping == pytest.approx(0.1)
    physics: Any = hinge.plant("physics")
    assert physics.model.body("link").mass[0] == 2
    assert physics.model.dof_damping[0] == 0.5
