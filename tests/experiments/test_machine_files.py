"""Machines in files: the parts of a case file, and the knowledge that laws have of them."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from case_texts import LUGRE, MOTOR, PARTS_OF, PLAY, load, written
from mjcf import ONE

from grosmc_mj.experiments.experiment import Experiment, undesigned
from grosmc_mj.experiments.file.reading import read_case_file
from grosmc_mj.machine import LuGre, Motor, Stop, SwingingLoad, Transmission, Wall
from grosmc_mj.physics.edits import BodyEdit, InputEdit, JointEdit
from grosmc_mj.robots.dynamics import bias

DEGREE = math.pi / 180


def read(folder: Any, text: str, system: str = "servo") -> Experiment:
    return load(folder, PARTS_OF.format(system) + text)


def table(kind: str, **keys: Any) -> str:
    """A table of a case file."""
    lines = (f"{key} = {json.dumps(value)}\n" for key, value in keys.items())
    return f"[[{kind}]]\n{''.join(lines)}"


MOTOR_OF = {"input": "current", "constant": "7.68 mN m/A", "resistance": "2.6 ohm"}
READ = [
    (
        "servo",
        table("transmission", joint="shaft", inertia="10 g m^2", stiffness="0.5 kN m/rad",
              damping="20 mN m s/rad", backlash="0.3 deg", friction="5 mN m", added=False),
        Transmission("shaft", 0.01, 500.0, 0.02, 0.3 * DEGREE, 0.005, added=False),
    ),
    (
        "cart_pendulum",
        table("transmission", joint="slider", inertia="71 g", stiffness="50 N/mm",
              backlash="0.1 mm"),
        Transmission("slider", 0.071, 5e4, backlash=1e-4),
    ),
    (
        "servo",
        table("stop", joint="shaft", low="-90 deg", high="2 rad", restitution=0.3,
              duration="10 ms"),
        Stop("shaft", -math.pi / 2, 2.0, 0.3, 0.01),
    ),
    (
        "servo",
        table("motor", **MOTOR_OF, inductance="0.18 mH", ratio=70, efficiency=0.6, voltage="24 V",
              current="4 A", inertia="4 g cm^2", cogging="1 mN m", cogging_periods=24,
              thermal_resistance="5 K/W", heat_capacity="20 J/K", added=False),
        Motor("current", 7.68e-3, 2.6, 1.8e-4, 70.0, 0.6, 24.0, 4.0, 0.0, 4e-7, 1e-3, 24.0, 5.0,
              20.0, added=False),
    ),
    (
        # An input by its name in words, where the model has another.
        "two_link_arm",
        table("motor", **{**MOTOR_OF, "input": "elbow torque"}, bandwidth="1 kHz"),
        Motor("elbow_torque", 7.68e-3, 2.6, bandwidth=2e3 * math.pi),
    ),
    (
        "servo",
        table("swinging_load", body="rotor", mass="100 g", length="20 cm",
              damping="1 mN m s/rad", at=["5 cm", "0 m", "-10 mm"]),
        SwingingLoad("rotor", 0.1, 0.2, 1e-3, (0.05, 0.0, -0.01)),
    ),
    (
        "servo",
        table("wall", body="rotor", radius="4 cm", at=["20 cm", "0 m", "0 m"],
              point=["0 m", "0 m", "1 m"], normal=[0, 0, -1], restitution=0.2, duration="15 ms"),
        Wall("rotor", 0.04, (0.2, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), 0.2, 0.015),
    ),
    ("servo", table("edit", input="current", gear=0.3), InputEdit("current", 0.3)),
    (
        "two_link_arm", table("edit", joint="shoulder", tilt="5 deg"),
        JointEdit("shoulder", tilt=5 * DEGREE),
    ),
]  # fmt: skip


@pytest.mark.parametrize(("system", "text", "part"), READ)
def test_a_part_is_read_with_its_units(system, text, part, tmp_path) -> None:
    path = written(tmp_path, PARTS_OF.format(system) + text)
    (edit,) = undesigned(read_case_file(path), path).case.edits
    assert type(edit) is type(part)
    for item in fields(part):
        value = getattr(part, item.name)
        # Within the rounding of a unit's conversion.
        expected = pytest.approx(value, rel=1e-12) if type(value) is float else value
        assert getattr(edit, item.name) == expected, item.name


def test_parts_are_the_plants_and_no_laws(tmp_path) -> None:
    bare, built = read(tmp_path, ""), read(tmp_path, PLAY + LUGRE + MOTOR)
    assert [type(edit) for edit in built.case.edits] == [Transmission, LuGre, Motor]
    physics: Any = built.plant("physics")
    assert physics.parts == built.case.edits
    for name in ("corrected", "physics"):
        assert built.plant(name).parameters == bare.plant(name).parameters
        ours, theirs = built.law(name, "lqr").parameters, bare.law(name, "lqr").parameters
        assert ours.plant == theirs.plant
        np.testing.assert_array_equal(ours.K, theirs.K)


# Edits that laws know

GEAR = '[[edit]]\nknown = {}\ninput = "current"\ngear = 0.3\n'
DAMPING = '[[edit]]\nknown = {}\njoint = "shaft"\ndamping = 0.1\n'
MASS = '[[edit]]\nknown = {}\nbody = "rotor"\nmass_scale = 2\n'


def test_a_law_that_knows_one_edit_does_not_know_the_others(tmp_path) -> None:
    text = GEAR.format("true") + DAMPING.format("false") + MASS.format("true") + LUGRE
    experiment = read(tmp_path, text + MASS.format("false").replace("2", "1.5"))
    assert experiment.case.edits == (
        JointEdit("shaft", damping=0.1), BodyEdit("rotor", 1.5), LuGre("shaft", 0.05)
    )  # fmt: skip
    believed = experiment.law("physics", "lqr").parameters.plant
    assert (believed.Kt, believed.J, believed.B) == pytest.approx((0.3, 2 * 0.0577, 8.8e-3))
    physics: Any = experiment.plant("physics")
    true = physics.analytic().parameters
    # An unknown edit comes on top of the known ones.
    assert (true.Kt, true.J, true.B) == pytest.approx((0.3, 3 * 0.0577, 0.1))


def test_a_robots_known_edits_are_in_the_dynamics_of_its_laws(tmp_path) -> None:
    motor = '<motor name="motor" joint="hinge"/>'
    euler = ONE.replace('timestep="0.001" integrator="RK4"', 'timestep="0.002"')
    (tmp_path / "arm.xml").write_text(euler.format("", motor), encoding="utf-8")
    experiment = load(
        tmp_path,
        '[plant]\nmodel = "arm.xml"\n[run]\nduration = "20 ms"\n[[controller]]\nlaw = "lqr"\n'
        '[task]\nreference = ["0.1"]\nQ = [1, 1]\nR = 1\n'
        '[[edit]]\nknown = true\nbody = "link"\nmass_scale = 2\n'
        f'[[edit]]\njoint = "hinge"\ndamping = 0.5\n{LUGRE.replace("shaft", "hinge")}',
    )
    # A slow timestep is the control period.
    settings = experiment.settings
    assert (settings.timestep, settings.control_period) == (0.002, 0.002)
    assert settings.integrator == "Euler"
    robot, physics = experiment.nominal.robot, experiment.plant("physics")
    assert robot is not None
    assert robot.plant.model.body("link").mass[0] == 2
    # It believes in the model's damping.
    damping = bias(robot.nominal, [0.0], [1.0]) - bias(robot.nominal, [0.0], [0.0])
    assert damping == pytest.approx(0.1)
    model: Any = physics.model
    assert (model.body("link").mass[0], model.dof_damping[0]) == (2, 0.5)
