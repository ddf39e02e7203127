"""Machines in files: what a case file says of each part, what laws know of it, and mistakes."""

from __future__ import annotations

import math
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from case_texts import LUGRE, MOTOR, PARTS_OF, PLAY, TRANSMISSION, load, written

from grosmc_mj.experiments.experiment import Experiment, undesigned
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.experiments.file.shipped import shipped_files
from grosmc_mj.machine import (
    LuGre,
    MachinePart,
    Motor,
    Stop,
    SwingingLoad,
    Transmission,
    Wall,
)
from grosmc_mj.physics.edits import BodyEdit, InputEdit, JointEdit
from grosmc_mj.physics.mujoco_plant import MujocoPlant
from grosmc_mj.robots.dynamics import bias

DEGREE = math.pi / 180


def read(folder: Path, text: str, system: str = "servo") -> Experiment:
    return load(folder, PARTS_OF.format(system) + text)


READ: list[tuple[str, str, MachinePart]] = [
    (
        "servo",
        f"""{TRANSMISSION}
        stiffness = "0.5 kN m/rad"
        damping = "20 mN m s/rad"
        backlash = "0.3 deg"
        friction = "5 mN m"
        added = false
        """,
        Transmission("shaft", 0.01, 500.0, 0.02, 0.3 * DEGREE, 0.005, added=False),
    ),
    (
        "cart_pendulum",
        """
        [[transmission]]
        joint = "slider"
        inertia = "71 g"
        stiffness = "50 N/mm"
        damping = "20 N s/m"
        backlash = "0.1 mm"
        friction = "1 N"
        """,
        Transmission("slider", 0.071, 5e4, 20.0, 1e-4, 1.0),
    ),
    (
        "servo",
        """
        [[stop]]
        joint = "shaft"
        low = "-90 deg"
        high = "2 rad"
        restitution = 0.3
        duration = "10 ms"
        """,
        Stop("shaft", -math.pi / 2, 2.0, 0.3, 0.01),
    ),
    (
        "servo",
        f"""{MOTOR}
        inductance = "0.18 mH"
        ratio = 70
        efficiency = 0.6
        voltage = "24 V"
        current = "4 A"
        inertia = "4 g cm^2"
        cogging = "1 mN m"
        cogging_periods = 24
        thermal_resistance = "5 K/W"
        heat_capacity = "20 J/K"
        added = false
        """,
        Motor(
            "current", 7.68e-3, 2.6, 1.8e-4, 70.0, 0.6, 24.0, 4.0, 0.0, 4e-7, 1e-3, 24.0, 5.0,
            20.0, added=False,
        ),
    ),
    (
        "servo",
        f'{MOTOR}bandwidth = "1 kHz"\n',
        Motor("current", 7.68e-3, 2.6, bandwidth=2e3 * math.pi),
    ),
    (
        # What people call an input, and what the model does.
        "two_link_arm",
        MOTOR.replace('"current"', '"elbow torque"'),
        Motor("elbow_torque", 7.68e-3, 2.6),
    ),
    (
        "servo",
        """
        [[swinging_load]]
        body = "rotor"
        mass = "100 g"
        length = "20 cm"
        damping = "1 mN m s/rad"
        at = ["5 cm", "0 m", "-10 mm"]
        """,
        SwingingLoad("rotor", 0.1, 0.2, 1e-3, (0.05, 0.0, -0.01)),
    ),
    (
        "servo",
        """
        [[wall]]
        body = "rotor"
        radius = "4 cm"
        at = ["20 cm", "0 m", "0 m"]
        point = ["0 m", "0 m", "1 m"]
        normal = [0, 0, -1]
        restitution = 0.2
        duration = "15 ms"
        """,
        Wall("rotor", 0.04, (0.2, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.2, 0.015),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("system", "text", "part"), READ)
def test_a_part_is_read_with_its_units(
    system: str, text: str, part: MachinePart, tmp_path: Path
) -> None:
    path = written(tmp_path, PARTS_OF.format(system) + text)
    (edit,) = undesigned(read_case_file(path), path).case.edits
    assert type(edit) is type(part)
    for item in fields(part):
        value = getattr(part, item.name)
        # Within the rounding of a unit's conversion.
        expected = pytest.approx(value, rel=1e-12) if type(value) is float else value
        assert getattr(edit, item.name) == expected, item.name
    assert str(edit) == str(part)


def test_parts_are_the_plants_and_no_laws(tmp_path: Path) -> None:
    bare, built = read(tmp_path, ""), read(tmp_path, PLAY + LUGRE + MOTOR)
    assert [type(edit) for edit in built.case.edits] == [Transmission, LuGre, Motor]
    physics: Any = built.plant("physics")
    assert physics.parts == built.case.edits
    for name in ("corrected", "physics"):
        twin, same = built.plant(name), bare.plant(name)
        assert twin.parameters == same.parameters
        ours, theirs = built.law(name, "lqr").parameters, bare.law(name, "lqr").parameters
        assert ours.plant == theirs.plant
        np.testing.assert_array_equal(ours.K, theirs.K)


# --- edits that laws know ---

GEAR = '[[edit]]\nknown = {}\ninput = "current"\ngear = 0.3\n'
DAMPING = '[[edit]]\nknown = {}\njoint = "shaft"\ndamping = 0.1\n'
MASS = '[[edit]]\nknown = {}\nbody = "rotor"\nmass_scale = 2\n'


@pytest.mark.parametrize(
    ("edit", "name", "value"),
    [(GEAR, "Kt", 0.3), (DAMPING, "B", 0.1), (MASS, "J", 2 * 0.0577)],
)
def test_a_known_edit_is_what_laws_believe_and_an_unknown_one_is_not(
    edit: str, name: str, value: float, tmp_path: Path
) -> None:
    nominal = read(tmp_path, "")
    before = getattr(nominal.law("physics", "lqr").parameters.plant, name)
    assert before != pytest.approx(value, rel=0.1)
    for known, believed in (("true", value), ("false", before)):
        experiment = read(tmp_path, edit.format(known))
        law = experiment.law("physics", "lqr")
        assert getattr(law.parameters.plant, name) == pytest.approx(believed, rel=1e-12)
        true: Any = experiment.plant("corrected").parameters
        assert getattr(true, name) == pytest.approx(value, rel=1e-12)
    assert len(read(tmp_path, edit.format("true")).case.edits) == 0


def test_a_law_that_knows_one_edit_does_not_know_the_others(tmp_path: Path) -> None:
    text = GEAR.format("true") + DAMPING.format("false") + MASS.format("true") + LUGRE
    experiment = read(tmp_path, text + MASS.format("false").replace("2", "1.5"))
    assert experiment.case.edits == (
        JointEdit("shaft", damping=0.1), BodyEdit("rotor", 1.5), LuGre("shaft", 0.05)
    )  # fmt: skip
    believed = experiment.law("physics", "lqr").parameters.plant
    assert (believed.Kt, believed.J, believed.B) == pytest.approx((0.3, 2 * 0.0577, 8.8e-3))
    physics: Any = experiment.plant("physics")
    true = physics.analytic().parameters
    # What is not known comes on top of what is.
    assert (true.Kt, true.J, true.B) == pytest.approx((0.3, 3 * 0.0577, 0.1))


def test_a_law_that_knows_every_edit_is_near_its_optimum_and_one_that_does_not_is_not(
    tmp_path: Path,
) -> None:
    away = []
    for known in ("true", "false"):
        run = read(tmp_path, GEAR.format(known) + DAMPING.format(known)).run("physics", "lqr")
        away.append(float(np.abs(run.comparison.deviation).max()))
    # What is left is a hold of 1 ms: 1 % of what the law does in 20 ms.
    assert 0 < away[0] < 0.05 * away[1]


def test_edits_of_inputs_and_tilts_reach_the_model(tmp_path: Path) -> None:
    experiment = read(tmp_path, GEAR.format("false"))
    assert experiment.case.edits == (InputEdit("current", 0.3),)
    physics: Any = experiment.plant("physics")
    assert physics.model.actuator_gear[0, 0] == 0.3
    text = '[[edit]]\nknown = {}\njoint = "shoulder"\ntilt = "5 deg"\n'
    path = written(tmp_path, PARTS_OF.format("two_link_arm") + text.format("false"))
    tilted = undesigned(read_case_file(path), path)
    (edit,) = tilted.case.edits
    assert isinstance(edit, JointEdit)
    assert (edit.joint, edit.tilt) == ("shoulder", pytest.approx(5 * DEGREE))
    leaning: Any = tilted.plant("physics")
    upright = MujocoPlant.load("two_link_arm").model
    cosine = leaning.model.jnt_axis[0] @ upright.jnt_axis[0]
    assert cosine == pytest.approx(math.cos(5 * DEGREE))


ROBOT = """<mujoco model="arm"><option timestep="0.001" integrator="RK4"/><worldbody><body name="a">
<joint name="hinge" axis="0 1 0" damping="0.1"/>
<geom type="capsule" size="0.05" fromto="0 0 0 0 0 0.5" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""


def test_a_robots_known_edits_are_in_the_dynamics_of_its_laws(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(ROBOT, encoding="utf-8")
    text = (
        '[plant]\nmodel = "arm.xml"\n[run]\nduration = "20 ms"\n[[controller]]\nlaw = "lqr"\n'
        '[task]\nreference = ["0.1"]\nQ = [1, 1]\nR = 1\n'
        '[[edit]]\nknown = true\nbody = "a"\nmass_scale = 2\n'
        '[[edit]]\njoint = "hinge"\ndamping = 0.5\n'
        '[[lugre]]\njoint = "hinge"\ncoulomb = "0.05 N m"\n'
    )
    experiment = load(tmp_path, text)
    robot = experiment.nominal.robot
    assert robot is not None
    assert robot.plant.model.body("a").mass[0] == 2
    # What it believes of damping is the model's.
    assert bias(robot.nominal, [0.0], [1.0]) - bias(robot.nominal, [0.0], [0.0]) == pytest.approx(
        0.1
    )
    physics: Any = experiment.plant("physics")
    assert physics.model.body("a").mass[0] == 2
    assert physics.model.dof_damping[0] == 0.5
    assert len(physics.parts) == 1


# --- the machines of the package ---

MACHINES = [name for name in shipped_files() if name.endswith("/machine")]


@pytest.mark.slow
@pytest.mark.parametrize("target", MACHINES)
def test_a_shipped_machine_moves_alike_in_both_engines(target: str) -> None:
    experiment = Experiment.load(target)
    short = experiment.varied(duration=0.2)
    parts = [edit for edit in short.case.edits if isinstance(edit, MachinePart)]
    assert parts
    runs = [
        short.with_settings(engine=engine).run("physics", experiment.controllers[0]).trajectory
        for engine in ("native", "python")
    ]
    ours, theirs = runs
    assert ours.physics is not None
    assert theirs.physics is not None
    assert ours.time[-1] == pytest.approx(0.2)
    np.testing.assert_array_equal(ours.physics, theirs.physics)
    np.testing.assert_array_equal(ours.input, theirs.input)
    np.testing.assert_array_equal(ours.command, theirs.command)
    # It is no rigid plant that was run.
    physics: Any = experiment.plant("physics")
    assert physics.model.nv > len(experiment.nominal.system.joints)
